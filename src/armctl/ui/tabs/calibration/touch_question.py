"""What is worked out of touched points, beside the event loop: errors, the fit, and which touch is next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.calibration import (
    LEAST_POINTS,
    Aim,
    Touches,
    TouchFit,
    TouchSheet,
    fit_touches,
    next_touch,
    reachable,
    reachable_at,
    touch_errors,
)
from armctl.errors import ArmctlError
from armctl.lazy_dataclass import dataclass
from armctl.motion.one_sided import OneSided
from armctl.robot import Robot

LEAST_PLACED, _LEAST_TOLD = 3, 4
"""touches by which it is known where a sheet lies; and by which each is judged by the others"""


@dataclass(frozen=True, slots=True, eq=False)
class NextTouch:
    """The crosshair that tells most."""

    number: int
    """from 1"""
    height_m: float
    """0 on the paper, else on the block that stands on the crosshair [m]"""
    q: FloatArray
    """(n,) a configuration with the tool there [rad]"""
    side: OneSided = "end-plus"
    """how the joints are to come to it: play shows where they came from both sides"""


@dataclass(frozen=True, slots=True, eq=False)
class TouchAnswer:
    """What was worked out of some touches."""

    errors_m: FloatArray | None = None
    """(k,) by how much each is missed by the numbers in force [m]; None: not known yet"""
    result: TouchFit | str | None = None
    possible: Touches | None = None
    following: NextTouch | None = None
    aim: Aim | None = None
    """how the arm comes near to a point, by these touches; None: too few"""


@dataclass(frozen=True, slots=True, eq=False)
class TouchQuestion:
    """What is worked out beside the event loop."""

    robot: Robot
    touches: Touches
    load_kg: float
    sheet: TouchSheet | None
    block_m: float
    skipped: frozenset[int]
    possible: Touches | None

    def answer(self) -> TouchAnswer:
        """May take a second or two."""
        errors: FloatArray | None = None
        result: TouchFit | str | None = None
        if len(self.touches) >= (1 if self.touches.frame == "base" else _LEAST_TOLD):
            missed = touch_errors(self.robot, self.touches, load_kg=self.load_kg)
            errors = np.linalg.norm(missed, axis=1)
        if len(self.touches) >= LEAST_POINTS:
            one = self.touches
            try:
                checked = Touches.checked(
                    self.robot, one.q, one.points_m, one.frame, one.sense, one.commanded
                )
                result = fit_touches(self.robot, checked, load_kg=self.load_kg)
            except ArmctlError as error:
                result = str(error)
        placed = len(self.touches) >= LEAST_PLACED
        aim = Aim.of(self.robot, self.touches, load_kg=self.load_kg) if placed else None
        return TouchAnswer(errors, result, *self._next(), aim)

    def _next(self) -> tuple[Touches | None, NextTouch | None]:
        sheet, placed = self.sheet, len(self.touches) >= LEAST_PLACED
        if sheet is None:
            return None, None
        possible = self.possible
        if possible is None and placed:
            points = _with_block(sheet.points_m, self.block_m)
            possible = reachable(self.robot, self.touches, points, load_kg=self.load_kg)
        elif possible is None:
            points, laid = (_with_block(one, self.block_m) for one in (sheet.points_m, sheet.laid_m))
            possible = reachable_at(self.robot, points, laid, "sheet")
        numbers = crosshair_numbers(sheet, possible)
        # the one that was touched last, again at once, looks like a mistake
        last = crosshair_numbers(sheet, self.touches)[-1:].tolist()
        left = np.flatnonzero(~np.isin(numbers, [*self.skipped, *last]))
        if not len(left):
            return possible, None
        if placed:
            some = possible.only(left)
            best = left[next_touch(self.robot, self.touches, some, load_kg=self.load_kg)]
        else:  # far from those before
            done = np.vstack([self.touches.points_m, np.zeros((1, 3))])
            apart = np.linalg.norm(possible.points_m[left][:, None] - done[None], axis=2)
            best = left[np.argmax(apart.min(axis=1))]
        height = float(possible.points_m[best][2] - sheet.points_m[numbers[best] - 1][2])
        side: OneSided = "end-plus" if possible.senses[best][0] > 0 else "end-minus"
        return possible, NextTouch(int(numbers[best]), height, possible.q[best], side)


def _with_block(points_m: FloatArray, block_m: float) -> FloatArray:
    """Points (k, 3), and those on a block that stands on them [m]; without one the points alone."""
    return np.vstack([points_m, points_m + np.array((0.0, 0.0, block_m))]) if block_m else points_m


def crosshair_numbers(sheet: TouchSheet, touches: Touches) -> NDArray[np.intp]:
    """(k,) which crosshair each of some touches is, from 1."""
    away = np.linalg.norm(touches.points_m[:, None, :2] - sheet.points_m[None, :, :2], axis=2)
    return 1 + np.argmin(away, axis=1)

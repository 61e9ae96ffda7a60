"""Points that the tool touched, what they say of the arm, and which to touch next. All pages share them."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.calibration import (
    LEAST_POINTS,
    Frame,
    Paper,
    Touches,
    TouchFit,
    TouchSheet,
    changes,
    fit_touches,
    next_touch,
    own_map,
    reachable,
    reachable_at,
    suggestion,
    touch_errors,
    touch_sheet,
    touches_csv,
)
from armctl.errors import ArmctlError, InputError, StateError
from armctl.facts.angles import DEGREE
from armctl.facts.causes import FitFigures
from armctl.protocol import Snapshot
from armctl.robot import Robot

_FARTHEST_M = 10.0
_LEAST_PLACED, _LEAST_TOLD = 3, 4
"""touches by which it is known where a sheet lies; and by which each is judged by the others"""
_TURNED = 0.2 * DEGREE
"""a joint that went back by less has not turned round"""
WorkOut = Callable[..., Awaitable[Any]]
"""calls a function with arguments on a thread, as ``asyncio.to_thread`` does"""


@dataclass(frozen=True, slots=True)
class TouchedPoint:
    """The tool stood on a point."""

    outputs: Mapping[int, float]
    """by channel, in the board's unit: they stay true when the calibration changes"""
    point_m: tuple[float, float, float]
    """in the frame of all points [m]"""
    number: int | None = None
    """of the crosshair, from 1; None: a place in the base frame"""
    sense: tuple[float, ...] = ()
    """(n,) in which sense each joint turned last: 1, -1, 0 not known; empty: nobody knows"""
    measured: bool = False
    """``outputs`` are what encoders read; else they are setpoints"""
    sent: Mapping[int, float] | None = None
    """the setpoints beside what encoders read; None: there are none, as where the arm is led by hand"""


@dataclass(frozen=True, slots=True, eq=False)
class NextTouch:
    """The crosshair that tells most."""

    number: int
    """from 1"""
    height_m: float
    """0 on the paper, else on the block that stands on the crosshair [m]"""
    q: FloatArray
    """(n,) a configuration with the tool there [rad]"""


@dataclass(frozen=True, slots=True, eq=False)
class _TouchAnswer:
    """What was worked out of some touches."""

    errors_m: FloatArray | None = None
    """(k,) by how much each is missed by the numbers in force [m]; None: not known yet"""
    result: TouchFit | str | None = None
    possible: Touches | None = None
    following: NextTouch | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _TouchQuestion:
    """What is worked out beside the event loop."""

    robot: Robot
    touches: Touches
    sheet: TouchSheet | None
    block_m: float
    skipped: frozenset[int]
    possible: Touches | None

    def answer(self) -> _TouchAnswer:
        """May take a second or two."""
        errors: FloatArray | None = None
        result: TouchFit | str | None = None
        if len(self.touches) >= (1 if self.touches.frame == "base" else _LEAST_TOLD):
            errors = np.linalg.norm(touch_errors(self.robot, self.touches), axis=1)
        if len(self.touches) >= LEAST_POINTS:
            one = self.touches
            try:
                checked = Touches.checked(
                    self.robot, one.q, one.points_m, one.frame, one.sense, one.commanded
                )
                result = fit_touches(self.robot, checked)
            except ArmctlError as error:
                result = str(error)
        return _TouchAnswer(errors, result, *self._next())

    def _next(self) -> tuple[Touches | None, NextTouch | None]:
        sheet, placed = self.sheet, len(self.touches) >= _LEAST_PLACED
        if sheet is None:
            return None, None
        possible = self.possible
        if possible is None and placed:
            possible = reachable(self.robot, self.touches, _with_block(sheet.points_m, self.block_m))
        elif possible is None:
            points, laid = (_with_block(one, self.block_m) for one in (sheet.points_m, sheet.laid_m))
            possible = reachable_at(self.robot, points, laid, "sheet")
        numbers = _numbers(sheet, possible)
        last = _numbers(sheet, self.touches)[-1:].tolist()  # the same again at once looks like a mistake
        left = np.flatnonzero(~np.isin(numbers, [*self.skipped, *last]))
        if not len(left):
            return possible, None
        if placed:
            best = left[next_touch(self.robot, self.touches, possible.only(left))]
        else:  # far from those before
            done = np.vstack([self.touches.points_m, np.zeros((1, 3))])
            apart = np.linalg.norm(possible.points_m[left][:, None] - done[None], axis=2)
            best = left[np.argmax(apart.min(axis=1))]
        height = float(possible.points_m[best][2] - sheet.points_m[numbers[best] - 1][2])
        return possible, NextTouch(int(numbers[best]), height, possible.q[best])


def _with_block(points_m: FloatArray, block_m: float) -> FloatArray:
    """Points (k, 3), and those on a block that stands on them [m]; without one the points alone."""
    return np.vstack([points_m, points_m + np.array((0.0, 0.0, block_m))]) if block_m else points_m


def _numbers(sheet: TouchSheet, touches: Touches) -> NDArray[np.intp]:
    """(k,) which crosshair each of some touches is, from 1."""
    away = np.linalg.norm(touches.points_m[:, None, :2] - sheet.points_m[None, :, :2], axis=2)
    return 1 + np.argmin(away, axis=1)


class TouchedPoints:
    """The touches so far. Used on the web server's event loop only."""

    def __init__(self, robot: Robot, calibrated: Collection[str] = ()) -> None:
        """``robot``: as the arm runs; ``calibrated``: the joints that the calibration in force covers."""
        self._robot, self._calibrated = robot, calibrated
        self.touches: tuple[TouchedPoint, ...] = ()
        """in the order in which they were made"""
        self.sheet: TouchSheet | None = None
        """None: the points are places in the base frame"""
        self.block_m = 0.0
        """the height of a block that may be put on a crosshair [m]; 0: there is none"""
        self.skipped: frozenset[int] = frozenset()
        """crosshairs that are not wanted next"""
        self.corrected: FitFigures | None = None
        """of the correction that these touches have led to; None: none was applied"""
        self.used = 0
        """touches before that; those behind check it"""
        self.version = 0
        """rises with every change, so that a page knows when to draw anew"""
        self._found: _TouchAnswer | None = None
        self._possible: Touches | None = None
        """poses with the tool on the crosshairs, since it is known where the sheet lies"""
        self._sense, self._turned_at = np.zeros(robot.n), np.full(robot.n, np.nan)

    @property
    def frame(self) -> Frame:
        """What the points are given in."""
        return "base" if self.sheet is None else "sheet"

    @property
    def result(self) -> TouchFit | str | None:
        """The tool error, or why there is none, in words; None: too few points, or not known yet."""
        return None if self._found is None else self._found.result

    @property
    def next(self) -> NextTouch | None:
        """The crosshair to touch next; None: not known."""
        return None if self._found is None else self._found.following

    @property
    def unknown(self) -> bool:
        """Whether it is still being worked out what the touches say."""
        return self._found is None

    @property
    def errors_m(self) -> FloatArray | None:
        """(k,) by how much the tool misses each point by the numbers in force [m]; None: not known yet.

        On a sheet, from where all other touches put it.
        """
        return None if self._found is None else self._found.errors_m

    async def use_sheet(self, paper: Paper | None, work_out: WorkOut = asyncio.to_thread) -> None:
        """Take crosshairs of a sheet for points, None: places in the base frame; refused among touches."""
        if paper == (None if self.sheet is None else self.sheet.paper):
            return
        self._require_none()
        sheet = None if paper is None else await work_out(touch_sheet, self._robot, paper)
        self._require_none()
        self.sheet = sheet
        self.clear()

    def use_block(self, height_m: float) -> None:
        """Propose points on a block of this height, too; 0: none. Counts from the next change on."""
        if height_m != self.block_m:
            self.block_m, self._possible = height_m, None

    def _require_none(self) -> None:
        if self.touches:
            raise StateError(
                f"{len(self.touches)} points of another kind are touched; press 'Start anew' first"
            )

    def follow(self, snapshot: Snapshot) -> None:
        """Note in which sense each joint turns: in its play it stays on the side from which it came."""
        q = np.where(np.isnan(snapshot.q), snapshot.q_command, snapshot.q)
        self._turned_at = np.where(np.isnan(self._turned_at), q, self._turned_at)
        away = q - self._turned_at
        turned = (away * self._sense > 0) | (np.abs(away) > _TURNED)
        self._sense = np.where(turned, np.sign(away), self._sense)
        self._turned_at = np.where(turned, q, self._turned_at)

    @property
    def sense(self) -> tuple[float, ...]:
        """(n,) in which sense each joint turned last."""
        return tuple(self._sense.tolist())

    def crosshair(self, number: int) -> FloatArray:
        """(3,) where it is on the sheet [m]; ``InputError``: there is none."""
        count = 0 if self.sheet is None else len(self.sheet.points_m)
        if self.sheet is None or not 1 <= number <= count:
            raise InputError(f"there is no crosshair {number}; the sheet has {count}")
        return self.sheet.points_m[number - 1]

    def pose(self, number: int, height_m: float) -> tuple[FloatArray, FloatArray]:
        """A configuration (n,) with the tool near a crosshair [rad], and where it is above it (3,) [m].

        By what is known of where the sheet lies. ``InputError``: no pose there is known.
        """
        self.crosshair(number)
        above = np.array((0.0, 0.0, height_m))
        if (proposed := self.next) is not None and proposed.number == number:
            return proposed.q, above - (0.0, 0.0, proposed.height_m)
        possible = None if self._found is None else self._found.possible
        if self.sheet is not None and possible is not None:
            there = np.flatnonzero(_numbers(self.sheet, possible) == number)
            if len(there):
                heights = possible.points_m[there, 2] - self.sheet.points_m[number - 1, 2]
                best = int(np.argmin(np.abs(heights - height_m)))
                return possible.q[there[best]], above - (0.0, 0.0, float(heights[best]))
        raise InputError(
            f"the arm does not reach crosshair {number} where the sheet lies; choose another one"
        )

    def add(self, touch: TouchedPoint) -> None:
        """Note that the tool touches a point."""
        point = np.array(touch.point_m)
        if not (np.isfinite(point).all() and np.linalg.norm(point) < _FARTHEST_M):
            raise InputError(f"a point is less than {_FARTHEST_M:.0f} m from the base; give X, Y, Z in mm")
        self._set((*self.touches, touch))

    def skip(self) -> None:
        """Another crosshair is wanted next."""
        if self.next is None:
            raise StateError("no crosshair is left to propose: choose one yourself")
        self.skipped |= {self.next.number}
        self._set(self.touches)

    def delete(self, index: int) -> None:
        """Take a touch away, from 0."""
        if not 0 <= index < len(self.touches):
            raise InputError(f"there is no point {index + 1}; there are {len(self.touches)}")
        self.used -= index < self.used
        self._set(self.touches[:index] + self.touches[index + 1 :])

    def clear(self) -> None:
        """Forget all touches, and what they have led to."""
        self.used, self.corrected, self.skipped, self._possible = 0, None, frozenset(), None
        self._set(())

    def applied(self, fit: TouchFit, used: int) -> None:
        """A correction by the first ``used`` touches is in force: those behind check it."""
        self.corrected, self.used = fit.figures, used
        self.version += 1

    def take_over(self, other: TouchedPoints) -> None:
        """Go on with the touches of another one."""
        self.sheet, self.block_m, self.skipped = other.sheet, other.block_m, other.skipped
        self.corrected, self.used = other.corrected, other.used
        self._set(other.touches)

    def go_back(self, touches: tuple[TouchedPoint, ...], now: tuple[TouchedPoint, ...]) -> bool:
        """Have ``touches`` again in place of ``now``; not where somebody has changed them since."""
        if self.touches is not now:
            return False
        self._set(touches)
        return True

    @property
    def suggestion(self) -> str:
        """What to write where by the result; empty where there is none."""
        result = self.result
        return suggestion(changes(result, self._calibrated)) if isinstance(result, TouchFit) else ""

    @property
    def csv(self) -> str:
        """The touches as a file for ``armctl calibrate points``."""
        return touches_csv(self._given(), self._robot)

    async def compute(self, work_out: WorkOut = asyncio.to_thread) -> None:
        """Find out what the touches say, off the event loop, unless it is known.

        ``work_out`` does so. What it raises leaves the touches without a result.
        """
        touches, skipped, sheet = self.touches, self.skipped, self.sheet
        if self._found is not None or not (touches or sheet):
            return
        asked = _TouchQuestion(self._robot, self._given(), sheet, self.block_m, skipped, self._possible)
        found: _TouchAnswer = await work_out(asked.answer)
        if self.touches is touches and self.sheet is sheet and self.skipped is skipped:
            self._found = found
            self._possible = found.possible if len(touches) > _LEAST_PLACED else None
            self.version += 1  # else they have changed meanwhile, and are computed anew

    def _set(self, touches: tuple[TouchedPoint, ...]) -> None:
        self.touches, self._found = touches, None
        self.version += 1

    def _given(self) -> Touches:
        """As the fit takes them, by the map that is in force."""
        outputs, touches, n = own_map(self._robot), self.touches, self._robot.n
        q = [outputs.angles(one.outputs, measured=one.measured) for one in touches]
        points = np.reshape([one.point_m for one in touches], (-1, 3))
        sense = np.reshape([one.sense or (0.0,) * n for one in touches], (-1, n))
        sent = [outputs.angles(one.sent, measured=True) for one in touches if one.sent is not None]
        commanded = np.reshape(sent, (-1, n)) if sent and len(sent) == len(touches) else None
        return Touches(np.reshape(q, (-1, n)), points, self.frame, sense, commanded)


def read_outputs(robot: Robot, q: FloatArray) -> dict[int, float]:
    """What the encoders read by channel, in the board's unit, where the arm shows ``q`` (n,) [rad]."""
    outputs = own_map(robot)
    bent = outputs.deflection
    return replace(outputs, deflection=None).outputs(q if bent is None else bent.shaft(q))

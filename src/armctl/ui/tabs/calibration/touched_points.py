"""Points that the tool touched, what they say of the arm, and which to touch next. All pages share them."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable, Collection
from dataclasses import replace
from typing import Any

import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration import (
    MOST_TOUCHES,
    Aim,
    Frame,
    KeptTouches,
    Paper,
    TouchedPoint,
    Touches,
    TouchesFile,
    TouchFit,
    TouchSheet,
    changes,
    own_map,
    suggestion,
    touch_sheet,
    touches_csv,
)
from armctl.errors import CalibrationError, InputError, StateError
from armctl.facts.angles import DEGREE
from armctl.facts.causes import NotBetter
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.tabs.calibration.touch_question import (
    LEAST_PLACED,
    NextTouch,
    TouchAnswer,
    TouchQuestion,
    crosshair_numbers,
)

_FARTHEST_M = 10.0
_STILL = 0.1 * DEGREE
"""an arm of which no joint has turned by more stands where it stood"""
_SAME_M = 1e-6
_RAISED_M = 0.05
"""how high the sheet of an arm lies that was never calibrated: by zeros that are 3° off its tip may seem to
be 30 mm lower than it is, and the arm does not go into the floor"""
_TURNED = 0.2 * DEGREE
"""a joint that went back by less has not turned round"""
GO_ON, FORGET = "Go on with them", "Forget them"
WorkOut = Callable[..., Awaitable[Any]]
"""calls a function with arguments on a thread, as ``asyncio.to_thread`` does"""


class TouchedPoints:
    """The touches so far. Used on the web server's event loop only."""

    def __init__(
        self,
        robot: Robot,
        calibrated: Collection[str] = (),
        *,
        file_robot: Robot | None = None,
        file: TouchesFile | None = None,
        stamp: Callable[[], str] = str,
    ) -> None:
        """Begin without a touch; what ``file`` has of an earlier time is offered.

        ``robot``: as the arm runs; ``calibrated``: the joints that the calibration in force covers;
        ``file_robot``: without it; ``stamp`` gives the time (ISO 8601).
        """
        self._robot, self._calibrated = robot, calibrated
        self._file_robot = robot if file_robot is None else file_robot
        self._file, self._stamp, self._writing = file, stamp, asyncio.Lock()
        self.offered: KeptTouches | None = None
        """what was touched before armctl was started; None: nothing, or it was taken or forgotten"""
        self.not_kept: str | None = None
        """why what is touched would not survive a restart; None: it does"""
        self._unreadable = False
        """what is kept of an earlier time stays as it is: somebody may mend it"""
        self.touches: tuple[TouchedPoint, ...] = ()
        """in the order in which they were made"""
        self.sheet: TouchSheet | None = None
        """None: the points are places in the base frame"""
        self.block_m: float = 0.0
        """the height of a block that may be put on a crosshair [m]; 0: there is none"""
        self.load_kg: float = 0.0
        """what the tool carries while points are touched, the same for all of them"""
        self.made: str = ""
        """when the last touch was made (ISO 8601)"""
        self.skipped: frozenset[int] = frozenset()
        """crosshairs that are not wanted next"""
        self.corrected: tuple[float, float] | None = None
        """RMS before and after the correction that they led to [m]; None: none was applied"""
        self.used = 0
        """touches before that; those behind check it"""
        self.version = 0
        """rises with every change, so that a page knows when to draw anew"""
        self._found: TouchAnswer | None = None
        self._retaken: TouchedPoint | None = None
        """the touch whose place the next one at its crosshair takes"""
        self._possible: Touches | None = None
        """poses with the tool on the crosshairs, since it is known where the sheet lies"""
        self._sense, self._turned_at = np.zeros(robot.n), np.full(robot.n, np.nan)
        if file is not None:
            try:
                self.offered = file.load()
            except CalibrationError as refusal:
                self.not_kept, self._unreadable = f"points of an earlier time: {refusal}", True

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
        """The crosshair to touch next: that of a touch that is made again, else what tells most.

        None: not known.
        """
        again = self._retaken
        if self._found is None or again is None or again.number is None:
            return None if self._found is None else self._found.following
        height = float(again.point_m[2] - self.crosshair(again.number)[2])
        q = own_map(self._robot).angles(again.outputs, measured=again.measured)
        return NextTouch(again.number, height, q)

    @property
    def aim(self) -> Aim | None:
        """How the arm comes near to a point, by the touches so far; None: too few."""
        return None if self._found is None else self._found.aim

    @property
    def heading(self) -> float | None:
        """How the sheet is turned against the base, by the touches so far [rad]; None: there is no sheet."""
        if self.sheet is None or self.aim is None:
            return None if self.sheet is None else 0.0
        x, y, _ = (self.aim.in_base(np.array((1.0, 0.0, 0.0))) - self.aim.in_base(np.zeros(3))).tolist()
        return math.atan2(y, x)

    @property
    def retaken(self) -> int | None:
        """Index of the touch that is made again; None: a new one is."""
        return None if self._retaken is None else self.touches.index(self._retaken)

    @property
    def doubtful(self) -> int | None:
        """Index of the touch to make again: one that fits to nothing, or is worst where nothing fits.

        None: there is none.
        """
        result = self.result
        if not isinstance(result, TouchFit) or len(result.missed_m) != len(self.touches):
            return None
        if mistaken := [one.number - 1 for one in result.mistaken]:
            return mistaken[0]
        if isinstance(result.verdict, NotBetter):
            return int(np.argmax(np.linalg.norm(result.missed_m, axis=1)))
        return None

    def retake(self, index: int) -> None:
        """Have the next touch of that point take the place of touch ``index``, from 0."""
        self._require_touch(index)
        self._retaken = self.touches[index]
        self.version += 1

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
        sheet = None if paper is None else await work_out(touch_sheet, self._file_robot, paper)
        self._require_none()
        if sheet is not None and not self._calibrated and sheet.height_m < _RAISED_M:
            sheet = self._raised(sheet, _RAISED_M)
        self.sheet = sheet
        self.clear()

    def use(self, block_m: float, lies_m: float, load_kg: float) -> bool:
        """Say how high a block is that may be put on a crosshair, how high the sheet lies [m], and the load.

        That is what the tool carried in all touches [kg]. Whether one of them is new: then all is compared
        anew.
        """
        sheet = self.sheet
        if sheet is not None and abs(lies_m - sheet.height_m) > _SAME_M:
            sheet = self._raised(sheet, lies_m)
        same = abs(block_m - self.block_m) < _SAME_M and load_kg == self.load_kg
        if same and sheet is self.sheet:
            return False
        self.block_m, self.load_kg = block_m, load_kg
        self.sheet, self._possible = sheet, None
        self._set(self.touches)
        return True

    def _raised(self, sheet: TouchSheet, height_m: float) -> TouchSheet:
        """The sheet, so high over the floor [m]."""
        x, y, _ = sheet.place_m.tolist()
        return replace(
            sheet, place_m=np.array((x, y, self._file_robot.floor_z + height_m)), height_m=height_m
        )

    def _require_none(self) -> None:
        self._require_no_offer()
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
            there = np.flatnonzero(crosshair_numbers(self.sheet, possible) == number)
            if len(there):
                heights = possible.points_m[there, 2] - self.sheet.points_m[number - 1, 2]
                best = int(np.argmin(np.abs(heights - height_m)))
                return possible.q[there[best]], above - (0.0, 0.0, float(heights[best]))
        raise InputError(
            f"the arm does not reach crosshair {number} where the sheet lies; choose another one"
        )

    def _require_no_offer(self) -> None:
        if self.offered is not None:
            raise StateError(
                f"{len(self.offered.touches)} points are kept from before; press '{GO_ON}' or '{FORGET}' "
                "first"
            )

    def add(self, touch: TouchedPoint) -> None:
        """Note that the tool touches a point."""
        self._require_no_offer()
        if len(self.touches) >= MOST_TOUCHES:
            raise InputError(f"{MOST_TOUCHES} points are enough; press 'Start anew' to begin again")
        point = np.array(touch.point_m)
        if not (np.isfinite(point).all() and np.linalg.norm(point) < _FARTHEST_M):
            raise InputError(f"a point is less than {_FARTHEST_M:.0f} m from the base; give X, Y, Z in mm")
        if self.touches and self._is_same(touch, self.touches[-1]):
            raise InputError(
                f"the arm stands as in point {len(self.touches)}; bring the tip to another one, then press "
                "again"
            )
        self.made = self._stamp()
        again, touches = self.retaken, list(self.touches)
        if again is not None and touches[again].is_where(touch):
            touches[again] = touch
        else:
            touches.append(touch)
        self._set(tuple(touches))

    def _is_same(self, one: TouchedPoint, other: TouchedPoint) -> bool:
        """Whether the button was pressed twice."""
        outputs = own_map(self._robot)
        q, before = (outputs.angles(each.outputs, measured=each.measured) for each in (one, other))
        same = (one.point_m, one.sense) == (other.point_m, other.sense)
        return same and bool(np.abs(q - before).max() < _STILL)

    def skip(self) -> None:
        """Another crosshair is wanted next."""
        if self.next is None:
            raise StateError("no crosshair is left to propose: choose one yourself")
        if self._retaken is None:
            self.skipped |= {self.next.number}
        self._set(self.touches)

    def delete(self, index: int) -> None:
        """Take a touch away, from 0."""
        self._require_touch(index)
        self.used -= index < self.used
        self._set(self.touches[:index] + self.touches[index + 1 :])

    def _require_touch(self, index: int) -> None:
        if not 0 <= index < len(self.touches):
            raise InputError(f"there is no point {index + 1}; there are {len(self.touches)}")

    def clear(self) -> None:
        """Forget all touches, and what they have led to."""
        self.used, self.corrected, self.skipped, self._possible = 0, None, frozenset(), None
        self._set(())

    def applied(self, fit: TouchFit, used: int) -> None:
        """A correction by the first ``used`` touches is in force: those behind check it."""
        self.corrected, self.used = (fit.before.rms, fit.after.rms), used
        self.version += 1

    def take_over(self, other: TouchedPoints) -> None:
        """Go on with the touches of another one; those of another tool are offered."""
        self.offered, self.not_kept, self._unreadable = other.offered, other.not_kept, other._unreadable
        if other.touches and other._robot.tool != self._robot.tool:
            self.offered = other.as_kept
        else:
            self._resume(other.as_kept)

    def go_on(self) -> None:
        """Go on with what is offered. ``StateError``: nothing is, or other points are touched."""
        offered = self._offer()
        if self.touches:
            raise StateError(f"{len(self.touches)} points are touched since; press 'Start anew' first")
        if offered.tool not in ("", self._robot.tool):
            raise StateError(
                f"these points were touched with the tool {offered.tool!r}, and {self._robot.tool!r} is on: "
                "put that one on, and say so in Main"
            )
        self.offered = None
        self._resume(offered)

    def forget(self) -> None:
        """Have nothing of what is offered. ``StateError``: nothing is."""
        self._offer()
        self.offered = None
        self.version += 1

    def _offer(self) -> KeptTouches:
        if self.offered is None:
            raise StateError("no points are kept from before")
        return self.offered

    @property
    def as_kept(self) -> KeptTouches:
        """All of it, as it is kept over a restart."""
        return KeptTouches(
            self.touches, self.sheet, self.block_m, self.load_kg, self.skipped, self.corrected, self.used,
            self.made, self._robot.tool,
        )  # fmt: skip

    def _resume(self, kept: KeptTouches) -> None:
        self.block_m, self.load_kg = kept.block_m, kept.load_kg
        self.sheet = kept.sheet
        self.skipped, self.corrected, self.used = kept.skipped, kept.corrected, kept.used
        self.made, self._possible = kept.made, None
        self._set(kept.touches)

    async def keep(self) -> None:
        """Have a restart find the touches as they are now; what is offered stays until that is decided."""
        if self._file is None or self.offered is not None or self._unreadable:
            return
        async with self._writing:  # one after the other, and the newest last
            before, self.not_kept = self.not_kept, None
            try:
                await asyncio.to_thread(self._file.save, self.as_kept)
            except CalibrationError as refusal:
                self.not_kept = str(refusal)
            self.version += self.not_kept != before

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
        asked = TouchQuestion(
            self._robot, self._given(), self.load_kg, sheet, self.block_m, skipped, self._possible
        )
        found: TouchAnswer = await work_out(asked.answer)
        if self.touches is touches and self.sheet is sheet and self.skipped is skipped:
            self._found = found
            self._possible = found.possible if len(touches) > LEAST_PLACED else None
            self.version += 1  # else they have changed meanwhile, and are computed anew

    def _set(self, touches: tuple[TouchedPoint, ...]) -> None:
        self.touches, self._found, self._retaken = touches, None, None
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

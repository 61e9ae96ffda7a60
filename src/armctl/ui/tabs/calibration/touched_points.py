"""Where the arm stands, and known points that the tool was brought to: they tell how far the tool is off."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration import LEAST_POINTS, ToolError, own_map, tool_error
from armctl.errors import ArmctlError, InputError, StateError
from armctl.hardware import Source
from armctl.robot import Robot
from armctl.runtime import Snapshot, State

_FARTHEST_M = 10.0


def present_outputs(robot: Robot, snapshot: Snapshot) -> dict[int, float]:
    """Output of every joint by channel, in the board's unit.

    As the board reports it; where it reports nothing, as it was last told. An arm that is off and whose
    board measures may have been moved by hand.

    Raises:
        StateError: it is not known where the arm is.
    """
    unknown = np.isnan(snapshot.q)
    if unknown.any() and not snapshot.commanded:
        if snapshot.source is Source.MEASURED:
            raise StateError("the board does not know where every joint stands; home the arm first")
        raise StateError(
            f"the arm is {snapshot.state.value}, so nobody knows where it stands; connect and enable it first"
        )
    return own_map(robot).outputs(np.where(unknown, snapshot.q_command, snapshot.q))


def standing_outputs(robot: Robot, snapshot: Snapshot) -> dict[int, float]:
    """``present_outputs`` of an arm that stands still: a mark is taken there.

    Raises:
        StateError: the arm moves, or it is not known where it is.
    """
    if snapshot.state in (State.MOVING, State.PAUSED):
        raise StateError("the arm is in the middle of a motion; wait until it stands, then press again")
    return present_outputs(robot, snapshot)


def standing_gripper(robot: Robot, snapshot: Snapshot) -> float:
    """Output of the gripper.

    Raises:
        StateError: it was not told to go anywhere yet.
    """
    if snapshot.gripper is None:
        raise StateError("the gripper has not been told to move yet; press 'Move gripper' first")
    (output,) = own_map(robot).gripper_output(snapshot.gripper).values()
    return output


@dataclass(frozen=True, slots=True)
class Touch:
    """The tool stood on a point."""

    outputs: Mapping[int, float]
    """by channel, in the board's unit: they stay true when the calibration changes"""
    point_m: tuple[float, float, float]
    """in the base frame [m]"""


class TouchedPoints:
    """The touches so far. Used on the web server's event loop only."""

    def __init__(self, robot: Robot, calibrated: Collection[str] = ()) -> None:
        """``robot``: as the arm runs; ``calibrated``: the joints that the calibration in force covers."""
        self._robot, self._calibrated = robot, calibrated
        self.touches: tuple[Touch, ...] = ()
        """in the order in which they were made"""
        self.result: ToolError | str | None = None
        """the tool error, or why there is none, in words; None: too few points, or not known yet"""
        self.version = 0
        """rises with every change, so that a page knows when to draw anew"""

    @property
    def distances_m(self) -> FloatArray:
        """(k,) from each point to where the arm believes the tool to be [m]."""
        if not self.touches:
            return np.zeros(0)
        points = np.array([touch.point_m for touch in self.touches])
        return np.linalg.norm(points - self._robot.forward(self._angles())[:, :3, 3], axis=1)

    def add(self, outputs: Mapping[int, float], point_m: FloatArray) -> None:
        """Note that the tool touches a point (3,) [m].

        Raises:
            InputError: no point an arm could touch.
        """
        if not (np.isfinite(point_m).all() and np.linalg.norm(point_m) < _FARTHEST_M):
            raise InputError(f"a point is less than {_FARTHEST_M:.0f} m from the base; give X, Y, Z in mm")
        x, y, z = point_m.tolist()
        self._set((*self.touches, Touch(dict(outputs), (x, y, z))))

    def delete(self, index: int) -> None:
        """Take a touch away, from 0.

        Raises:
            InputError: there is none of that number.
        """
        if not 0 <= index < len(self.touches):
            raise InputError(f"there is no point {index + 1}; there are {len(self.touches)}")
        self._set(self.touches[:index] + self.touches[index + 1 :])

    def take_over(self, other: TouchedPoints) -> None:
        """Go on with the touches of another one."""
        self._set(other.touches)

    async def compute(self) -> None:
        """Compute the tool error off the event loop, unless it is known or there are too few points."""
        touches = self.touches
        if len(touches) < LEAST_POINTS or self.result is not None:
            return
        q, points = self._angles(), np.array([touch.point_m for touch in touches])
        try:
            result: ToolError | str = await asyncio.to_thread(
                tool_error, self._robot, q, points, self._calibrated
            )
        except ArmctlError as error:
            result = str(error)
        if self.touches is touches:  # else they have changed meanwhile, and are computed anew
            self._set(touches, result)

    def _set(self, touches: tuple[Touch, ...], result: ToolError | str | None = None) -> None:
        self.touches, self.result = touches, result
        self.version += 1

    def _angles(self) -> FloatArray:
        """(k, n) [rad]."""
        outputs = own_map(self._robot)
        return np.array([outputs.angles(touch.outputs) for touch in self.touches])

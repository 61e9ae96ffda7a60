"""Known points that the tool was brought to, and what they tell of the arm."""

from __future__ import annotations

import asyncio
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.calibration import LEAST_POINTS, ToolError, tool_error
from armctl.errors import ArmctlError, InputError
from armctl.robot import Robot
from armctl.ui.widgets.standing import calibrated_map

FloatArray = NDArray[np.float64]
_FARTHEST_M = 10.0


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
        """Begin without a touch.

        Args:
            robot: as the arm runs, with its calibration.
            calibrated: names of the joints that the calibration in force covers.
        """
        self._robot, self._calibrated = robot, calibrated
        self._touches: tuple[Touch, ...] = ()
        self._version = 0
        self._told: ToolError | str | None = None

    @property
    def version(self) -> int:
        """Rises with every change, so that a page knows when to draw anew."""
        return self._version

    @property
    def touches(self) -> tuple[Touch, ...]:
        """In the order in which they were made."""
        return self._touches

    @property
    def told(self) -> ToolError | str | None:
        """What they tell, or why they tell nothing, in words; None: too few, or not known yet."""
        return self._told

    @property
    def distances_m(self) -> FloatArray:
        """(k,) from each point to where the arm believes the tool to be [m]."""
        if not self._touches:
            return np.zeros(0)
        points = np.array([touch.point_m for touch in self._touches])
        return np.linalg.norm(points - self._robot.forward(self._angles())[:, :3, 3], axis=1)

    def add(self, outputs: Mapping[int, float], point_m: FloatArray) -> None:
        """Note that the tool touches a point (3,) [m].

        Raises:
            InputError: no point an arm could touch.
        """
        if not (np.isfinite(point_m).all() and np.linalg.norm(point_m) < _FARTHEST_M):
            raise InputError(f"a point is less than {_FARTHEST_M:.0f} m from the base; give X, Y, Z in mm")
        x, y, z = point_m.tolist()
        self._set((*self._touches, Touch(dict(outputs), (x, y, z))))

    def delete(self, index: int) -> None:
        """Take a touch away, from 0.

        Raises:
            InputError: there is none of that number.
        """
        if not 0 <= index < len(self._touches):
            raise InputError(f"there is no point {index + 1}; there are {len(self._touches)}")
        self._set(self._touches[:index] + self._touches[index + 1 :])

    def take_over(self, other: TouchedPoints) -> None:
        """Go on with the touches of another desk."""
        self._set(other.touches)

    async def think(self) -> None:
        """Find out what the touches tell, off the event loop, unless that is known."""
        touches = self._touches
        if len(touches) < LEAST_POINTS or self._told is not None:
            return
        q, points = self._angles(), np.array([touch.point_m for touch in touches])
        try:
            told: ToolError | str = await asyncio.to_thread(
                tool_error, self._robot, q, points, self._calibrated
            )
        except ArmctlError as error:
            told = str(error)
        if self._touches is touches:  # else somebody has changed them meanwhile, and thinks himself
            self._told = told
            self._version += 1

    def _set(self, touches: tuple[Touch, ...]) -> None:
        self._touches, self._told = touches, None
        self._version += 1

    def _angles(self) -> FloatArray:
        """(k, n) [rad]."""
        outputs = calibrated_map(self._robot)
        return np.array([outputs.angles(touch.outputs) for touch in self._touches])

"""From joint angles to the board's channels and back, with what each channel may do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from armctl.hardware import ChannelSettings
from armctl.robot import OutputMap, Robot

FloatArray = NDArray[np.float64]
BOARD_SPEED_MARGIN = 1.5
"""The board's own speed limit over the joint's: a second line of defence that never meets a good stream."""
_GRIPPER_UP_S = 0.1
"""a gripper's motor may take this long to its speed"""
BOARD_ACCELERATION_MARGIN = 4.0
"""The same for the acceleration: a stream of setpoints is one of small steps, which the board smooths."""


class Outputs:
    """The robot's output map; where its file gives none, a stand-in that only a simulated board may drive."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._map = robot.output_map or OutputMap.stand_in(robot.limits)
        self.unit = self._map.unit
        self.power = "motors" if self.unit == "counts" else "pulses"
        """what is switched on and off"""
        self.unit_per_rad = np.abs(self._map.per_rad)
        """(n,) board units a radian"""
        self.titles = {
            channel: joint.title for channel, joint in zip(self._map.channels, robot.joints, strict=True)
        }
        """what the user calls each channel"""
        if self._map.gripper_channel is not None and robot.gripper is not None:
            self.titles[self._map.gripper_channel] = robot.gripper.title

    @property
    def has_gripper(self) -> bool:
        """Whether the board drives a gripper."""
        return self._map.gripper_channel is not None

    def settings(self) -> list[ChannelSettings]:
        """What each channel may do.

        A servo board's own acceleration limit stays off: its ramp would lag behind a 50 Hz stream of
        setpoints and round off the path; the stream itself keeps the acceleration limits. Motors need one.
        """
        robot, outputs = self._robot, self._map
        speeds = robot.speed_limits * self.unit_per_rad * BOARD_SPEED_MARGIN
        accelerations = robot.acceleration_limits * self.unit_per_rad * BOARD_ACCELERATION_MARGIN
        settings = [
            ChannelSettings(channel, low, high, speed, self._acceleration(acceleration))
            for channel, low, high, speed, acceleration in zip(
                outputs.channels,
                outputs.low.tolist(),
                outputs.high.tolist(),
                speeds.tolist(),
                accelerations.tolist(),
                strict=True,
            )
        ]
        if outputs.gripper_channel is not None and robot.gripper is not None:
            low, high = sorted((outputs.gripper_closed, outputs.gripper_open))
            speed = robot.gripper.speed * (high - low) * BOARD_SPEED_MARGIN
            acceleration = self._acceleration(speed / _GRIPPER_UP_S)
            settings.append(ChannelSettings(outputs.gripper_channel, low, high, speed, acceleration))
        return settings

    def _acceleration(self, value: float) -> float | None:
        return value if self.unit == "counts" else None

    def setpoints(self, q: FloatArray | None, opening: float | None) -> dict[int, float]:
        """Board units by channel for joint angles (n,) [rad] and a gripper opening 0..1; None: not sent."""
        values: dict[int, float] = {}
        if q is not None:
            # Robot files may round the safe range inwards by an eighth of a microsecond.
            low, high = self._map.low.tolist(), self._map.high.tolist()
            for (channel, value), least, most in zip(self._map.outputs(q).items(), low, high, strict=True):
                values[channel] = min(max(value, least), most)
        if opening is not None:
            values.update(self._map.gripper_output(opening))
        return values

    def angles(self, positions: Mapping[int, float | None]) -> FloatArray:
        """Joint angles (n,) [rad]; NaN where the board does not know."""
        return self._map.angles(positions)

    def opening(self, positions: Mapping[int, float | None]) -> float | None:
        """Gripper opening 0..1, if the board knows it."""
        return self._map.opening(positions)


def channel_settings(robot: Robot) -> list[ChannelSettings]:
    """What each channel of the robot's board may do; a simulated board is set up with the same."""
    return Outputs(robot).settings()

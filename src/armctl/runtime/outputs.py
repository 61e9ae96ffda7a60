"""From joint angles to the board's channels and back, with what each channel may do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from armctl.hardware import ChannelSettings
from armctl.robot import Robot, ServoMap

FloatArray = NDArray[np.float64]
BOARD_SPEED_MARGIN = 1.5
"""The board's own speed limit over the joint's: a second line of defence that never meets a good stream."""


class Outputs:
    """The robot's servo map; where its file gives none, a stand-in that only a simulated board may drive."""

    unit = "µs"

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._map = robot.servo_map or ServoMap.stand_in(robot.limits)
        self.unit_per_rad = np.abs(self._map.us_per_rad)
        """(n,) board units a radian"""

    @property
    def joint_channels(self) -> tuple[int, ...]:
        """Channel of each joint."""
        return self._map.channels

    @property
    def has_gripper(self) -> bool:
        """Whether the board drives a gripper."""
        return self._map.gripper_channel is not None

    def settings(self) -> list[ChannelSettings]:
        """What each channel may do.

        The board's own acceleration limit stays off: its ramp would lag behind a 50 Hz stream of
        setpoints and round off the path; the stream itself keeps the acceleration limits.
        """
        return self._pulse_settings(self._robot, self._map)

    def setpoints(self, q: FloatArray | None, opening: float | None) -> dict[int, float]:
        """Board units by channel for joint angles (n,) [rad] and a gripper opening 0..1; None: not sent."""
        values: dict[int, float] = {}
        if q is not None:
            # Robot files may round the safe range inwards by an eighth of a microsecond.
            low, high = self._map.pulse_min_us.tolist(), self._map.pulse_max_us.tolist()
            for (channel, pulse), least, most in zip(self._map.pulses(q).items(), low, high, strict=True):
                values[channel] = min(max(pulse, least), most)
        if opening is not None:
            values.update(self._map.gripper_pulse(opening))
        return values

    def angles(self, positions: Mapping[int, float | None]) -> FloatArray:
        """Joint angles (n,) [rad]; NaN where the board does not know."""
        return self._map.angles(positions)

    def opening(self, positions: Mapping[int, float | None]) -> float | None:
        """Gripper opening 0..1, if the board knows it."""
        return self._map.opening(positions)

    @staticmethod
    def _pulse_settings(robot: Robot, servo_map: ServoMap) -> list[ChannelSettings]:
        speeds = robot.speed_limits * np.abs(servo_map.us_per_rad) * BOARD_SPEED_MARGIN
        settings = [
            ChannelSettings(channel, minimum=low, maximum=high, speed=speed)
            for channel, low, high, speed in zip(
                servo_map.channels,
                servo_map.pulse_min_us.tolist(),
                servo_map.pulse_max_us.tolist(),
                speeds.tolist(),
                strict=True,
            )
        ]
        if servo_map.gripper_channel is not None and robot.gripper is not None:
            closed, opened = servo_map.gripper_closed_us, servo_map.gripper_open_us
            settings.append(
                ChannelSettings(
                    servo_map.gripper_channel,
                    minimum=min(closed, opened),
                    maximum=max(closed, opened),
                    speed=robot.gripper.speed * abs(opened - closed) * BOARD_SPEED_MARGIN,
                )
            )
        return settings


def channel_settings(robot: Robot) -> list[ChannelSettings]:
    """What each channel of the robot's board may do; a simulated board is set up with the same."""
    return Outputs(robot).settings()

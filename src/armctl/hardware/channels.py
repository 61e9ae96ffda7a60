"""What the channels of a robot's board may do."""

from __future__ import annotations

import numpy as np

from armctl.hardware.boards import board_type
from armctl.hardware.driver import ChannelSettings
from armctl.robot import Robot

_SPEED_MARGIN = 1.5
"""the board's own speed limit over the joint's: a second line of defence that never meets a good stream"""
_ACCELERATION_MARGIN = 4.0
"""the same for the acceleration: a stream of setpoints is one of small steps, which the board smooths"""
_GRIPPER_UP_S = 0.1
"""a gripper's motor may take this long to its speed"""


def channel_settings(robot: Robot) -> list[ChannelSettings]:
    """What each channel of the robot's board may do; a simulated board is set up with the same.

    A servo board's own acceleration limit stays off: its ramp would lag behind a 50 Hz stream of
    setpoints and round off the path; the stream itself keeps the acceleration limits. Motors need one.
    """
    outputs, limited = robot.outputs, board_type(robot.board).limits_acceleration
    units = np.abs(outputs.per_rad)
    speeds = robot.speed_limits * units * _SPEED_MARGIN
    accelerations = robot.acceleration_limits * units * _ACCELERATION_MARGIN
    table = np.stack([outputs.low, outputs.high, speeds, accelerations], axis=1).tolist()
    rows = list(zip(outputs.channels, table, strict=True))
    for one in outputs.mirrors:
        low, high, speed, acceleration = table[one.joint]
        low, high = sorted((one.output(low), one.output(high)))
        rows.append((one.channel, [low, high, abs(one.ratio) * speed, abs(one.ratio) * acceleration]))
    if outputs.gripper_channel is not None and robot.gripper is not None:
        low, high = sorted((outputs.gripper_closed, outputs.gripper_open))
        speed = robot.gripper.speed * (high - low) * _SPEED_MARGIN
        rows.append((outputs.gripper_channel, [low, high, speed, speed / _GRIPPER_UP_S]))
    return [
        ChannelSettings(channel, low, high, speed, acceleration if limited else None)
        for channel, (low, high, speed, acceleration) in rows
    ]

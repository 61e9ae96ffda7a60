"""The kinds of board that armctl knows, its own and those of other packages; and the channels of a robot."""

from __future__ import annotations

import logging
from functools import cache

import numpy as np

from armctl.errors import InputError
from armctl.hardware.board_type import NEEDED, BoardType
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.dynamixel.board import DynamixelBoard
from armctl.hardware.encoder.board import EncoderBoard
from armctl.hardware.feetech.board import FeetechBoard, ScsBoard
from armctl.hardware.firmata.board import FirmataBoard
from armctl.hardware.maestro.board import MaestroBoard
from armctl.hardware.pca9685.board import Pca9685Board
from armctl.robot import Robot
from armctl.robot.board_entries import BoardEntries, SignalKinds
from armctl.robot.tools import own_gripper

SHIPPED: tuple[BoardType, ...] = (
    MaestroBoard(),
    FirmataBoard(),
    EncoderBoard(),
    FeetechBoard(),
    Pca9685Board(),
    DynamixelBoard(),
    ScsBoard(),
)
"""in the order in which they are asked who is there: a question of the second upsets the first,
and a Maestro takes a ping on a servo bus for an order"""
GROUP = "armctl.boards"
_LOGGER = logging.getLogger("armctl.hardware")


@cache
def board_types() -> tuple[BoardType, ...]:
    """The shipped boards, then each ``BoardType`` (class or instance) that an entry point brings."""
    from importlib.metadata import entry_points

    found = list(SHIPPED)
    for entry in entry_points(group=GROUP):
        try:
            loaded: object = entry.load()
            board = loaded() if isinstance(loaded, type) else loaded
            missing = [name for name in NEEDED if not hasattr(board, name)]
            if missing and isinstance(board, BoardType):
                raise TypeError(f"it does not say its {', '.join(missing)}")
        except Exception as error:
            _LOGGER.warning("the board %s of %s cannot be loaded: %s", entry.name, entry.value, error)
            continue
        if not isinstance(board, BoardType):
            _LOGGER.warning("the board %s: %s is no BoardType", entry.name, entry.value)
        elif board.kind in (one.kind for one in found):
            _LOGGER.warning("the board %s: there is a board of the kind %r already", entry.name, board.kind)
        else:
            found.append(board)
    return tuple(found)


def find_board_type(kind: str) -> BoardType | None:
    """The board of a kind; None where there is none. Installed packages are asked only if need be."""
    shipped = next((one for one in SHIPPED if one.kind == kind), None)
    return shipped or next((one for one in board_types() if one.kind == kind), None)


def board_type(kind: str) -> BoardType:
    """The board of a kind; ``InputError`` names those that there are."""
    found = find_board_type(kind)
    if found is None:
        raise InputError(f"there is no board of the kind {kind!r}; there are {', '.join(kinds())}")
    return found


def board_of_address(port: str) -> BoardType | None:
    """The board that opens a port itself: its address is of that board's own form. None: any other port."""
    scheme, colon, _ = port.partition("://")
    return next((one for one in board_types() if colon and one.scheme == scheme), None)


def kinds() -> tuple[str, ...]:
    """The kinds of all boards, sorted."""
    return tuple(sorted(one.kind for one in board_types()))


def find_entries(kind: str) -> BoardEntries | tuple[str, ...]:
    """What reads the robot-file entries of a kind of board; where there is none, the kinds that there are."""
    found = find_board_type(kind)
    return kinds() if found is None else found.entries


def signal_kinds(kind: str) -> SignalKinds:
    """The kinds of inputs and outputs that a kind of board has beside those of joints."""
    found = find_board_type(kind)
    return ((), ()) if found is None else (found.inputs, found.outputs)


# What the channels of a robot's board may do.

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
    gripper = own_gripper(robot)
    if outputs.gripper_channel is not None and gripper is not None:
        low, high = sorted((outputs.gripper_closed, outputs.gripper_open))
        speed = gripper.speed * (high - low) * _SPEED_MARGIN
        rows.append((outputs.gripper_channel, [low, high, speed, speed / _GRIPPER_UP_S]))
    return [
        ChannelSettings(channel, low, high, speed, acceleration if limited else None)
        for channel, (low, high, speed, acceleration) in rows
    ]

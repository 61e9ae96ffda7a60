"""The driver, spoken to in joint angles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, StateError
from armctl.hardware import BoardIdentity, ChannelSettings, Driver, HomingState, Source
from armctl.hardware.boards import board_type
from armctl.hardware.driver import translated
from armctl.robot import OutputMap, Robot

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
        self.map = robot.output_map or OutputMap.stand_in(robot.limits)
        self.unit = self.map.unit
        self._board = board_type(robot.board)
        self.power = self._board.power
        """what is switched on and off"""
        self.unit_per_rad = np.abs(self.map.per_rad)
        """(n,) board units a radian"""
        self.titles = {
            channel: joint.title for channel, joint in zip(self.map.channels, robot.joints, strict=True)
        }
        """what the user calls each channel"""
        if self.map.gripper_channel is not None and robot.gripper is not None:
            self.titles[self.map.gripper_channel] = robot.gripper.title

    def settings(self) -> list[ChannelSettings]:
        """What each channel may do.

        A servo board's own acceleration limit stays off: its ramp would lag behind a 50 Hz stream of
        setpoints and round off the path; the stream itself keeps the acceleration limits. Motors need one.
        """
        robot, outputs = self._robot, self.map
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
        return value if self._board.limits_acceleration else None

    def setpoints(self, q: FloatArray | None, opening: float | None) -> dict[int, float]:
        """Board units by channel for joint angles (n,) [rad] and a gripper opening 0..1; None: not sent."""
        values: dict[int, float] = {}
        if q is not None:
            # Robot files may round the safe range inwards by an eighth of a microsecond.
            low, high = self.map.low.tolist(), self.map.high.tolist()
            for (channel, value), least, most in zip(self.map.outputs(q).items(), low, high, strict=True):
                values[channel] = min(max(value, least), most)
        if opening is not None:
            values.update(self.map.gripper_output(opening))
        return values


def channel_settings(robot: Robot) -> list[ChannelSettings]:
    """What each channel of the robot's board may do; a simulated board is set up with the same."""
    return Outputs(robot).settings()


@dataclass(frozen=True, slots=True)
class Reading:
    """What the board says of itself."""

    q: FloatArray
    """(n,) [rad]; NaN where it does not know"""
    on: NDArray[np.bool_]
    """(n,) joints whose outputs are on; where the board does not say, those that have a position"""
    opening: float | None
    """of the gripper 0..1; None: not known"""
    source: Source
    errors: tuple[str, ...]
    powered: bool | None = None
    """whether its outputs are on; None: it does not say"""
    homing: HomingState | None = None
    """None: there is nothing to home"""


class Board:
    """An open board. Every method may raise ``BoardError``; then it is best closed."""

    def __init__(self, robot: Robot, driver: Driver, identity: BoardIdentity) -> None:
        self.outputs = Outputs(robot)
        self.identity = identity
        self._driver = driver

    @classmethod
    def open(cls, robot: Robot, open_driver: Callable[[str], Driver], port: str) -> Board:
        """Open the line, find out who is there and tell it what each channel may do. Moves nothing.

        Raises:
            BoardError: nobody there, or not what is needed.
            StateError: a real board, and the robot file does not say which pulse is which angle.
        """
        driver = translated("opening the board", open_driver, port)
        try:
            board = cls(robot, driver, translated("opening the board", driver.open))
            if robot.output_map is None and not board.identity.simulated:
                raise StateError(
                    f"{robot.name} has no servo map: which pulse is which angle is not known, so only the "
                    "simulated board may be driven (port sim); give each joint of the robot file a servo"
                )
            board.configure()
        except ArmctlError:
            _quietly(driver.close)
            raise
        return board

    def configure(self) -> None:
        """Tell the board what each channel may do: one that started anew has forgotten. Moves nothing."""
        translated("setting the channels", self._driver.configure, self.outputs.settings())

    def write(self, q: FloatArray | None, opening: float | None) -> None:
        """Send joint angles (n,) [rad] and a gripper opening 0..1 in one write; None: not sent."""
        translated("writing setpoints", self._driver.write, self.outputs.setpoints(q, opening))

    def read(self) -> Reading:
        """Read back."""
        readback = translated("reading back", self._driver.read)
        q = self.outputs.map.angles(readback.positions)
        powered = readback.powered
        errors = readback.errors
        if readback.faults:
            faults = [f"{self.title(channel)}: {words}" for channel, words in readback.faults.items()]
            errors = (*faults, *errors)
        return Reading(
            q,
            ~np.isnan(q) if powered is None else np.full(q.shape, powered),
            self.outputs.map.opening(readback.positions),
            readback.source,
            errors,
            powered,
            readback.homing,
        )

    def home(self) -> None:
        """Begin to look for the zeros of the axes: the arm moves."""
        translated("homing", self._driver.home)

    def hold(self) -> None:
        """Brake on the board itself and hold there."""
        translated("stopping the board", self._driver.stop)

    def title(self, channel: int) -> str:
        """What the user calls a channel."""
        return self.outputs.titles.get(channel, f"channel {channel}")

    def release(self) -> None:
        """Pulses or motors off: the arm drops."""
        translated(f"switching the {self.outputs.power} off", self._driver.release)

    def close(self) -> None:
        """Close the line, whatever state it is in; the outputs stay as they are."""
        _quietly(self._driver.close)


def no_reading(n: int) -> Reading:
    """Nothing is known of ``n`` joints."""
    return Reading(np.full(n, math.nan), np.zeros(n, dtype=np.bool_), None, Source.COMMANDED, ())


def _quietly(action: Callable[[], None]) -> None:
    """A board that is gone may fail to close; that it is gone was reported before."""
    try:
        action()
    except Exception:
        return

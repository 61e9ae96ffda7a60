"""The driver, spoken to in joint angles."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, BoardError, StateError
from armctl.hardware import BoardIdentity, ChannelSettings, Driver, HomingState, Source
from armctl.robot import OutputMap, Robot

# From joint angles to the board's channels and back, with what each channel may do.

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


@dataclass(frozen=True, slots=True)
class Reading:
    """What the board says of itself."""

    q: FloatArray
    """(n,) [rad]; NaN where it does not know"""
    opening: float | None
    source: Source
    errors: tuple[str, ...]
    powered: bool | None = None
    """whether its outputs are on; None: it does not say, a joint is on where it has a position"""
    homing: HomingState | None = None
    """None: there is nothing to home"""

    @property
    def on(self) -> NDArray[np.bool_]:
        """(n,) joints whose outputs are on."""
        if self.powered is None:
            return ~np.isnan(self.q)
        return np.full(self.q.shape, self.powered)


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
        with _translated("opening the board"):
            driver = open_driver(port)
        try:
            with _translated("opening the board"):
                board = cls(robot, driver, driver.open())
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
        with _translated("setting the channels"):
            self._driver.configure(self.outputs.settings())

    def write(self, q: FloatArray | None, opening: float | None) -> None:
        """Send joint angles (n,) [rad] and a gripper opening 0..1 in one write; None: not sent."""
        with _translated("writing setpoints"):
            self._driver.write(self.outputs.setpoints(q, opening))

    def read(self) -> Reading:
        """Read back."""
        with _translated("reading back"):
            readback = self._driver.read()
        faults = [f"{self.title(channel)}: {words}" for channel, words in readback.faults.items()]
        return Reading(
            self.outputs.angles(readback.positions),
            self.outputs.opening(readback.positions),
            readback.source,
            (*faults, *readback.errors),
            readback.powered,
            readback.homing,
        )

    def home(self) -> None:
        """Begin to look for the zeros of the axes: the arm moves."""
        with _translated("homing"):
            self._driver.home()

    def hold(self) -> None:
        """Brake on the board itself and hold there."""
        with _translated("stopping the board"):
            self._driver.stop()

    def title(self, channel: int) -> str:
        """What the user calls a channel."""
        return self.outputs.titles.get(channel, f"channel {channel}")

    def release(self) -> None:
        """Pulses or motors off: the arm drops."""
        with _translated(f"switching the {self.outputs.power} off"):
            self._driver.release()

    def close(self) -> None:
        """Close the line, whatever state it is in; the outputs stay as they are."""
        _quietly(self._driver.close)


def no_reading(n: int) -> Reading:
    """Nothing is known of ``n`` joints."""
    return Reading(np.full(n, math.nan), None, Source.COMMANDED, ())


class _translated:  # noqa: N801  a context manager, used like a function
    """Anything a driver raises leaves here as an ``ArmctlError``, with its cause kept."""

    def __init__(self, doing: str) -> None:
        self._doing = doing

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if isinstance(error, Exception) and not isinstance(error, ArmctlError):
            raise BoardError(f"{self._doing}: {type(error).__name__}: {error}") from error


def _quietly(action: Callable[[], None]) -> None:
    """A board that is gone may fail to close: that it is gone has been told already."""
    try:
        action()
    except Exception:
        return

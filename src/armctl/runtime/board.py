"""The driver, spoken to in joint angles."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, BoardError, StateError
from armctl.hardware import BoardIdentity, Driver, HomingState, Source
from armctl.robot import Robot
from armctl.runtime.outputs import Outputs

FloatArray = NDArray[np.float64]


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

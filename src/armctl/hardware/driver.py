"""The seam between the runtime and any board: one protocol, plain values."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Literal, ParamSpec, Protocol, TypeVar

import msgspec

from armctl.errors import ArmctlError, BoardError, BoardTimeoutError, StateError, out_of_range
from armctl.facts import QuantityLimits
from armctl.facts.commands import ReleaseUnconfirmed
from armctl.lazy_dataclass import dataclass
from armctl.robot.signals import Signals

P = ParamSpec("P")
T = TypeVar("T")


class Source(Enum):
    """Where a position comes from; it is always shown next to the figure."""

    COMMANDED = "commanded"  # what the host last asked for
    TRANSMITTED = "transmitted"  # what the board sends to the servos (Maestro)
    MEASURED = "measured"  # what encoders see


@dataclass(frozen=True, slots=True)
class BoardIdentity:
    """What answered at the other end of the line."""

    kind: str  # "Pololu Micro Maestro 6-channel"
    port: str  # as the user named it, or the pty of the simulated board
    serial_number: str | None = None
    simulated: bool = False
    notes: tuple[str, ...] = ()  # what to know of this kind of board, e.g. what its watchdog does
    earlier: tuple[str, ...] = ()  # what was wrong with this one before it was connected
    abilities: tuple[str, ...] = ()  # methods of ``Abilities`` that its driver has; armctl fills this in

    @property
    def title(self) -> str:
        """What people read: a simulated board has the kind of a real one."""
        return f"simulated {self.kind}" if self.simulated else self.kind


@dataclass(frozen=True, slots=True)
class ChannelSettings:
    """What one output of the board may do, in the board's own unit (µs for servos)."""

    channel: int
    minimum: float
    maximum: float
    speed: float | None = None  # unit/s that the board itself enforces; None: unlimited
    acceleration: float | None = None  # unit/s²; None: unlimited
    first: float | None = None  # the setpoint that will switch it on, where that is known by now


@dataclass(frozen=True, slots=True)
class HomingState:
    """How far a board that must find its zeros has come with it."""

    homed: Mapping[int, bool]  # by channel
    running: int | None = None  # the channel that is looking for its zero now

    @property
    def done(self) -> bool:
        """Every channel knows where it is."""
        return all(self.homed.values())


class Readback(msgspec.Struct, frozen=True):
    """Positions by channel in the board's unit; None where the board does not know."""

    positions: Mapping[int, float | None]
    source: Source
    errors: tuple[str, ...] = ()  # what the board itself reports, in words
    powered: bool | None = None  # whether its outputs are on; None: a channel is on where it has a position
    faults: Mapping[int, str] = {}  # by channel, in words without its name
    homing: HomingState | None = None  # None: the board needs no homing
    warnings: Mapping[int, str] = {}  # as faults, but it goes on
    # By channel; None where the board does not measure it.
    load: Mapping[int, float | None] | None = None  # force of its motor, as a signed fraction of the largest
    temperature: Mapping[int, float | None] | None = None  # [°C]
    voltage: Mapping[int, float | None] | None = None  # of the supply [V]
    current: Mapping[int, float | None] | None = None  # of its motor [A]
    limits: Mapping[int, QuantityLimits] = {}  # of these four
    # Questions put to the board since the last reading, and those that got no answer and were asked again.
    asked: int = 1
    lost: int = 0
    # The longest that an answer took since the last reading; None: the driver does not measure it.
    delay_s: float | None = None
    # Channels whose setpoint, or switching on, could not be sent in time: it was dropped, never sent later.
    # The driver brings them to the next setpoint no faster than they may move.
    expired: tuple[int, ...] = ()
    sent: bool = True  # nothing that was written still waits for the line
    # By channel, whether it is on, of a board that switches each by itself; else ``powered`` says it.
    on: Mapping[int, bool] | None = None
    # What its other pins are at, by the names that people call them: 0 or 1, or a share 0 ... 1. Of
    # ``Signals`` these are the levels of the pins: the runtime knows which are active low.
    inputs: Mapping[str, float] = {}
    outputs: Mapping[str, float] = {}
    # By name, how often an input has changed since the last reading, of a board that counts: a pulse between
    # two readings is seen.
    changes: Mapping[str, int] = {}
    home_again: bool = False  # ``errors`` or ``faults`` tell already to home the arm


class Driver(Protocol):
    """One board. Only the controller thread calls it; every method may raise ``BoardError``.

    Units are the board's own (servo boards: pulse width in µs). A driver never decides where the
    arm goes: it writes what it is given, refuses what is outside ``ChannelSettings``, and reports.
    """

    def open(self) -> BoardIdentity:
        """Open the line, find out who is there, and leave every output as it was."""
        ...

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        """Tell the board and the driver what each channel may do. Moves nothing."""

    def write(self, setpoints: Mapping[int, float]) -> None:
        """Send setpoints; the first one of a channel that is off switches its pulses on."""

    def read(self) -> Readback:
        """Read positions and errors back."""
        ...

    def stop(self) -> None:
        """Board-side hold: every channel that is on stays where the board now has it."""

    def home(self) -> None:
        """Begin to look for the zero of every channel: the arm moves. ``read`` tells how it goes.

        ``stop`` and ``release`` end it. A board that needs no homing refuses with ``BoardError``.
        """

    def release(self) -> None:
        """Pulses off on every configured channel: the arm drops."""

    def close(self) -> None:
        """Close the line; safe to call twice, and after an unplug. Leaves the outputs as they are."""


class Abilities:
    """What only some boards can do. A driver that is one of these has what it overrides; the rest refuses.

    A driver that is none has none of them. A refusal is no fault of the board: the arm goes on.
    """

    def release_channels(self, channels: Sequence[int]) -> None:
        """Switch off these channels only; a setpoint switches one on again."""
        raise StateError("this board switches its outputs off all at once only")

    def limit_torque(self, limits: Mapping[int, float]) -> None:
        """How strong motors may be, by channel: a share 0 ... 1 of their full torque."""
        raise StateError("this board cannot limit the torque of its motors")

    def scale_torque(self, share: float, channels: Sequence[int] | None = None) -> None:
        """Let motors that are on have this share of their torque, 0 ... 1: on the way to a release.

        ``channels``: of these only; None: of all. Whatever switches one off, or on again, ends it.
        """
        raise StateError("this board cannot take the torque of its motors away by and by")

    def clear_faults(self) -> None:
        """The user has read what went wrong: end what is latched of outputs that are off. Moves nothing."""

    def use_signals(self, signals: Signals) -> None:
        """Set inputs and outputs up, as ``configure`` does channels; their levels are in each ``Readback``.

        An output stays as it is where the board can tell that it is one.
        """
        raise StateError("this board has no inputs or outputs beside those of the joints")

    def set_output(self, name: str, value: float) -> None:
        """Switch an output that moves no joint, as ``Readback.outputs`` names it: 0, 1, or a share.

        Of ``Signals`` that is the level of its pin.
        """
        raise StateError("this board has no outputs beside those of the joints")


def abilities_of(driver: object) -> tuple[str, ...]:
    """The methods of ``Abilities`` that a driver has."""
    names = ("release_channels", "limit_torque", "scale_torque", "use_signals", "set_output")
    own = type(driver) if isinstance(driver, Abilities) else Abilities
    return tuple(name for name in names if getattr(own, name) is not getattr(Abilities, name))


# The outputs of a board: how they are called and counted, and what each may be sent.


@dataclass(frozen=True, slots=True)
class ChannelScale:
    """How a board names its outputs, and how finely it takes their setpoints."""

    noun: str  # what the user calls an output of this board: channel, pin, axis
    unit: str  # of setpoints
    steps: int = 1  # of the board in one unit

    @property
    def step(self) -> float:
        """The smallest change of a setpoint, in the unit."""
        return 1 / self.steps

    def whole_range(self, settings: ChannelSettings) -> tuple[int, int]:
        """The first and the last whole step inside the range: rounding a setpoint must not lead out of it."""
        return math.ceil(settings.minimum * self.steps), math.floor(settings.maximum * self.steps)

    def holds_range(self, settings: ChannelSettings, lowest: int, highest: int) -> bool:
        """Whether the range is finite, holds a whole step and lies within ``lowest`` … ``highest`` steps."""
        if not (math.isfinite(settings.minimum) and math.isfinite(settings.maximum)):
            return False
        first, last = self.whole_range(settings)
        return lowest <= settings.minimum * self.steps and first <= last <= highest


class ChannelTable:
    """The configured channels of a board, and the last check before the wire; ``check`` raises to refuse."""

    def __init__(
        self,
        scale: ChannelScale,
        settings: Sequence[ChannelSettings] = (),
        check: Callable[[ChannelSettings], None] | None = None,
    ) -> None:
        self._scale = scale
        self._settings: dict[int, ChannelSettings] = {}
        for one in settings:
            if check is not None:
                check(one)
            if one.channel in self._settings:
                raise BoardError(
                    f"{scale.noun} {one.channel} is configured twice; give each joint its own {scale.noun}"
                )
            self._settings[one.channel] = one
        self._ranges: dict[int, tuple[float, float, int, int]] = {}
        """by channel that was admitted before: its range, and the first and the last step of it"""
        self.channels = tuple(sorted(self._settings))
        """the configured channels, lowest first"""
        self.settings = tuple(self._settings[channel] for channel in self.channels)
        """their settings, in the same order"""

    def of(self, channel: int) -> ChannelSettings | None:
        """The settings of a channel; None: it is not configured."""
        return self._settings.get(channel)

    def whole_range(self, channel: int) -> tuple[int, int]:
        """The first and the last step that a configured channel may be sent."""
        return self._scale.whole_range(self._settings[channel])

    def admit(self, channel: int, value: float) -> int:
        """A setpoint [the board's unit] in whole steps; ``BoardError`` where it may not be sent."""
        scale = self._scale
        if channel not in self._ranges and (settings := self._settings.get(channel)) is not None:
            self._ranges[channel] = (settings.minimum, settings.maximum, *scale.whole_range(settings))
        limits = self._ranges.get(channel)
        if limits is None:
            known = ", ".join(map(str, self.channels)) or "none"
            raise BoardError(
                f"{scale.noun} {channel} is not configured (configured: {known}); nothing was sent"
            )
        # Written so that a NaN, which compares false with everything, is refused too.
        minimum, maximum, first, last = limits
        if not minimum <= value <= maximum:
            raise BoardError(
                f"{scale.noun} {channel}: "
                f"{out_of_range(value, minimum, maximum, scale.unit)}; nothing was sent"
            )
        return min(last, max(first, round(value * scale.steps)))


def switch_off(
    line: str,
    board: str,
    noun: Literal["channel", "pin"],
    outputs: Sequence[int],
    attempts: int,
    attempt: Callable[[Sequence[int]], Sequence[int]],
) -> None:
    """Switch outputs off in some attempts. ``BoardTimeoutError``: the board does not confirm it.

    ``attempt`` tells those that are on to go off, and gives those that do not say so.
    """
    on = outputs
    for _ in range(attempts):
        on = attempt(on)
        if not on:
            return
    raise BoardTimeoutError(ReleaseUnconfirmed(line, board, noun, tuple(on)))


def translated(doing: str, action: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
    """What ``action`` gives; an exception that is not armctl's becomes a ``BoardError``, its cause kept.

    Boards of other packages may raise anything.
    """
    try:
        return action(*args, **kwargs)
    except ArmctlError:
        raise
    except Exception as error:
        raise BoardError(f"{doing}: {type(error).__name__}: {error}") from error

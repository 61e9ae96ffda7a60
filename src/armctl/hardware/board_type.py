"""What a kind of board tells of itself: everything that the rest of armctl asks of it, its check-up too.

A kind of board stands in one folder. Its descriptor, a ``BoardType``, is made known by one line in
``boards.py``, or, from another package, by an entry point in the group ``armctl.boards``. Every program that
loads a robot file imports the descriptors, so they import a driver only when one is asked for.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from enum import Enum
from functools import partial
from typing import TYPE_CHECKING, ClassVar, Protocol, TypeAlias

import numpy as np

from armctl.errors import BoardError, PortError
from armctl.hardware.driver import ChannelScale, ChannelSettings, Driver, translated
from armctl.lazy_dataclass import dataclass
from armctl.robot.board_entries import BoardEntries
from armctl.robot.signals import InputKind, OutputKind, Signals

if TYPE_CHECKING:
    from armctl.hardware.servo_records import KeptSettings
    from armctl.hardware.servos import ServoSetup
    from armctl.hardware.transport import Connection, PortInfo, Transport
    from armctl.robot import Robot

ANY_PRODUCT = None
"""stands for every product number of a USB vendor"""


class SimulatedPins:
    """Of a simulated board: what is connected to its inputs."""

    def __init__(self) -> None:
        self.levels: dict[int, float] = {}
        """by channel, 0 ... 1 of the board's supply; what is not in it is not connected"""


class ByteModel(Protocol):
    """A simulated board: its behaviour behind its serial line.

    Whoever carries its bytes calls ``advance`` with the time before every ``feed``. Either may raise
    ``BoardError``: the board has left the line.
    """

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host, any number at a time, and return what the board answers."""
        ...

    def advance(self, now: float) -> bytes:
        """Let time pass up to ``now`` [s] and return what the board sends unasked."""
        ...

    def reset(self) -> None:
        """Start anew, as after its reset button or a power cut."""


Kept: TypeAlias = "Callable[[str | None], Mapping[int, KeptSettings]]"
"""the settings of servos that were kept as right, by id, of the board with a serial number"""


def nothing_kept(_serial_number: str | None) -> Mapping[int, KeptSettings]:
    """No settings were kept."""
    return {}


@dataclass(frozen=True, slots=True)
class Setup:
    """What a robot needs of its board."""

    channels: Sequence[ChannelSettings] = ()
    settings: object = None
    """what ``BoardType.entries`` has read from the robot file besides the map of the outputs"""
    robot: Robot | None = None
    """for a simulated board that simulates the arm, too"""
    kept: Kept = nothing_kept

    @property
    def signals(self) -> Signals:
        """The robot's inputs and outputs beside its channels."""
        return Signals() if self.robot is None else self.robot.signals


@dataclass(frozen=True, slots=True)
class Introduction:
    """What a board says of itself."""

    name: str  # of the board, or of its firmware
    version: str | None = None  # of the firmware
    details: tuple[str, ...] = ()  # what else it told, in words
    reported: tuple[str, ...] = ()  # errors that it had kept from before, in words; they are cleared now


class Listener(Protocol):
    """Recognises one kind of board by what it sends unasked."""

    def feed(self, data: bytes) -> Introduction | None:
        """Take what came, in any pieces; the introduction once it is complete."""
        ...


@dataclass(frozen=True, slots=True)
class SimulatorOption:
    """An option of ``armctl simulate`` for one kind of board: a choice among words, a number, or a flag."""

    name: str
    help: str
    choices: tuple[str, ...] = ()  # the words
    between: tuple[float, float] | None = None  # the smallest and the largest number; neither of both: a flag
    whole: bool = False  # whether the number is a whole one


SimulatorOptions: TypeAlias = Mapping[str, str | float | bool | None]
"""the values that were given, by the options' names: a word, a number, whether a flag was, or None"""
NEEDED = ("kind", "title", "plugged_in", "scale", "entries")
"""what every board has to say of itself"""


class BoardType(ABC):
    """A kind of board. What is given a value here holds for boards that say nothing else."""

    kind: ClassVar[str]  # in robot files, on the command line
    title: ClassVar[str]  # in sentences: "Pololu Maestro"
    plugged_in: ClassVar[str]  # what a user looks for on the desk: "Maestro", "Arduino"
    scale: ClassVar[ChannelScale]  # noun, unit and steps of its channels
    entries: ClassVar[BoardEntries]  # reads its part of a robot file
    inputs: ClassVar[tuple[InputKind, ...]] = ()
    """the kinds of inputs that it has beside its channels"""
    outputs: ClassVar[tuple[OutputKind, ...]] = ()
    """the kinds of outputs likewise"""
    usb: ClassVar[Mapping[tuple[int, int | None], str]] = {}
    """how a port is listed, by USB vendor and product (``ANY_PRODUCT``)"""
    likely: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """how a port with this board may be listed, likeliest first; those of one group are as likely"""
    shared: ClassVar[tuple[str, ...]] = ()
    """which of these are listings behind which another kind of board may be as well"""
    scheme: ClassVar[str | None] = None
    """what stands before ``://`` in the addresses that only this kind of board has; it opens them itself"""
    stands_behind: ClassVar[str | None] = None
    """the kind of board that answers for it on a serial port, where it stands behind another board"""
    baud: ClassVar[int] = 115_200  # at which its line is opened
    restarts: ClassVar[bool] = False
    """whether opening its port starts it anew: it may take seconds to answer then"""
    homing: ClassVar[bool] = False
    """whether it must find the zeros of its axes, after which the arm stays where that ended"""
    power: ClassVar[str] = "pulses"  # what Enable switches on and Release off
    slowest_answer_s: ClassVar[float] = 0.05  # on a line whose answers take longer nothing is enabled
    sag_deg: ClassVar[float] = 1.0
    """A measured joint that stands farther than this from its setpoint is reported. Proportional control lets
    a joint sag under its load."""
    off_when_left: ClassVar[bool] = False
    """whether it switches its outputs off when no program speaks to it any more"""
    limits_acceleration: ClassVar[bool] = False  # whether it is to keep acceleration limits of its own
    advice: ClassVar[str] = "check its cable and its power"  # what to do where it does not answer
    simulator_robot: ClassVar[str | None] = None
    """whose channels the simulated board has unless another robot is named; None: it needs no robot"""
    simulator_help: ClassVar[str] = ""
    simulator_options: ClassVar[tuple[SimulatorOption, ...]] = ()

    @abstractmethod
    def driver(self, setup: Setup, connection: Connection) -> Driver:
        """A driver, not opened yet."""

    @abstractmethod
    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        """A simulated board, set up for a robot; ``options`` by name, as ``simulator_options`` has them."""

    def settings_type(self) -> type | None:
        """Of what ``entries`` reads besides the map of the outputs (None: nothing), for ``msgspec.convert``.

        The arm process is told it as a record.
        """
        return None

    def check(self, setup: Setup) -> None:  # noqa: B027
        """Raise ``BoardError`` for a setup that the largest board of this kind would refuse."""

    def listed_by_name(self, stable_name: str) -> str | None:
        """How a port is listed of which only udev's stable name is known; None: not this board."""
        return None

    def own_ports(self) -> Sequence[PortInfo]:
        """The addresses of its own that this computer has; opens none."""
        return ()

    def open_line(self, port: str) -> Transport:
        """Open one of its own addresses; ``PortError`` says why it cannot be opened, and what to do."""
        raise PortError(f"{port}: a {self.title} has no addresses of its own")

    def port_refusal(self, listing: str, interface: int | None) -> str | None:
        """Why a port of this board is the wrong one to use; ``interface``: its USB interface number."""
        return None

    def listener(self) -> Listener | None:
        """Recognises a board that introduces itself; None: it never speaks unasked."""
        return None

    def ask(self, line: Transport, now: Callable[[], float]) -> Introduction | None:
        """Ask, upsetting no board that is asked later; None: no answer. ``BoardProtocolError``: a fault."""
        return None

    def servo_setup(
        self, open_line: Callable[[int], Transport], now: Callable[[], float], *, simulated: bool = False
    ) -> ServoSetup | None:
        """Its servos, to be set up; ``open_line`` opens the port at a baud rate, which is not done yet.

        None: it has none that could be.
        """
        return None

    def examine(self, check_up: CheckUp) -> list[Finding]:
        """Everything that can be asked of a board without moving or changing anything."""
        return [not_checked("channels", f"a {self.title} cannot be asked for more")]

    @property
    def own_listings(self) -> tuple[str, ...]:
        """How a port is listed that has this kind of board for certain."""
        return tuple(name for group in self.likely for name in group if name not in self.shared)


_UNDERSTOOD_WITHIN_S = 1.0
"""how long a board may speak without being understood"""
_KEPT = 64


def listen(
    line: Transport,
    listeners: Sequence[Listener],
    for_s: float,
    now: Callable[[], float],
    until: Callable[[], bool] = lambda: False,
) -> tuple[tuple[int, Introduction] | None, bytes]:
    """The first of the listeners to recognise a board, by its place, with the introduction; the first bytes.

    Ends after ``for_s`` [s], earlier where a board speaks that no listener understands, and when ``until``
    says so.
    """
    from armctl.hardware.transport import pieces  # pyserial: 10 ms that `armctl ik` does not need

    first = bytearray()
    give_up_at = math.inf
    for data in pieces(line, for_s, now):
        for place, listener in enumerate(listeners):
            if (found := translated("listening to the port", listener.feed, data)) is not None:
                return (place, found), bytes(first)
        if data and not first:
            give_up_at = now() + _UNDERSTOOD_WITHIN_S
        first += data[: _KEPT - len(first)]
        if until() or now() >= give_up_at:
            break
    return None, bytes(first)


# How Arduinos, and the chips on clones of them, are listed: several kinds of board are such a one.

ARDUINO_MEGA = "Arduino Mega"
USB_SERIAL = "Arduino or clone (USB-serial)"
ARDUINO_LIKELY = ((ARDUINO_MEGA,), (USB_SERIAL,))
"""what calls itself a Mega goes before what may be anything"""

_ARDUINO_VENDORS = (0x2341, 0x2A03)
_MEGAS = (
    *((vendor, product) for vendor in _ARDUINO_VENDORS for product in (0x0010, 0x0042)),
    (0x2341, 0x0210),
    (0x2341, 0x0242),
)
_CHIPS = (
    (0x1A86, 0x7523),  # CH340
    (0x1A86, 0x5523),  # CH341
    (0x1A86, 0x55D4),  # CH9102
    (0x0403, 0x6001),  # FT232R
    (0x0403, 0x6015),  # FT231X
    (0x10C4, 0xEA60),  # CP2102
    (0x067B, 0x2303),  # PL2303
)
"""Chips on clones of the Mega and the Uno, and in plain adapter cables: the numbers do not tell which."""
ARDUINO_USB: Mapping[tuple[int, int | None], str] = {
    **dict.fromkeys(_MEGAS, ARDUINO_MEGA),
    **dict.fromkeys(_CHIPS, USB_SERIAL),
    **{(vendor, ANY_PRODUCT): USB_SERIAL for vendor in _ARDUINO_VENDORS},
}


# The check-up of a board: its findings, what it starts from, and how long answers take.


class Verdict(Enum):
    """How a check ended."""

    OK = "ok"
    WARNING = "warning"
    FAILED = "failed"
    NOT_CHECKED = "not checked"


@dataclass(frozen=True, slots=True)
class Finding:
    """One check: what was looked at, what was seen, and what to do about it."""

    check: str
    verdict: Verdict = field(kw_only=True)
    seen: str
    advice: str = ""


ok = partial(Finding, verdict=Verdict.OK)
warning = partial(Finding, verdict=Verdict.WARNING)  # it works, but the user should know
failed = partial(Finding, verdict=Verdict.FAILED)
not_checked = partial(Finding, verdict=Verdict.NOT_CHECKED)  # unknown, or an earlier failure stands before it


@dataclass(frozen=True, slots=True)
class ChannelsToCheck:
    """The channels of a robot file, or why none can be checked."""

    channels: Sequence[ChannelSettings] = ()
    why_none: str = "no robot was named"
    advice: str = "name one with --robot"

    def not_known(self, check: str) -> Finding:
        """The finding of a check that takes a robot file for this board."""
        return not_checked(check, self.why_none, self.advice)


OF_ANOTHER_BOARD = ChannelsToCheck(
    why_none="the robot file is for another kind of board", advice="choose the robot that belongs to this one"
)


@dataclass(frozen=True, slots=True)
class CheckUp:
    """A board that answers and is to be examined."""

    line: Transport  # open
    now: Callable[[], float]  # the clock [s]
    needs: ChannelsToCheck = ChannelsToCheck()
    listing: str | None = None  # how the port is listed; None: it is not
    reported: tuple[str, ...] = ()  # errors that the board had kept from before
    simulated: bool = False
    settings: object = None  # what the robot file says of the board besides the map of the outputs


# How long questions to a board and their answers take.

_CHECK = "round trips"
_ROUNDS = 50
_TICK_S = 0.020
_SLOW_MEDIAN_S = 0.010
_MOST_LATE = _ROUNDS // 20

_SLOW_ADVICE = (
    "the arm is controlled every 20 ms, and each time the board is asked once: plug it into the computer "
    "itself, not into a hub; where an FTDI adapter holds answers back for 16 ms all the same, set its "
    "latency timer to 1 (/sys/bus/usb-serial/devices/ttyUSB0/latency_timer); a busy computer is late as well"
)


def round_trips(ask: Callable[[], object], now: Callable[[], float]) -> Finding:
    """Ask often (``ask`` raises ``BoardError`` without an answer) and say how long it took [ms]."""
    took: list[float] = []
    for _ in range(_ROUNDS):
        before = now()
        try:
            ask()
        except BoardError as error:
            return failed(_CHECK, f"{len(took)} of {_ROUNDS} answered, then: {error}")
        took.append(now() - before)
    late, median = sum(one > _TICK_S for one in took), float(np.median(took))
    seen = f"{_ROUNDS} questions answered, median {1000 * median:.1f} ms, worst {1000 * max(took):.1f} ms"
    if median > _SLOW_MEDIAN_S or late > _MOST_LATE:
        return warning(_CHECK, f"{seen}, {late} later than 20 ms", _SLOW_ADVICE)
    return ok(_CHECK, seen)

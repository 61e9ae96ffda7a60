"""What a make of bus servos says of itself; the rest of the bus asks nothing else of it."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from operator import attrgetter

import msgspec

from armctl.errors import BoardError, BoardTimeoutError, EnableError, InputError
from armctl.facts.servos import (
    ServoNotTaken,
    ServoOutside,
    ServoTorqueOn,
    ServoTurned,
    ServoTurning,
    ServoUnconfirmed,
    ServoUnfit,
)
from armctl.hardware.bus.line import BusLine
from armctl.hardware.bus.packets import BusPacket, PacketForm
from armctl.hardware.bus.table import ControlTable
from armctl.hardware.servos import ServoSettings
from armctl.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Block:
    """Bytes of the control table that are read in one piece."""

    address: int
    size: int


@dataclass(frozen=True, slots=True)
class Limits:
    """What a servo may do, of its own accord, under torque."""

    torque: float = 1.0
    """a share 0 ... 1 of its full torque"""
    speed: float | None = None
    """[steps/s]; None: all that it can"""


class Telemetry(msgspec.Struct, frozen=True):
    """What a servo says of itself at one reading; None: that reading does not tell."""

    position: int | None = None
    """[steps]"""
    goal: int | None = None
    """[steps]"""
    on: bool | None = None
    """whether its torque is on"""
    torque_limit: float | None = None
    """how strong its motor may be now, a share 0 ... 1"""
    load: float | None = None
    """signed share of its largest"""
    voltage: float | None = None
    """of its supply [V]"""
    temperature: float | None = None
    """[°C]"""
    current: float | None = None
    """[A]"""
    faults: tuple[str, ...] | None = None
    """what is wrong, in words; empty: nothing is"""
    latched: tuple[str, ...] | None = None
    """what has gone wrong and lasts until ``ServoMake.clear``, in words"""
    gave_way: bool | None = None
    """whether it has given way to an overload, which its next goal ends"""
    unloaded: bool | None = None
    """whether its motor is off though its torque is on, until what is wrong with it has ended"""
    forgot: bool | None = None
    """whether what it is told before torque is not there any more: it has started anew"""
    refuses: bool | None = None
    """whether it holds by itself and takes no goals until it is taken over again"""

    @property
    def wrong(self) -> tuple[str, ...]:
        """All that is wrong, in words."""
        return (*(self.faults or ()), *(self.latched or ()))

    def after(self, before: Telemetry) -> Telemetry:
        """This, and what the one before tells besides."""
        pairs = zip(_VALUES(self), _VALUES(before), strict=True)
        return Telemetry(*[then if now is None else now for now, then in pairs])


_VALUES = attrgetter(*Telemetry.__struct_fields__)


class ServoMake(ABC):
    """A make of bus servos, whose table and packets are the same for all of them on a line."""

    title: str  # "Feetech servo bus"
    form: PacketForm
    table: ControlTable
    steps_per_turn: float
    last_step: int
    """the largest position"""
    bauds: Sequence[int]
    """all that its servos may be set to, the likeliest first"""
    baud_register: str
    baud_numbers: Mapping[int, int]
    """by rate, what stands for it in that register"""
    registers: Mapping[str, str]
    """what its table calls ``offset``, ``lowest``, ``highest`` and ``mode``, where it calls them otherwise"""
    telemetry: Block
    """read from all servos at each reading"""
    in_turn: Sequence[Block] = ()
    """read from one servo at each reading, one after the other"""
    limits_torque = True
    """whether its torque can be limited while it is on"""
    wakes_locked = True
    """whether its EEPROM is closed after its supply has come"""
    keeps_limit = False
    """whether a torque limit that is another one shows that a servo has started anew"""
    goal_address: int
    delay_register: str | None = None
    """by which a servo waits before it answers; None: it does not"""
    watchdog_ms: int | None = None
    """after how long a silence it stops by itself under torque; None: never"""
    models: Mapping[int, str]
    """names of model numbers"""

    @property
    def still_steps(self) -> float:
        """How far a servo may turn while its torque is switched on: one degree [steps]."""
        return self.steps_per_turn / 360

    @abstractmethod
    def understood(self, packet: BusPacket, block: Block) -> Telemetry:
        """What an answer with the bytes of ``block`` tells."""

    @abstractmethod
    def settings(self, line: BusLine, servo: int) -> ServoSettings:
        """Read its EEPROM; ``BoardTimeoutError`` where it does not answer."""

    @abstractmethod
    def goal_bytes(self, steps: int) -> bytes:
        """A goal as it is written at ``goal_address``."""

    @abstractmethod
    def prepare(self, line: BusLine, servo: int, limits: Limits) -> None:
        """Set what must be right before torque: its limits of speed and of torque, in RAM."""

    @abstractmethod
    def on_at(self, line: BusLine, servo: int, position: int) -> None:
        """The end of the rite: goal, read back, torque, read back; ``EnableError`` says what went wrong."""

    @abstractmethod
    def off(self, line: BusLine, servo: int) -> bool:
        """Torque off; whether the servo confirms it."""

    @abstractmethod
    def limit_torque(self, line: BusLine, servo: int, share: float) -> bool:
        """How strong its motor may be, 0 ... 1; whether the servo confirms it."""

    def is_one(self, line: BusLine, servo: int) -> bool:
        """Whether one that answers is of this make and series; ``BoardTimeoutError``: it is silent now."""
        return True

    def hold_here(self, line: BusLine, servo: int) -> int | None:
        """Make the place where a servo is its goal [steps]; None: it did not confirm."""
        try:
            place = self.position(line, servo)
        except BoardTimeoutError:
            return None
        return None if line.write(servo, self.goal_address, self.goal_bytes(place)) is None else place

    def unlock(self, line: BusLine, servo: int) -> None:  # noqa: B027
        """Let its EEPROM keep what is written."""

    def lock(self, line: BusLine, servo: int) -> None:  # noqa: B027
        """Protect its EEPROM again."""

    def require_limp(self, line: BusLine, servo: int) -> None:
        """Refuse (``BoardError``) to write the EEPROM of a servo whose torque is on."""
        torque = self.table["torque"]
        if any(line.read(servo, torque.address, torque.size).data):
            raise BoardError(ServoTorqueOn(servo))

    def write_kept(
        self, line: BusLine, servo: int, name: str, number: int, answers_as: int | None = None
    ) -> None:
        """Write a register of the EEPROM, lock it, and read it back; ``answers_as``: its id after that.

        ``BoardError``: its torque is on, or it did not take the number.
        """
        if name not in self.table or not self.table[name].kept:
            kept = ", ".join(one.name for one in self.table.registers if one.kept and one.writable)
            raise InputError(f"servo {servo} keeps no {name!r}; it keeps {kept}")
        register = self.table[name]
        data = self.table.encode(name, number)
        self.require_limp(line, servo)
        self.unlock(line, servo)
        after = servo
        try:
            line.write(servo, register.address, data)  # what it answers may get lost: it is read back
            if answers_as is not None and line.ping(answers_as) is not None:
                after = answers_as
        finally:
            self.lock(line, after)
        kept = line.read(after, register.address, register.size, more=True).data
        if kept != data:
            raise BoardError(ServoNotTaken(servo, number, name))

    def put(self, line: BusLine, servo: int, name: str, number: int) -> BusPacket:
        """Write a register; what the servo answers. ``BoardTimeoutError``: it does not confirm that."""
        answer = line.write(servo, self.table[name].address, self.table.encode(name, number))
        if answer is None:
            raise BoardTimeoutError(ServoUnconfirmed(servo, "told"))
        return answer

    def sound(self, servo: int, answer: BusPacket) -> BusPacket:
        """``answer``; ``EnableError`` where it tells of an error with which no torque may be on."""
        return answer

    def set_goal(self, line: BusLine, servo: int, position: int, *, more: bool = False) -> Telemetry:
        """Make the place where it stands its goal, read back, with ``more`` as ``BusLine.read`` has it.

        ``EnableError``: it did not take that, or turns.
        """
        self.put(line, servo, "goal_position", position)
        block = self.telemetry
        answer = self.sound(servo, line.read(servo, block.address, block.size, more=more))
        seen = self.understood(answer, block)
        if seen.goal != position or seen.position is None:
            raise EnableError(ServoNotTaken(servo, position, "goal", seen.goal))
        if abs(seen.position - position) > self.still_steps:
            raise EnableError(ServoTurning(servo, enabling=True))
        return seen

    def require_on(self, line: BusLine, servo: int) -> BusPacket:
        """What it answers once its torque is on; ``EnableError``: it is not."""
        answer = self.sound(servo, line.read(servo, self.table["torque"].address, 1, more=True))
        if answer.data[0] != 1:
            raise EnableError(ServoUnconfirmed(servo, "on"))
        return answer

    def clear(self, line: BusLine, servo: int) -> bool:
        """End what is latched of a limp servo; whether it starts anew for that, and is silent for a while."""
        return False

    def position(self, line: BusLine, servo: int) -> int:
        """Where it stands now [steps], from two answers that agree; a late answer is taken for none."""
        register = self.table["present_position"]
        last: int | None = None
        for _ in range(_AGREE_ATTEMPTS):
            packet = line.read(servo, register.address, register.size, more=True)
            found = self.table.decode("present_position", packet.data)
            if last is not None and abs(found - last) <= _AGREE_STEPS:
                return found
            last = found
        raise EnableError(ServoTurning(servo))


SAG_DEG = 4.0
"""how far a joint may hang from its goal under its load: control is proportional"""
_AGREE_STEPS = 3
"""by which two readings of a servo may differ, one right after the other, though a hand turns it"""
_AGREE_ATTEMPTS = 6


def bring_on(
    make: ServoMake, line: BusLine, servo: int, settings: ServoSettings, expected: float, limits: Limits
) -> tuple[int, bool]:
    """Bring a servo under goals: the goal [steps] at which it holds now, and whether it was limp before.

    ``expected`` [steps] is where it was looked at last. ``EnableError``: it has moved by more than a degree
    since, it stands outside its own limits, it is not fit, or it did not confirm. One that was limp is limp
    then again; where it does not confirm that, the error says so.
    """
    block = make.telemetry
    seen = make.understood(line.read(servo, block.address, block.size), block)
    for more in make.in_turn:
        seen = make.understood(line.read(servo, more.address, more.size), more).after(seen)
    try:
        if seen.on:
            return _take_over(make, line, servo, settings, seen, limits), False
        return _switch_on(make, line, servo, settings, expected, limits), True
    except (EnableError, BoardTimeoutError) as error:
        if seen.on or make.off(line, servo):
            raise
        raise EnableError(
            f"{error}. Servo {servo} did not confirm that its torque is off again: cut the power of the "
            "servos before you reach in"
        ) from error


def _switch_on(
    make: ServoMake, line: BusLine, servo: int, settings: ServoSettings, expected: float, limits: Limits
) -> int:
    """The torque-on rite; the goal [steps]."""
    _require_still(make, line, servo, settings, expected)
    make.prepare(line, servo, limits)
    place = _require_still(make, line, servo, settings, expected)
    make.on_at(line, servo, place)
    return place


def _take_over(
    make: ServoMake, line: BusLine, servo: int, settings: ServoSettings, seen: Telemetry, limits: Limits
) -> int:
    """Take over one whose torque is on already; the goal [steps].

    It keeps the goal that it was found with, from which it sags. Where it is farther from it than that, or
    weak, it would be thrown there by its new limits: it holds where it stands then, and so does one that
    refuses goals.
    """
    place = make.position(line, servo)
    _require_fit(make, servo, settings, place)
    goal = place if seen.goal is None else seen.goal
    weak = seen.torque_limit is not None and seen.torque_limit < limits.torque
    room = make.still_steps * (1.0 if weak else SAG_DEG)
    if seen.refuses or seen.gave_way or abs(goal - place) > room:
        goal = place
        make.on_at(line, servo, place)
    make.prepare(line, servo, limits)
    return goal


def _require_still(
    make: ServoMake, line: BusLine, servo: int, settings: ServoSettings, expected: float
) -> int:
    """Where it stands [steps]; refused where it has turned, or torque would throw it."""
    place = make.position(line, servo)
    if abs(place - expected) > make.still_steps:
        raise EnableError(ServoTurned(servo, math.tau * abs(place - expected) / make.steps_per_turn))
    _require_fit(make, servo, settings, place)
    return place


def _require_fit(make: ServoMake, servo: int, settings: ServoSettings, place: int) -> None:
    """Refuse what its EEPROM makes dangerous: a goal outside of its own limits becomes another one."""
    if settings.unfit is not None:
        raise EnableError(ServoUnfit(servo, settings.unfit))
    if not settings.lowest <= place <= settings.highest:
        away = math.tau * max(settings.lowest - place, place - settings.highest) / make.steps_per_turn
        raise EnableError(ServoOutside(servo, place, settings.lowest, settings.highest, away))

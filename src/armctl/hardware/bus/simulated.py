"""A simulated servo bus: servos behind one half-duplex line, and the arm that they turn."""

from __future__ import annotations

import math
import random
from abc import ABC, abstractmethod
from collections.abc import Sequence

from armctl.hardware.bus.packets import BROADCAST, BusPacket, Instruction, PacketForm, PacketReader
from armctl.hardware.bus.plant import ArmPlant, PlantJoint
from armctl.hardware.bus.table import ControlTable
from armctl.hardware.driver import ChannelSettings
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot

_PAUSE_S = 0.005
"""a silence after which a servo expects the beginning of a packet"""
_ROOM_C, _WARM_S, _HEAT_C = 25.0, 400.0, 70.0
"""room; how long a servo takes to get warm [s]; how much warmer it gets at full load for good [°C]"""
_LATE_S = 0.1
"""without time that long somebody else was late than the host"""


@dataclass
class Supply:
    """What feeds the servos: it droops under load."""

    open_v: float = 12.0
    ohms: float = 0.1
    amps: float = 0.0
    """drawn now"""

    @property
    def volts(self) -> float:
        """What is left for the servos."""
        return max(0.0, self.open_v - self.ohms * self.amps)


@dataclass(frozen=True, slots=True)
class Gear:
    """How the steps of a servo and the angle of its joint belong together: steps = zero + per_rad · angle."""

    zero: float
    per_rad: float

    def steps(self, angle: float) -> float:
        """Of a joint angle [rad]."""
        return self.zero + self.per_rad * angle

    def angle(self, steps: float) -> float:
        """[rad] of a position in steps."""
        return (steps - self.zero) / self.per_rad


class BusServo(ABC):
    """One servo: a control table, a motor on a joint, and what it makes of instructions.

    A make fills the table (``power_up``), says what a write means (``written``), keeps its measured values
    (``measure``) and moves its motor (``drive``, a share -1 ... 1 of the stall torque).
    """

    stall_amps = 2.7
    full_speed = 4.7
    """of the shaft without load at full voltage [rad/s]"""

    def __init__(
        self, table: ControlTable, joint: PlantJoint, gear: Gear, supply: Supply, memory: bytes
    ) -> None:
        """``memory``: what the table holds from the factory, and which part of it an EEPROM keeps."""
        self.table, self.joint, self.gear, self.supply = table, joint, gear, supply
        self.memory = bytearray(memory)
        self.share = 0.0
        """of its torque that the motor gives now, signed in steps"""
        self._effort = 0.0
        self.heat = _ROOM_C
        """[°C]"""
        self.silent_s = 0.0
        """how long it does not listen, because it starts anew"""
        self._put_off: BusPacket | None = None
        self._numbers: dict[str, int] = {}
        joint.drives.append(self)

    # The control table.

    def get(self, name: str) -> int:
        """A number of the table."""
        try:
            return self._numbers[name]
        except KeyError:  # since it was written
            number = self._numbers[name] = self._decoded(name)
            return number

    def _decoded(self, name: str) -> int:
        return self.table.decode(name, self.memory, 0)

    def put(self, name: str, number: int) -> None:
        """Set a number of the table, as its own electronics do."""
        if self._numbers.get(name) == number:
            return
        register = self.table[name]
        self.memory[register.address : register.end] = self.table.encode(name, number)
        self._numbers[name] = number

    def store(self, address: int, data: bytes) -> None:
        """Put bytes into the table."""
        size = len(self.memory)
        self.memory[address : address + len(data)] = data[: max(0, size - address)]
        self._numbers.clear()

    @property
    def id(self) -> int:
        """Its address on the bus."""
        return self.get("id")

    @property
    def shaft(self) -> float:
        """Where its shaft is [steps], before any offset."""
        return self.gear.steps(self.joint.angle)

    # What a make says.

    @abstractmethod
    def power_up(self) -> None:
        """What the table holds after its supply has come."""

    @abstractmethod
    def errors(self) -> int:
        """The error byte of its answers, without what this instruction is refused for."""

    @abstractmethod
    def written(self, address: int, data: bytes) -> int:
        """Take what a host writes; the error of it, 0: none."""

    @abstractmethod
    def measure(self) -> None:
        """Put what it measures into its table."""

    @abstractmethod
    def drive(self, dt: float) -> float:
        """The share -1 ... 1 of its torque that it gives towards more steps, for the next ``dt`` [s]."""

    @abstractmethod
    def answers(self, instruction: int) -> bool:
        """Whether its status level lets it answer this."""

    def overhear(self) -> None:  # noqa: B027
        """Somebody was told something, whoever is meant."""

    @abstractmethod
    def other(self, packet: BusPacket) -> BusPacket | None:
        """An instruction that only this make has; None: no answer."""

    # The motor.

    def torque(self, angle: float, speed: float) -> float:
        """What it does at its joint [N·m]."""
        way = math.copysign(1.0, self.gear.per_rad)
        self._effort = 0.0
        if self.share == 0.0 and not self.driven:
            return 0.0
        weak = self.supply.volts / self.supply.open_v if self.supply.open_v else 0.0
        self._effort = way * self.share * weak - speed / self.full_speed
        return self.joint.stall / len(self.joint.drives) * self._effort

    @property
    def driven(self) -> bool:
        """Whether its bridge is on, which brakes a shaft that turns."""
        return self.get("torque") == 1

    def begin(self, dt: float) -> None:
        """Before a step of the simulation."""
        if self.silent_s > 0.0:
            self.silent_s -= dt
            self.share = 0.0
            return
        self.share = self.drive(dt)
        self.heat += dt / _WARM_S * (_ROOM_C + _HEAT_C * self._effort**2 - self.heat)

    @property
    def amps(self) -> float:
        """What its motor draws."""
        return min(1.0, abs(self._effort)) * self.stall_amps

    def restart(self, silent_s: float = 0.0) -> None:
        """Its supply was interrupted: what is not in the EEPROM is lost."""
        self.silent_s, self.share, self._put_off = silent_s, 0.0, None
        self.power_up()

    # Instructions.

    def handle(self, packet: BusPacket, form: PacketForm) -> BusPacket | None:
        """What it answers to an instruction that is for it, or for all."""
        if self.silent_s > 0.0:
            return None
        self.measure()
        number, data, status = self.id, b"", self.errors()  # the old id answers the write of a new one
        match packet.code:
            case Instruction.PING:
                data = self.introduction
            case Instruction.READ:
                address, size = form.asked_size(packet)
                data = self.looked_up(address, size)
            case Instruction.WRITE:
                address = int.from_bytes(packet.data[: form.word], "little")
                status |= self.written(address, packet.data[form.word :])
            case Instruction.REG_WRITE:
                self._put_off = packet
            case Instruction.ACTION:
                put_off, self._put_off = self._put_off, None
                if put_off is not None:
                    self.handle(BusPacket(put_off.id, Instruction.WRITE, put_off.data), form)
            case _:
                return self.other(packet)
        if packet.id == BROADCAST and packet.code != Instruction.PING:
            return None
        return BusPacket(number, status, data) if self.answers(packet.code) else None

    introduction = b""
    """what an answer to a ping holds"""

    def looked_up(self, address: int, size: int) -> bytes:
        """Bytes of the table; zeros behind its end."""
        return bytes(self.memory[address : address + size]).ljust(size, b"\0")


class SimulatedBus:
    """A byte model of a bus: ``servos`` in the order in which they are plugged into each other."""

    def __init__(
        self,
        form: PacketForm,
        servos: Sequence[BusServo],
        plant: ArmPlant,
        supply: Supply,
        *,
        echo: bool = False,
    ) -> None:
        self.form, self.servos, self.plant, self.supply, self.echo = form, list(servos), plant, supply, echo
        self.loose: int | None = None
        """the place in the chain whose plug is loose: it and all behind it are not there"""
        self.lost = self.spoilt = self.doubled = 0.0
        """shares of packets, either way, that noise takes, spoils, or doubles"""
        self.heard: list[BusPacket] = []
        """the last instructions"""
        self._random = random.Random(0)
        self._reader = PacketReader(form, status=False)
        self._time = self._fed_at = 0.0
        plant.began.append(self._begin)
        for servo in self.servos:
            servo.power_up()
            servo.measure()

    @property
    def present(self) -> list[BusServo]:
        """The servos that have a line and a supply."""
        return self.servos[: self.loose]

    def servo(self, number: int) -> BusServo:
        """The first servo with this id."""
        return next(one for one in self.servos if one.id == number)

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the host; what the servos answer, behind the echo of an adapter that echoes."""
        answer = bytearray(data if self.echo else b"")
        self.plant.wake()
        if self._time - self._fed_at > _PAUSE_S:
            self._reader.clear()
        self._fed_at = self._time
        for packet in self._reader.feed(data):
            self.heard.append(packet)
            del self.heard[:-64]
            for servo in self.present:
                servo.overhear()
            for _ in range(self._times()):
                answer += self._answered(packet)
        return bytes(answer)

    def advance(self, now: float) -> bytes:
        """Let time pass; servos say nothing unasked."""
        if now - self._time > _LATE_S:  # who carries the bytes was late, which is not the host's silence
            for servo in self.servos:
                servo.overhear()
        self._time = now
        self.plant.advance(now)
        return b""

    def reset(self) -> None:
        """A power cut: every servo starts anew, the arm stays where it is."""
        self._reader.clear()
        for servo in self.servos:
            servo.restart()

    def _begin(self, dt: float) -> None:
        self.supply.amps = sum(one.amps for one in self.servos)
        for servo in self.servos:
            servo.begin(dt)

    def _answered(self, packet: BusPacket) -> bytes:
        form = self.form
        if packet.code == Instruction.SYNC_READ and not form.sync_reads:
            return b""
        if packet.code == Instruction.SYNC_READ:
            address, size = form.asked_size(packet)
            ids, data = packet.data[2 * form.word :], form.number(address) + form.number(size)
            asked = [BusPacket(one, Instruction.READ, data) for one in ids]
            return b"".join(self._said(one) for one in asked)
        if packet.code == Instruction.SYNC_WRITE:
            address, size = form.asked_size(packet)
            rows = packet.data[2 * form.word :]
            for start in range(0, len(rows) - size, size + 1):
                row = form.number(address) + rows[start + 1 : start + 1 + size]
                for servo in self.present:
                    if servo.id == rows[start] and servo.silent_s <= 0.0:
                        servo.handle(BusPacket(BROADCAST, Instruction.WRITE, row), form)
            return b""
        return self._said(packet)

    def _said(self, packet: BusPacket) -> bytes:
        """What comes back of the answers of all servos that a packet is for; at once means spoilt."""
        wanted = [one for one in self.present if packet.id in (one.id, BROADCAST)]
        said = [form for one in wanted if (form := self._say(one, packet))]
        if packet.id == BROADCAST:  # one after the other, by their ids
            return b"".join(said)
        return b"" if not said else said[0] if len(said) == 1 else _at_once(said)

    def _say(self, servo: BusServo, packet: BusPacket) -> bytes:
        answer = servo.handle(packet, self.form)
        if answer is None:
            return b""
        data = bytearray(self.form.status(answer) * self._times())
        if data and self._random.random() < self.spoilt:
            data[self._random.randrange(len(data))] ^= 1 << self._random.randrange(8)
        return bytes(data)

    def _times(self) -> int:
        """How often a packet arrives."""
        if self.lost and self._random.random() < self.lost:
            return 0
        return 2 if self.doubled and self._random.random() < self.doubled else 1


def _at_once(said: Sequence[bytes]) -> bytes:
    """What a host hears where several speak at the same time: a line is low where one of them is."""
    size = max(map(len, said))
    together = int.from_bytes(said[0].ljust(size, b"\xff"), "big")
    for one in said[1:]:
        together &= int.from_bytes(one.ljust(size, b"\xff"), "big") >> 1  # they begin not quite together
    return together.to_bytes(size, "big")


def gears(
    robot: Robot | None, channels: Sequence[ChannelSettings], steps_per_turn: float, last_step: int
) -> dict[int, tuple[int, Gear]]:
    """By servo: the place of its joint in the plant, and how it is geared to it."""
    if robot is None:
        per_rad = steps_per_turn / math.tau
        return {one.channel: (i, Gear((last_step + 1) / 2, per_rad)) for i, one in enumerate(channels)}
    outputs = robot.outputs
    found = {
        channel: (i, Gear(float(outputs.zero[i]), float(outputs.per_rad[i])))
        for i, channel in enumerate(outputs.channels)
    }
    for one in outputs.mirrors:
        first = found[outputs.channels[one.joint]][1]
        found[one.channel] = (one.joint, Gear(one.output(first.zero), one.ratio * first.per_rad))
    if outputs.gripper_channel is not None:
        way = outputs.gripper_open - outputs.gripper_closed
        found[outputs.gripper_channel] = (robot.n, Gear(outputs.gripper_closed, way))
    return found

"""Hiwonder's LX-16A bus servos as a board of armctl, from a package of its own.

The protocol is LewanSoul's "bus servo communication protocol": 115,200 baud, half duplex,
``55 55 id length command parameters checksum``; 1000 steps over 240 degrees. Only reads are answered.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from armctl.errors import BoardError, BoardTimeoutError, EnableError
from armctl.hardware import (
    Abilities,
    BoardIdentity,
    BoardType,
    ByteModel,
    ChannelScale,
    ChannelSettings,
    ChannelTable,
    Introduction,
    Readback,
    ServoEntries,
    Setup,
    SimulatorOptions,
    Source,
)
from armctl.hardware.board_type import CheckUp, Finding, failed, ok
from armctl.hardware.transport import Connection, Transport

STEPS = ChannelScale("servo", "steps")
STEPS_PER_DEG = 1000 / 240
HEAD = b"\x55\x55"
MOVE, READ_POSITION, READ_TEMPERATURE, READ_VOLTAGE, LOAD, READ_LOAD = 1, 28, 26, 27, 31, 32
LISTING = "LX-16A debug board (CH340)"
_ATTEMPTS, _ANSWER_S, _SIMULATED_ANSWER_S = 3, 0.012, 0.15
_STILL_STEPS = STEPS_PER_DEG + 1.0
_TICK_MS = 20
_GONE = 5


def packet(servo: int, command: int, parameters: bytes = b"") -> bytes:
    """The bytes of a packet, either way."""
    body = bytes((servo, len(parameters) + 3, command)) + parameters
    return HEAD + body + bytes((~sum(body) & 0xFF,))


def packets(data: bytes) -> list[tuple[int, int, bytes]]:
    """Id, command and parameters of the packets that are whole and sound."""
    found: list[tuple[int, int, bytes]] = []
    place = data.find(HEAD)
    while place >= 0 and place + 6 <= len(data):
        end = place + data[place + 3] + 3
        body = data[place + 2 : end - 1]
        if data[place + 3] >= 3 and end <= len(data) and ~sum(body) & 0xFF == data[end - 1]:
            found.append((body[0], body[2], body[3:]))
            place = data.find(HEAD, end)
        else:
            place = data.find(HEAD, place + 1)
    return found


class Lx16aBoard(BoardType):
    """A chain of LX-16A servos behind their USB debug board."""

    kind = "lx16a"
    title = "LX-16A servo bus"
    plugged_in = "debug board of the servos"
    scale = STEPS
    entries = ServoEntries(unit="steps", key="steps", range_key="range_steps", lowest=0, highest=1000)
    power = "motors"
    sag_deg = 3.0
    slowest_answer_s = 0.1
    simulator_robot = None

    def driver(self, setup: Setup, connection: Connection) -> Lx16aDriver:
        """A driver."""
        return Lx16aDriver(connection, [one.channel for one in setup.channels])

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        """A chain with the servos of a robot; three of them without one."""
        return SimulatedLx16as([one.channel for one in setup.channels] or [1, 2, 3])

    def ask(self, line: Transport, now: Callable[[], float]) -> Introduction | None:
        """Ask the first servos where they are."""
        bus = Bus(line, _ANSWER_S)
        found = [servo for servo in range(1, 8) if bus.asked(servo, READ_POSITION, 2, 1) is not None]
        return Introduction(self.title, details=(f"servos {found}",)) if found else None

    def examine(self, check_up: CheckUp) -> list[Finding]:
        """Each servo of the robot: whether it answers, and its supply."""
        bus = Bus(check_up.line, _SIMULATED_ANSWER_S if check_up.simulated else _ANSWER_S)
        findings: list[Finding] = []
        for one in check_up.needs.channels:
            volts = bus.asked(one.channel, READ_VOLTAGE, 2)
            name = f"servo {one.channel}"
            if volts is None:
                findings.append(failed(name, "does not answer", "look at its plug, its id and its power"))
            else:
                findings.append(ok(name, f"{int.from_bytes(volts, 'little') / 1000:.1f} V"))
        return findings


class Bus:
    """Questions and answers on the half-duplex line."""

    def __init__(self, line: Transport, answer_s: float) -> None:
        self.line, self._answer_s = line, answer_s
        self.count = self.lost = 0

    def asked(self, servo: int, command: int, size: int, attempts: int = _ATTEMPTS) -> bytes | None:
        """``size`` bytes that a servo answers; None where it does not. An echo has no parameters."""
        for _ in range(attempts):
            self.count += 1
            self.line.discard_input()
            self.line.write(packet(servo, command))
            data = b""
            while piece := self.line.read(1, self._answer_s):
                data += piece + self.line.read(64, 0.0)
                for who, what, parameters in packets(data):
                    if (who, what, len(parameters)) == (servo, command, size):
                        return parameters
            self.lost += 1
        return None

    def tell(self, servo: int, command: int, parameters: bytes) -> None:
        """What no servo answers."""
        self.line.write(packet(servo, command, parameters))


@dataclass
class Seen:
    """What is known of a servo."""

    position: int | None = None
    on: bool = False
    missed: int = 0
    temperature: float | None = None
    voltage: float | None = None
    goal: int | None = None


class Lx16aDriver(Abilities):
    """LX-16A servos behind the ``Driver`` protocol. A channel is an id, units are steps.

    A servo is asked at each reading whether its torque is on: one that started anew gets no goal.
    """

    def __init__(self, connection: Connection, servos: Sequence[int]) -> None:
        self._connection = connection
        self._answer_s = _SIMULATED_ANSWER_S if connection.simulated else _ANSWER_S
        self._bus: Bus | None = None
        self._seen = {servo: Seen() for servo in servos}
        self._table = ChannelTable(STEPS)
        self._turn = 0

    def open(self) -> BoardIdentity:
        """Open the line; at least one servo has to answer."""
        self.close()
        line, info = self._connection.open()
        bus = self._bus = Bus(line, self._answer_s)
        answers = [servo for servo in self._seen if bus.asked(servo, READ_POSITION, 2) is not None]
        if not answers:
            self.close()
            raise BoardTimeoutError(f"{line.name}: no servo answers; are they powered?")
        number = None if info is None else info.serial_number
        return BoardIdentity(Lx16aBoard.title, line.name, number, self._connection.simulated)

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        """Take what each servo may do."""
        self._table = ChannelTable(STEPS, channels)
        for one in channels:
            self._seen.setdefault(one.channel, Seen())

    def write(self, setpoints: Mapping[int, float]) -> None:
        """Send goals; a servo that is limp is switched on where it stands, or refused."""
        goals = {servo: self._table.admit(servo, value) for servo, value in setpoints.items()}
        bus = self._opened
        switched: list[int] = []
        for servo in [one for one in goals if self._seen[one].goal is None]:
            try:
                self._switch_on(bus, servo)
            except EnableError as refusal:
                self.release_channels(switched)
                refusal.channel = servo
                raise
            switched.append(servo)
        for servo, goal in goals.items():
            if self._seen[servo].on and goal != self._seen[servo].goal:
                bus.tell(servo, MOVE, goal.to_bytes(2, "little") + _TICK_MS.to_bytes(2, "little"))
                self._seen[servo].goal = goal

    def read(self) -> Readback:
        """Position and torque of every servo; heat and voltage of one of them, in turn."""
        bus = self._opened
        for servo in self._table.channels:
            self._look(bus, servo)
        if all(self._seen[servo].missed for servo in self._table.channels):
            raise BoardTimeoutError(f"{bus.line.name}: none of the servos answers")
        self._turn += 1
        servo = self._table.channels[self._turn % len(self._table.channels)]
        if (heat := bus.asked(servo, READ_TEMPERATURE, 1, 1)) is not None:
            self._seen[servo].temperature = float(heat[0])
        if (volts := bus.asked(servo, READ_VOLTAGE, 2, 1)) is not None:
            self._seen[servo].voltage = int.from_bytes(volts, "little") / 1000
        known = {servo: self._seen[servo] for servo in self._table.channels}
        gone = [servo for servo, one in known.items() if one.missed >= _GONE]
        asked, lost, bus.count, bus.lost = bus.count, bus.lost, 0, 0
        return Readback(
            {servo: None if servo in gone else one.position for servo, one in known.items()},
            Source.MEASURED,
            faults={servo: f"servo {servo} does not answer" for servo in gone},
            temperature={servo: one.temperature for servo, one in known.items()},
            voltage={servo: one.voltage for servo, one in known.items()},
            asked=asked,
            lost=lost,
            on={servo: one.on for servo, one in known.items()},
        )

    def stop(self) -> None:
        """They hold their last goal, a tick ahead at most."""

    def home(self) -> None:
        """They know where they are."""
        raise BoardError("LX-16A servos need no homing")

    def release(self) -> None:
        """All of them limp."""
        self.release_channels(list(self._seen))

    def release_channels(self, channels: Sequence[int]) -> None:
        """These limp; ``BoardTimeoutError`` names who does not confirm it."""
        bus, still = self._opened, list[int]()
        for servo in channels:
            self._seen[servo].goal = None
            bus.tell(servo, LOAD, b"\0")
            state = bus.asked(servo, READ_LOAD, 1)
            self._seen[servo].on = state != b"\0" and self._seen[servo].on
            if state != b"\0" and self._seen[servo].missed < _GONE:
                still.append(servo)
        if still:
            raise BoardTimeoutError(f"servos {still} do not confirm that they are off; cut their power")

    def close(self) -> None:
        """Leave the servos as they are."""
        if self._bus is not None:
            self._bus.line.close()
            self._bus = None

    @property
    def _opened(self) -> Bus:
        if self._bus is None:
            raise BoardError("the servos are not connected")
        return self._bus

    def _look(self, bus: Bus, servo: int) -> None:
        one = self._seen[servo]
        attempts = _ATTEMPTS if one.missed < _GONE else 1
        place = bus.asked(servo, READ_POSITION, 2, attempts)
        state = None if place is None else bus.asked(servo, READ_LOAD, 1, attempts)
        if place is None or state is None:
            one.missed += 1
            return
        one.missed, one.position = 0, int.from_bytes(place, "little", signed=True)
        one.on = state == b"\1"

    def _switch_on(self, bus: Bus, servo: int) -> None:
        """Goal where it stands, torque, read back; refused where it has turned since it was looked at."""
        one = self._seen[servo]
        before = one.position
        self._look(bus, servo)
        if one.missed or one.position is None or before is None:
            raise EnableError(f"servo {servo} does not answer")
        if abs(one.position - before) > _STILL_STEPS:
            raise EnableError(f"servo {servo} has turned since it was looked at; hold the arm still")
        if not 0 <= one.position <= 1000:
            raise EnableError(f"servo {servo} stands at {one.position}, outside 0 … 1000; turn it back")
        if not one.on:
            bus.tell(servo, MOVE, one.position.to_bytes(2, "little") + b"\0\0")
            bus.tell(servo, LOAD, b"\1")
            self._look(bus, servo)
            if not one.on:
                raise EnableError(f"servo {servo} did not switch its motor on")
        one.goal = one.position


class SimulatedLx16a:
    """One servo: it goes to its goal in the time that it was given."""

    def __init__(self) -> None:
        self.position = self.goal = 500.0
        self.speed = 0.0
        self.on = False

    def step(self, dt: float) -> None:
        """Let time pass."""
        if self.on:
            way = self.goal - self.position
            self.position += max(-self.speed * dt, min(self.speed * dt, way))


class SimulatedLx16as:
    """The chain itself."""

    full_speed = 1300.0
    """steps/s"""

    def __init__(self, ids: Sequence[int]) -> None:
        self.servos = {servo: SimulatedLx16a() for servo in ids}
        self._pending = b""
        self._now: float | None = None

    def reset(self) -> None:
        """A power cut: all limp."""
        for one in self.servos.values():
            one.on = False

    def advance(self, now: float) -> bytes:
        """Let time pass."""
        for one in self.servos.values():
            one.step(0.0 if self._now is None else now - self._now)
        self._now = now
        return b""

    def feed(self, data: bytes) -> bytes:
        """Take instructions; only reads are answered."""
        self._pending = (self._pending + data)[-64:]
        said = b"".join(self._obey(*one) for one in packets(self._pending))
        if said or packets(self._pending):
            self._pending = b""
        return said

    def _obey(self, servo: int, command: int, parameters: bytes) -> bytes:
        one = self.servos.get(servo)
        if one is None:
            return b""
        if command == MOVE and len(parameters) == 4:
            one.goal = float(int.from_bytes(parameters[:2], "little"))
            seconds = int.from_bytes(parameters[2:], "little") / 1000
            way = abs(one.goal - one.position)
            one.speed = min(self.full_speed, way / seconds if seconds else self.full_speed)
            one.on = True
        elif command == LOAD and parameters:
            one.on = parameters[0] == 1
        answers = {
            READ_POSITION: round(one.position).to_bytes(2, "little", signed=True),
            READ_TEMPERATURE: b"\x1c",
            READ_VOLTAGE: (7400).to_bytes(2, "little"),
            READ_LOAD: bytes((one.on,)),
        }
        known = answers.get(command)
        return b"" if known is None else packet(servo, command, known)

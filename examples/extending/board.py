"""A board of somebody's own: lines of text, outputs counted in steps. Nothing of armctl names it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from armctl.errors import BoardError, BoardTimeoutError
from armctl.hardware import (
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
from armctl.hardware.board_type import CheckUp, Finding, ok
from armctl.hardware.transport import Connection, Transport

LISTING = "Toy board"
STEPS = ChannelScale("output", "steps")
_ANSWER_S = 1.0


class ToyBoard(BoardType):
    """What armctl asks of the toy."""

    kind = "toy"
    title = "Toy board"
    plugged_in = "Toy"
    scale = STEPS
    entries = ServoEntries(unit="steps", key="steps", range_key="range_steps", lowest=0, highest=4095)
    usb = {(0x1209, 0x0001): LISTING}  # noqa: RUF012
    likely = ((LISTING,),)
    simulator_robot = None

    def driver(self, setup: Setup, connection: Connection) -> ToyDriver:
        return ToyDriver(connection)

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        return SimulatedToy()

    def ask(self, line: Transport, now: Callable[[], float]) -> Introduction | None:
        line.write(b"WHO\n")
        answer = line.read(8, _ANSWER_S)
        return Introduction("Toy", "1.0") if answer == b"TOY 1.0\n" else None

    def examine(self, check_up: CheckUp) -> list[Finding]:
        return [ok("supply", f"toys need none; {len(check_up.needs.channels)} outputs are asked for")]


class ToyDriver:
    """Writes lines; where the outputs are, it is told."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._line: Transport | None = None
        self._table = ChannelTable(STEPS)

    def open(self) -> BoardIdentity:
        self._line, info = self._connection.open()
        serial_number = None if info is None else info.serial_number
        return BoardIdentity("Toy board", self._line.name, serial_number, self._connection.simulated)

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        self._table = ChannelTable(STEPS, channels)

    def write(self, setpoints: Mapping[int, float]) -> None:
        admitted = {channel: self._table.admit(channel, value) for channel, value in setpoints.items()}
        self._open.write(b"".join(b"SET %d %d\n" % one for one in admitted.items()))

    def read(self) -> Readback:
        self._open.write(b"GET\n")
        said = b""
        while not said.endswith(b"\n"):
            byte = self._open.read(1, _ANSWER_S)
            if not byte:
                raise BoardTimeoutError("the toy says nothing")
            said += byte
        known = dict(tuple(map(int, word.split(b"="))) for word in said.split())
        positions = {channel: known.get(channel) for channel in self._table.channels}
        return Readback(positions, Source.MEASURED, temperature=dict.fromkeys(self._table.channels, 21.0))

    def stop(self) -> None:
        """It stands when nothing is sent."""

    def home(self) -> None:
        raise BoardError("a toy needs no homing")

    def release(self) -> None:
        self._open.write(b"OFF\n")

    def close(self) -> None:
        if self._line is not None:
            self._line.close()
            self._line = None

    @property
    def _open(self) -> Transport:
        if self._line is None:
            raise BoardError("the toy is not connected")
        return self._line


class SimulatedToy:
    """The toy itself."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.outputs: dict[int, int] = {}
        self.most: dict[int, int] = {}
        self._pending = b""

    def advance(self, now: float) -> bytes:
        return b""

    def feed(self, data: bytes) -> bytes:
        *lines, self._pending = (self._pending + data).split(b"\n")
        return b"".join(map(self._obey, lines))

    def _obey(self, line: bytes) -> bytes:
        match line.split():
            case [b"WHO"]:
                return b"TOY 1.0\n"
            case [b"GET"]:
                return b" ".join(b"%d=%d" % one for one in self.outputs.items()) + b"\n"
            case [b"SET", channel, steps]:
                self.outputs[int(channel)] = int(steps)
                self.most[int(channel)] = max(int(steps), self.most.get(int(channel), 0))
            case _:
                self.outputs.clear()
        return b""

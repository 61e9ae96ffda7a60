"""A board of somebody else's that can do more than move: power by channel, loads, an input, an output.

Two servos of it may turn one joint. Nothing of armctl names it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armctl.errors import BoardTimeoutError
from armctl.hardware import (
    Abilities,
    BoardIdentity,
    BoardType,
    ByteModel,
    ChannelScale,
    ChannelSettings,
    ChannelTable,
    Readback,
    ServoEntries,
    Setup,
    SimulatorOptions,
    Source,
)
from armctl.hardware.transport import Connection, Transport

STEPS = ChannelScale("output", "steps")
_ANSWER_S = 1.0


class AbleBoard(BoardType):
    """What armctl asks of it."""

    kind = "able"
    title = "Able board"
    plugged_in = "Able"
    scale = STEPS
    entries = ServoEntries(unit="steps", key="steps", range_key="range_steps", lowest=0, highest=4095)

    def driver(self, setup: Setup, connection: Connection) -> AbleDriver:
        return AbleDriver(connection)

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        return SimulatedAble()


class AbleDriver(Abilities):
    """Writes lines; where the outputs are, which are on and how loaded they are, it is told."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._table = ChannelTable(STEPS)

    def open(self) -> BoardIdentity:
        self._line: Transport = self._connection.open()[0]
        return BoardIdentity("Able board", self._line.name, None, self._connection.simulated)

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        self._table = ChannelTable(STEPS, channels)

    def write(self, setpoints: Mapping[int, float]) -> None:
        self._say(*(f"SET {channel} {self._table.admit(channel, at)}" for channel, at in setpoints.items()))

    def read(self) -> Readback:
        self._say("GET")
        said = b""
        while not said.endswith(b"\n"):
            byte = self._line.read(1, _ANSWER_S)
            if not byte:
                raise BoardTimeoutError("the board says nothing")
            said += byte
        door, lamp, *outputs = said.decode().split()
        known = {int(c): (float(at), on == "1", float(load)) for c, at, on, load in map(_parted, outputs)}
        return Readback(
            {channel: known[channel][0] if channel in known else None for channel in self._table.channels},
            Source.MEASURED,
            on={channel: on for channel, (_, on, _) in known.items()},
            load={channel: load for channel, (_, _, load) in known.items()},
            inputs={"door": float(door)},
            outputs={"lamp": float(lamp)},
        )

    def stop(self) -> None:
        """It stands when nothing is sent."""

    def home(self) -> None:
        raise NotImplementedError

    def release(self) -> None:
        self.release_channels(self._table.channels)

    def release_channels(self, channels: Sequence[int]) -> None:
        self._say(*(f"OFF {channel}" for channel in channels))

    def limit_torque(self, limits: Mapping[int, float]) -> None:
        self._say(*(f"TORQUE {channel} {share}" for channel, share in limits.items()))

    def set_output(self, name: str, value: float) -> None:
        self._say(f"OUT {name} {value}")

    def close(self) -> None:
        self._line.close()

    def _say(self, *lines: str) -> None:
        self._line.write("".join(f"{line}\n" for line in lines).encode())


def _parted(word: str) -> list[str]:
    return word.split(":")


class SimulatedAble:
    """The board itself: its servos stand somewhere when it starts, switched off."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.outputs: dict[int, float] = {}
        self.on: set[int] = set()
        self.load: dict[int, float] = {}
        self.torque: dict[int, float] = {}
        self.door = self.lamp = 0.0
        self.stuck = False
        """nothing comes on"""
        self._pending = b""

    def advance(self, now: float) -> bytes:
        return b""

    def feed(self, data: bytes) -> bytes:
        *lines, self._pending = (self._pending + data).split(b"\n")
        return b"".join(self._obey(line.decode().split()) for line in lines)

    def _obey(self, words: list[str]) -> bytes:
        match words:
            case ["GET"]:
                told = [
                    f"{c}:{at}:{int(c in self.on)}:{self.load.get(c, 0.0)}" for c, at in self.outputs.items()
                ]
                return " ".join([str(self.door), str(self.lamp), *told]).encode() + b"\n"
            case ["SET", channel, steps]:
                self.outputs[int(channel)] = float(steps)
                if not self.stuck:
                    self.on.add(int(channel))
            case ["OFF", channel]:
                self.on.discard(int(channel))
            case ["TORQUE", channel, share]:
                self.torque[int(channel)] = float(share)
            case ["OUT", "lamp", value]:
                self.lamp = float(value)
            case _:
                raise AssertionError(words)
        return b""

"""A simulated Maestro on a pty, in a process of its own, that stamps each setpoint when it arrives."""

from __future__ import annotations

import os
import threading
import time
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from types import TracebackType
from typing import NamedTuple, Self

from armctl.boards import setup_of
from armctl.hardware.maestro.codec import Opcode, PacketParser, us_to_quarters
from armctl.hardware.maestro.simulated import simulated_maestro
from armctl.hardware.simulation import BoardServer
from armctl.robot import load_robot

ROBOT = "uzuner"
US_PER_QUARTER = 0.25
_LOOK_S, _STOOD_S = 0.005, 0.03


class Frame(NamedTuple):
    """One setpoint as it came over the line."""

    at_s: float
    """when its last byte was read, on the machine's monotonic clock"""
    targets: dict[int, int]
    """channel: quarter µs"""


class _Board:
    """A Maestro whose servos are on, in the arm's rest pose, so that Enable takes them over at once."""

    def __init__(self) -> None:
        robot = load_robot(ROBOT)
        self._maestro = simulated_maestro(setup_of(robot).channels)
        outputs = robot.outputs
        pulses = outputs.outputs(robot.pose("rest"))
        if outputs.gripper_channel is not None:
            pulses |= outputs.gripper_output(0.5)
        for channel, pulse_us in pulses.items():
            self._maestro.channel(channel).set_target(us_to_quarters(pulse_us))
        self._parser = PacketParser(device=12, crc=False, mini=False)
        self.frames: list[Frame] = []

    def advance(self, now: float) -> bytes:
        return self._maestro.advance(now)

    def feed(self, data: bytes) -> bytes:
        at_s = time.monotonic()
        targets: dict[int, int] = {}
        for byte in data:
            for packet in self._parser.push(byte):
                if getattr(packet, "opcode", None) is Opcode.SET_TARGET:
                    targets[packet.data[0]] = packet.data[1] | packet.data[2] << 7
        if targets:
            self.frames.append(Frame(at_s, targets))
        return self._maestro.feed(data)


class _Watch(threading.Thread):
    """Notes when this process, which has precedence and next to nothing to do, stood still itself."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.stood: list[tuple[float, float]] = []

    def run(self) -> None:
        last = time.monotonic()
        while True:
            time.sleep(_LOOK_S)
            now = time.monotonic()
            if now - last > _STOOD_S:
                self.stood.append((last, now))
            last = now


def _serve(pipe: Connection) -> None:
    with suppress(PermissionError, AttributeError):  # a board is late for no other program
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    watch = _Watch()
    watch.start()
    with BoardServer(_Board(), time.monotonic, tick_s=0.1) as server:
        pipe.send(server.port)
        while pipe.recv():
            with server.inspect() as board:
                frames, board.frames = board.frames, []
            stood, watch.stood = watch.stood, []
            pipe.send(([tuple(frame) for frame in frames], stood))


class Wire:
    """The board, as seen from the benchmark."""

    def __init__(self) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        self.port: str = self._pipe.recv()
        self.stood: list[tuple[float, float]] = []
        """from when to when [s] the board's own process stood still: then it is the machine, not armctl"""

    def frames(self) -> list[Frame]:
        """The setpoints that have come since the last call."""
        self._pipe.send(True)
        frames, stood = self._pipe.recv()
        self.stood += stood
        return [Frame(*frame) for frame in frames]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._pipe.send(False)
        self._process.join()

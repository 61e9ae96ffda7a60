"""An arm with a true driver on a simulated board, all of it on one manual clock; and what may befall it."""

from __future__ import annotations

import asyncio
import errno
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial
from tests.hardware.lines import LoopTransport
from tests.runtime.kit import TEST, TICK

from armctl.arrays import FloatArray
from armctl.boards import setup_of
from armctl.facts import State
from armctl.hardware import Abilities, BoardIdentity, ChannelSettings, Driver, Readback
from armctl.hardware.boards import board_type, channel_settings
from armctl.hardware.bus.driver import BusDriver
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.encoder.messages import Mode
from armctl.hardware.encoder.simulated import simulated_encoder_board
from armctl.hardware.faults import FaultyModel, trouble
from armctl.hardware.firmata.codec import PinMode
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.firmata.simulated import SimulatedFirmata
from armctl.hardware.maestro import MaestroModel
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import ChannelConfig, MaestroSettings, SimulatedMaestro
from armctl.hardware.transport import Connection, SerialTransport
from armctl.process.records import Ask, Codec, Hello
from armctl.process.server import Server
from armctl.protocol import Command, ManualClock, Snapshot, Ticket
from armctl.robot import Robot, load_robot
from armctl.runtime import Controller, InlineExecutor, PoseFolder

ROBOTS = {
    board: load_robot(arm)
    for board, arm in (
        ("maestro", "uzuner"),
        ("firmata", "abaas"),
        ("encoder", "scorbot"),
        ("feetech", "so101"),
        ("dynamixel", "koch"),
    )
}
PORT, OTHER_PORT = "/dev/ttyACM7", "/dev/ttyACM8"
FRAME_S = 0.02


class Spied:
    """A driver that keeps what the runtime asks of it: when [s], what, and the setpoints of a write."""

    def __init__(
        self, driver: Driver, clock: ManualClock, log: list[tuple[float, str, dict[int, float]]]
    ) -> None:
        self._driver, self._clock, self._log = driver, clock, log

    def open(self) -> BoardIdentity:
        self._note("open")
        return self._driver.open()

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        self._note("configure")
        self._driver.configure(channels)

    def write(self, setpoints: Mapping[int, float]) -> None:
        self._note("write", setpoints)
        self._driver.write(setpoints)

    def read(self) -> Readback:
        return self._driver.read()

    def stop(self) -> None:
        self._note("stop")
        self._driver.stop()

    def home(self) -> None:
        self._note("home")
        self._driver.home()

    def release(self) -> None:
        self._note("release")
        self._driver.release()

    def close(self) -> None:
        self._note("close")
        self._driver.close()

    def _note(self, what: str, setpoints: Mapping[int, float] | None = None) -> None:
        self._log.append((self._clock.now(), what, dict(setpoints or {})))


class SpiedBus(Spied, Abilities):
    """The same of a servo bus, which can do more."""

    def release_channels(self, channels: Sequence[int]) -> None:
        self._note("release", dict.fromkeys(channels, 0.0))
        self._bus.release_channels(channels)

    def limit_torque(self, limits: Mapping[int, float]) -> None:
        self._note("limit", limits)
        self._bus.limit_torque(limits)

    def scale_torque(self, share: float, channels: Sequence[int] | None = None) -> None:
        self._note("scale", dict.fromkeys((0,) if channels is None else channels, share))
        self._bus.scale_torque(share, channels)

    @property
    def _bus(self) -> Abilities:
        assert isinstance(self._driver, Abilities)
        return self._driver


class NoSuchPort:
    """Stands for pyserial: every port is as ``trouble`` says."""

    def __init__(self, number: int) -> None:
        self._number = number

    def __call__(self, *_: Any, **__: Any) -> serial.Serial:
        raise serial.SerialException(self._number, "as the fault has it")


@dataclass
class Bench:
    """One arm, its board behind a bad line, and the computer that drives it."""

    kind: str
    seed: int = 0
    folder: Path | None = None
    clock: ManualClock = field(default_factory=lambda: ManualClock(100.0))
    log: list[tuple[float, str, dict[int, float]]] = field(default_factory=list)
    tickets: list[tuple[float, Ticket]] = field(default_factory=list)
    history: list[Snapshot] = field(default_factory=list)
    busy = False
    """another program has the port"""
    port = PORT
    """what the board is called now"""
    spoilt = False
    """bytes were spoilt on its line: nobody can tell what it was told, or what it said"""
    by_client = False
    """whether a client of the arm process asks for the motions"""
    hold: Command | None = None
    """asked for anew at each tick, as by a button that is held"""

    def __post_init__(self) -> None:
        self.robot = self._robot()
        self.board = self._model()
        self.line: FaultyModel[Any] = FaultyModel(self.board, self.seed)
        self.patch = pytest.MonkeyPatch()
        self.client: Client | None = None
        self.start()

    def start(self) -> None:
        """A new controller, as after a restart of the arm process; the board goes on."""
        folder = self.folder
        self.poses = folder and PoseFolder(folder, self.robot)
        self.controller = Controller(
            self.robot,
            self._driver,
            self.clock,
            executor=InlineExecutor(),
            black_boxes=folder and folder / "black-box",
            poses=self.poses,
        )

    def _robot(self) -> Robot:
        return ROBOTS[self.kind]

    def _model(self) -> Any:
        if self.kind == "maestro":
            channels = {
                one.channel: ChannelConfig(minimum_us=500, maximum_us=2500)
                for one in channel_settings(self.robot)
            }
            return SimulatedMaestro(MaestroModel.MICRO_6, MaestroSettings(channels=channels))
        if self.kind == "firmata":
            return SimulatedFirmata(boot_s=0.1, log_length=2)
        if self.kind == "encoder":
            return simulated_encoder_board(channel_settings(self.robot), self.robot.board_settings.axes)
        return board_type(self.kind).simulated(setup_of(self.robot), {})

    def _driver(self, port: str) -> Driver:
        connection = Connection(lambda: self._open(port), self.clock.now)
        if self.kind == "maestro":
            driver: Driver = MaestroDriver(connection, model=MaestroModel.MICRO_6)
        elif self.kind == "firmata":
            driver = FirmataDriver(connection)
        elif self.kind == "encoder":
            driver = EncoderDriver(connection, self.robot.board_settings)
        else:
            driver = board_type(self.kind).driver(setup_of(self.robot), connection)
        spied = SpiedBus if isinstance(driver, BusDriver) else Spied
        return spied(driver, self.clock, self.log)

    def _open(self, port: str) -> LoopTransport:
        number = errno.ENOENT if port != self.port else errno.EBUSY if self.busy else 0
        if number:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(serial, "serial_for_url", NoSuchPort(number))
                SerialTransport(port)
        return LoopTransport(self, self.clock.now, self.clock.advance, port)

    def advance(self, now: float) -> bytes:
        return self.line.advance(now)

    def feed(self, data: bytes) -> bytes:
        return self.line.feed(data)

    def reset(self) -> None:
        self.line.reset()

    def trouble(self, *texts: str) -> None:
        """From now on the line is as ``armctl simulate --fault`` would have it; none: as good as new."""
        self.line = FaultyModel(self.board, self.seed, [trouble(text) for text in texts])

    @property
    def now(self) -> Snapshot:
        return self.controller.snapshot

    def tick(self, elapsed: float = TICK) -> Snapshot:
        if self.poses is not None:
            self.poses.wait(10.0)  # the disk is as fast as the ticks
        self.clock.advance(elapsed)
        if self.hold is not None:
            self.submit(self.hold)
        if self.client is not None:
            self.client.turn()
        self.controller.tick()
        self.history.append(self.now)
        return self.now

    def run(self, seconds: float) -> Snapshot:
        for _ in range(round(seconds / TICK)):
            self.tick()
        return self.now

    def submit(self, command: Command) -> None:
        """Ask for something; a client does where it is to be one."""
        if self.by_client:
            self.client = self.client or Client(self.controller)
            self.client.submit(command)
        else:
            self.tickets.append((self.clock.now(), self.controller.submit(command, TEST)))

    def ask(self, command: Command) -> None:
        """Submit and tick once."""
        self.submit(command)
        self.tick()

    def lose_client(self) -> Callable[[], None]:
        assert self.client is not None
        self.client.go()
        self.by_client, self.hold = False, None
        return lambda: None

    def die(self) -> Callable[[], None]:
        """The process is killed, and the board is left alone; another one is started."""
        self.hold = None
        self.start()
        return lambda: None

    def does(self, command: Command, *states: State, seconds: float = 60.0) -> None:
        """It is carried out, and ends in one of these states."""
        ticket = self.controller.submit(command, TEST)
        self.tick()
        for _ in range(round(seconds / TICK)):
            if ticket.finished.done():
                break
            self.tick()
        ticket.finished.result(0)
        assert self.now.state in states, (self.now.state, self.now.cause)

    def until_told(self, words: str) -> None:
        """Tick until a warning says so: a thread that writes to the disk has to come to it."""
        for _ in range(500):
            if any(words in warning for warning in self.now.warnings):
                return
            threading.Event().wait(0.005)
            self.tick()
        raise AssertionError(f"nobody says that {words}")

    def outputs(self) -> FloatArray:
        """Where each joint's output stands, in the board's unit; NaN: its pulses or motors are off."""
        self._quietly()
        channels = self.robot.outputs.channels
        if self.kind == "maestro":
            where = [self.board.position_us(channel) for channel in channels]
        elif self.kind == "firmata":
            where = [
                self.board.pulses(pin)[-1].width_us
                if self.board.mode(pin) == PinMode.SERVO and self.board.pulses(pin)
                else None
                for pin in channels
            ]
        elif self.kind == "encoder":
            where = [self.board.axes[axis].place for axis in channels]
        else:
            servos = [self.board.servo(channel) for channel in channels]
            where = [servo.shaft if servo.driven else None for servo in servos]
        return np.array([math.nan if value is None else value for value in where], dtype=float)

    @property
    def measures(self) -> bool:
        """The board knows where the arm stands, and takes it over there at once."""
        return self.kind in ("encoder", "feetech", "dynamixel")

    @property
    def homes(self) -> bool:
        """The board moves the arm by itself."""
        return self.kind == "encoder" and self.board.mode is Mode.HOMING

    def _quietly(self) -> None:
        """Bring the board up to the present, past its line."""
        if self.kind != "encoder":  # what it says of itself would be lost
            self.board.advance(self.clock.now())

    def words(self, since: float, first: int) -> str:
        """All that a person was told since then: cause, warnings, log, answers."""
        told = [self.now.cause]
        for snapshot in self.history[first:]:
            told += [snapshot.cause, *snapshot.warnings]
        known = {event.text for event in self.history[first - 1].events} if first else set[str]()
        told += [event.text for event in self.now.events if event.text not in known]
        for asked, ticket in self.tickets:
            if asked >= since - 1.0 and ticket.finished.done() and (error := ticket.finished.exception()):
                told.append(str(error))
        return "\n".join(dict.fromkeys(told))

    def close(self) -> None:
        self.patch.undo()
        self.controller.close()
        if self.client is not None:
            self.client.close()


class Client:
    """A client of the arm process, on the process's own code, without its socket."""

    def __init__(self, controller: Controller) -> None:
        self._loop = asyncio.new_event_loop()
        self._codec = Codec()
        self._incoming: asyncio.Queue[bytes | None] = asyncio.Queue()
        self._loop.run_until_complete(self._begin(controller))
        self._number = 0

    async def _begin(self, controller: Controller) -> None:
        server = Server("secret")
        server.arm = controller
        self._incoming.put_nowait(self._codec.encode(Hello("laptop", beats=True)))
        self._task = asyncio.ensure_future(server.attend(self, True))
        await asyncio.sleep(0)

    def alive(self, _: int) -> None:
        """Somebody else's sign of life; there is nobody else."""

    def abort(self) -> None:
        self._incoming.put_nowait(None)

    async def receive(self) -> bytes:
        data = await self._incoming.get()
        if data is None:
            raise EOFError
        return data

    async def send(self, data: bytes) -> None:
        assert data

    def submit(self, command: Command) -> None:
        self._number += 1
        self._incoming.put_nowait(self._codec.encode(Ask(self._number, command)))
        self.turn()

    def go(self) -> None:
        """It dies, or its cable is pulled."""
        self._incoming.put_nowait(None)
        self.turn()

    def turn(self) -> None:
        """Let the event loop do what is due."""
        for _ in range(4):
            self._loop.run_until_complete(asyncio.sleep(0))

    def close(self) -> None:
        self._task.cancel()
        self._loop.run_until_complete(asyncio.gather(self._task, return_exceptions=True))
        self._loop.close()

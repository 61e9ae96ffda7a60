"""A simulated bus of Dynamixel servos on a manual clock, and what a host needs to speak with it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from tests.hardware.lines import LoopTransport
from tests.runtime.board_bench import BoardBench

from armctl.boards import setup_of
from armctl.facts import State
from armctl.hardware import Driver
from armctl.hardware.boards import board_type
from armctl.hardware.bus.line import BusLine
from armctl.hardware.bus.plant import ArmPlant, PlantJoint
from armctl.hardware.bus.simulated import Gear, SimulatedBus, Supply
from armctl.hardware.dynamixel.make import DYNAMIXEL
from armctl.hardware.dynamixel.simulated import SimulatedX, factory_memory
from armctl.hardware.transport import Connection
from armctl.protocol import Connect, Enable, ManualClock, MoveJoints
from armctl.robot import Robot, load_robot

OMX = load_robot("open_manipulator_x")
HOME, REST = OMX.pose("home"), OMX.pose("rest")
ELBOW = 13
STEPS_PER_RAD = 4096 / 6.283185307179586


@dataclass
class Rig:
    """Servos on free joints, and a line to them."""

    clock: ManualClock
    bus: SimulatedBus
    line: BusLine

    @classmethod
    def of(cls, clock: ManualClock, *memories: bytes) -> Rig:
        """A servo for each memory, its shaft at 2048."""
        joints = [PlantJoint() for _ in memories]
        supply = Supply()
        servos = [
            SimulatedX(joint, Gear(2048.0, STEPS_PER_RAD), supply, memory)
            for joint, memory in zip(joints, memories, strict=True)
        ]
        bus = SimulatedBus(DYNAMIXEL.form, servos, ArmPlant(joints), supply)
        line = BusLine(LoopTransport(bus, clock.now, clock.advance), DYNAMIXEL.form, clock.now, 0.02)
        return cls(clock, bus, line)

    def servo(self, number: int = 1) -> SimulatedX:
        servo = self.bus.servo(number)
        assert isinstance(servo, SimulatedX)
        return servo

    def let(self, seconds: float) -> None:
        """Let time pass in silence, as the thread that carries a board's bytes does."""
        for _ in range(round(seconds / 0.02)):
            self.clock.advance(0.02)
            self.bus.advance(self.clock.now())

    def write(self, name: str, number: int, servo: int = 1) -> int:
        """Write by name; the error of the answer."""
        answer = self.line.write(servo, DYNAMIXEL.table[name].address, DYNAMIXEL.table.encode(name, number))
        assert answer is not None
        return answer.code

    def read(self, name: str, servo: int = 1) -> int:
        register = DYNAMIXEL.table[name]
        data = self.line.read(servo, register.address, register.size).data
        return DYNAMIXEL.table.decode(name, data)

    def reads(self, *names: str) -> list[int]:
        return [self.read(name) for name in names]


def one_servo(clock: ManualClock, **changes: int) -> Rig:
    return Rig.of(clock, factory_memory(id=1, **changes))


def memory(servo: SimulatedX, **changes: int) -> None:
    """Change what the EEPROM of a servo keeps, as another program would have done."""
    for name, number in changes.items():
        register = DYNAMIXEL.table[name]
        assert servo.written(register.address, DYNAMIXEL.table.encode(name, number)) == 0


class Arm:
    """An OpenMANIPULATOR-X on its simulated bus, driven by the runtime on a manual clock."""

    def __init__(self, bus: SimulatedBus | None = None, robot: Robot = OMX) -> None:
        """``bus``: one that there is already; None: a new one."""
        kind, setup = board_type("dynamixel"), setup_of(robot)
        made = kind.simulated(setup, {}) if bus is None else bus
        assert isinstance(made, SimulatedBus)
        self.bus = made

        def driver(line: Callable[[], LoopTransport], now: Callable[[], float]) -> Driver:
            return kind.driver(setup, Connection(line, now, simulated=True))

        self.bench = BoardBench.of(robot, made, driver)

    def servo(self, number: int = ELBOW) -> SimulatedX:
        servo = self.bus.servo(number)
        assert isinstance(servo, SimulatedX)
        return servo

    def joint(self, number: int = ELBOW) -> PlantJoint:
        return self.servo(number).joint

    def connect(self) -> Arm:
        self.bench.do(Connect("sim"))
        self.bench.run(1.0)
        return self

    def enable(self) -> Arm:
        self.bench.do(Enable())
        self.bench.until(State.HOLDING)
        return self

    def go(self, pose: object = HOME, **options: float) -> Arm:
        self.bench.do(MoveJoints(pose, **options))  # type: ignore[arg-type]
        return self

    def silence(self, seconds: float) -> None:
        """The host says nothing; time goes on for the servos."""
        for _ in range(round(seconds / 0.01)):
            self.bench.clock.advance(0.01)
            self.bus.advance(self.bench.clock.now())

    @property
    def told(self) -> str:
        now = self.bench.now
        return " | ".join((now.cause, *now.warnings, *now.more_warnings))

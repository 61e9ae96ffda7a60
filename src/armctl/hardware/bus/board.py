"""What the boards of all makes of bus servos tell alike."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, ClassVar

from armctl.errors import BoardTimeoutError
from armctl.hardware.board_type import (
    ARDUINO_LIKELY,
    USB_SERIAL,
    BoardType,
    ByteModel,
    CheckUp,
    Finding,
    Introduction,
    Setup,
    SimulatorOption,
    SimulatorOptions,
    nothing_kept,
)
from armctl.hardware.bus import SERVO_ENTRIES, BusSettings
from armctl.hardware.driver import Driver

if TYPE_CHECKING:
    from armctl.hardware.bus.driver import BusDriver
    from armctl.hardware.bus.make import ServoMake
    from armctl.hardware.bus.plant import PlantJoint
    from armctl.hardware.bus.simulated import BusServo, Gear, Supply
    from armctl.hardware.servos import ServoSetup
    from armctl.hardware.transport import Connection, Transport

SERVO_BUS = "USB adapter of a servo bus"
_CHIPS = ((0x1A86, 0x55D3), (0x0403, 0x6014), (0x2F5D, 0x2202))
"""CH343, FT232H (U2D2), OpenRB-150"""
_TIMEOUT_S, _SIMULATED_TIMEOUT_S = 0.008, 0.15
_MOST_ASKED = 32
"""ids that a port is probed for"""


class BusBoard(BoardType):
    """A bus of servos behind a USB adapter; the make is what differs."""

    entries = SERVO_ENTRIES
    usb: ClassVar[Mapping[tuple[int, int | None], str]] = dict.fromkeys(_CHIPS, SERVO_BUS)
    likely = ((SERVO_BUS,), *ARDUINO_LIKELY[1:])
    shared = (SERVO_BUS, USB_SERIAL)
    power = "motors"
    sag_deg = 4.0
    advice = "see that the servos have power of their own, and that the first plug of the chain is in"
    notes: ClassVar[tuple[str, ...]] = ()
    """what to know of real ones, e.g. what they do when this program ends"""
    simulator_options = (
        SimulatorOption("echo", "An adapter that sends back what it is sent."),
        SimulatorOption("loose", "A servo whose plug is loose, with all behind it.", (), (1, 252), True),
        SimulatorOption("twin", "A second servo with this id.", (), (1, 252), True),
        SimulatorOption("jam", "A servo whose joint is held fast.", (), (1, 252), True),
        SimulatorOption("volts", "Voltage of the supply (default: 12).", (), (0, 30)),
        SimulatorOption("lost", "Share of packets that noise takes (0 ... 0.5).", (), (0, 0.5)),
        SimulatorOption("spoilt", "Share of answers that noise spoils (0 ... 0.5).", (), (0, 0.5)),
    )

    @abstractmethod
    def make(self) -> ServoMake:
        """The make of its servos."""

    @abstractmethod
    def servo(self, number: int, joint: PlantJoint, gear: Gear, supply: Supply) -> BusServo:
        """A simulated servo with the id ``number``, as it is set up for its arm."""

    def driver(self, setup: Setup, connection: Connection) -> Driver:
        """A driver."""
        timeout_s = _SIMULATED_TIMEOUT_S if connection.simulated else _TIMEOUT_S
        ids = [one.channel for one in setup.channels]
        gripper = None if setup.robot is None else setup.robot.outputs.gripper_channel
        settings = setup.settings if isinstance(setup.settings, BusSettings) else BusSettings()
        kept = nothing_kept if connection.simulated else setup.kept  # simulated servos begin anew each time
        return self.driver_type()(
            connection, self.make(), ids, timeout_s, settings, gripper, self.notes, kept
        )

    def driver_type(self) -> type[BusDriver]:
        """What drives it."""
        from armctl.hardware.bus.driver import BusDriver

        return BusDriver

    def settings_type(self) -> type[BusSettings]:
        """How strong the servos may be, and their supply."""
        return BusSettings

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        """A bus with an arm that fits the robot; its servos in the order of the joints."""
        from armctl.hardware.bus.plant import plant_of
        from armctl.hardware.bus.simulated import SimulatedBus, Supply, gears

        make = self.make()
        plant = plant_of(setup.robot, setup.channels)
        volts = options.get("volts")
        supply = Supply(12.0 if volts is None else float(volts))
        geared = gears(setup.robot, setup.channels, make.steps_per_turn, make.last_step)
        servos = [
            self.servo(number, plant.joints[place], gear, supply) for number, (place, gear) in geared.items()
        ]
        bus = SimulatedBus(make.form, servos, plant, supply, echo=bool(options.get("echo")))
        bus.lost, bus.spoilt = (float(options.get(name) or 0.0) for name in ("lost", "spoilt"))
        ids = list(geared)
        for name in ("loose", "twin", "jam"):
            number = options.get(name)
            if number is None or int(number) not in ids:
                continue
            place, gear = geared[int(number)]
            if name == "loose":
                bus.loose = ids.index(int(number))
            elif name == "jam":
                plant.joints[place].blocked = True
            else:
                bus.servos.append(self.servo(int(number), plant.joints[place], gear, supply))
                bus.servos[-1].power_up()
        return bus

    def servo_setup(
        self, open_line: Callable[[int], Transport], now: Callable[[], float], *, simulated: bool = False
    ) -> ServoSetup:
        """Scan, ids, EEPROM, nudges."""
        from armctl.hardware.bus.setup import BusSetup

        timeout_s = _SIMULATED_TIMEOUT_S if simulated else _TIMEOUT_S
        return BusSetup(self.make(), open_line, now, timeout_s, simulated=simulated)

    def examine(self, check_up: CheckUp) -> list[Finding]:
        """Who answers, their settings and errors, what holds answers back, how long they take."""
        from armctl.hardware.bus.check_up import examine_bus

        timeout_s = _SIMULATED_TIMEOUT_S if check_up.simulated else _TIMEOUT_S
        return examine_bus(self.make(), check_up, timeout_s, self.baud)

    def ask(self, line: Transport, now: Callable[[], float]) -> Introduction | None:
        """Ping the ids that arms have; pings upset no other board."""
        from armctl.hardware.bus.line import BusLine

        make = self.make()
        bus = BusLine(line, make.form, now, _TIMEOUT_S, self.baud)
        bus.look_for_echo(1, make.table["model"].address)
        found: list[str] = []
        for servo in range(1, _MOST_ASKED):
            if bus.ping(servo, attempts=1) is None:
                continue
            try:
                if not make.is_one(bus, servo):
                    continue
                model = make.table.decode("model", bus.read(servo, make.table["model"].address, 2).data)
            except BoardTimeoutError:
                continue
            found.append(f"servo {servo}: {make.models.get(model, f'model {model}')}")
        return Introduction(self.title, details=tuple(found)) if found else None

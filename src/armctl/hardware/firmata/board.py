"""An Arduino with StandardFirmata: hobby servos on its pins."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from armctl.hardware.board_type import (
    ARDUINO_LIKELY,
    ARDUINO_MEGA,
    ARDUINO_USB,
    USB_SERIAL,
    BoardType,
    ByteModel,
    CheckUp,
    Finding,
    Introduction,
    Listener,
    Setup,
    SimulatorOption,
    SimulatorOptions,
)
from armctl.hardware.driver import Driver
from armctl.hardware.firmata import BAUD, HOW_TO_LOAD, SCALE, pin_table
from armctl.robot.board_entries import ServoEntries

if TYPE_CHECKING:
    from armctl.hardware.transport import Connection, Transport

_TIMEOUT_S, _SIMULATED_TIMEOUT_S = 0.25, 0.5


class FirmataBoard(BoardType):
    """An Arduino with StandardFirmata."""

    kind = "firmata"
    title = "Arduino with StandardFirmata"
    plugged_in = "Arduino"
    scale = SCALE
    entries = ServoEntries()
    inputs = ("digital", "pull-up", "analog")
    outputs = ("digital", "pwm")
    usb = ARDUINO_USB
    likely = ARDUINO_LIKELY
    shared = (ARDUINO_MEGA, USB_SERIAL)
    baud = BAUD
    restarts = True
    slowest_answer_s = 0.1  # answers are not waited for, so a late one keeps no tick waiting
    advice = HOW_TO_LOAD
    simulator_help = """Serve a simulated Arduino Mega with StandardFirmata until interrupted.

    Servos on pins 2 … 49. It does not restart when its port is opened, as a real Mega does.
    """
    simulator_options = (
        SimulatorOption("boot", "Silent for so long [s] after each start (a real Mega: 1.7).", (), (0, 60)),
    )

    def driver(self, setup: Setup, connection: Connection) -> Driver:
        """A driver."""
        from armctl.hardware.firmata.driver import FirmataDriver

        return FirmataDriver(connection, _SIMULATED_TIMEOUT_S if connection.simulated else _TIMEOUT_S)

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        """A simulated Mega, which needs to be told nothing of the robot."""
        from armctl.hardware.firmata.simulated import SimulatedFirmata

        return SimulatedFirmata(boot_s=float(options.get("boot") or 0.0))

    def check(self, setup: Setup) -> None:
        """Refuse what a Mega would refuse."""
        from armctl.hardware.firmata.signals import FirmataSignals
        from armctl.hardware.firmata.simulated import CAPABILITIES, SERVO_PINS

        pin_table(setup.channels, SERVO_PINS)
        FirmataSignals(setup.signals, CAPABILITIES, [one.channel for one in setup.channels])

    def listener(self) -> Listener:
        """Recognises the sketch by the name that it tells when it starts."""
        from armctl.hardware.firmata.line import FirmataListener

        return FirmataListener()

    def ask(self, line: Transport, now: Callable[[], float]) -> Introduction | None:
        """The version query, and after its answer the firmware query: to a Maestro both would be errors."""
        from armctl.hardware.firmata.line import ask_firmata

        return ask_firmata(line, now)

    def examine(self, check_up: CheckUp) -> list[Finding]:
        """Sketch, pins, what is on, and round trips."""
        from armctl.hardware.firmata.check_up import examine_firmata

        return examine_firmata(check_up)

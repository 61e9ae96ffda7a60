"""PCA9685: sixteen channels of pulses on I²C, on a Raspberry Pi or behind an Arduino."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from armctl.hardware.board_type import (
    ARDUINO_LIKELY,
    ARDUINO_MEGA,
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
from armctl.hardware.firmata import BAUD
from armctl.hardware.pca9685 import (
    HIGHEST_ADDRESS,
    LOWEST_ADDRESS,
    PI_BUS,
    SCALE,
    SCHEME,
    Pca9685Options,
    channel_table,
)
from armctl.robot.board_entries import BoardPart, ServoEntries

if TYPE_CHECKING:
    from armctl.hardware.transport import Connection, PortInfo, Transport
    from armctl.robot.outputs import OutputMap

_TIMEOUT_S, _SIMULATED_TIMEOUT_S = 0.1, 0.5


class Pca9685Entries:
    """Reads ``servo`` tables, and the chip's address, frequency and clock in ``[board]``."""

    def read(self, part: BoardPart) -> tuple[OutputMap | None, Pca9685Options]:
        """The map of the joints (None: none in the file), and ``[board]``."""
        options = part.board(Pca9685Options)
        bare = replace(part.document, record={**part.document.record, "board": {"kind": part.kind}})
        outputs, _ = ServoEntries().read(replace(part, document=bare))
        return outputs, options


class Pca9685Board(BoardType):
    """A PCA9685; the address of the port says which way leads to it: ``i2c://…``, or an Arduino's device."""

    kind = "pca9685"
    title = "PCA9685"
    plugged_in = "PCA9685 (on I²C or behind an Arduino)"
    scale = SCALE
    entries = Pca9685Entries()
    likely = ((PI_BUS,), *ARDUINO_LIKELY)
    shared = (ARDUINO_MEGA, USB_SERIAL)
    scheme = SCHEME
    stands_behind = "firmata"
    baud = BAUD
    restarts = True
    slowest_answer_s = 0.1  # behind an Arduino an answer is fetched a tick or two later
    advice = (
        "on a Raspberry Pi switch I²C on and look with `i2cdetect -y 1` whether it shows 40; behind an "
        "Arduino load StandardFirmata; check VCC, SDA, SCL and GND"
    )
    simulator_help = """Serve a simulated PCA9685 behind an Arduino with StandardFirmata until interrupted.

    It does not restart when its port is opened, as a real Arduino does.
    """
    simulator_options = (
        SimulatorOption(
            "address",
            "Its I²C address (default: 64, which is 0x40).",
            (),
            (LOWEST_ADDRESS, HIGHEST_ADDRESS),
            True,
        ),
        SimulatorOption(
            "oscillator", "Its true clock [MHz] (default: 25; most are off by several percent).", (), (20, 30)
        ),
        SimulatorOption("boot", "Silent for so long [s] after each start (a real Mega: 1.7).", (), (0, 60)),
    )

    def settings_type(self) -> type[Pca9685Options]:
        """Address, frequency and clock."""
        return Pca9685Options

    def driver(self, setup: Setup, connection: Connection) -> Driver:
        """A driver."""
        from armctl.hardware.pca9685.driver import Pca9685Driver

        timeout_s = _SIMULATED_TIMEOUT_S if connection.simulated else _TIMEOUT_S
        return Pca9685Driver(connection, _options(setup.settings), timeout_s)

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        """A simulated chip behind an Arduino, at the address that the robot file says."""
        from armctl.hardware.pca9685.simulated import SimulatedPca9685, SimulatedPca9685Board

        address, oscillator_mhz, boot_s = (options.get(name) for name in ("address", "oscillator", "boot"))
        chip = SimulatedPca9685(
            int(address or _options(setup.settings).address), float(oscillator_mhz or 25.0)
        )
        return SimulatedPca9685Board(chip, float(boot_s or 0.0))

    def check(self, setup: Setup) -> None:
        """Refuse what the chip would refuse."""
        from armctl.hardware.pca9685.registers import period_us

        channel_table(setup.channels, period_us(_options(setup.settings)))

    def own_ports(self) -> Sequence[PortInfo]:
        """The bus on the pins of a Raspberry Pi."""
        from armctl.hardware.pca9685.i2c import pi_buses

        return pi_buses()

    def open_line(self, port: str) -> Transport:
        """An I²C bus of this computer."""
        from armctl.hardware.pca9685.i2c import BusTransport

        return BusTransport(port)

    def listener(self) -> Listener:
        """An Arduino introduces itself, as ``stands_behind`` says: its own kind is recognised first."""
        from armctl.hardware.firmata.line import FirmataListener

        return FirmataListener()

    def ask(self, line: Transport, now: Callable[[], float]) -> Introduction | None:
        """Read the chip on a bus. An Arduino is not asked whether it has one: that takes two of its pins."""
        from armctl.hardware.pca9685.check_up import introduce

        return introduce(line, now)

    def examine(self, check_up: CheckUp) -> list[Finding]:
        """Chip, frequency, clock, channels and round trips."""
        from armctl.hardware.pca9685.check_up import examine_pca9685

        return examine_pca9685(check_up, _options(check_up.settings))


def _options(settings: object) -> Pca9685Options:
    return settings if isinstance(settings, Pca9685Options) else Pca9685Options()

"""An Arduino with armctl's own firmware, for motors with encoders."""

from __future__ import annotations

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
    Listener,
    Setup,
    SimulatorOption,
    SimulatorOptions,
)
from armctl.hardware.driver import Driver
from armctl.hardware.encoder import FLASH_IT, SCALE

if TYPE_CHECKING:
    from armctl.hardware.encoder.axes import EncoderSettings
    from armctl.hardware.encoder.simulated_axis import Trouble
    from armctl.hardware.transport import Connection
    from armctl.robot.board_entries import BoardPart
    from armctl.robot.outputs import OutputMap

_TIMEOUT_S, _SIMULATED_TIMEOUT_S = 0.1, 0.5
_MOST_AXES = 6
_TROUBLES: tuple[tuple[Trouble, str], ...] = (
    ("stall", "jams"),
    ("torn", "has no encoder any more"),
    ("slip", "loses an edge of its encoder every 1000 counts"),
)


class EncoderEntries:
    """Reads ``encoder`` tables, and ``differential`` in ``[board]``."""

    def read(self, part: BoardPart) -> tuple[OutputMap | None, EncoderSettings]:
        """The map of the joints, and the axes behind it (``axes.read_entries``)."""
        from armctl.hardware.encoder.axes import read_entries

        return read_entries(part)


class EncoderBoard(BoardType):
    """An Arduino Mega with armctl's encoder firmware."""

    kind = "encoder"
    title = "Arduino with armctl's encoder firmware"
    plugged_in = "Arduino"
    scale = SCALE
    entries = EncoderEntries()
    usb = ARDUINO_USB
    likely = ARDUINO_LIKELY
    shared = (ARDUINO_MEGA, USB_SERIAL)
    restarts = True
    homing = True
    power = "motors"
    off_when_left = True
    limits_acceleration = True
    inputs = ("digital", "pull-up")
    outputs = ("digital",)
    advice = FLASH_IT
    simulator_robot = "scorbot"
    simulator_help = """Serve a simulated Mega with armctl's encoder firmware and an arm until interrupted.

    Its axes must be homed. At first each takes about a second; far from the home switches all of them
    take half a minute. It does not restart when its port is opened, as a real Mega does.
    """

    simulator_options = tuple(
        SimulatorOption(trouble, f"An axis that {what} as soon as it is homed.", between=(0, 5), whole=True)
        for trouble, what in _TROUBLES
    )

    def settings_type(self) -> type[EncoderSettings]:
        """Its axes."""
        from armctl.hardware.encoder.axes import EncoderSettings

        return EncoderSettings

    def driver(self, setup: Setup, connection: Connection) -> Driver:
        """A driver."""
        from armctl.hardware.encoder.driver import EncoderDriver

        timeout_s = _SIMULATED_TIMEOUT_S if connection.simulated else _TIMEOUT_S
        return EncoderDriver(connection, _settings(setup), timeout_s)

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        """A simulated board with an arm on it that fits the robot."""
        from armctl.hardware.encoder.simulated import simulated_encoder_board

        troubles: dict[int, Trouble] = {}
        for trouble, _ in _TROUBLES:
            if (axis := options.get(trouble)) is not None:
                troubles[int(axis)] = trouble
        return simulated_encoder_board(setup.channels, _settings(setup).axes, troubles)

    def check(self, setup: Setup) -> None:
        """Refuse what the board would refuse."""
        from armctl.hardware.encoder.axes import AxisTable
        from armctl.hardware.encoder.pins import check_pins

        AxisTable(setup.channels, _settings(setup), _MOST_AXES)
        check_pins(setup.signals)

    def listener(self) -> Listener:
        """Recognises the banner, and the status line that comes 50 times a second."""
        from armctl.hardware.encoder.session import EncoderListener

        return EncoderListener()

    def examine(self, check_up: CheckUp) -> list[Finding]:
        """Firmware, axes, switches, faults and round trips."""
        from armctl.hardware.encoder.driver import examine_encoder

        return examine_encoder(check_up)


def _settings(setup: Setup) -> EncoderSettings:
    from armctl.hardware.encoder.axes import EncoderSettings

    return setup.settings if isinstance(setup.settings, EncoderSettings) else EncoderSettings()

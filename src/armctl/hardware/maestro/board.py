"""Pololu's Maestro: servos on six to twenty-four channels, over USB."""

from __future__ import annotations

import re
from collections.abc import Callable
from types import MappingProxyType
from typing import TYPE_CHECKING

from armctl.errors import BoardTimeoutError
from armctl.hardware.board_type import (
    BoardType,
    ByteModel,
    CheckUp,
    Finding,
    Introduction,
    Setup,
    SimulatorOption,
    SimulatorOptions,
)
from armctl.hardware.driver import Driver
from armctl.hardware.maestro import DEFAULT_DEVICE_NUMBER, SCALE, SILENT_ADVICE, MaestroModel
from armctl.robot.board_entries import ServoEntries

if TYPE_CHECKING:
    from armctl.hardware.transport import Connection, Transport

_USB_VENDOR = 0x1FFB
_TTL_INTERFACE = 2
_STABLE_NAME = re.compile(r"Pololu_.*Maestro_(6|12|18|24)-Servo")
_SIMULATED_TIMEOUT_S = 0.5
_ANSWER_S = 1.0


class MaestroBoard(BoardType):
    """A Pololu Maestro of any size."""

    kind = "maestro"
    title = "Pololu Maestro"
    plugged_in = "Maestro"
    scale = SCALE
    entries = ServoEntries()
    inputs = ("digital", "analog")
    outputs = ("digital",)
    usb = MappingProxyType({(_USB_VENDOR, one.usb_product): one.label for one in MaestroModel})
    likely = (tuple(model.label for model in MaestroModel),)
    advice = SILENT_ADVICE
    simulator_robot = "uzuner"
    simulator_help = """Serve a simulated Pololu Maestro until interrupted.

    It speaks the compact and the Pololu protocol in USB dual-port mode.
    """
    simulator_options = (
        SimulatorOption("factory", "Leave all channels at the factory's 992 … 2000 µs."),
        SimulatorOption("channels", "Board size (default: what the robot needs).", ("6", "12", "18", "24")),
        SimulatorOption("crc", "Want a CRC-7 after each command."),
        SimulatorOption("device", "Its number in the Pololu protocol (default: 12).", (), (0, 127), True),
        SimulatorOption(
            "timeout",
            "Serial timeout [s], after which it goes home (default: none).",
            (),
            (0.01, 655.35),
        ),
    )

    def driver(self, setup: Setup, connection: Connection) -> Driver:
        """A driver; that of a simulated board knows the model, which no listing tells."""
        from armctl.hardware.maestro.driver import MaestroDriver

        if not connection.simulated:
            return MaestroDriver(connection)
        return MaestroDriver(connection, model=_smallest(setup), timeout_s=_SIMULATED_TIMEOUT_S)

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        """A simulated Maestro whose channels have the robot's ranges."""
        from armctl.hardware.maestro.simulated import MaestroSettings, simulated_maestro

        size, device, timeout_s = (options.get(name) for name in ("channels", "device", "timeout"))
        settings = MaestroSettings(
            device=DEFAULT_DEVICE_NUMBER if device is None else int(device),
            crc=bool(options.get("crc")),
            timeout_units=0 if timeout_s is None else round(100 * float(timeout_s)),
        )
        model = None if size is None else MaestroModel.with_channels(int(size))
        channels = () if options.get("factory") else setup.channels
        return simulated_maestro(channels, model, settings, setup.signals)

    def check(self, setup: Setup) -> None:
        """Refuse what the largest Maestro would refuse."""
        from armctl.hardware.maestro.driver import channel_table, check_signals

        channel_table(setup.channels, None)
        check_signals(setup.signals, None)

    def listed_by_name(self, stable_name: str) -> str | None:
        """Udev's name of a Maestro tells its size."""
        found = _STABLE_NAME.search(stable_name)
        return MaestroModel.with_channels(int(found[1])).label if found else None

    def port_refusal(self, listing: str, interface: int | None) -> str | None:
        """A Maestro has two ports, and answers on the first."""
        if interface != _TTL_INTERFACE:
            return None
        return "this is the Maestro's TTL port, which passes bytes to its TX pin; use the port ending in if00"

    def ask(self, line: Transport, now: Callable[[], float]) -> Introduction | None:
        """Get Errors, and after silence the CRC byte that completes it (``MaestroLine.probe``)."""
        from armctl.hardware.maestro.codec import error_words
        from armctl.hardware.maestro.driver import MaestroLine

        board = MaestroLine(line, _ANSWER_S)
        try:
            earlier = board.probe()
        except BoardTimeoutError:
            return None
        details = ("commands carry a CRC",) if board.crc else ()
        return Introduction(self.title, details=details, reported=error_words(earlier))

    def examine(self, check_up: CheckUp) -> list[Finding]:
        """Serial mode, CRC, error register, channels, ranges and round trips."""
        from armctl.hardware.maestro.check_up import examine_maestro

        model = None if check_up.listing is None else MaestroModel.from_label(check_up.listing)
        if check_up.simulated:
            model = _smallest(Setup(check_up.needs.channels))
        return examine_maestro(check_up, model)


def _smallest(setup: Setup) -> MaestroModel:
    """The smallest Maestro with enough channels."""
    every = (*setup.channels, *setup.signals.inputs, *setup.signals.outputs)
    return MaestroModel.with_channels(max((one.channel for one in every), default=0) + 1)

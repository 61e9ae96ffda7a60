"""Arduinos with StandardFirmata: codec, driver and a simulated board."""

from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.firmata.replies import (
    BoardText,
    CapabilityReport,
    FirmwareReport,
    Malformed,
    PinState,
    ReplyParser,
    VersionReport,
)
from armctl.hardware.firmata.simulated import Pulse, SimulatedFirmata, serve_simulated_firmata

__all__ = [
    "BoardText",
    "CapabilityReport",
    "FirmataDriver",
    "FirmwareReport",
    "Malformed",
    "PinState",
    "Pulse",
    "ReplyParser",
    "SimulatedFirmata",
    "VersionReport",
    "serve_simulated_firmata",
]

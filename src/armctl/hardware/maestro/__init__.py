"""Pololu's Maestro: codec, driver and a simulated board."""

from armctl.hardware.maestro.codec import COMPACT, DEFAULT_DEVICE_NUMBER, Framing, MaestroErrors, error_words
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import (
    ChannelConfig,
    HomeMode,
    MaestroSettings,
    ReceivedCommand,
    SerialMode,
    SimulatedMaestro,
    serve_simulated_maestro,
)
from armctl.hardware.ports import MaestroModel

__all__ = [
    "COMPACT",
    "DEFAULT_DEVICE_NUMBER",
    "ChannelConfig",
    "Framing",
    "HomeMode",
    "MaestroDriver",
    "MaestroErrors",
    "MaestroModel",
    "MaestroSettings",
    "ReceivedCommand",
    "SerialMode",
    "SimulatedMaestro",
    "error_words",
    "serve_simulated_maestro",
]

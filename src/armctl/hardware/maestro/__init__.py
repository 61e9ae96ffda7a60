"""Pololu's Maestro: codec, driver and a simulated board."""

from armctl.hardware.maestro.codec import COMPACT, DEFAULT_DEVICE_NUMBER, Framing
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.error_register import MaestroErrors, error_words
from armctl.hardware.maestro.serve import serve_simulated_maestro
from armctl.hardware.maestro.simulated import MaestroSettings, ReceivedCommand, SerialMode, SimulatedMaestro
from armctl.hardware.maestro.simulated_channel import ChannelConfig, HomeMode
from armctl.hardware.maestro_models import MaestroModel

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

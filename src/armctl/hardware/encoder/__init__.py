"""armctl's own encoder board: codec, driver and a simulated board."""

from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.encoder.messages import Banner, FaultKind, Message, Mode, Status, decode
from armctl.hardware.encoder.simulated import (
    SimulatedEncoderBoard,
    serve_simulated_encoder,
    simulated_encoder_board,
)
from armctl.hardware.encoder.simulated_axis import AxisPlant

__all__ = [
    "AxisPlant",
    "Banner",
    "EncoderDriver",
    "FaultKind",
    "Message",
    "Mode",
    "SimulatedEncoderBoard",
    "Status",
    "decode",
    "serve_simulated_encoder",
    "simulated_encoder_board",
]

"""armctl's own encoder board: codec, driver and a simulated board."""

from armctl.hardware.encoder.axis_fault import FaultKind
from armctl.hardware.encoder.axis_plant import AxisPlant
from armctl.hardware.encoder.driver import EncoderDriver
from armctl.hardware.encoder.messages import Banner, Message, decode
from armctl.hardware.encoder.serve import serve_simulated_encoder, simulated_encoder_board
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.hardware.encoder.status import Mode, Status

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

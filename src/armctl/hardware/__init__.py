"""Boards: transports, codecs, drivers, simulated boards."""

from armctl.hardware.byte_model import ByteModel
from armctl.hardware.driver import BoardIdentity, ChannelSettings, Driver, HomingState, Readback, Source
from armctl.hardware.faults import Fault, FaultyModel
from armctl.hardware.loop_transport import LoopTransport
from armctl.hardware.ports import PortInfo, describe_port, find_board, list_ports
from armctl.hardware.pty_server import PtyServer
from armctl.hardware.serial_transport import SerialTransport
from armctl.hardware.transport import Transport

__all__ = [
    "BoardIdentity",
    "ByteModel",
    "ChannelSettings",
    "Driver",
    "Fault",
    "FaultyModel",
    "HomingState",
    "LoopTransport",
    "PortInfo",
    "PtyServer",
    "Readback",
    "SerialTransport",
    "Source",
    "Transport",
    "describe_port",
    "find_board",
    "list_ports",
]

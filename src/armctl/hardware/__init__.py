"""Boards: transports, codecs, drivers, simulated boards."""

from armctl.hardware.driver import BoardIdentity, ChannelSettings, Driver, HomingState, Readback, Source
from armctl.hardware.ports import PortInfo, describe_port, find_board, list_ports
from armctl.hardware.simulation.faults import Fault, FaultyModel
from armctl.hardware.simulation.loop_transport import LoopTransport
from armctl.hardware.simulation.pty_server import ByteModel, PtyServer
from armctl.hardware.transport import SerialTransport, Transport

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

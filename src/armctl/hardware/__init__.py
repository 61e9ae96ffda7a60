"""Boards: what a kind of board must tell of itself, and the seam between the runtime and any of them."""

from armctl.hardware.board_type import (
    BoardType,
    ByteModel,
    Introduction,
    Listener,
    Setup,
    SimulatorOption,
    SimulatorOptions,
)
from armctl.hardware.driver import (
    Abilities,
    BoardIdentity,
    ChannelScale,
    ChannelSettings,
    ChannelTable,
    Driver,
    HomingState,
    Readback,
    Source,
)
from armctl.robot.board_entries import BoardEntries, BoardPart, ServoEntries

__all__ = [
    "Abilities",
    "BoardEntries",
    "BoardIdentity",
    "BoardPart",
    "BoardType",
    "ByteModel",
    "ChannelScale",
    "ChannelSettings",
    "ChannelTable",
    "Driver",
    "HomingState",
    "Introduction",
    "Listener",
    "Readback",
    "ServoEntries",
    "Setup",
    "SimulatorOption",
    "SimulatorOptions",
    "Source",
]

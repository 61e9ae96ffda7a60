"""An operator's console for small serial robot arms."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from armctl.errors import ArmctlError
from armctl.hardware.boards import find_entries, signal_kinds
from armctl.robot import Robot, board_entries, load_robot, shipped_robots
from armctl.version import __version__

if TYPE_CHECKING:
    from armctl.arm import Arm


board_entries.find_signal_kinds = signal_kinds
board_entries.find_entries = find_entries  # robot files are read in a layer below the boards
logging.getLogger("armctl").addHandler(logging.NullHandler())  # whoever uses the library chooses what to show
__all__ = ["Arm", "ArmctlError", "Robot", "__version__", "load_robot", "shipped_robots"]


def __getattr__(name: str) -> object:
    """Import ``Arm`` when it is first asked for: the library's kinematics must not pull drivers in."""
    if name == "Arm":
        from armctl.arm import Arm

        return Arm
    raise AttributeError(f"module 'armctl' has no attribute {name!r}")

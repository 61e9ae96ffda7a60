"""The arm process: controller, planner, gate and driver in an interpreter of their own, and its clients."""

from armctl.process.lines import RemoteLine
from armctl.process.link import Link
from armctl.process.start import start_arm

__all__ = ["Link", "RemoteLine", "start_arm"]

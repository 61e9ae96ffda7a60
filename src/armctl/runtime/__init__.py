"""The runtime: commands in, snapshots out."""

from armctl.runtime.controller import Controller
from armctl.runtime.last_pose import PoseFolder
from armctl.runtime.planner import InlineExecutor

__all__ = ["Controller", "InlineExecutor", "PoseFolder"]

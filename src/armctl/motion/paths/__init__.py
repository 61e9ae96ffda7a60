"""Paths: where a motion goes, without its time."""

from armctl.motion.paths.tool_path import PITCH_MODES, PitchMode, ToolPath, tool_arc, tool_line, usual_pitch
from armctl.motion.paths.tool_refusal import PathPlace, ToolPathRefusedError, ToolPathUnreachableError

__all__ = [
    "PITCH_MODES",
    "PathPlace",
    "PitchMode",
    "ToolPath",
    "ToolPathRefusedError",
    "ToolPathUnreachableError",
    "tool_arc",
    "tool_line",
    "usual_pitch",
]

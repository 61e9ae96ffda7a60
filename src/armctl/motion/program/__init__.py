"""Serial-motion programs: steps, files, editing."""

from armctl.motion.program.edit import delete, insert, move, replace
from armctl.motion.program.file import decode_program, encode_program, load_program, save_program
from armctl.motion.program.program import (
    ArcStep,
    CommentStep,
    EndStep,
    GripperStep,
    LineStep,
    MotionStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    SpeedStep,
    Step,
    WaitStep,
)

__all__ = [
    "ArcStep",
    "CommentStep",
    "EndStep",
    "GripperStep",
    "LineStep",
    "MotionStep",
    "MoveStep",
    "PointStep",
    "Program",
    "RepeatStep",
    "SpeedStep",
    "Step",
    "WaitStep",
    "decode_program",
    "delete",
    "encode_program",
    "insert",
    "load_program",
    "move",
    "replace",
    "save_program",
]

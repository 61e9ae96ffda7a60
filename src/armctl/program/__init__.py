"""Serial-motion programs: steps, blocks, files, editing."""

from armctl.program.base_steps import Effect, Senses, Until
from armctl.program.check import check_program
from armctl.program.conditions import Condition
from armctl.program.csv import read_csv, write_csv
from armctl.program.draw_step import DrawStep
from armctl.program.files import (
    PROGRAM_SUFFIXES,
    checked_program,
    decode_program,
    encode_program,
    load_program,
    may_be_program,
    open_program,
    read_program,
    save_program,
    write_script,
)
from armctl.program.frames import FrameStep, UserFrame
from armctl.program.grid_step import GridStep
from armctl.program.logic_steps import CountStep, ElseStep, IfStep, WhileStep
from armctl.program.program import Blocks, Cursor, Program
from armctl.program.steps import (
    ArcStep,
    CommentStep,
    EndStep,
    GripperStep,
    LineStep,
    MotionStep,
    MoveStep,
    PointStep,
    RepeatStep,
    SetStep,
    SpeedStep,
    Step,
    WaitForStep,
    WaitStep,
)

__all__ = [
    "PROGRAM_SUFFIXES",
    "ArcStep",
    "Blocks",
    "CommentStep",
    "Condition",
    "CountStep",
    "Cursor",
    "DrawStep",
    "Effect",
    "ElseStep",
    "EndStep",
    "FrameStep",
    "GridStep",
    "GripperStep",
    "IfStep",
    "LineStep",
    "MotionStep",
    "MoveStep",
    "PointStep",
    "Program",
    "RepeatStep",
    "Senses",
    "SetStep",
    "SpeedStep",
    "Step",
    "Until",
    "UserFrame",
    "WaitForStep",
    "WaitStep",
    "WhileStep",
    "check_program",
    "checked_program",
    "decode_program",
    "encode_program",
    "load_program",
    "may_be_program",
    "open_program",
    "read_csv",
    "read_program",
    "save_program",
    "write_csv",
    "write_script",
]

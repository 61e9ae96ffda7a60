"""Serial-motion programs: steps, blocks, files, editing."""

from armctl.program.base_steps import Effect, MotionStep, Senses, Step, Until
from armctl.program.check import check_program
from armctl.program.conditions import Condition
from armctl.program.csv import read_csv, write_csv
from armctl.program.draw_step import DrawStep
from armctl.program.files import (
    PROGRAM_SUFFIXES,
    SavedPrograms,
    checked_program,
    decode_program,
    encode_program,
    load_program,
    may_be_program,
    open_program,
    read_program,
    save_program,
)
from armctl.program.frames import FrameStep, UserFrame
from armctl.program.grid_step import GridStep
from armctl.program.logic_steps import CallStep, CountStep, ElseStep, EndStep, IfStep, RepeatStep, WhileStep
from armctl.program.message_step import MessageStep
from armctl.program.motion_steps import ArcStep, LineStep, MoveStep, PointStep
from armctl.program.pick_steps import PickStep, PlaceStep
from armctl.program.program import Blocks, CalledProgram, Cursor, Program
from armctl.program.scripts import write_script
from armctl.program.signal_steps import SetStep, WaitForStep
from armctl.program.standing_steps import GripperStep, SpeedStep, ToolStep, WaitStep
from armctl.program.steps import CommentStep

__all__ = [
    "PROGRAM_SUFFIXES",
    "ArcStep",
    "Blocks",
    "CallStep",
    "CalledProgram",
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
    "MessageStep",
    "MotionStep",
    "MoveStep",
    "PickStep",
    "PlaceStep",
    "PointStep",
    "Program",
    "RepeatStep",
    "SavedPrograms",
    "Senses",
    "SetStep",
    "SpeedStep",
    "Step",
    "ToolStep",
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

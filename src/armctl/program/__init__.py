"""Serial-motion programs: steps, blocks, files, editing."""

from armctl.program.check import ProgramFinding, check_program
from armctl.program.csv import CsvForm, read_csv, write_csv
from armctl.program.feed import (
    PlannedStep,
    PlanState,
    ProgramSource,
    begin_program,
    plan_next,
    require_runnable,
)
from armctl.program.program import Blocks, Cursor, Program
from armctl.program.rehearsal import Rehearsal, rehearse, rehearse_pose
from armctl.program.script import write_script
from armctl.program.steps import (
    WIDEST_BLEND_MM,
    ArcStep,
    CommentStep,
    EndStep,
    GripperStep,
    LineStep,
    MotionStep,
    MoveStep,
    PointStep,
    RepeatStep,
    SpeedStep,
    Step,
    WaitStep,
)
from armctl.program.toml import (
    PROGRAM_SUFFIXES,
    checked_program,
    decode_program,
    encode_program,
    load_program,
    open_program,
    read_program,
    save_program,
)

__all__ = [
    "PROGRAM_SUFFIXES",
    "WIDEST_BLEND_MM",
    "ArcStep",
    "Blocks",
    "CommentStep",
    "CsvForm",
    "Cursor",
    "EndStep",
    "GripperStep",
    "LineStep",
    "MotionStep",
    "MoveStep",
    "PlanState",
    "PlannedStep",
    "PointStep",
    "Program",
    "ProgramFinding",
    "ProgramSource",
    "Rehearsal",
    "RepeatStep",
    "SpeedStep",
    "Step",
    "WaitStep",
    "begin_program",
    "check_program",
    "checked_program",
    "decode_program",
    "encode_program",
    "load_program",
    "open_program",
    "plan_next",
    "read_csv",
    "read_program",
    "rehearse",
    "rehearse_pose",
    "require_runnable",
    "save_program",
    "write_csv",
    "write_script",
]

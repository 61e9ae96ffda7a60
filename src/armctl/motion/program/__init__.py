"""Serial-motion programs: steps, blocks, files, editing."""

from armctl.motion.program.blocks import Blocks, block_findings, depths_of
from armctl.motion.program.csv_read import read_csv
from armctl.motion.program.csv_write import CsvForm, write_csv
from armctl.motion.program.cursor import Cursor
from armctl.motion.program.edit import delete, duplicate, insert, move, repeat, replace
from armctl.motion.program.file import (
    checked_program,
    decode_program,
    encode_program,
    load_program,
    save_program,
)
from armctl.motion.program.program import (
    WIDEST_BLEND_MM,
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
    kind_of,
)
from armctl.motion.program.read import PROGRAM_SUFFIXES, open_program, read_program
from armctl.motion.program.script_read import read_script
from armctl.motion.program.script_write import write_script

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
    "PointStep",
    "Program",
    "RepeatStep",
    "SpeedStep",
    "Step",
    "WaitStep",
    "block_findings",
    "checked_program",
    "decode_program",
    "delete",
    "depths_of",
    "duplicate",
    "encode_program",
    "insert",
    "kind_of",
    "load_program",
    "move",
    "open_program",
    "read_csv",
    "read_program",
    "read_script",
    "repeat",
    "replace",
    "save_program",
    "write_csv",
    "write_script",
]

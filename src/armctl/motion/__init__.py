"""Motion: profiles, trajectories, paths, programs, pre-flight."""

from armctl.motion.joined import JoinedTrajectory
from armctl.motion.plan import Profile, plan_joints, plan_step, plan_target, solve, step_target
from armctl.motion.preflight import FLOOR_TOLERANCE_M, Finding, preflight, require_clear
from armctl.motion.preflight.floor import Floor
from armctl.motion.profiles.cubic import CubicTrajectory, shortest_duration
from armctl.motion.profiles.trapezoid import TrapezoidTrajectory
from armctl.motion.program import (
    GripperStep,
    MoveStep,
    PointStep,
    Program,
    Step,
    WaitStep,
    decode_program,
    delete,
    encode_program,
    insert,
    load_program,
    move,
    replace,
    save_program,
)
from armctl.motion.program_check import ProgramFinding, check_program
from armctl.motion.published_paths import arc, line
from armctl.motion.trajectory import Sample, Trajectory

__all__ = [
    "FLOOR_TOLERANCE_M",
    "CubicTrajectory",
    "Finding",
    "Floor",
    "GripperStep",
    "JoinedTrajectory",
    "MoveStep",
    "PointStep",
    "Profile",
    "Program",
    "ProgramFinding",
    "Sample",
    "Step",
    "Trajectory",
    "TrapezoidTrajectory",
    "WaitStep",
    "arc",
    "check_program",
    "decode_program",
    "delete",
    "encode_program",
    "insert",
    "line",
    "load_program",
    "move",
    "plan_joints",
    "plan_step",
    "plan_target",
    "preflight",
    "replace",
    "require_clear",
    "save_program",
    "shortest_duration",
    "solve",
    "step_target",
]

"""Kinematics in pure numpy: chains, inverse solutions, energy, reach. No I/O, no clock, no robot file."""

from armctl.kinematics.angles import quaternion_wxyz, roll_pitch_yaw, rotation_from_rpy
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import (
    CRITERIA,
    CRITERION_TEXT,
    FROM_START,
    Body,
    Criterion,
    EnergyModel,
    GravityModel,
    checked_criterion,
)
from armctl.kinematics.families.registry import Branch, BranchFinder, inverse_kinematics
from armctl.kinematics.frames import DHRow
from armctl.kinematics.samples import DEFAULT_STEP
from armctl.kinematics.solutions import BatchSolutions, Choice, Solutions
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.target import Target, rotation_of

__all__ = [
    "CRITERIA",
    "CRITERION_TEXT",
    "DEFAULT_STEP",
    "FROM_START",
    "BatchSolutions",
    "Body",
    "Branch",
    "BranchFinder",
    "Chain",
    "Choice",
    "Criterion",
    "DHRow",
    "EnergyModel",
    "GravityModel",
    "InverseKinematics",
    "Solutions",
    "Target",
    "checked_criterion",
    "inverse_kinematics",
    "quaternion_wxyz",
    "roll_pitch_yaw",
    "rotation_from_rpy",
    "rotation_of",
]

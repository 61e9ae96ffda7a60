"""Motion: profiles, trajectories, paths, pre-flight."""

from armctl.motion.analysis import arc, line
from armctl.motion.choices import plan_choice, plan_target, solve
from armctl.motion.clearance import FLOOR_TOLERANCE_M, Floor, Obstacles, SelfCollision
from armctl.motion.paths.refusals import ToolPathRefusedError, ToolPathUnreachableError
from armctl.motion.paths.tool_path import PitchMode, TurnMode, usual_pitch
from armctl.motion.plan import Profile, plan_arc, plan_joints, plan_line, plan_spline
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.preflight import Finding, Kind, not_checked, preflight, require_clear
from armctl.motion.profiles import PROFILES, PointToPoint, ProfileName, stopping_s
from armctl.motion.timing import PathTrajectory
from armctl.motion.trajectory import JoinedTrajectory, Sample, SlowedTrajectory, Trajectory, peaks_of

__all__ = [
    "FLOOR_TOLERANCE_M",
    "PROFILES",
    "Finding",
    "Floor",
    "JoinedTrajectory",
    "Kind",
    "Obstacles",
    "PathTrajectory",
    "PiecewisePolynomial",
    "PitchMode",
    "PointToPoint",
    "Profile",
    "ProfileName",
    "Sample",
    "SelfCollision",
    "SlowedTrajectory",
    "ToolPathRefusedError",
    "ToolPathUnreachableError",
    "Trajectory",
    "TurnMode",
    "arc",
    "line",
    "not_checked",
    "peaks_of",
    "plan_arc",
    "plan_choice",
    "plan_joints",
    "plan_line",
    "plan_spline",
    "plan_target",
    "preflight",
    "require_clear",
    "solve",
    "stopping_s",
    "usual_pitch",
]

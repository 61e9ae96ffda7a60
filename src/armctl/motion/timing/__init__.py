"""Timing: how fast a path is followed."""

from armctl.motion.timing.path_trajectory import PathTrajectory
from armctl.motion.timing.speed_plan import PathLimits, SpeedPlan, TooFastError
from armctl.motion.timing.stopping import stopping_s
from armctl.motion.timing.timed import timed

__all__ = ["PathLimits", "PathTrajectory", "SpeedPlan", "TooFastError", "stopping_s", "timed"]

"""Motion profiles: how a point-to-point motion is spread over time."""

from armctl.motion.profiles.cubic import CubicTrajectory, shortest_duration
from armctl.motion.profiles.trapezoid import TrapezoidTrajectory

__all__ = ["CubicTrajectory", "TrapezoidTrajectory", "shortest_duration"]

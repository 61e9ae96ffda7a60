"""Pre-flight: what is wrong with a motion, before the arm makes it."""

from armctl.motion.preflight.batch import Finding, Kind, Severity
from armctl.motion.preflight.clearance import FLOOR_TOLERANCE_M, Floor, Obstacles, SelfCollision
from armctl.motion.preflight.preflight import preflight, preflight_batch, require_clear
from armctl.motion.preflight.torque import not_checked

__all__ = [
    "FLOOR_TOLERANCE_M",
    "Finding",
    "Floor",
    "Kind",
    "Obstacles",
    "SelfCollision",
    "Severity",
    "not_checked",
    "preflight",
    "preflight_batch",
    "require_clear",
]

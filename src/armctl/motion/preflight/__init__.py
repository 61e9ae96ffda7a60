"""Pre-flight: what is wrong with a motion, before the arm makes it."""

from armctl.motion.preflight.clearance import FLOOR_TOLERANCE_M, Floor, Obstacles, SelfCollision
from armctl.motion.preflight.preflight import isotropy_of, not_checked, preflight, require_clear
from armctl.motion.preflight.sampled import Finding, Kind, Severity

__all__ = [
    "FLOOR_TOLERANCE_M",
    "Finding",
    "Floor",
    "Kind",
    "Obstacles",
    "SelfCollision",
    "Severity",
    "isotropy_of",
    "not_checked",
    "preflight",
    "require_clear",
]

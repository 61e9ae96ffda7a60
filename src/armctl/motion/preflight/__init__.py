"""Pre-flight: what is wrong with a motion, before the arm makes it."""

from armctl.motion.preflight.floor import Floor
from armctl.motion.preflight.preflight import FLOOR_TOLERANCE_M, Finding, preflight, require_clear

__all__ = ["FLOOR_TOLERANCE_M", "Finding", "Floor", "preflight", "require_clear"]

"""Motion profiles: how a motion is spread over time."""

from armctl.motion.profiles.law import PROFILES, ProfileName, law_over
from armctl.motion.profiles.point_to_point import (
    PointToPoint,
    checked_duration,
    checked_ends,
    shortest_words,
)

__all__ = [
    "PROFILES",
    "PointToPoint",
    "ProfileName",
    "checked_duration",
    "checked_ends",
    "law_over",
    "shortest_words",
]

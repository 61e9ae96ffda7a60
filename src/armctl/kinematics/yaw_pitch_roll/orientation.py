"""Where the tool points in the vertical plane: what a pitch above the horizontal asks for."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PlanePose:
    """Tool direction in the vertical plane and roll."""

    tool_angle: float | None
    """plane angle of the approach axis above forward [rad]; None: whatever the position gives"""
    roll: float
    """angle of the roll joint [rad]; 0 where there is none"""


def pitch_poses(pitch: float | None, roll: float) -> list[PlanePose]:
    """Plane angles that hold the tool at a pitch above the horizontal.

    A pitch within ±90° is met by a tool that points away from the base axis and by one that points back
    at it. Beyond ±90° the angle is taken as it is, in the arm's own plane: the tool points back.
    """
    if pitch is None:
        return [PlanePose(None, roll)]
    if abs(pitch) > math.pi / 2:
        return [PlanePose(pitch, roll)]
    return [PlanePose(pitch, roll), PlanePose(math.pi - pitch, roll)]

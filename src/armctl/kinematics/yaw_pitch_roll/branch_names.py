"""Names of the branches of *yaw + parallel pitch joints (+ roll)*."""

from __future__ import annotations

import itertools
import math

from armctl.kinematics.angles import wrap
from armctl.kinematics.yaw_pitch_roll.base_yaw import BaseBranch
from armctl.kinematics.yaw_pitch_roll.orientation import PlanePose

BRANCHES = tuple(
    f"{base} elbow-{elbow}{tool}"
    for base, elbow, tool in itertools.product(("front", "back"), ("up", "down"), ("", " tool-in"))
)
"""Index: 4 · back + 2 · elbow down + tool pointing back at the base axis."""
LEVEL = 1e-9
"""how near to upright a tool points neither outward nor back at the base axis (cosine)"""


def bend_sense(angle: float) -> int:
    """+1 or -1: the side to which a plane angle [rad] bends."""
    return 1 if wrap(angle) >= 0 else -1


def branch_index(front: bool, bend: int, tool_in: bool = False) -> int:
    """Index into ``BRANCHES``.

    A positive bend leaves the elbow below the line to the target in front, above it at the back.
    """
    elbow_up = (bend < 0) == front
    return 4 * (not front) + 2 * (not elbow_up) + tool_in


def tool_points_in(branch: BaseBranch, pose: PlanePose) -> bool:
    """True when the tool points back at the base axis."""
    if pose.tool_angle is None:
        return False
    outward = math.cos(pose.tool_angle) if branch.front else -math.cos(pose.tool_angle)
    return outward < -LEVEL

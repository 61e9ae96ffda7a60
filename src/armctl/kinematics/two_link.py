"""The planar two-link triangle, which every closed form of this package comes down to."""

from __future__ import annotations

import math

REACH_TOLERANCE = 1e-12
"""How far beyond the two links' reach rounding may carry a target [m]."""
ON_JOINT = 1e-12
"""How near to the first joint a target says nothing about the direction of links folded onto it [m]."""
_STRETCHED = 1.0 - 1e-13
"""From this cosine on the links count as stretched: the angle is lost in rounding (1e-16 in the cosine is
1e-8 rad), and a joint that stands on its limit would seem outside; the tip moves 1e-14 m."""
_FOLDING = -1.0 + 1e-6
"""up to this cosine the half angle is taken"""
_FOLDED = 1e-14
"""how far a tip may lie from where two folded links bring it [m]"""


def bend_angle(square: float, a: float, b: float) -> float | None:
    """The bend of two links whose tip is at a distance from the first joint.

    Args:
        square: squared distance of the target from the first joint [m²].
        a: length of the first link [m], positive.
        b: length of the second link [m], positive.

    Returns:
        The angle in [0, pi] of the second link against the first [rad], 0 and pi where they are in line;
        None when they do not reach.
    """
    cosine = (square - a * a - b * b) / (2.0 * a * b)
    if _FOLDING <= cosine <= _STRETCHED:
        return math.acos(cosine)
    distance = math.sqrt(square)
    if cosine > 0.0:
        return 0.0 if distance - (a + b) <= REACH_TOLERANCE else None
    least = abs(a - b)
    if distance <= least + _FOLDED:
        return math.pi if distance >= least - REACH_TOLERANCE else None
    # the half angle keeps its digits where the arc cosine loses them
    return math.pi - 2.0 * math.asin(math.sqrt((distance - least) * (distance + least) / (4.0 * a * b)))


def inner_angle(a: float, b: float, bend: float) -> float:
    """Direction of the tip of two links against the first [rad]; ``bend`` as ``bend_angle`` has it."""
    if bend == 0.0 or bend == math.pi:
        return math.pi if bend and b > a else 0.0
    return math.atan2(b * math.sin(bend), a + b * math.cos(bend))


def two_link(x: float, y: float, a: float, b: float) -> list[tuple[float, float]]:
    """Angles of two links that reach a point of the plane.

    Args:
        x: target along the zero direction [m].
        y: target across it [m].
        a: length of the first link [m], positive.
        b: length of the second link [m], positive.

    Returns:
        ``(first, bend)`` [rad]: the first link's direction and the second's relative to it; none, one
        (stretched or folded) or two (bend positive first). With the target on the first joint itself
        (a = b, folded) the direction is undefined and 0 is given.
    """
    direction = math.atan2(y, x)
    bend = bend_angle(x * x + y * y, a, b)
    if bend is None:
        return []
    inner = inner_angle(a, b, bend)
    if bend == 0.0 or bend == math.pi:
        return [(direction - inner, bend)]
    return [(direction - inner, bend), (direction + inner, -bend)]

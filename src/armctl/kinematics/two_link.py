"""The planar two-link triangle, which every closed form of this package comes down to."""

from __future__ import annotations

import math

COSINE_TOLERANCE = 1e-11
"""How far rounding may carry the elbow's cosine beyond ±1: less than 1e-12 m at the tip of these arms."""
STRAIGHT = 1e-13
"""How near to ±1 a cosine counts as stretched or folded. Its angle is lost in rounding there (1e-16 in the
cosine is 1e-8 rad), and a joint that stands on its limit would seem to be outside; the tip moves 1e-14 m."""
_NEARLY = 1.0 - STRAIGHT


def bend_angle(cosine: float) -> float | None:
    """The bend in [0, pi] [rad] of an elbow's cosine; None when the two links do not reach."""
    if -_NEARLY <= cosine <= _NEARLY:
        return math.acos(cosine)
    if abs(cosine) > 1.0 + COSINE_TOLERANCE:
        return None
    return 0.0 if cosine > 0.0 else math.pi


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
    return two_link_towards(x * x + y * y, math.atan2(y, x), a, b)


def two_link_towards(square: float, direction: float, a: float, b: float) -> list[tuple[float, float]]:
    """``two_link`` for a target at a squared distance [m²] in a direction [rad]."""
    cosine = (square - a * a - b * b) / (2.0 * a * b)
    if -_NEARLY <= cosine <= _NEARLY:
        bend = math.acos(cosine)
        inner = math.atan2(b * math.sqrt(1.0 - cosine * cosine), a + b * cosine)
        return [(direction - inner, bend), (direction + inner, -bend)]
    straight = bend_angle(cosine)
    if straight is None:
        return []
    return [(direction - (math.pi if straight and b > a else 0.0), straight)]

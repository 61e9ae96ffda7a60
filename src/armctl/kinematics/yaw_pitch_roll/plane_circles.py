"""Circles in the tool plane on which a yaw + pitch arm's tip runs while it cannot leave them by itself.

Where every pitch joint is at a limit or on the line through the tip, the tip can only move across that
line: the joints' columns of the planar Jacobian are parallel. So there are 3^m choices of which of the m
pitch joints is at which limit, the free groups of links lie on one line, and the arm is rigid but for one
angle: its tip runs on a circle.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PlaneCircle:
    """A rigid arm that turns by phi.

    tip = centre + arm · exp(i phi), plane angles = constants + slopes · phi
    """

    centre: complex
    """from the first pitch axis [m]"""
    arm: complex
    constants: tuple[float, ...]
    slopes: tuple[float, ...]


def collinear_circles(
    lengths: Sequence[float], plane_limits: Sequence[tuple[float, float]]
) -> Iterator[PlaneCircle]:
    """The circles of every choice of pitch joints at limits.

    Args:
        lengths: (m,) of the links [m].
        plane_limits: (m,) lower and upper limit of each plane angle [rad].
    """
    for sides in itertools.product((0, 1, None), repeat=len(lengths)):
        angles = [
            None if side is None else limits[side] for side, limits in zip(sides, plane_limits, strict=True)
        ]
        yield from _of_choice(lengths, angles)


def _of_choice(lengths: Sequence[float], angles: Sequence[float | None]) -> Iterator[PlaneCircle]:
    """The circles of one choice: plane angles of the joints at limits, None for those that are free."""
    groups, heading = [0j], 0.0  # the first stands still; a further one begins with each free joint
    for length, angle in zip(lengths, angles, strict=True):
        if angle is None:
            groups.append(complex(length))
            heading = 0.0
        else:
            heading += angle
            groups[-1] += length * cmath.exp(1j * heading)
    standing, *turning = groups
    for later in itertools.product((0.0, math.pi), repeat=max(0, len(turning) - 1)):
        senses = (0.0, *later)
        arm = sum(abs(g) * cmath.exp(1j * s) for g, s in zip(turning, senses, strict=False))
        constants, slopes = _line_up(angles, turning, senses)
        yield PlaneCircle(standing, complex(arm), constants, slopes)


def _line_up(
    angles: Sequence[float | None], groups: Sequence[complex], senses: Sequence[float]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Constants and slopes of the plane angles that bring every group onto the line at phi."""
    constants: list[float] = []
    slopes: list[float] = []
    heading, turns, group = 0.0, 0.0, 0
    for angle in angles:
        if angle is None:
            lead = senses[group] - cmath.phase(groups[group])
            constants.append(lead - heading)
            slopes.append(1.0 - turns)
            heading, turns, group = lead, 1.0, group + 1
        else:
            constants.append(angle)
            slopes.append(0.0)
            heading += angle
    return tuple(constants), tuple(slopes)

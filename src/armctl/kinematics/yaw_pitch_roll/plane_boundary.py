"""The boundary of what a yaw + pitch arm reaches in its tool plane: arcs, in closed form.

A boundary point is reached only where the free joints cannot push the tip across the boundary, so it lies
on one of the circles of ``plane_circles``, on the arc that the limits leave of it. Not every arc bounds:
most run through the inside. So each arc is cut where it meets another one, and a piece is kept when a
point beside its middle is out of reach.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import TWO_PI
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.plane_circles import PlaneCircle, collinear_circles
from armctl.kinematics.yaw_pitch_roll.plane_reach import PlaneReach, within

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
_SAME_M = 1e-9
"""closer points and radii [m] are the same but for rounding"""
_JOIN_M = 2e-4
"""how far apart the ends of neighbouring arcs may lie: pieces too short to count are left out between"""
_SHORTEST = 1e-4
"""of the arm's length: a shorter piece is none"""
_BESIDE = 1e-8
"""of the arm's length: how far beside a piece, at most, it is asked whether the arm reaches"""
_SLIVER = 0.05
"""of the square of a piece's length over that of the arm: arcs that touch part as slowly as that, and the
question must not skip a sliver between two of them"""
_TOLERANCE = 1e-12
"""[rad] over a limit: less than a point beside a piece lies out of reach"""


@dataclass(frozen=True, slots=True)
class PlaneArc:
    """A piece of a circle in the tool plane: centre + radius · exp(i α), α from start to end."""

    centre: complex
    """r + i z: forward of the base axis, above the base origin [m]"""
    radius: float
    """[m]"""
    start: float
    """[rad]"""
    end: float
    """[rad], above the start by 2 pi at most"""

    def at(self, angle: float) -> complex:
        """The point in a direction from the centre [rad]."""
        return self.centre + self.radius * cmath.exp(1j * angle)

    @property
    def middle(self) -> complex:
        """The point half-way."""
        return self.at(0.5 * (self.start + self.end))

    @property
    def length(self) -> float:
        """Along the arc [m]."""
        return self.radius * (self.end - self.start)

    @property
    def ends(self) -> tuple[complex, complex]:
        """Where it starts and ends."""
        return self.at(self.start), self.at(self.end)

    def polyline(self, chord_error_m: float) -> ComplexArray:
        """Points from end to end, with chords no farther than that from the arc."""
        widest = 2.0 * math.acos(max(1.0 - chord_error_m / self.radius, 0.0))
        count = max(2, math.ceil((self.end - self.start) / widest) + 1)
        angle = np.linspace(self.start, self.end, count)
        line: ComplexArray = self.centre + self.radius * (np.cos(angle) + 1j * np.sin(angle))
        return line


def boundary_arcs(geometry: YawPitchRoll, limits: FloatArray) -> tuple[PlaneArc, ...]:
    """All arcs that bound the reach with the base standing still, inner bounds included.

    Args:
        geometry: the arm.
        limits: (n, 2) joint limits [rad].
    """
    scale = sum(geometry.lengths)
    arcs = _inside_limits(geometry, limits, scale)
    pieces = [piece for arc in arcs for piece in _cut(arc, arcs, _SHORTEST * scale)]
    pieces = _without_doubles(pieces)
    if not pieces:
        return ()
    middle = np.array([piece.middle for piece in pieces], dtype=np.complex128)
    out = middle - np.array([piece.centre for piece in pieces], dtype=np.complex128)
    length = np.array([piece.length for piece in pieces])
    offset = np.minimum(_BESIDE * scale, _SLIVER * length * length / scale)
    beside: ComplexArray = offset * out / np.abs(out)
    reach = PlaneReach(geometry, limits, _TOLERANCE)
    inside = reach.contains(middle + beside) & reach.contains(middle - beside)
    return tuple(piece for piece, through in zip(pieces, inside.tolist(), strict=True) if not through)


def joined(arcs: Sequence[PlaneArc], chord_error_m: float) -> tuple[ComplexArray, ...]:
    """Arcs strung together to polylines (k,), closed where the arcs close."""
    left = [arc.polyline(chord_error_m) for arc in arcs]
    lines: list[ComplexArray] = []
    while left:
        line = left.pop()
        while left and abs(line[-1] - line[0]) > _JOIN_M:
            gaps = np.abs(np.array([[part[0], part[-1]] for part in left]) - line[-1])
            nearest, side = divmod(int(np.argmin(gaps)), 2)
            if gaps[nearest, side] > _JOIN_M:
                break
            part = left.pop(nearest)
            line = np.concatenate([line, (part if side == 0 else part[::-1])[1:]])
        if abs(line[-1] - line[0]) <= _JOIN_M:
            line[-1] = line[0]
        lines.append(line)
    return tuple(lines)


def _inside_limits(geometry: YawPitchRoll, limits: FloatArray, scale: float) -> list[PlaneArc]:
    """What the limits leave of each circle."""
    plane = [geometry.plane_limits(k, limits) for k in range(len(geometry.lengths))]
    arcs: list[PlaneArc] = []
    for circle in collinear_circles(geometry.lengths, plane):
        span = _span(circle, plane)
        if span is not None and abs(circle.arm) * (span[1] - span[0]) > _SHORTEST * scale:
            turn = cmath.phase(circle.arm)
            arcs.append(
                PlaneArc(geometry.shoulder + circle.centre, abs(circle.arm), span[0] + turn, span[1] + turn)
            )
    return arcs


def _span(circle: PlaneCircle, plane: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """The values of phi inside the limits; only the first free joint turns, the others stay in line."""
    span = None
    for constant, slope, (low, high) in zip(circle.constants, circle.slopes, plane, strict=True):
        if slope:
            span = low - constant, min(high - constant, low - constant + TWO_PI)
        elif not within(np.array([constant]), low, high)[0]:
            return None
    return span


def _cut(arc: PlaneArc, others: Iterable[PlaneArc], shortest: float) -> list[PlaneArc]:
    """The pieces between the points where an arc meets others."""
    cuts = [arc.start, arc.end]
    for other in others:
        for angle in _meetings(arc, other):
            at = arc.start + (angle - arc.start) % TWO_PI
            if at < arc.end:
                cuts.append(at)
    cuts.sort()
    pieces: list[PlaneArc] = []
    start = cuts[0]
    for end in cuts[1:]:
        if arc.radius * (end - start) > shortest:
            pieces.append(PlaneArc(arc.centre, arc.radius, start, end))
            start = end
    return pieces


def _meetings(arc: PlaneArc, other: PlaneArc) -> list[float]:
    """Directions from the arc's centre in which the two circles meet, or one ends on the other [rad]."""
    between = other.centre - arc.centre
    distance = abs(between)
    if distance < _SAME_M:
        if abs(arc.radius - other.radius) > _SAME_M:
            return []
        return [cmath.phase(end - arc.centre) for end in other.ends]
    along = (distance * distance + arc.radius**2 - other.radius**2) / (2.0 * distance)
    across = arc.radius**2 - along * along
    if across < -_SAME_M * arc.radius:
        return []
    spread = math.atan2(math.sqrt(max(across, 0.0)), along)
    towards = cmath.phase(between)
    return [towards - spread, towards + spread]


def _without_doubles(pieces: Iterable[PlaneArc]) -> list[PlaneArc]:
    """Each piece once: arcs of different joints may lie on the same circle."""
    kept: list[PlaneArc] = []
    for piece in pieces:
        same = (
            abs(piece.middle - other.middle) < _SAME_M
            and abs(piece.centre - other.centre) < _SAME_M
            and abs(piece.length - other.length) < _SAME_M
            for other in kept
        )
        if not any(same):
            kept.append(piece)
    return kept

"""Which points of its tool plane a yaw + pitch arm can reach inside its limits, for many points at once.

Two pitch joints: the triangle's two postures, tried against the limits. Three leave one joint free: the
configurations that reach a point form curves, and a curve ends where a joint meets a limit. One without
ends runs on until its first joint turns back, where the outer links are stretched or folded, or until
it has gone all the way round and passed any angle. So a point is reachable if, and only if, it is with a
joint at a limit, with the outer links in line, or with the first joint in the middle of its range.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI
from armctl.kinematics.tool_plane import ToolPlane
from armctl.kinematics.workspace import within

ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
_NO_LENGTH = 1e-12
_COSINE_TOLERANCE = 1e-11
"""how far rounding may carry the elbow's cosine beyond ±1"""
_CHUNK = 8192


class PlaneReach:
    """Reachable points of one arm's tool plane. Immutable; safe in several threads."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray, tolerance: float = LIMIT_TOLERANCE) -> None:
        """``tolerance``: how far rounding may carry a joint over its limit [rad]."""
        self._tolerance = tolerance
        self._shoulder, self._lengths = geometry.shoulder, geometry.lengths
        self._limits = [geometry.plane_limits(k, limits) for k in range(len(geometry.lengths))]

    def contains(self, points: ComplexArray) -> BoolArray:
        """Whether the tip can come to each point with the base standing still.

        Args:
            points: (k,) r + i z: forward of the base axis and above the base origin [m].
        """
        found = np.zeros(len(points), dtype=np.bool_)
        for first in range(0, len(points), _CHUNK):
            part = slice(first, first + _CHUNK)
            for postures in self._postures(points[part] - self._shoulder):
                found[part] |= self._inside(postures).any(axis=0)
        return found

    def _postures(self, tip: ComplexArray) -> Iterator[tuple[FloatArray, ...]]:
        """Plane angles (2, k) of each pitch joint; NaN where the links do not reach."""
        if len(self._lengths) == 2:
            yield _triangle(tip, *self._lengths)
            return
        l1, l2, l3 = self._lengths
        first, second, third = self._limits
        for angle in (*first, 0.5 * sum(first)):
            direction, bend = _triangle(tip - l1 * cmath.exp(1j * angle), l2, l3)
            yield np.full_like(bend, angle), direction - angle, bend
        for angle in second:
            rigid = l1 + l2 * cmath.exp(1j * angle)
            direction, bend = _triangle(tip, abs(rigid), l3)
            lead = cmath.phase(rigid)
            yield direction - lead, np.full_like(bend, angle), bend + lead - angle
        for angle in (*third, 0.0, math.pi):
            rigid = l2 + l3 * cmath.exp(1j * angle)
            direction, bend = _triangle(tip, l1, abs(rigid))
            yield direction, bend - cmath.phase(rigid), np.full_like(bend, angle)

    def _inside(self, postures: tuple[FloatArray, ...]) -> BoolArray:
        inside = np.ones(postures[0].shape, dtype=np.bool_)
        for angles, limits in zip(postures, self._limits, strict=True):
            inside &= within(angles, *limits, self._tolerance)
        return inside


def _triangle(tip: ComplexArray, a: float, b: float) -> tuple[FloatArray, FloatArray]:
    """Both postures (2, k) of two links: direction of the first, bend of the second; NaN out of reach."""
    if a < _NO_LENGTH or b < _NO_LENGTH:
        # a circle of points at most, and each of them is found with another joint at its limit
        nowhere = np.full((2, len(tip)), np.nan)
        return nowhere, nowhere
    cosine = (tip.real**2 + tip.imag**2 - a * a - b * b) / (2.0 * a * b)
    reached = np.abs(cosine) <= 1.0 + _COSINE_TOLERANCE
    bend = np.where(reached, np.arccos(np.clip(cosine, -1.0, 1.0)), np.nan)
    inner = np.arctan2(b * np.sin(bend), a + b * np.cos(bend))
    direction = np.angle(tip)
    return np.stack([direction - inner, direction + inner]), np.stack([bend, -bend])


# Circles in the tool plane on which a yaw + pitch arm's tip runs while it cannot leave them by itself.
#
# Where every pitch joint is at a limit or on the line through the tip, the tip can only move across that
# line: the joints' columns of the planar Jacobian are parallel. So there are 3^m choices of which of the m
# pitch joints is at which limit, the free groups of links lie on one line, and the arm is rigid but for one
# angle: its tip runs on a circle.


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


# The boundary of what a yaw + pitch arm reaches in its tool plane: arcs, in closed form.
#
# A boundary point is reached only where the free joints cannot push the tip across the boundary, so it lies
# on one of the circles of ``plane_circles``, on the arc that the limits leave of it. Not every arc bounds:
# most run through the inside. So each arc is cut where it meets another one, and a piece is kept when a
# point beside its middle is out of reach.

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
_CHORD_ERROR_M = 2e-4
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


def boundary_arcs(geometry: ToolPlane, limits: FloatArray) -> tuple[PlaneArc, ...]:
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


def _inside_limits(geometry: ToolPlane, limits: FloatArray, scale: float) -> list[PlaneArc]:
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


class PlanarSection:
    """Of a yaw + pitch arm: what the pitch joints reach while the base stands still."""

    exact = True

    def __init__(self, geometry: ToolPlane, limits: FloatArray) -> None:
        self._geometry = geometry
        lines = joined(boundary_arcs(geometry, limits), _CHORD_ERROR_M)
        self._outline = tuple(np.column_stack([line.real, line.imag]) for line in lines)

    def plane(self, q: FloatArray) -> FloatArray:
        """See ``Section``."""
        turn = self._geometry.yaw_sign * float(q[0])
        c, s = math.cos(turn), math.sin(turn)
        T = np.eye(4)
        T[:3, :3] = self._geometry.frame @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        T[:3, 3] = self._geometry.origin + self._geometry.lateral * T[:3, 1]
        return T

    def outline(self, q: FloatArray) -> tuple[FloatArray, ...]:
        """See ``Section``; the same for every ``q``."""
        return self._outline

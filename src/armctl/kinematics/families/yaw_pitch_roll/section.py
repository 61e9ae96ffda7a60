"""What a yaw + pitch arm reaches in its tool plane inside its limits, and the arcs that bound it.

Two pitch joints: the triangle's two postures, tried against the limits. Three leave one joint free: the
configurations that reach a point form curves. A curve ends where a joint meets a limit; one without ends
has its first joint turn back, where the outer links are in line, or pass any angle. So a point is reachable
if, and only if, it is with a joint at a limit, the outer links in line, or the first joint in mid-range.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, within
from armctl.kinematics.subproblems import ToolPlane

ComplexArray = NDArray[np.complex128]
_NO_LENGTH = 1e-12
_COSINE_TOLERANCE = 1e-11
"""how far rounding may carry the elbow's cosine beyond ±1"""


def reaches(
    geometry: ToolPlane, limits: FloatArray, points: ComplexArray, tolerance: float = LIMIT_TOLERANCE
) -> NDArray[np.bool_]:
    """Whether the tip can come to each point with the base standing still.

    For joint limits (n, 2), over which rounding may carry a joint by the tolerance [rad], and points (k,)
    r + i z: forward of the base axis and above the base origin [m].
    """
    ranges = [geometry.plane_limits(k, limits) for k in range(len(geometry.lengths))]
    found = np.zeros(len(points), dtype=np.bool_)
    for posture in _postures(geometry.lengths, ranges, points - geometry.shoulder):
        inside = [within(angle, *span, tolerance) for angle, span in zip(posture, ranges, strict=True)]
        found |= np.logical_and.reduce(inside).any(axis=0)
    return found


def _postures(
    lengths: Sequence[float], ranges: Sequence[tuple[float, float]], tip: ComplexArray
) -> Iterator[tuple[FloatArray, ...]]:
    """Plane angles (2, k) of each pitch joint; NaN where the links do not reach."""
    if len(lengths) == 2:
        yield triangle(tip, *lengths)
        return
    l1, l2, l3 = lengths
    first, second, third = ranges
    for angle in (*first, 0.5 * sum(first)):
        direction, bend = triangle(tip - cmath.rect(l1, angle), l2, l3)
        yield np.full_like(bend, angle), direction - angle, bend
    for angle in second:
        rigid = l1 + cmath.rect(l2, angle)
        direction, bend = triangle(tip, abs(rigid), l3)
        lead = cmath.phase(rigid)
        yield direction - lead, np.full_like(bend, angle), bend + lead - angle
    for angle in (*third, 0.0, math.pi):
        rigid = l2 + cmath.rect(l3, angle)
        direction, bend = triangle(tip, l1, abs(rigid))
        yield direction, bend - cmath.phase(rigid), np.full_like(bend, angle)


def triangle(tip: ComplexArray, a: float, b: float) -> tuple[FloatArray, FloatArray]:
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


class PlaneCircle(NamedTuple):
    """A rigid arm that turns by phi: tip = centre + arm · exp(i phi), angles = constants + slopes · phi."""

    centre: complex
    """from the first pitch axis [m]"""
    arm: complex
    constants: tuple[float, ...]
    """of the plane angles [rad]"""
    slopes: tuple[float, ...]


def collinear_circles(
    lengths: Sequence[float], plane_limits: Sequence[tuple[float, float]]
) -> Iterator[PlaneCircle]:
    """The circles on which every pitch joint is at a limit or on the line through the tip.

    There the free joints' columns of the planar Jacobian are parallel. For lengths (m,) [m] and limits of
    the plane angles (m, 2) [rad].
    """
    for held in itertools.product(*((low, high, None) for low, high in plane_limits)):
        groups, heading = [0j], 0.0  # the first stands still; a further one begins with each free joint
        for length, angle in zip(lengths, held, strict=True):
            if angle is None:
                groups.append(complex(length))
                heading = 0.0
            else:
                heading += angle
                groups[-1] += cmath.rect(length, heading)
        centre, *turning = groups
        for later in itertools.product((0.0, math.pi), repeat=max(0, len(turning) - 1)):
            senses = (0.0, *later)[: len(turning)]
            leads = iter(sense - cmath.phase(group) for sense, group in zip(senses, turning, strict=True))
            angles: list[tuple[float, float]] = []
            heading, turns = 0.0, 0.0  # of the link before: heading + turns · phi
            for angle in held:
                if angle is None:
                    lead = next(leads)
                    angles.append((lead - heading, 1.0 - turns))
                    heading, turns = lead, 1.0
                else:
                    angles.append((angle, 0.0))
                    heading += angle
            arm = sum(abs(group) * math.cos(sense) for sense, group in zip(senses, turning, strict=True))
            yield PlaneCircle(centre, complex(arm), *zip(*angles, strict=True))


# The boundary of the reach. It lies on the circles, on the arcs that the limits leave of them, but most arcs
# run through the inside: each is cut where it meets another one, and a piece is kept when a point beside its
# middle is out of reach.

_SAME_M = 1e-9
"""closer points and radii [m] are the same but for rounding"""
_JOIN_M = 2e-4
"""how far apart the ends of neighbouring arcs may lie: pieces too short to count are left out between"""
_SHORTEST = 1e-4
"""of the arm's length: a shorter piece is none"""
_BESIDE = 1e-8
"""of the arm's length: how far beside a piece, at most, it is asked whether the arm reaches"""
_SLIVER = 0.05
"""of the square of a piece's length over that of the arm: arcs that touch part as slowly as that"""
_CHORD_ERROR_M = 2e-4
_TOLERANCE = 1e-12
"""[rad] over a limit: less than a point beside a piece lies out of reach"""


class PlaneArc(NamedTuple):
    """A piece of a circle in the tool plane: centre + radius · exp(i α), α from start to end."""

    centre: complex
    """r + i z: forward of the base axis, above the base origin [m]"""
    radius: float
    start: float
    end: float
    """[rad], above the start by 2 pi at most"""

    def at(self, share: float) -> complex:
        """The point after a share of the way."""
        return self.centre + cmath.rect(self.radius, self.start + share * (self.end - self.start))

    @property
    def length(self) -> float:
        """Along the arc [m]."""
        return self.radius * (self.end - self.start)

    def polyline(self, chord_error_m: float) -> ComplexArray:
        """Points from end to end, with chords no farther than that from the arc."""
        widest = 2.0 * math.acos(max(1.0 - chord_error_m / self.radius, 0.0))
        count = max(2, math.ceil((self.end - self.start) / widest) + 1)
        angle = np.linspace(self.start, self.end, count)
        line: ComplexArray = self.centre + self.radius * (np.cos(angle) + 1j * np.sin(angle))
        return line


def boundary_arcs(geometry: ToolPlane, limits: FloatArray) -> tuple[PlaneArc, ...]:
    """All arcs that bound the reach in limits (n, 2) [rad], the base standing still; inner bounds, too."""
    scale = sum(geometry.lengths)
    arcs = list(_inside_limits(geometry, limits, _SHORTEST * scale))
    pieces: list[PlaneArc] = []
    for piece in (piece for arc in arcs for piece in _cut(arc, arcs, _SHORTEST * scale)):
        # each once: arcs of different joints may lie on the same circle
        if not any(
            abs(piece.at(0.5) - other.at(0.5)) < _SAME_M
            and abs(piece.centre - other.centre) < _SAME_M
            and abs(piece.length - other.length) < _SAME_M
            for other in pieces
        ):
            pieces.append(piece)
    middle = np.array([piece.at(0.5) for piece in pieces], dtype=np.complex128)
    out = middle - np.array([piece.centre for piece in pieces], dtype=np.complex128)
    length = np.array([piece.length for piece in pieces])
    offset = np.minimum(_BESIDE * scale, _SLIVER * length * length / scale)
    beside: ComplexArray = offset * out / np.abs(out)
    inside = reaches(geometry, limits, middle + beside, _TOLERANCE)
    inside &= reaches(geometry, limits, middle - beside, _TOLERANCE)
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


def _inside_limits(geometry: ToolPlane, limits: FloatArray, shortest: float) -> Iterator[PlaneArc]:
    """What the limits leave of each circle; only its first free joint turns, the others stay in line."""
    plane = [geometry.plane_limits(k, limits) for k in range(len(geometry.lengths))]
    for centre, arm, *angles in collinear_circles(geometry.lengths, plane):
        span = None
        for constant, slope, (low, high) in zip(*angles, plane, strict=True):
            if slope:
                span = low - constant, min(high - constant, low - constant + TWO_PI)
            elif not within(np.array([constant]), low, high)[0]:
                break
        else:
            if span is not None and abs(arm) * (span[1] - span[0]) > shortest:
                turn = cmath.phase(arm)
                yield PlaneArc(geometry.shoulder + centre, abs(arm), span[0] + turn, span[1] + turn)


def _cut(arc: PlaneArc, others: Iterable[PlaneArc], shortest: float) -> Iterator[PlaneArc]:
    """The pieces between the points where an arc meets others."""
    cuts = (arc.start + (angle - arc.start) % TWO_PI for other in others for angle in _meetings(arc, other))
    start = arc.start
    for end in sorted([arc.end, *(cut for cut in cuts if cut < arc.end)]):
        if arc.radius * (end - start) > shortest:
            yield PlaneArc(arc.centre, arc.radius, start, end)
            start = end


def _meetings(arc: PlaneArc, other: PlaneArc) -> list[float]:
    """Directions from the arc's centre in which the two circles meet, or one ends on the other [rad]."""
    between = other.centre - arc.centre
    distance = abs(between)
    if distance < _SAME_M:
        if abs(arc.radius - other.radius) > _SAME_M:
            return []
        return [cmath.phase(other.at(share) - arc.centre) for share in (0.0, 1.0)]
    along = (distance * distance + arc.radius**2 - other.radius**2) / (2.0 * distance)
    across = arc.radius**2 - along * along
    if across < -_SAME_M * arc.radius:
        return []
    spread = math.atan2(math.sqrt(max(across, 0.0)), along)
    towards = cmath.phase(between)
    return [towards - spread, towards + spread]


class PlanarSection:
    """What the pitch joints reach while the base stands still; the same outline for every ``q``."""

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
        """See ``Section``."""
        return self._outline

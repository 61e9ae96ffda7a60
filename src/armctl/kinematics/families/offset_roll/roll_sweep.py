"""All solutions of a target that leaves the roll free: the roll joint takes the values of a grid.

At each roll the pitch joints are the triangle of the tool plane, and its feasibility changes only at knots:
where a joint is at a limit, the links are in line, or the tool plane passes the target by too little. With a
joint held at an angle two corners of the triangle are at a known distance,

    |r - u + i Y|² = m        r² = x² + y² - d², with d, u, Y and m of the first or second degree in the roll

and ``(r² + u² + Y² - m)² = 4 r² u²`` is a trigonometric polynomial of the roll, whose zeros are the knots.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import (
    LIMIT_TOLERANCE,
    TWO_PI,
    all_images,
    images,
    into_limits,
    trigonometric_zeros,
    wrap,
)
from armctl.kinematics.chain import Chain
from armctl.kinematics.families.yaw_pitch_roll.closed_form import REACH_TOLERANCE, UPRIGHT
from armctl.kinematics.families.yaw_pitch_roll.geometry import (
    LEVEL,
    base_angles,
    branch_index,
    recognise,
    tool_angles,
)
from armctl.kinematics.samples import grid_values
from armctl.kinematics.subproblems import ToolPlane, circle_angles
from armctl.lazy_dataclass import dataclass

# Recognising arms of the build *yaw + parallel pitch joints + roll* with the tool beside the roll axis.
#
# At each roll the arm is one of the build *yaw + parallel pitch joints*, with another last link and another
# lateral offset of its tool plane. Both go round with the roll angle c:
#
#     L(c) = L0 + L1 cos c + L2 sin c         from the last pitch axis to the tip, in the tool plane
#     d(c) = d0 + d1 cos c + d2 sin c         how far the tip lies to the left of the base axis

ComplexArray = NDArray[np.complex128]
_ALIGNED = 1e-9
"""how far from parallel or perpendicular axes may be (sine of the angle)"""
_SHORTEST_M = 1e-6
"""a last link that gets shorter than this at some roll has no direction there [m]"""
_CLEAN_M = 1e-14
"""an offset below this is rounding [m]"""
_LOOKS = 64


@dataclass(frozen=True)
class OffsetRoll:
    """How such an arm moves its tool: lengths in metres, angles in radians."""

    plane: ToolPlane
    """the tool plane with the roll joint at zero"""
    joint: int
    """index of the roll joint"""
    hand: tuple[complex, complex, complex]
    """L0, L1, L2 at the zero pose"""
    side: tuple[float, float, float]
    """d0, d1, d2"""
    before: float
    """direction of the link ahead of the last pitch axis at the zero pose"""
    roll_axis: FloatArray
    """(3,) the direction of the roll axis at the zero pose: forward, left, up"""

    @property
    def pitched(self) -> bool:
        """True where a pitch and a roll are as many as the joints can hold: three pitch joints."""
        return len(self.plane.lengths) == 3

    def last_link(self, roll: FloatArray) -> ComplexArray:
        """L(c) for roll angles (k,)."""
        L0, L1, L2 = self.hand
        link: ComplexArray = L0 + L1 * np.cos(roll) + L2 * np.sin(roll)
        return link

    def lateral(self, roll: FloatArray) -> FloatArray:
        """d(c) for roll angles (k,)."""
        d0, d1, d2 = self.side
        return d0 + d1 * np.cos(roll) + d2 * np.sin(roll)

    def at(self, roll: float) -> ToolPlane:
        """The tool plane with the roll joint held at an angle."""
        plane, angle = self.plane, np.array([roll])
        lateral = float(self.lateral(angle)[0])
        link, zero = complex(self.last_link(angle)[0]), self.before + plane.offsets[-1]
        offset = wrap(cmath.phase(link) - self.before)
        tool = plane.tool_angle
        return replace(
            plane,
            lateral=lateral if abs(lateral) >= _CLEAN_M else 0.0,
            lengths=(*plane.lengths[:-1], abs(link)),
            offsets=(*plane.offsets[:-1], offset),
            tool_angle=None if tool is None else wrap(tool + zero - self.before - offset),
        )


def recognise_offset_roll(chain: Chain) -> OffsetRoll | None:
    """The arm's geometry, or None when it is not of this build.

    Needed: a first joint, two or three parallel joints perpendicular to it, and a last one perpendicular to
    those; without the last one the arm is of the build *yaw + parallel pitch joints*.
    """
    if chain.n not in (4, 5):
        return None
    plane = recognise(chain.with_last_held(0.0))
    _, axes = chain.axes()
    if plane is None or len(plane.lengths) != chain.n - 2 or abs(axes[-1] @ axes[1]) > _ALIGNED:
        return None
    rolls = np.zeros((3, chain.n))
    rolls[:, -1] = 0.0, 0.5 * math.pi, math.pi
    tips = (chain.forward(rolls)[:, :3, 3] - plane.origin) @ plane.frame
    ahead = np.cumsum(plane.offsets[:-1]).tolist()
    wrist = plane.shoulder + sum(map(cmath.rect, plane.lengths[:-1], ahead))
    links = [complex(x, z) - wrist for x, _, z in tips.tolist()]
    sides: list[float] = tips[:, 1].tolist()
    approach = chain.forward(np.zeros(chain.n))[:3, 2]
    along = np.linalg.norm(np.cross(axes[-1], approach)) < _ALIGNED
    L0, d0 = 0.5 * (links[0] + links[2]), 0.5 * (sides[0] + sides[2])
    found = OffsetRoll(
        plane=plane if along else replace(plane, tool_angle=None),
        joint=chain.n - 1,
        hand=(L0, links[0] - L0, links[1] - L0),
        side=(d0, sides[0] - d0, sides[1] - d0),
        before=ahead[-1],
        roll_axis=plane.frame.T @ axes[-1],
    )
    turns = np.linspace(0.0, 2.0 * math.pi, _LOOKS)
    return found if np.abs(found.last_link(turns)).min() > _SHORTEST_M else None


_SAMPLES, _DEGREE, _STRETCHED_DEGREE = 32, 4, 8
_MOST_ROWS = 500_000
"""of a list; more images by whole turns are left out"""
_ZOOMS, _ZOOM = 3, 101
"""rounds, and values in each, by which the least of a smooth sum is found between two values of the grid"""
_STRAIGHT = 4e-7
"""a bend below this is lost in rounding [rad]: the tip moves 1e-14 m"""
_SAME = 1e-9
"""rolls this near to each other are one [rad]"""


class BaseTarget(NamedTuple):
    """A target in the coordinates of the base axis: forward, left, up [m]."""

    x: float
    y: float
    z: float
    pitch: float | None
    """[rad]; None with two pitch joints, where the position decides it"""


class _FacingBranch(NamedTuple):
    """One way to face the target, to point and to bend."""

    back: int
    turn: float | None
    """what the pitch joints turn in all [rad]"""
    tool_in: bool
    sense: int
    """+1 or -1: sign of the elbow's plane angle"""


class Rows(NamedTuple):
    """Configurations (k, n) [rad] inside the limits, the index of each branch, and how many are left out."""

    q: FloatArray
    branch: NDArray[np.int8]
    left_out: int = 0


class RollSweep:
    """The solutions of one arm inside its limits over the roll. Immutable; safe in several threads."""

    def __init__(self, geometry: OffsetRoll, limits: FloatArray) -> None:
        self._geometry, self._limits = geometry, limits
        self._ranges: list[tuple[float, float]] = [(low, high) for low, high in limits.tolist()]
        self._wide = bool((limits[:-1, 1] - limits[:-1, 0] >= TWO_PI - 2.0 * LIMIT_TOLERANCE).any())

    def solve(self, place: BaseTarget, step: float) -> Rows:
        """Every configuration with the roll on the grid of a step [rad].

        Where a whole interval lies between two values of the grid, one in its middle.
        """
        grid = grid_values(*self._ranges[-1], step)
        knots = self.knots(place)
        looks = np.concatenate([knots, 0.5 * (knots[:-1] + knots[1:])])
        found: list[Rows] = []
        for way in self._ways(place):
            ok = self._follow(place, way, looks)[1]
            at_knot, between = ok[: len(knots)], ok[len(knots) :]
            kept = np.zeros(len(grid), dtype=np.bool_)
            extra: list[float] = []
            begin = np.searchsorted(grid, knots[:-1] - _SAME)
            end = np.searchsorted(grid, knots[1:] + _SAME, side="right")
            for i in np.flatnonzero(between).tolist():
                kept[begin[i] : end[i]] = True
                if begin[i] == end[i]:
                    extra.append(float(looks[len(knots) + i]))
            beside = np.append(between, False) | np.append(False, between)
            extra += knots[at_knot & ~beside].tolist()
            rolls = np.union1d(grid[kept], extra)
            found.append(self._rows(way, *self._follow(place, way, rolls), rolls))
        return self._together(found)

    def at(self, place: BaseTarget, rolls: FloatArray, start: FloatArray | None = None) -> Rows:
        """Every configuration at roll angles (m,) [rad]."""
        ways = list(self._ways(place))
        return self._together(
            [self._rows(way, *self._follow(place, way, rolls), rolls) for way in ways], start
        )

    def candidates(
        self, place: BaseTarget, start: FloatArray, weights: FloatArray, step: float, listed: FloatArray
    ) -> FloatArray:
        """Configurations (m, n) among which Σ weight · |θ - start| is least, (n,) [rad] and positive.

        A joint is where it starts or at a limit there, or the sum is smooth: then its least is looked for
        about the best of those ``listed`` (k, n) with a step of the roll [rad].
        """
        rolls = np.append(self.knots(place, start), np.clip(start[-1], *self._ranges[-1]))
        found = np.concatenate([listed, self.at(place, rolls, start).q])

        def least(q: FloatArray) -> FloatArray:
            return q[int((np.abs(q - start) @ weights).argmin())]

        best, reach, kept = least(found), step, [found[len(listed) :]]
        for _ in range(_ZOOMS):
            kept.append(best[None])
            at = float(best[-1])
            near: FloatArray = np.linspace(at - reach, at + reach, _ZOOM).clip(*self._ranges[-1])
            best = least(np.concatenate([best[None], self.at(place, near, start).q]))
            reach *= 2.0 / (_ZOOM - 1)
        return np.concatenate([*kept, best[None]])

    def _ways(self, place: BaseTarget) -> Iterator[_FacingBranch]:
        plane = self._geometry.plane
        pitch = place.pitch
        readings = tool_angles(pitch)
        if pitch is not None and abs(abs(pitch) - 0.5 * math.pi) < UPRIGHT:
            readings = readings[:1]  # straight up and down both are the same
        zero = self._geometry.before + plane.offsets[-1] + (plane.tool_angle or 0.0)
        for back in (0, 1):
            for angle in readings:
                outward = 0.0 if angle is None else (1 - 2 * back) * math.cos(angle)
                turn = None if angle is None else angle - zero
                for sense in (1, -1):
                    yield _FacingBranch(back, turn, outward < -LEVEL, sense)

    def _follow(
        self, place: BaseTarget, way: _FacingBranch, rolls: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Joint angles (m, n) [rad] of a way at roll angles (m,), and where they are inside the limits.

        Of equal angles the one nearest to zero.
        """
        geometry, plane = self._geometry, self._geometry.plane
        x, y = np.full(len(rolls), place.x), np.full(len(rolls), place.y)
        yaws, forwards, faces = base_angles(plane, x, y, self._ranges[0], geometry.lateral(rolls))
        link = geometry.last_link(rolls)
        tip: ComplexArray = forwards[way.back] + 1j * place.z - plane.shoulder
        o2, o3 = plane.offsets[:2]
        near, far = np.full(len(rolls), plane.lengths[0]), np.abs(link)
        if way.turn is None:
            o3 = np.angle(link) - geometry.before
        else:
            tip, far = tip - link * cmath.rect(1.0, way.turn), np.full(len(rolls), plane.lengths[1])
        distance = np.abs(tip)
        stretched, folded = near + far, np.abs(near - far)
        ok = faces[way.back] & (distance <= stretched + REACH_TOLERANCE)
        ok &= distance >= folded - REACH_TOLERANCE
        # the half-angle form keeps its digits where the arc cosine loses them
        wide = np.maximum((stretched - distance) * (stretched + distance), 0.0)
        close = np.maximum((distance - folded) * (distance + folded), 0.0)
        bend = 2.0 * np.arctan2(np.sqrt(wide), np.sqrt(close))
        bend[bend < _STRAIGHT] = 0.0
        if way.sense < 0:  # links in line count as bent to the positive side, so that they are listed once
            ok &= (bend > 0.0) & (bend < math.pi)
            bend = -bend
        inner = np.arctan2(far * np.sin(bend), near + far * np.cos(bend))
        q = np.empty((len(rolls), len(self._ranges)))
        q[:, 0], q[:, -1] = yaws[way.back], rolls
        q[:, 1] = plane.signs[0] * (np.angle(tip) - inner - o2)
        q[:, 2] = plane.signs[1] * (bend - o3)
        if way.turn is not None:
            turned = q[:, 1] * plane.signs[0] + q[:, 2] * plane.signs[1]
            q[:, 3] = plane.signs[2] * (way.turn - turned)
        for joint in range(1, len(self._ranges) - 1):
            column = q[:, joint].copy()
            ok &= into_limits(column, *self._ranges[joint])
            q[:, joint] = column
        return np.clip(q, *self._limits.T), ok

    def _rows(self, way: _FacingBranch, q: FloatArray, ok: NDArray[np.bool_], rolls: FloatArray) -> Rows:
        kept = q[ok]
        kept[:, -1] = rolls[ok]
        index = np.full(len(kept), branch_index(not way.back, way.sense, way.tool_in), dtype=np.int8)
        return Rows(kept, index)

    def _together(self, found: Sequence[Rows], start: FloatArray | None = None) -> Rows:
        """With all images of the joints but the roll, each configuration once."""
        q, left_out = np.concatenate([rows.q for rows in found]), 0
        branch = np.concatenate([rows.branch for rows in found])
        if self._wide:
            begin = None if start is None else start[:-1]
            turned = all_images(q[:, :-1], self._limits[:-1], begin, max(_MOST_ROWS, len(q)))
            q = np.column_stack([turned.q, q[turned.source, -1]])
            branch, left_out = branch[turned.source], turned.left_out
        return Rows(q, branch, left_out)

    # Where feasibility may change.

    def knots(self, place: BaseTarget, kinks: FloatArray | None = None) -> FloatArray:
        """Roll angles (m,) inside the limits, rising, the limits included [rad].

        With ``kinks`` (n,) [rad], angles of the joints, also where a joint is at its one.
        """
        low, high = self._ranges[-1]
        found = [*self._base_knots(place, kinks)]
        for turn in {way.turn for way in self._ways(place)}:
            for values, degree in self._locks(place, turn, kinks):
                found += trigonometric_zeros(values, degree).tolist()
        inside = [image for angle in found for image in images(angle, low, high)]
        return np.unique([low, *inside, high])

    def _base_knots(self, place: BaseTarget, kinks: FloatArray | None) -> Iterator[float]:
        """Where the tool plane touches the target's circle about the base axis, or the base is at a limit."""
        rho, azimuth = math.hypot(place.x, place.y), math.atan2(place.y, place.x)
        values = [rho, -rho]
        for yaw in (*self._ranges[0], *(() if kinks is None else (float(kinks[0]),))):
            values.append(rho * math.sin(azimuth - self._geometry.plane.yaw_sign * yaw))
        for value in values:
            yield from circle_angles(*self._geometry.side, value)[0]

    def _locks(
        self, place: BaseTarget, turn: float | None, kinks: FloatArray | None
    ) -> Iterator[tuple[FloatArray, int]]:
        """Values at ``_SAMPLES`` rolls, and the degree, of polynomials that are zero at the knots."""
        geometry, plane = self._geometry, self._geometry.plane
        rolls = np.linspace(0.0, TWO_PI, _SAMPLES, endpoint=False)
        link, lateral = geometry.last_link(rolls), geometry.lateral(rolls)
        square = place.x**2 + place.y**2 - lateral**2  # r²

        def held(joint: int) -> Iterator[float]:
            yield from self._ranges[joint]
            if kinks is not None:
                yield float(kinks[joint])

        def lock(corner: ComplexArray | complex, most: FloatArray | float) -> tuple[FloatArray, int]:
            """|r + i z - corner|² = most, from the base origin."""
            u = np.real(corner) + plane.shoulder.real
            Y = place.z - plane.shoulder.imag - np.imag(corner)
            return (square + u * u + Y * Y - most) ** 2 - 4.0 * square * u * u, _DEGREE

        o2, o3 = plane.offsets[:2]
        s2, s3 = plane.signs[:2]
        if turn is not None:
            l2, l3, _ = plane.lengths
            hand = link * cmath.rect(1.0, turn)
            for bend in (0.0, math.pi, *(plane.plane_angle(1, angle) for angle in held(2))):
                yield lock(hand, l2 * l2 + l3 * l3 + 2.0 * l2 * l3 * math.cos(bend))
            for angle in held(1):
                yield lock(hand + cmath.rect(l2, plane.plane_angle(0, angle)), l3 * l3)
            for angle in held(3):
                yield lock(hand + cmath.rect(l3, o2 + o3 + turn - plane.signs[2] * angle), l2 * l2)
            return
        l2, size = plane.lengths[0], np.abs(link) ** 2
        for angle in held(2):
            yield lock(0j, np.abs(l2 + link * cmath.rect(1.0, s3 * angle - geometry.before)) ** 2)
        for angle in held(1):
            yield lock(cmath.rect(l2, s2 * angle + o2), size)
        a1 = plane.shoulder.real
        G = square + a1 * a1 + (place.z - plane.shoulder.imag) ** 2 - l2 * l2 - size
        stretched = (G * G + 4.0 * a1 * a1 * square - 4.0 * l2 * l2 * size) ** 2
        yield stretched - 16.0 * a1 * a1 * square * G * G, _STRETCHED_DEGREE

    def pitch_rolls(self, place: BaseTarget, pitch: float) -> FloatArray:
        """Roll angles (m,) inside the limits at which two pitch joints may hold the tool at a pitch [rad]."""
        geometry, plane = self._geometry, self._geometry.plane
        rolls = np.linspace(0.0, TWO_PI, _SAMPLES, endpoint=False)
        square = place.x**2 + place.y**2 - geometry.lateral(rolls) ** 2
        zero = geometry.before + plane.offsets[-1] + (plane.tool_angle or 0.0)
        found: list[float] = []
        for angle in tool_angles(pitch):
            corner = plane.shoulder + geometry.last_link(rolls) * cmath.rect(1.0, (angle or 0.0) - zero)
            u, Y = corner.real, place.z - corner.imag
            values = (square + u * u + Y * Y - plane.lengths[0] ** 2) ** 2 - 4.0 * square * u * u
            for root in trigonometric_zeros(values, _DEGREE).tolist():
                found += images(root, *self._ranges[-1])
        return np.unique(found)

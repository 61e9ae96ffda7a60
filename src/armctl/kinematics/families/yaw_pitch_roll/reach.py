"""Why a target cannot be reached, with numbers, and what can be reached instead.

The nearest point is exact: at an optimum each joint is at a limit, or the distance does not fall when it
alone turns. For the base the latter means that the tip faces the target, for a pitch joint that it lies on
the line along which the tip misses the target in the tool plane: the tip runs on one of the circles of
``section``. Nearest on a circle is closed form while the base is at a limit, and the roots of a polynomial
while it faces the target. If the tip misses only sideways, across the tool plane, the pitch joints have an
ordinary inverse solution in the plane.
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
from armctl.facts import AngleNeeded, Reason, Several
from armctl.facts.targets import (
    InsideCylinder,
    JointsNeeded,
    LimitsForbid,
    NotInOrientation,
    OutOfReach,
    PitchByPosition,
    Side,
)
from armctl.kinematics.angles import (
    LIMIT_TOLERANCE,
    TWO_PI,
    central_image,
    central_images,
    images,
    nearest_angle,
    rest_angle,
    wrap,
)
from armctl.kinematics.explanations import angles_needed
from armctl.kinematics.families.yaw_pitch_roll.closed_form import PlanePostures
from armctl.kinematics.families.yaw_pitch_roll.geometry import (
    AXIS_TOLERANCE,
    BaseBranch,
    base_branches,
    tool_angles,
)
from armctl.kinematics.families.yaw_pitch_roll.least_rotation import LeastRotation
from armctl.kinematics.families.yaw_pitch_roll.section import PlaneCircle, collinear_circles, triangle
from armctl.kinematics.subproblems import ToolPlane
from armctl.kinematics.target import Target

ComplexArray = NDArray[np.complex128]
Rows = NDArray[np.intp]
_NO_LENGTH = 1e-12
_SEARCHED = 1e-8
"""how far outside a limit a search for the least leaves a joint that is on it [rad]"""
_ALIKE_M = 1e-12
"""distances that differ by rounding alone [m]"""


class _Nearest(NamedTuple):
    q: FloatArray
    """(1 + m,) base and pitch joints [rad]"""
    distance: float
    """of the tip from the target [m]"""


class _Miss(NamedTuple):
    """By how much the links miss a target, turned to it one way."""

    miss_m: float
    length: float
    """of the links in their plane [m]"""
    limit_m: float
    """how far they reach, or how near"""
    away_m: float | None
    """of the target, or the wrist, from the shoulder; None: the shortest way is in none of the planes"""
    branch: BaseBranch

    def rank(self) -> tuple[float, float, BaseBranch]:
        """The least counts."""
        return self.miss_m, self.limit_m, self.branch


class _Circles:
    """Many circles (k,), as columns."""

    def __init__(self, circles: Iterable[PlaneCircle], shoulder: complex) -> None:
        centre, arm, constants, slopes = zip(*circles, strict=True)
        self.centre: ComplexArray = np.array(centre, dtype=np.complex128) + shoulder
        self.arm: ComplexArray = np.array(arm, dtype=np.complex128)
        self.constants: FloatArray = np.array(constants)
        self.slopes: FloatArray = np.array(slopes)


class Reach:
    """Explains refusals of one arm. Immutable; safe in several threads."""

    def __init__(
        self,
        geometry: ToolPlane,
        limits: FloatArray,
        titles: Sequence[str],
        planar: PlanePostures,
        least: LeastRotation | None,
    ) -> None:
        """Prepare for an arm; ``least`` where it has three pitch joints, None where it has two."""
        self._geometry, self._limits, self._titles = geometry, limits, titles
        self._planar, self._least = planar, least
        self._plane = [geometry.plane_limits(k, limits) for k in range(len(geometry.lengths))]
        self._free = _Circles(collinear_circles(geometry.lengths, self._plane), geometry.shoulder)

    def explain(self, target: Target) -> tuple[Reason, FloatArray | None]:
        """Of a target without a solution: the reason, and the nearest configuration (n,) [rad]."""
        geometry = self._geometry
        x, y, z = geometry.local_of(*target.point)
        nearest = self._nearest_to(x, y, z, target)
        branches = base_branches(geometry, x, y, None)
        if not branches:
            return InsideCylinder(abs(geometry.lateral), math.hypot(x, y)), nearest
        angles = tool_angles(target.pitch)
        two = target.pitch is not None and len(geometry.lengths) == 2
        if two and not self._postures(branches, z, angles):
            reason = self._beyond_links(branches, z, [None], nearest) or self._other_pitch(branches, z)
            return reason, nearest
        reason = self._beyond_links(branches, z, angles, nearest) or self._by_limits(branches, z, angles)
        return reason, nearest

    def _postures(
        self, branches: Iterable[BaseBranch], z: float, angles: Iterable[float | None]
    ) -> list[tuple[float, ...]]:
        """Plane angles with which the links alone hold the tool there, at some plane angles [rad]."""
        ways = itertools.product(branches, angles)
        return [plane for branch, angle in ways for plane in self._planar.at(branch.r, z, angle)]

    def _other_pitch(self, branches: list[BaseBranch], z: float) -> PitchByPosition:
        tool = self._geometry.tool_angle or 0.0
        ways = self._postures(branches, z, [None])
        return PitchByPosition(tuple(sorted(math.asin(math.sin(sum(way) + tool)) for way in ways)))

    def _beyond_links(
        self, branches: list[BaseBranch], z: float, angles: list[float | None], nearest: FloatArray | None
    ) -> Reason | None:
        """Too far or too near for the links alone, whatever the limits.

        By the way of turning to the target that takes the tip nearest; where the base cannot turn so far and
        the ``nearest`` configuration turns the other way, by that one, with what holds the base.
        """
        lengths = list(self._geometry.lengths)
        wrist = angles[0] is not None and len(lengths) == 3
        last = lengths.pop() if wrist else 0.0
        inner, outer = max(0.0, 2 * max(lengths) - sum(lengths)), sum(lengths)
        beside, foot = self._geometry.lateral, self._geometry.shoulder
        misses: list[_Miss] = []
        for branch, angle in itertools.product(branches, angles):
            hand = cmath.rect(last, (angle or 0.0) - (self._geometry.tool_angle or 0.0))
            distance = abs(complex(branch.r, z) - foot - hand)
            if inner - AXIS_TOLERANCE <= distance <= outer + AXIS_TOLERANCE:
                return None
            for length in (inner, outer):
                if beside and (foot + hand).real:  # the shortest way lies in none of the plane's poses
                    miss = self._geometry.way_to_circle(math.hypot(branch.r, beside), z, length, hand)
                    misses.append(_Miss(miss, length, length, None, branch))
                else:
                    away, limit = math.hypot(distance, beside), math.hypot(length, beside)
                    misses.append(_Miss(abs(away - limit), length, limit, away, branch))
        least, held = min(misses, key=_Miss.rank), None
        if nearest is not None and (beyond := self._base_needs(least.branch)):
            others = [one for one in misses if _turned_alike(one.branch.angle, float(nearest[0]))]
            if others and not _turned_alike(least.branch.angle, float(nearest[0])):
                other = min(others, key=_Miss.rank)
                if other.miss_m > least.miss_m + AXIS_TOLERANCE:  # else the base would turn for nothing
                    held = JointsNeeded(
                        angles_needed(self._titles, self._limits, beyond), _side(least.branch)
                    )
                least = other
        reason = OutOfReach(
            far=least.length == outer, miss_m=least.miss_m, length_m=least.limit_m, distance_m=least.away_m,
            point="wrist" if wrist else "target", shoulder=self._titles[1], pitched=wrist,
            side=None if held is None else _side(least.branch),
        )  # fmt: skip
        return reason if held is None else Several((reason, held))

    def _base_needs(self, branch: BaseBranch) -> list[tuple[int, float]]:
        """The base joint and its angle [rad], where that is outside its limits."""
        low, high = self._limits[0].tolist()
        yaw = central_image(branch.angle, low, high)
        return [] if low - LIMIT_TOLERANCE <= yaw <= high + LIMIT_TOLERANCE else [(0, yaw)]

    def _by_limits(self, branches: list[BaseBranch], z: float, angles: list[float | None]) -> Reason:
        """All joints that would have to leave their limits together, for each way to face the target.

        Of several ways to bend, those joints that would have to leave them least, by the sum.
        """
        swept = angles[0] is None and len(self._geometry.lengths) == 3
        ways: list[tuple[tuple[AngleNeeded, ...], Side]] = []
        several = swept
        for branch in branches:
            planes = self._swept(branch, z) if swept else np.array(self._postures([branch], z, angles))
            if not len(planes):
                ways.append(((), _side(branch)))
                continue
            several = several or len(planes) > 1
            q, beyond = self._joints(planes)
            beyond[beyond <= _SEARCHED] = 0.0
            i = int(beyond.sum(axis=1).argmin())
            needed = self._base_needs(branch)
            needed += [(1 + k, float(q[i, k])) for k in np.flatnonzero(beyond[i]).tolist()]
            if needed:
                ways.append((angles_needed(self._titles, self._limits, needed), _side(branch)))
        pitched = angles[0] is not None
        if not ways:
            return NotInOrientation(pitched)
        return LimitsForbid(tuple(JointsNeeded(*way, least=several) for way in ways), pitched)

    def _swept(self, branch: BaseBranch, z: float) -> FloatArray:
        """(1, 3) plane angles nearest to the limits, found by sweeping the first round; or (0, 3)."""
        tip = complex(branch.r, z) - self._geometry.shoulder
        l2, l3, l4 = self._geometry.lengths
        # from the direction of the target on: at the end of the reach the links are stretched or folded there
        centre, reach, count, best = cmath.phase(tip), math.pi, 7201, np.empty((0, 3))
        for _ in range(4):  # 0.05°, then finer about the best
            grid: FloatArray = np.linspace(centre - reach, centre + reach, count)
            direction, bend = triangle(tip - l2 * np.exp(1j * grid), l3, l4)
            planes = np.stack([np.broadcast_to(grid, bend.shape), direction - grid, bend], axis=2)
            beyond = self._joints(planes)[1].sum(axis=2)
            if np.isnan(beyond).all():
                break
            side, i = np.unravel_index(np.nanargmin(beyond), beyond.shape)
            best = planes[side, i][None]
            centre, reach, count = float(grid[i]), 2 * reach / (count - 1), 401
        return best

    def _joints(self, plane: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pitch joint angles of plane angles (..., m), and how far each is outside its limits [rad]."""
        q = np.array(self._geometry.signs) * (plane - np.array(self._geometry.offsets))
        return _central_images(q, *self._limits[1 : 1 + len(self._plane)].T)

    def _nearest_to(self, x: float, y: float, z: float, target: Target) -> FloatArray | None:
        """(n,) with the pitch kept if any pose inside the limits has it, else with any pitch."""
        found: list[_Nearest] = []
        if target.pitch is not None and len(self._geometry.lengths) == 3:
            tool = self._geometry.tool_angle or 0.0
            for angle in tool_angles(target.pitch):
                found += self._nearest(x, y, z, (angle or 0.0) - tool)
        nearest = _nearest_of(found or self._nearest(x, y, z, None))
        joint = self._geometry.roll_joint
        if not nearest or joint is None:
            return nearest[0].q if nearest else None
        return np.append(nearest[0].q, nearest_angle(target.roll or 0.0, *self._limits[joint]))

    def _nearest(self, x: float, y: float, z: float, heading: float | None) -> list[_Nearest]:
        """The nearest configuration inside the limits to a point forward, left, up of the base origin [m]."""
        # With the plane angle of the last link [rad], or any; none when none has that angle.
        geometry, base = self._geometry, self._limits[0].tolist()
        for branch in base_branches(geometry, x, y, tuple(base)):
            q = self._in_plane(branch.angle, branch.r, z, heading)
            if q is not None:  # it was refused for something else, such as the roll
                return [_Nearest(q, 0.0)]
        circles = self._free
        if heading is not None:
            circles = _Circles(_circles_at(heading, geometry.lengths, self._plane), geometry.shoulder)
        found = self._best(circles, *self._facing(circles, x, y, z))
        sideways: list[tuple[float, float | None]] = [(yaw, None) for yaw in base]
        rho, d = math.hypot(x, y), geometry.lateral
        if rho < abs(d):  # inside the cylinder that the tool plane cannot enter
            turn = geometry.yaw_sign * (math.atan2(y, x) - math.copysign(0.5 * math.pi, d))
            sideways += [(yaw, 0.0) for yaw in images(turn, *base)]
        for yaw, forward in sideways:
            across = complex(x, y) * cmath.exp(-1j * geometry.yaw_sign * yaw)
            if forward is None:
                goal, forward = complex(across.real, z), across.real
                phi = np.angle(goal - circles.centre) - np.angle(circles.arm)
                tip = circles.centre + circles.arm * np.exp(1j * phi)
                miss = np.hypot(np.abs(tip - goal), across.imag - d)
                found += self._best(circles, np.arange(len(phi)), phi, np.full(len(phi), yaw), miss)
            q = self._in_plane(yaw, forward, z, heading)  # the tip level with the target
            if q is not None:
                found.append(_Nearest(q, abs(across - complex(forward, d))))
        return _nearest_of(found)

    def _in_plane(self, yaw: float, r: float, z: float, heading: float | None) -> FloatArray | None:
        """Base and pitch joints inside the limits for a tip r + i z [m] and a base angle [rad]; or None."""
        if self._least is not None and heading is None:
            least = self._least.solve([BaseBranch(True, yaw, r)], z)
            return None if least is None else np.array(least)
        tool_angle = None if heading is None else heading + (self._geometry.tool_angle or 0.0)
        angles = self._planar.inside(r, z, tool_angle)
        return np.array([yaw, *angles[0]]) if angles else None

    def _best(
        self, circles: _Circles, row: Rows, phi: FloatArray, yaw: FloatArray, miss: FloatArray
    ) -> list[_Nearest]:
        """The nearest of some candidates that are inside the limits of the pitch joints."""
        q, beyond = self._joints(circles.constants[row] + circles.slopes[row] * phi[:, None])
        inside = np.isfinite(miss) & (beyond <= LIMIT_TOLERANCE).all(axis=1)
        near = np.flatnonzero(inside & (miss <= miss[inside].min(initial=np.inf) + _ALIKE_M))
        low, high = self._limits[: 1 + len(self._plane)].T
        return _nearest_of(_Nearest(np.clip([yaw[i], *q[i]], low, high), float(miss[i])) for i in near)

    def _facing(
        self, circles: _Circles, x: float, y: float, z: float
    ) -> tuple[Rows, FloatArray, FloatArray, FloatArray]:
        """Circle, phi, base angle and distance of every minimum with the tip facing the target, and more."""
        rho, d = math.hypot(x, y), self._geometry.lateral
        row, phi = _stationary(circles, rho, d, z)
        tip = circles.centre[row] + circles.arm[row] * np.exp(1j * phi)
        miss = np.hypot(rho - np.hypot(tip.real, d), tip.imag - z)
        low, high = self._limits[0].tolist()
        if rho == 0.0:  # any base angle serves
            return row, phi, np.full(len(phi), rest_angle(low, high)), miss
        turn = self._geometry.yaw_sign * (math.atan2(y, x) - np.arctan2(d, tip.real))
        yaw, beyond = _central_images(turn, low, high)
        return row, phi, yaw, np.where(beyond <= LIMIT_TOLERANCE, miss, np.inf)


def _side(branch: BaseBranch) -> Side:
    return "facing" if branch.front else "over the back"


def _turned_alike(a: float, b: float) -> bool:
    return abs(wrap(a - b)) < _SEARCHED


def _nearest_of(found: Iterable[_Nearest]) -> list[_Nearest]:
    """The nearest; of several that are, such as one and the same point over the back, the least turned."""
    found = list(found)
    least = min((one.distance for one in found), default=0.0) + _ALIKE_M
    return sorted((one for one in found if one.distance <= least), key=lambda one: np.abs(one.q).sum())[:1]


# Where the distance of a circle's points x + i y from a ring of radius ρ at height z (with the tool plane d
# beside the axis) is stationary: with w = √(x² + d²) and l = (c_y - z) cos ψ - c_x sin ψ
#
#     l = -ρ x sin ψ / w,  squared  (x² + d²) l² - ρ² x² sin² ψ = 0
#
# a trigonometric polynomial of degree 4 in ψ. With t = tan((ψ - ψ0) / 2) it is one of degree 8 in t, whose
# roots are eigenvalues. ψ0 lies opposite the largest of its samples, so that t⁸ has a good coefficient.

_DEGREE = 4
_ORDERS = np.arange(-_DEGREE, _DEGREE + 1)
_SAMPLED = TWO_PI * np.arange(2 * _DEGREE + 1) / (2 * _DEGREE + 1)


def _half_angle_powers() -> ComplexArray:
    """(9, 9) coefficients of (1 + i t)^(4 + k) (1 - i t)^(4 - k), row k from -4 to 4, lowest power first."""
    rows: list[ComplexArray] = []
    for k in _ORDERS.tolist():
        row = np.ones(1, dtype=np.complex128)
        for factor in [(1.0, 1j)] * (_DEGREE + k) + [(1.0, -1j)] * (_DEGREE - k):
            row = np.convolve(row, factor)
        rows.append(row)
    return np.array(rows)


_POWERS = _half_angle_powers()


def _stationary(circles: _Circles, rho: float, d: float, z: float) -> tuple[Rows, FloatArray]:
    """Circle and phi of every minimum of the distance from a ring (radius rho, height z [m]), and more."""
    scale = np.abs(circles.centre) + np.abs(circles.arm) + abs(d) + rho + abs(z)
    turning = np.flatnonzero(np.abs(circles.arm) >= _NO_LENGTH)
    still = np.flatnonzero(np.abs(circles.arm) < _NO_LENGTH)  # every joint at a limit
    size = scale[turning, None]
    centre, arm = circles.centre[turning, None] / size, np.abs(circles.arm[turning, None]) / size
    x = centre.real + arm * np.cos(_SAMPLED)
    across = (centre.imag - z / size) * np.cos(_SAMPLED) - centre.real * np.sin(_SAMPLED)
    value = (x * x + (d / size) ** 2) * across**2 - (rho / size * x * np.sin(_SAMPLED)) ** 2
    spectrum = value @ np.exp(-1j * _SAMPLED[:, None] * _ORDERS) / len(_SAMPLED)
    origin = _SAMPLED[np.abs(value).argmax(axis=1)] - math.pi
    polynomial = ((spectrum * np.exp(1j * origin[:, None] * _ORDERS)) @ _POWERS).real
    varies = np.abs(polynomial[:, -1]) > 0.0  # else the distance is the same all round
    companion = np.zeros((int(varies.sum()), 2 * _DEGREE, 2 * _DEGREE))
    companion[:, 1:, :-1] = np.eye(2 * _DEGREE - 1)
    companion[:, :, -1] = -polynomial[varies, :-1] / polynomial[varies, -1:]
    # complex roots too: rounding splits a double one, and one too many is harmless
    t: FloatArray = np.linalg.eigvals(companion).real.astype(np.float64)
    psi = origin[varies, None] + 2.0 * np.arctan(t)
    row = np.concatenate([np.repeat(turning[varies], 2 * _DEGREE), turning[~varies], still])
    phi = np.concatenate([psi.ravel(), np.zeros(len(row) - psi.size)])
    return row, phi - np.angle(circles.arm[row])


def _circles_at(
    heading: float, lengths: Sequence[float], limits: Sequence[tuple[float, float]]
) -> Iterator[PlaneCircle]:
    """The circles with the last link's direction [rad] kept: two links turn, the third joint makes up."""
    (l2, l3, l4), (limits2, limits3, limits4) = lengths, limits
    hand = cmath.rect(l4, heading)

    def circle(
        centre: complex, arm: complex, first: tuple[float, float], second: tuple[float, float]
    ) -> PlaneCircle:
        (c2, s2), (c3, s3) = first, second
        return PlaneCircle(hand + centre, arm, (c2, c3, heading - c2 - c3), (s2, s3, -s2 - s3))

    for centre, arm, *angles in collinear_circles((l2, l3), (limits2, limits3)):
        first, second = zip(*angles, strict=True)
        yield circle(centre, arm, first, second)
    seconds = [heading - v for v in limits4]  # headings of the second link, with the third joint at a limit
    for second in seconds:
        yield circle(cmath.rect(l3, second), complex(l2), (0.0, 1.0), (second, -1.0))
    corners = [(v, h - v) for v in limits2 for h in seconds] + [(h - v, v) for v in limits3 for h in seconds]
    for t2, t3 in corners:
        yield circle(cmath.rect(l2, t2) + cmath.rect(l3, t2 + t3), 0j, (t2, 0.0), (t3, 0.0))


def _central_images(
    angle: FloatArray, low: FloatArray | float, high: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """The images of angles nearest to the middle of their limits, and how far outside they are [rad]."""
    near = central_images(angle, low, high)
    return near, np.maximum(0.0, np.abs(near - 0.5 * (low + high)) - 0.5 * (high - low))

"""Why a target cannot be reached, with numbers, and what can be reached instead."""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, central_image, images, nearest_angle, rest_angle
from armctl.kinematics.solutions import all_needs, needs, too_far, too_near
from armctl.kinematics.target import Target
from armctl.kinematics.tool_plane import ToolPlane
from armctl.kinematics.yaw_pitch_roll.geometry import (
    AXIS_TOLERANCE,
    BaseBranch,
    base_branches,
    pitch_poses,
)
from armctl.kinematics.yaw_pitch_roll.section import PlaneCircle, collinear_circles

# The nearest point that the tool can reach: exact, by the conditions that an optimum must meet.
#
# At the nearest point each joint is either at a limit or at rest: the distance does not fall when it alone
# turns. For the base, at rest means that the tip faces the target. For the pitch joints it means that the
# joint lies on the line along which the tip misses the target, within the tool plane. So there are 3^m
# choices of which pitch joints are at which limit, and for each the free groups of links lie on one line:
# the arm is rigid but for one angle, and its tip runs on a circle. Nearest on a circle is closed form while
# the base is at a limit, and a search in one variable while it faces the target.
#
# One case is left: the tip misses the target only sideways, across the tool plane, where the pitch joints
# can do nothing about it. Then they have an ordinary inverse solution in the plane.

ComplexArray = NDArray[np.complex128]
PlaneSolver = Callable[[float, float, float, float | None], FloatArray | None]
"""(1 + m,) joint angles inside the limits for a base angle, a forward and an upward coordinate, and the last
link's direction or any; None where there are none"""
_SAMPLES = 128
_BISECTIONS = 52
_NO_LENGTH = 1e-12
_ALIKE_M = 1e-12
"""distances that differ by rounding alone [m]"""


class _Circles:
    """Many of them, as columns."""

    def __init__(self, circles: Iterable[PlaneCircle], shoulder: complex) -> None:
        kept = list(circles)
        self.centre: ComplexArray = np.array([c.centre for c in kept], dtype=np.complex128) + shoulder
        self.arm: ComplexArray = np.array([c.arm for c in kept], dtype=np.complex128)
        self.constants: FloatArray = np.array([c.constants for c in kept], dtype=np.float64)
        self.slopes: FloatArray = np.array([c.slopes for c in kept], dtype=np.float64)


@dataclass(frozen=True, slots=True)
class Nearest:
    """A nearest configuration."""

    q: FloatArray
    """(1 + m,) base and pitch joints [rad]"""
    distance: float
    """of its tip from the target [m]"""


def nearest_of(found: Iterable[Nearest | None]) -> Nearest | None:
    """The nearest; of several that are, such as one and the same point over the back, the least turned."""
    known = [one for one in found if one is not None]
    if not known:
        return None
    least = min(one.distance for one in known) + _ALIKE_M
    return min((one for one in known if one.distance <= least), key=lambda one: np.abs(one.q).sum())


class NearestReach:
    """Nearest reachable points of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray, in_plane: PlaneSolver) -> None:
        self.geometry, self._in_plane = geometry, in_plane
        self._limits = limits[: 1 + len(geometry.lengths)]
        self._base = (float(limits[0, 0]), float(limits[0, 1]))
        self._plane = [geometry.plane_limits(k, limits) for k in range(len(geometry.lengths))]
        self._free = _Circles(collinear_circles(geometry.lengths, self._plane), geometry.shoulder)

    def solve(self, x: float, y: float, z: float, tool_angle: float | None = None) -> Nearest | None:
        """The nearest configuration inside the limits.

        Args:
            x: target, forward of the base axis [m].
            y: target, left of the base axis [m].
            z: target, above the base origin [m].
            tool_angle: plane angle of the last link to be kept [rad]; None: free.

        Returns:
            None when no configuration has that tool angle.
        """
        for branch in base_branches(self.geometry, x, y, self._base):
            reached = self._in_plane(branch.angle, branch.r, z, tool_angle)
            if reached is not None:  # it was refused for something else, such as the roll
                return Nearest(reached, 0.0)
        circles = self._free
        if tool_angle is not None:
            circles = _Circles(self._at_tool_angle(tool_angle), self.geometry.shoulder)
        found = [self._best(circles, *self._facing(circles, x, y, z))]
        for yaw in self._base:
            across = complex(x, y) * cmath.exp(-1j * self.geometry.yaw_sign * yaw)
            phi = np.angle(complex(across.real, z) - circles.centre) - np.angle(circles.arm)
            tip = circles.centre + circles.arm * np.exp(1j * phi)
            miss = np.hypot(np.abs(tip - complex(across.real, z)), across.imag - self.geometry.lateral)
            found.append(self._best(circles, np.arange(len(phi)), phi, np.full(len(phi), yaw), miss))
            found.append(self._sideways(yaw, across, z, tool_angle, across.real))
        rho, d = math.hypot(x, y), self.geometry.lateral
        if rho < abs(d):  # inside the cylinder that the tool plane cannot enter
            turn = self.geometry.yaw_sign * (math.atan2(y, x) - math.copysign(0.5 * math.pi, d))
            for yaw in images(turn, *self._base):
                across = complex(x, y) * cmath.exp(-1j * self.geometry.yaw_sign * yaw)
                found.append(self._sideways(yaw, across, z, tool_angle, 0.0))
        return nearest_of(found)

    def _sideways(
        self, yaw: float, across: complex, z: float, tool_angle: float | None, r: float
    ) -> Nearest | None:
        """The tip level with the target, at a forward coordinate r [m] of the tool plane."""
        q = self._in_plane(yaw, r, z, tool_angle)
        return None if q is None else Nearest(q, abs(across - complex(r, self.geometry.lateral)))

    def _best(
        self, circles: _Circles, row: NDArray[np.intp], phi: FloatArray, yaw: FloatArray, miss: FloatArray
    ) -> Nearest | None:
        """The nearest of some candidates that is inside the limits of the pitch joints."""
        plane = circles.constants[row] + circles.slopes[row] * phi[:, None]
        inside = np.isfinite(miss)
        for k, limits in enumerate(self._plane):
            plane[:, k], ok = _into(plane[:, k], *limits)
            inside &= ok
        if not inside.any():
            return None
        near = inside & (miss <= miss[inside].min() + _ALIKE_M)
        return nearest_of(self._at(yaw[i], plane[i], miss[i]) for i in np.flatnonzero(near))

    def _at(self, yaw: float, plane: FloatArray, miss: float) -> Nearest:
        angles = [self.geometry.joint_angle(k, float(t)) for k, t in enumerate(plane)]
        return Nearest(np.clip([yaw, *angles], *self._limits.T), float(miss))

    def _facing(
        self, circles: _Circles, x: float, y: float, z: float
    ) -> tuple[NDArray[np.intp], FloatArray, FloatArray, FloatArray]:
        """Circle, phi, base angle and distance of every minimum with the tip facing the target."""
        rho, d = math.hypot(x, y), self.geometry.lateral
        row, phi = self._minima(circles, rho, z)
        tip = circles.centre[row] + circles.arm[row] * np.exp(1j * phi)
        miss = np.hypot(rho - np.hypot(tip.real, d), tip.imag - z)
        low, high = self._base
        if rho == 0.0:  # any base angle serves
            return row, phi, np.full(len(phi), rest_angle(low, high)), miss
        yaw, inside = _into(self.geometry.yaw_sign * (math.atan2(y, x) - np.arctan2(d, tip.real)), low, high)
        return row, phi, yaw, np.where(inside, miss, np.inf)

    def _minima(self, circles: _Circles, rho: float, z: float) -> tuple[NDArray[np.intp], FloatArray]:
        """Circle and phi of every minimum of the distance from a ring of radius rho at height z."""
        d, size = self.geometry.lateral, np.abs(circles.arm)

        def slope(row: NDArray[np.intp], phi: FloatArray) -> FloatArray:
            """Half the derivative of the squared distance over phi."""
            lever = circles.arm[row] * np.exp(1j * phi)
            tip = circles.centre[row] + lever
            w = np.maximum(np.hypot(tip.real, d), 1e-300)
            return (rho - w) * (tip.real / w) * lever.imag + (tip.imag - z) * lever.real

        every = np.arange(len(size))
        # where a circle passes over the base axis two minima may lie close together: sample there too
        over = np.clip(-circles.centre.real / np.maximum(size, _NO_LENGTH), -1.0, 1.0)
        crossing = np.stack([np.arccos(over), -np.arccos(over)], axis=1) - np.angle(circles.arm)[:, None]
        even = np.broadcast_to(
            np.linspace(-math.pi, math.pi, _SAMPLES, endpoint=False), (len(size), _SAMPLES)
        )
        phi = np.sort(np.concatenate([even, (crossing + math.pi) % TWO_PI - math.pi], axis=1), axis=1)
        phi = np.concatenate([phi, phi[:, :1] + TWO_PI], axis=1)
        value = slope(every[:, None], phi)
        row, at = np.nonzero((value[:, :-1] < 0.0) & (value[:, 1:] >= 0.0))
        low, high = phi[row, at], phi[row, at + 1]
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            falling = slope(row, middle) < 0.0
            low, high = np.where(falling, middle, low), np.where(falling, high, middle)
        still = np.flatnonzero(size < _NO_LENGTH)  # every joint at a limit: nothing turns
        return np.concatenate([row, still]), np.concatenate([0.5 * (low + high), np.zeros(len(still))])

    def _at_tool_angle(self, tool_angle: float) -> Iterator[PlaneCircle]:
        """The circles with the last link's direction kept: two links turn, the third joint makes up."""
        if len(self.geometry.lengths) != 3:
            return
        l2, l3, l4 = self.geometry.lengths
        hand = l4 * cmath.exp(1j * tool_angle)
        limits2, limits3, limits4 = self._plane

        def circle(
            centre: complex, arm: complex, first: tuple[float, float], second: tuple[float, float]
        ) -> PlaneCircle:
            (c2, s2), (c3, s3) = first, second
            return PlaneCircle(hand + centre, arm, (c2, c3, tool_angle - c2 - c3), (s2, s3, -s2 - s3))

        headings = [tool_angle - v for v in limits4]  # of the second link, with the third joint at a limit
        yield circle(0j, complex(l2 + l3), (0.0, 1.0), (0.0, 0.0))
        yield circle(0j, complex(l2 - l3), (0.0, 1.0), (math.pi, 0.0))
        for v in limits2:
            yield circle(l2 * cmath.exp(1j * v), complex(l3), (v, 0.0), (-v, 1.0))
        for v in limits3:
            yield circle(0j, l2 + l3 * cmath.exp(1j * v), (0.0, 1.0), (v, 0.0))
        for heading in headings:
            yield circle(l3 * cmath.exp(1j * heading), complex(l2), (0.0, 1.0), (heading, -1.0))
        corners = [*itertools.product(limits2, limits3), *((v, h - v) for v in limits2 for h in headings)]
        for t2, t3 in [*corners, *((h - v, v) for v in limits3 for h in headings)]:
            tip = l2 * cmath.exp(1j * t2) + l3 * cmath.exp(1j * (t2 + t3))
            yield circle(tip, 0j, (t2, 0.0), (t3, 0.0))


def _into(angle: FloatArray, low: float, high: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Images of angles nearest to the middle of their limits, clipped onto them, and which are inside."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    near = angle - TWO_PI * np.rint((angle - middle) / TWO_PI)
    return np.clip(near, low, high), np.abs(near - middle) <= half + LIMIT_TOLERANCE


PlanarSolver = Callable[[float, float, float | None], list[tuple[float, ...]]]
_SIDE = {True: "facing it", False: "over the back"}


@dataclass(frozen=True, slots=True)
class Excess:
    """One joint that would have to leave its limits."""

    joint: int
    needs: float
    """[rad]"""

    def beyond(self, limits: FloatArray) -> float:
        """How far outside [rad]."""
        low, high = limits[self.joint]
        return max(low - self.needs, self.needs - high)


class Reach:
    """Explains refusals of one arm. Immutable; safe in several threads."""

    def __init__(
        self, geometry: ToolPlane, limits: FloatArray, titles: Sequence[str], nearest: NearestReach
    ) -> None:
        self._geometry, self._limits, self._titles, self._nearest = geometry, limits, titles, nearest

    def explain(self, target: Target, planar: PlanarSolver) -> tuple[str, FloatArray | None]:
        """Reason in words, and the configuration (n,) that comes nearest [rad].

        Args:
            target: what was asked for and has no solution inside the limits.
            planar: the arm's closed form in the tool plane, without limits.
        """
        x, y, z = self._geometry.local_of(*target.point)
        branches = base_branches(self._geometry, x, y, None)
        if not branches:
            return self._inside_axis_cylinder(math.hypot(x, y)), self._nearest_to(x, y, z, target)
        angles = [pose.tool_angle for pose in pitch_poses(target.pitch, 0.0)]
        two_links = target.pitch is not None and len(self._geometry.lengths) == 2
        if two_links and not self._links_give(branches, z, angles, planar):
            return self._given_pitch(branches, z, planar), self._nearest_to(x, y, z, target)
        reason = self._beyond_links(branches, z, angles) or self._by_limits(branches, z, angles, planar)
        return reason, self._nearest_to(x, y, z, target)

    def _links_give(
        self, branches: list[BaseBranch], z: float, angles: list[float | None], planar: PlanarSolver
    ) -> bool:
        """True where the links alone hold the tool at one of some plane angles."""
        shoulder = self._geometry.shoulder
        return any(planar(b.r - shoulder.real, z - shoulder.imag, a) for b in branches for a in angles)

    def _given_pitch(self, branches: list[BaseBranch], z: float, planar: PlanarSolver) -> str:
        """With two pitch joints the position alone decides the pitch, unless it is out of reach anyhow."""
        too_far = self._beyond_links(branches, z, [None])
        if too_far is not None:
            return too_far
        shoulder, tool = self._geometry.shoulder, self._geometry.tool_angle or 0.0
        ways = [p for b in branches for p in planar(b.r - shoulder.real, z - shoulder.imag, None)]
        pitches = sorted({round(math.degrees(math.asin(math.sin(sum(way) + tool))), 2) for way in ways})
        return (
            "that pitch is impossible here: with two pitch joints the position alone decides it; "
            f"the links would give {' or '.join(f'{pitch:.2f}°' for pitch in pitches)}, within limits or not"
        )

    def _nearest_to(self, x: float, y: float, z: float, target: Target) -> FloatArray | None:
        """With the pitch kept if any pose inside the limits has it, else with any pitch."""
        found: list[Nearest | None] = []
        if target.pitch is not None and len(self._geometry.lengths) == 3:
            last = self._geometry.tool_angle or 0.0
            poses = [pose.tool_angle for pose in pitch_poses(target.pitch, 0.0)]
            found = [self._nearest.solve(x, y, z, angle - last) for angle in poses if angle is not None]
        nearest = nearest_of(found) or self._nearest.solve(x, y, z)
        joint = self._geometry.roll_joint
        if nearest is None or joint is None:
            return None if nearest is None else nearest.q
        return np.append(nearest.q, nearest_angle(target.roll or 0.0, *self._limits[joint]))

    def _inside_axis_cylinder(self, rho: float) -> str:
        d = abs(self._geometry.lateral)
        return (
            f"inside the {1000 * d:.2f} mm cylinder about the base axis that the tip cannot enter: "
            f"the target is {1000 * rho:.2f} mm from the axis, the tool plane passes it at {1000 * d:.2f} mm"
        )

    def _beyond_links(self, branches: list[BaseBranch], z: float, angles: list[float | None]) -> str | None:
        """Too far or too near for the links alone, whatever the limits."""
        lengths = list(self._geometry.lengths)
        shoulder = self._geometry.shoulder
        point, after = "the target", ""
        misses: list[tuple[float, float]] = []
        fixed_pitch = angles[0] is not None and len(lengths) == 3
        if fixed_pitch:
            last = lengths.pop()
            point, after = "the wrist", " with the tool at that pitch"
        inner, outer = max(0.0, 2 * max(lengths) - sum(lengths)), sum(lengths)
        for branch in branches:
            for angle in angles:
                tip = complex(branch.r, z) - shoulder
                if fixed_pitch and angle is not None:
                    direction = angle - (self._geometry.tool_angle or 0.0)
                    tip -= last * complex(math.cos(direction), math.sin(direction))  # pyright: ignore[reportPossiblyUnboundVariable]
                distance = abs(tip)
                if inner - AXIS_TOLERANCE <= distance <= outer + AXIS_TOLERANCE:
                    return None
                misses.append((max(distance - outer, inner - distance), distance))
        miss, distance = min(misses)
        where = f"{point} would be {1000 * distance:.1f} mm from the {self._titles[1].lower()}{after}"
        if distance > outer:
            return too_far(miss, where, "the arm reaches", outer)
        return too_near(miss, where, "the arm folds no closer than", inner)

    def _by_limits(
        self, branches: list[BaseBranch], z: float, angles: list[float | None], planar: PlanarSolver
    ) -> str:
        """Which joints would have to leave their limits, for each way to face the target."""
        said: list[str] = []
        for branch in branches:
            side = _SIDE[branch.front]
            yaw = _excess(0, branch.angle, self._limits)
            if yaw is not None:
                said.append(f"{side}, {needs(self._titles[0], self._limits[0], yaw.needs)}")
                continue
            excesses = self._least_excess(branch, z, angles, planar)
            if excesses is None:
                said.append(f"{side}, the links do not reach it")
            elif excesses:
                needed = [(excess.joint, excess.needs) for excess in excesses]
                said.append(f"{side}, {all_needs(self._titles, self._limits, needed)}")
        held = "" if angles[0] is None else " at that pitch"
        if not said:
            return f"the arm reaches it{held}, but not with the orientation that was asked for"
        return f"within the links' reach{held}, but joint limits forbid it: " + "; ".join(said)

    def _least_excess(
        self, branch: BaseBranch, z: float, angles: list[float | None], planar: PlanarSolver
    ) -> list[Excess] | None:
        """Joints outside their limits in the posture that leaves them least; None where the links cannot."""
        x, y = branch.r - self._geometry.shoulder.real, z - self._geometry.shoulder.imag
        postures = [posture for angle in angles for posture in planar(x, y, angle)]
        if angles[0] is None and len(self._geometry.lengths) == 3:
            postures = self._swept_postures(x, y)
        if not postures:
            return None
        outside = [
            [e for k, t in enumerate(plane) if (e := self._pitch_excess(k, t)) is not None]
            for plane in postures
        ]
        return min(outside, key=lambda excesses: sum(e.beyond(self._limits) for e in excesses))

    def _pitch_excess(self, k: int, plane_angle: float) -> Excess | None:
        return _excess(1 + k, self._geometry.joint_angle(k, plane_angle), self._limits)

    def _swept_postures(self, x: float, y: float) -> list[tuple[float, ...]]:
        """The posture nearest to the limits of three pitch joints, found by sweeping the first one round."""
        centre, reach, count, best = 0.0, math.pi, 7201, None
        for _ in range(3):  # 0.05°, then finer about the best
            grid: FloatArray = np.linspace(centre - reach, centre + reach, count)
            found = [self._follow(grid, x, y, bend) for bend in (1, -1)]
            energies = [self._total_excess(planes) for planes in found]
            side = int(np.argmin([np.min(energy) for energy in energies]))
            i = int(np.argmin(energies[side]))
            if not np.isfinite(energies[side][i]):
                return []
            best = tuple(float(column[i]) for column in found[side])
            centre, reach, count = float(grid[i]), 2 * reach / (count - 1), 401
        return [] if best is None else [best]

    def _follow(
        self, t2: FloatArray, x: float, y: float, bend: int
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Second and third plane angle for values of the first (k,); NaN where the links do not reach."""
        l2, l3, l4 = self._geometry.lengths
        X, Y = x - l2 * np.cos(t2), y - l2 * np.sin(t2)
        cosine = (X * X + Y * Y - l3 * l3 - l4 * l4) / (2 * l3 * l4)
        t4 = bend * np.arccos(np.where(np.abs(cosine) <= 1.0, cosine, np.nan))
        t3 = np.arctan2(Y, X) - np.arctan2(l4 * np.sin(t4), l3 + l4 * np.cos(t4)) - t2
        return t2, t3, t4

    def _total_excess(self, planes: tuple[FloatArray, FloatArray, FloatArray]) -> FloatArray:
        """(k,) sum over the joints of how far each is outside its limits [rad]; infinite where NaN."""
        total = np.zeros(planes[0].shape)
        for k, plane in enumerate(planes):
            low, high = self._limits[1 + k]
            angle = self._geometry.signs[k] * (plane - self._geometry.offsets[k])
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            total += np.maximum(
                0.0, np.abs(angle - middle - TWO_PI * np.rint((angle - middle) / TWO_PI)) - half
            )
        return np.where(np.isnan(total), np.inf, total)


def _excess(joint: int, angle: float, limits: FloatArray) -> Excess | None:
    """The image of an angle nearest to a joint's limits, if it is outside them."""
    low, high = limits[joint].tolist()
    nearest = central_image(angle, low, high)
    return None if low - LIMIT_TOLERANCE <= nearest <= high + LIMIT_TOLERANCE else Excess(joint, nearest)

"""Why a target cannot be reached, with numbers, and what can be reached instead."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, central_image, nearest_angle
from armctl.kinematics.length_words import millimetres
from armctl.kinematics.limit_words import all_needs, needs
from armctl.kinematics.target import Target
from armctl.kinematics.yaw_pitch_roll.base_yaw import AXIS_TOLERANCE, BaseBranch, base_branches
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.nearest import Nearest, NearestReach, nearest_of
from armctl.kinematics.yaw_pitch_roll.orientation import pitch_poses

FloatArray = NDArray[np.float64]
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
        self, geometry: YawPitchRoll, limits: FloatArray, titles: Sequence[str], nearest: NearestReach
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
        first = self._titles[1].lower()
        if distance > outer:
            return (
                f"too far by {millimetres(miss)} mm: {point} would be {1000 * distance:.1f} mm from the "
                f"{first}{after}, the arm reaches {1000 * outer:.1f} mm"
            )
        return (
            f"inside the dead zone, too near by {millimetres(miss)} mm: "
            f"{point} would be {1000 * distance:.1f} mm from the {first}{after}, "
            f"the arm folds no closer than {1000 * inner:.1f} mm"
        )

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

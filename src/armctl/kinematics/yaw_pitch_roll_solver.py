"""Inverse kinematics of *yaw + parallel pitch joints (+ roll)*: every branch, in closed form."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics.angles import TWO_PI, images, wrap
from armctl.kinematics.base_yaw import BaseBranch, base_branches
from armctl.kinematics.chain import DHChain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.least_rotation import LeastRotation
from armctl.kinematics.nearest import NearestReach
from armctl.kinematics.orientation import PlanePose, RotationFit, pitch_poses
from armctl.kinematics.reach import Reach
from armctl.kinematics.solutions import Solutions
from armctl.kinematics.sweep import FreeJointSweep
from armctl.kinematics.target import Target
from armctl.kinematics.two_link import two_link
from armctl.kinematics.yaw_pitch_roll import YawPitchRoll

FloatArray = NDArray[np.float64]
Optimum = Callable[[], FloatArray | None]
BRANCHES = tuple(
    f"{base} elbow-{elbow}{tool}"
    for base, elbow, tool in itertools.product(("front", "back"), ("up", "down"), ("", " tool-in"))
)
"""Index: 4 · back + 2 · elbow down + tool pointing back at the base axis."""
_PITCH_TOLERANCE = 1e-6


class YawPitchRollSolver:
    """One arm of the family inside its limits. Immutable; safe in several threads."""

    family = "yaw, parallel pitch joints, roll"

    def __init__(
        self,
        chain: DHChain,
        geometry: YawPitchRoll,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
    ) -> None:
        self.chain, self.geometry, self.limits, self.energy = chain, geometry, limits, energy
        self._pairs = [(float(low), float(high)) for low, high in limits]
        three = len(geometry.lengths) == 3
        self._sweep = FreeJointSweep(geometry, limits) if three else None
        self._least = LeastRotation(geometry, limits) if three else None
        roll_axis = None if geometry.roll_joint is None else chain.axes()[1][geometry.roll_joint]
        self._fit = RotationFit(geometry, chain.forward(np.zeros(chain.n))[:3, :3], roll_axis)
        self._reach = Reach(geometry, limits, titles, NearestReach(geometry, limits))

    @property
    def pitch_joints(self) -> tuple[int, ...]:
        """Indices of the parallel pitch joints."""
        return self.geometry.pitch_joints

    @property
    def free_joint(self) -> int | None:
        """The first pitch joint, where there are three."""
        return 1 if self._sweep is not None else None

    def pitch_and_roll(self, q: FloatArray) -> tuple[float | None, float | None]:
        """Tool pitch in [-pi/2, pi/2] and roll [rad] at one configuration (n,)."""
        geometry = self.geometry
        roll = None if geometry.roll_joint is None else float(q[geometry.roll_joint])
        if geometry.tool_angle is None:
            return None, roll
        up = float(geometry.frame[:, 2] @ self.chain.forward(q)[:3, 2])
        return math.asin(max(-1.0, min(1.0, up))), roll

    def solve(self, target: Target, step: float) -> Solutions:
        """All solutions inside the limits.

        Position alone with three pitch joints: the first one is swept in steps of ``step`` [rad]. Else
        the solutions are isolated: position and pitch (and roll), position alone with two pitch joints,
        or position and rotation (the nearest rotation that the arm can take at that position).

        Raises:
            InputError: ``step`` is not a positive number.
        """
        if not (math.isfinite(step) and step > 0):
            raise InputError(f"the step of the swept joint must be a positive angle, got {step!r}")
        refusal, roll = self._roll(target)
        if refusal is not None:
            return self._refused(target, refusal)
        x, y, z = self.geometry.local(target.position)
        branches = base_branches(self.geometry, x, y, self._pairs[0])
        if self._sweep is not None and target.pitch is None and target.rotation is None:
            return self._swept(target, branches, z, roll, step)
        return self._isolated(target, branches, z, roll)

    def _roll(self, target: Target) -> tuple[str | None, float]:
        """Why the roll or pitch asked for cannot be, or the roll joint's angle (0 where it does not matter)."""
        joint = self.geometry.roll_joint
        if target.pitch is not None and self.geometry.tool_angle is None:
            return "this arm's tool does not point within its vertical plane, so it has no pitch to ask for", 0.0
        if joint is None:
            refused = None if target.roll is None else "this arm has no joint that rolls the tool"
            return refused, 0.0
        low, high = self._pairs[joint]
        if target.roll is None:
            return None, min(max(0.0, low), high)
        inside = images(target.roll, low, high)
        if inside:
            return None, inside[0]
        return self._reach.joint_outside(joint, wrap(target.roll)), 0.0

    def _swept(
        self, target: Target, branches: list[BaseBranch], z: float, roll: float, step: float
    ) -> Solutions:
        if self._sweep is None or self._least is None:
            raise InputError("only arms with three pitch joints have a free joint")
        shoulder, sweep, least = self.geometry.shoulder, self._sweep, self._least
        parts = [
            (branch, part)
            for branch in branches
            for part in sweep.solve(branch.r - shoulder.real, z - shoulder.imag, step)
        ]

        def optimum() -> FloatArray | None:
            found = least.solve(branches, z)
            return None if found is None else self._with_roll(found, roll)

        count = sum(len(part.first) for _, part in parts)
        if count == 0:
            single = optimum()  # a sliver between two grid values, or a single stretched configuration
            if single is None:
                return self._refused(target)
            return self._solutions(target, [single], [0], optimum)
        q = np.empty((self.chain.n, count))  # joint by joint in memory: one contiguous write each
        index = np.empty(count, dtype=np.int8)
        at = 0
        for branch, part in parts:
            cut = slice(at, at + len(part.first))
            at = cut.stop
            q[0, cut], q[1, cut], q[2, cut], q[3, cut] = branch.angle, part.first, part.second, part.third
            index[cut] = _branch_index(branch.front, part.bend)
        if self.geometry.roll_joint is not None:
            q[self.geometry.roll_joint] = roll
        return self._make(target, q.T, index, optimum, free=1)

    def _isolated(self, target: Target, branches: list[BaseBranch], z: float, roll: float) -> Solutions:
        found: list[FloatArray] = []
        index: list[int] = []
        for branch in branches:
            for plane, pose in self._postures(target, branch, z, roll):
                for angles in self._joint_images(plane):
                    for rolled in self._roll_images(pose.roll):
                        found.append(self._with_roll(np.array([branch.angle, *angles]), rolled))
                        index.append(_branch_index(branch.front, _sense(plane[1]), _tool_in(branch, pose)))
        if not found:
            return self._refused(target)
        return self._solutions(target, *_distinct(found, index))

    def _postures(
        self, target: Target, branch: BaseBranch, z: float, roll: float
    ) -> Iterator[tuple[tuple[float, ...], PlanePose]]:
        """Plane angles and tool pose of every posture, limits not yet looked at."""
        x, y = branch.r - self.geometry.shoulder.real, z - self.geometry.shoulder.imag
        if target.rotation is None:
            for pose in pitch_poses(target.pitch, roll):
                for plane in self.planar(x, y, pose.tool_angle):
                    yield plane, pose
        elif len(self.geometry.lengths) == 3:
            pose = self._fit.nearest(branch.angle, target.rotation)
            for plane in self.planar(x, y, pose.tool_angle):
                yield plane, pose
        else:  # two pitch joints: the position alone decides where the tool points
            for plane in self.planar(x, y, None):
                angle = sum(plane) + (self.geometry.tool_angle or 0.0)
                yield plane, PlanePose(angle, self._fit.roll_at(branch.angle, angle, target.rotation))

    def _roll_images(self, roll: float) -> list[float]:
        joint = self.geometry.roll_joint
        return [0.0] if joint is None else images(roll, *self._pairs[joint])

    def planar(self, x: float, y: float, tool_angle: float | None) -> list[tuple[float, ...]]:
        """Plane angles for a tip seen from the first pitch axis [m], with the tool at a plane angle or any."""
        lengths = self.geometry.lengths
        if tool_angle is None:
            return list(two_link(x, y, *lengths)) if len(lengths) == 2 else []
        last = tool_angle - (self.geometry.tool_angle or 0.0)  # absolute direction of the last link
        if len(lengths) == 2:
            return [
                pair
                for pair in two_link(x, y, *lengths)
                if abs(math.remainder(sum(pair) - last, TWO_PI)) < _PITCH_TOLERANCE
            ]
        x, y = x - lengths[2] * math.cos(last), y - lengths[2] * math.sin(last)
        pairs = two_link(x, y, lengths[0], lengths[1])
        if pairs and math.hypot(x, y) < 1e-12:  # folded onto its own first axis: any direction serves
            pairs = [(self.geometry.plane_angle(0, v), pairs[0][1]) for v in (0.0, *self._pairs[1])]
        return [(first, bend, last - first - bend) for first, bend in pairs]

    def _joint_images(self, plane: tuple[float, ...]) -> list[tuple[float, ...]]:
        """Every joint configuration inside the limits that has these plane angles."""
        choices = [
            images(self.geometry.joint_angle(k, angle), *self._pairs[1 + k]) for k, angle in enumerate(plane)
        ]
        return list(itertools.product(*choices))

    def _with_roll(self, q: FloatArray, roll: float) -> FloatArray:
        return q if self.geometry.roll_joint is None else np.append(q, roll)

    def _solutions(
        self, target: Target, q: list[FloatArray], index: list[int], optimum: Optimum | None = None
    ) -> Solutions:
        return self._make(target, np.array(q), np.array(index, dtype=np.int8), optimum)

    def _make(
        self, target: Target, q: FloatArray, index: NDArray[np.int8], optimum: Optimum | None, free: int | None = None
    ) -> Solutions:
        return Solutions(
            target=target, q=q, branch_index=index, branch_names=BRANCHES, chain=self.chain,
            energy=self.energy, pitch_joints=self.pitch_joints, free_joint=free,
            least_rotation=optimum,
        )  # fmt: skip

    def _refused(self, target: Target, reason: str | None = None) -> Solutions:
        why, nearest = self._reach.explain(target, self.planar)
        return Solutions(
            target=target, q=np.empty((0, self.chain.n)), branch_index=np.empty(0, dtype=np.int8),
            branch_names=BRANCHES, chain=self.chain, energy=self.energy, pitch_joints=self.pitch_joints,
            reason=reason or why, nearest_q=nearest,
        )  # fmt: skip


def _sense(angle: float) -> int:
    return 1 if wrap(angle) >= 0 else -1


def _branch_index(front: bool, bend: int, tool_in: bool = False) -> int:
    """A positive bend leaves the elbow below the line to the target in front, above it at the back."""
    elbow_up = (bend < 0) == front
    return 4 * (not front) + 2 * (not elbow_up) + tool_in


def _tool_in(branch: BaseBranch, pose: PlanePose) -> bool:
    """True when the tool points back at the base axis."""
    if pose.tool_angle is None:
        return False
    outward = math.cos(pose.tool_angle) if branch.front else -math.cos(pose.tool_angle)
    return outward < -1e-9


def _distinct(found: list[FloatArray], index: list[int]) -> tuple[list[FloatArray], list[int]]:
    """Without copies: straight up and straight down are reached by two pitch angles that are the same."""
    kept: list[FloatArray] = []
    names: list[int] = []
    for q, i in zip(found, index, strict=True):
        if not any(np.abs(q - other).max() < 1e-12 for other in kept):
            kept.append(q)
            names.append(i)
    return kept, names

"""Inverse kinematics of *yaw, two pitch joints, rods that keep the hand level (+ roll)*: palletisers.

The hand never tilts, so it is a constant vector in the tool plane. Moved to the shoulder it leaves a triangle
of two links. Its angles are sums of joint angles, because rods also let a motor in the base turn the forearm.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from itertools import product
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts import Reason
from armctl.facts.targets import (
    AnyAngle,
    BesideAxis,
    BetweenReaches,
    JointsNeeded,
    LimitsForbid,
    OutOfReach,
    PitchOfRods,
)
from armctl.kinematics.angles import (
    LIMIT_TOLERANCE,
    central_image,
    images,
    nearest_angle,
    rotation_angle,
)
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.explanations import SolvedArm, angle_needed, angles_needed
from armctl.kinematics.families.yaw_pitch_roll.closed_form import two_link
from armctl.kinematics.families.yaw_pitch_roll.geometry import (
    BRANCHES,
    BaseBranch,
    base_branches,
    bend_sense,
    branch_index,
    is_on_axis,
    recognise,
)
from armctl.kinematics.samples import checked_step
from armctl.kinematics.solutions import Solutions
from armctl.kinematics.solver import InverseKinematics, held_roll, roll_angles
from armctl.kinematics.subproblems import ToolPlane
from armctl.kinematics.target import Target
from armctl.lazy_dataclass import dataclass

_ALIGNED = 1e-9
"""how far from parallel or at a right angle axes may be (sine), and factors from whole numbers"""
_ROUNDING = 1e-10
"""how far beyond the links' reach a target still counts as on its edge [m]"""
_LEVEL = 1e-7
"""a pitch this near to the one that the rods keep is met [rad]"""
_EDGE_SAMPLES, _SECTIONINGS = 361, 60
_ROUNDS, _SETTLED = 60, 1e-8
"""how often base and reach are found in turn, and how much nearer is still worth a round [m]"""
_GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class Linkage:
    """The triangle in the tool plane, and which joint angles make its angles."""

    plane: ToolPlane
    """as if the hand stood between base and shoulder; ``joint_angle`` gives the turns of the two links"""
    turns_of_joints: FloatArray
    """(2, 2) the turns of the two links of the two pitch joints' angles"""
    joints_of_turns: FloatArray
    """(2, 2) the two pitch joints' angles of the turns of the two links"""
    roll_axis: FloatArray | None
    """(3,) direction of the joint that turns the hand about the vertical, base frame; None: there is none"""

    @classmethod
    def of(cls, chain: Chain) -> Linkage | None:
        """The geometry of an arm of the family, or None."""
        C, links = chain.coupling, len(chain.segments)
        if C is None or (links, chain.n) not in ((4, 3), (5, 4)):
            return None
        points, axes = chain.axes()
        tool = chain.forward(np.zeros(chain.n))
        tip = tool[:3, 3]
        if np.linalg.norm(np.cross(axes[1], axes[3])) > _ALIGNED:
            return None
        senses = np.sign(axes[1:4] @ axes[1])
        own = np.zeros_like(C)  # what only the base and the roll joint may turn
        own[0, 0] = 1.0
        inner = np.zeros_like(C, dtype=np.bool_)
        inner[1:4, 1:3] = True
        if links == 5:
            own[4, 3] = 1.0
            aside = np.linalg.norm(np.cross(tip - points[4], axes[4]))
            if np.linalg.norm(np.cross(axes[4], axes[0])) > _ALIGNED or aside > _ALIGNED:
                return None
        turns = C[1:3, 1:3]
        whole = np.abs(turns - np.rint(turns)).max() < _ALIGNED and round(abs(np.linalg.det(turns))) == 1
        level = np.abs(senses @ C[1:4]).max() < _ALIGNED
        if not (np.array_equal(C[~inner], own[~inner]) and whole and level):
            return None
        plane = recognise(Chain(chain.segments[:3], chain.segments[3]))  # as far as the wrist
        if plane is None:
            return None
        ahead, left, up = ((tip - points[3]) @ plane.frame).tolist()
        plane = replace(
            plane,
            lateral=plane.lateral + left,
            shoulder=plane.shoulder + complex(ahead, up),
            tool_angle=None,
        )
        inverse = np.linalg.inv(turns).astype(np.float64)
        return cls(plane, turns, inverse, axes[4] if links == 5 else None)

    def turns_at(self, shoulder: float, bend: float) -> FloatArray:
        """(2,) pitch joints' angles [rad] of two plane angles, up to whole turns."""
        turns = [self.plane.joint_angle(0, shoulder), self.plane.joint_angle(1, bend)]
        return self.joints_of_turns @ turns

    def triangle(self, w: complex, *, clamp: bool = False) -> list[tuple[float, float]]:
        """Plane angles of shoulder and elbow that put the wrist at ``w`` from the shoulder [m].

        None where it is out of reach; with ``clamp`` those of the nearest point that is not.
        """
        first, second = self.plane.lengths
        if clamp:
            w = cmath.rect(min(max(abs(w), abs(first - second)), first + second), cmath.phase(w))
        return two_link(w.real, w.imag, first, second)


class ParallelLinkageSolver(InverseKinematics):
    """One arm of the family inside its limits. Immutable; safe in several threads."""

    family = "yaw, two pitch joints, level hand"
    takes_linkages = True

    def __init__(
        self, chain: Chain, linkage: Linkage, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]
    ) -> None:
        super().__init__(chain, limits, energy, titles, roll_joint=None if linkage.roll_axis is None else 3)
        self._linkage, self._plane = linkage, linkage.plane
        self._arm = SolvedArm(
            BRANCHES, chain, energy, (), limits, self.roll_joint, titles=self.titles, solver_of=self.of
        )
        z = chain.forward(np.zeros(chain.n))[:3, 2]
        self._pitch = math.atan2(z[2], math.hypot(z[0], z[1]))

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """See ``InverseKinematics``."""
        linkage = Linkage.of(chain)
        return None if linkage is None else cls(chain, linkage, limits, energy, titles)

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """All solutions inside the limits; nothing is swept, ``step`` [rad] is only looked at.

        With a rotation those are listed whose orientation is nearest to it.
        Raises ``InputError``: ``step`` is not a positive number.
        """
        checked_step(step)
        refusal, roll = held_roll(self._roll, target.roll)
        if target.pitch is not None and abs(math.sin(target.pitch) - math.sin(self._pitch)) > _LEVEL:
            refusal = PitchOfRods(self._pitch, target.pitch)
        if refusal is not None:
            return self._refused(
                target, self._besides(refusal, target._replace(pitch=None, roll=None), step), roll
            )
        found = [
            (q, index) for position, index in self._positions(target) for q in self._rolled(position, target)
        ]
        if not found:
            return self._refused(target, self._why_not(target), roll)
        if target.rotation is not None:
            turned = np.swapaxes(self.chain.forward(np.array([q for q, _ in found]))[:, :3, :3], 1, 2)
            off = rotation_angle(turned @ target.rotation)
            found = [one for one, away in zip(found, off, strict=True) if away <= off.min() + _LEVEL]
        return Solutions(
            self._arm,
            target,
            np.array([q for q, _ in found]),
            [i for _, i in found],
            incomplete=self._continuum(target),
        )

    def _continuum(self, target: Target) -> AnyAngle | None:
        """Why one solution of many stands in the list, or None."""
        x, y, z = self._plane.local_of(*target.point)
        if is_on_axis(self._plane, x, y):
            return AnyAngle(self.titles[0], "target on base axis")
        folded = abs(self._plane.lengths[0] - self._plane.lengths[1]) < _ROUNDING
        bases = base_branches(self._plane, x, y, None)
        if folded and any(abs(complex(one.r, z) - self._plane.shoulder) < _ROUNDING for one in bases):
            return AnyAngle(self.titles[1], "wrist on shoulder axis")
        return None

    def _positions(self, target: Target) -> Iterator[tuple[FloatArray, int]]:
        """The first three joints (3,) inside their limits, all images, and their branches."""
        for base, pair, index in self._branches(target, tuple(self.limits[0].tolist())):
            both = [images(angle, *self.limits[1 + k].tolist()) for k, angle in enumerate(pair.tolist())]
            for first, second in product(*both):
                q = np.array([base.angle, first, second])
                if self.chain.keeps_turns(self._whole(q)):
                    yield q, index

    def _whole(self, q: FloatArray) -> FloatArray:
        """The first three joints (3,) with the hand's roll, which turns no other link, at 0."""
        return np.append(q, np.zeros(self.chain.n - 3))

    def _branches(
        self, target: Target, yaw_limits: tuple[float, float] | None
    ) -> Iterator[tuple[BaseBranch, FloatArray, int]]:
        x, y, z = self._plane.local_of(*target.point)
        for base in base_branches(self._plane, x, y, yaw_limits):
            for shoulder, bend in self._linkage.triangle(complex(base.r, z) - self._plane.shoulder):
                pair = self._linkage.turns_at(shoulder, bend)
                yield base, pair, branch_index(base.front, bend_sense(bend))

    def _rolled(self, q: FloatArray, target: Target) -> list[FloatArray]:
        """A position (3,) with the roll joint at what is asked for, where there is one."""
        axis = self._linkage.roll_axis
        if self._roll is None or axis is None:
            return [q]
        if target.rotation is None:
            return [np.append(q, angle) for angle in roll_angles(self._roll, target.roll)]
        # nearest is the turn of most trace(Rot(axis, angle) M), else one of the limits
        M = self.chain.forward(np.append(q, 0.0))[:3, :3] @ target.rotation.T
        wanted = math.atan2(np.trace(np.cross(np.eye(3), axis) @ M), np.trace(M) - axis @ M @ axis)
        ends = dict.fromkeys((self._roll.low, self._roll.high))  # one, where it is held
        return [np.append(q, angle) for angle in self._roll.angles(wanted) or ends]

    # Refusals.

    def _refused(self, target: Target, reason: Reason, roll: float) -> Solutions:
        q = self._nearest(target)
        nearest = q if self._roll is None else np.append(q, roll)
        return Solutions(self._arm, target, (), (), reason=reason, nearest_q=nearest)

    def _why_not(self, target: Target) -> Reason:
        """Why a position has no solution."""
        x, y, z = self._plane.local_of(*target.point)
        first, second = self._plane.lengths
        bases = base_branches(self._plane, x, y, None)
        if not bases:
            return BesideAxis(abs(self._plane.lateral), math.hypot(x, y))
        distances = [abs(complex(base.r, z) - self._plane.shoulder) for base in bases]
        least, most = abs(first - second), first + second

        near, far = min(distances), max(distances)
        if near > most + _ROUNDING or far < least - _ROUNDING:
            too_far = near > most + _ROUNDING
            away, length = (near, most) if too_far else (far, least)
            if not self._plane.lateral:
                return OutOfReach(too_far, abs(away - length), length, away, "wrist", links="two links")
            miss = self._plane.way_to_circle(math.hypot(x, y), z, length)
            return OutOfReach(too_far, miss, length, None, "wrist", links="two links")
        if not any(least - _ROUNDING <= away <= most + _ROUNDING for away in distances):
            return BetweenReaches(near, far, least, most)
        best, smallest = JointsNeeded(()), math.inf
        limits = self.limits[:3].tolist()
        for base, pair, _ in self._branches(target, None):
            angles = zip((base.angle, *pair.tolist()), limits, strict=True)
            ways = [images(angle, *pair) or [central_image(angle, *pair)] for angle, pair in angles]
            for q in map(np.array, product(*ways)):
                way, excess = self._needs(q)
                if excess < smallest:
                    best, smallest = way, excess
        return LimitsForbid((best,) if best.needs else ())

    def _needs(self, q: FloatArray) -> tuple[JointsNeeded, float]:
        """Which limits the first three joints (3,) would have to leave, and by how much in all [rad]."""
        chain, low, high = self.chain, *self.limits[:3].T
        over = np.maximum(low - q, q - high)
        leaving = [(k, float(q[k])) for k in np.flatnonzero(over > LIMIT_TOLERANCE).tolist()]
        needs = list(angles_needed(self.titles, self.limits, leaving))
        whole = self._whole(q)
        for limit, turn in chain.turns_beyond(whole):
            needs.append(angle_needed(limit.name, (limit.lower, limit.upper), turn))
        beyond = np.maximum(chain.turn_excess(whole), 0.0)
        return JointsNeeded(tuple(needs)), float(np.maximum(over, 0.0).sum() + beyond.sum())

    def _nearest(self, target: Target) -> FloatArray:
        """(3,) where the tool point comes nearest to the target.

        Exact where the tool plane goes through the base axis. Beside it the best base angle depends on the
        reach, and both are found in turn until nothing comes nearer.
        """
        plane = self._plane
        x, y, z = plane.local_of(*target.point)
        low, high = self.limits[0].tolist()
        yaws = {base.angle for base in base_branches(plane, x, y, (low, high))} | {low, high}
        azimuth = plane.yaw_sign * math.atan2(y, x)
        for facing in (azimuth, azimuth + math.pi):  # inside the cylinder that the plane's offset keeps free
            yaws.update(images(facing, low, high))
        best, least = np.zeros(3), math.inf
        for yaw in sorted(yaws):
            nearer, off = yaw, math.inf
            for _ in range(_ROUNDS if plane.lateral else 1):
                before, (away, pair) = off, self._nearest_in_plane(nearer, x, y, z)
                off = min(away, before)
                if off < least - 1e-15:
                    best, least = np.array([nearer, *pair.tolist()]), off
                if before - off < _SETTLED:
                    break
                ahead = float((self._wrist(pair[None])[0] + plane.shoulder).real)
                facing = azimuth - plane.yaw_sign * math.atan2(plane.lateral, ahead)
                nearer = nearest_angle(facing, low, high)
        return best

    def _nearest_in_plane(self, yaw: float, x: float, y: float, z: float) -> tuple[float, FloatArray]:
        """How near to a point [m] the tool comes with a base angle, and the pitch joints (2,) for that."""
        turn = cmath.exp(-1j * self._plane.yaw_sign * yaw) * complex(x, y)
        w, aside = complex(turn.real, z) - self._plane.shoulder, turn.imag - self._plane.lateral
        pairs = list(self._nearest_pairs(w))
        away = np.hypot(np.abs(self._wrist(np.array(pairs)) - w), aside)
        i = int(away.argmin())
        return float(away[i]), pairs[i]

    def _nearest_pairs(self, w: complex) -> Iterator[FloatArray]:
        """Candidates (2,) for the wrist nearest to ``w``: inside, or on an edge of what the limits leave."""
        limits = self.limits[1:3]
        for shoulder, bend in self._linkage.triangle(w, clamp=True):
            pair = self._linkage.turns_at(shoulder, bend).tolist()
            both = [images(angle, *limits[k].tolist()) for k, angle in enumerate(pair)]
            for inside in map(np.array, product(*both)):
                if self.chain.keeps_turns(self._whole(np.append(0.0, inside))):
                    yield inside
        yield from self._nearest_on_edges(w)

    @cached_property
    def _corners(self) -> list[FloatArray]:
        """Corners (2,), in order, of what the limits leave to the two pitch joints [rad]."""
        (low, high), (least, most) = self.limits[1:3].tolist()
        corners = [np.array(pair) for pair in ((low, least), (high, least), (high, most), (low, most))]
        turning = self.chain.turns(np.eye(self.chain.n)).T[:, 1:3]
        for limit in self.chain.turn_limits:
            row = turning[limit.link]
            for normal, bound in ((row, limit.upper), (-row, -limit.lower)):
                corners = _cut(corners, normal, bound)
        if not corners:
            raise InputError("the limits of the joints and those of the angles between links leave no pose")
        return corners

    def _nearest_on_edges(self, w: complex) -> FloatArray:
        """The best pair (e, 2) on each of the edges between the corners: samples, then sectioning."""
        start = np.array(self._corners)[:, None]
        way = np.roll(start, -1, axis=0) - start

        def away(shares: FloatArray) -> FloatArray:
            """(e, k) how far the wrist is from ``w`` [m] at shares (e, k) of the edges."""
            pairs = start + shares[:, :, None] * way
            return np.abs(self._wrist(pairs.reshape(-1, 2)).reshape(shares.shape) - w)

        row, gap = np.arange(len(start)), 1.0 / (_EDGE_SAMPLES - 1)
        samples: FloatArray = np.tile(np.linspace(0.0, 1.0, _EDGE_SAMPLES), (len(start), 1))
        at_k = gap * away(samples).argmin(axis=1)
        left, right = np.maximum(at_k - gap, 0.0), np.minimum(at_k + gap, 1.0)
        for _ in range(_SECTIONINGS):
            inner = _GOLDEN * (right - left)
            first, second = away(np.stack([right - inner, left + inner], axis=1)).T
            left, right = np.where(first < second, [left, left + inner], [right - inner, right])
        ends = np.stack([left, right, 0.5 * (left + right), at_k], axis=1)
        best = ends[row, away(ends).argmin(axis=1)]
        return start[:, 0] + best[:, None] * way[:, 0]

    def _wrist(self, pairs: FloatArray) -> FloatArray:
        """Complex (k,) place of the wrist from the shoulder in the tool plane [m] at pitch joints (k, 2)."""
        plane = self._plane
        turns = pairs @ self._linkage.turns_of_joints.T
        first, bend = (plane.signs[k] * turns[:, k] + plane.offsets[k] for k in (0, 1))
        (a, b) = plane.lengths
        return a * np.exp(1j * first) + b * np.exp(1j * (first + bend))


def _cut(corners: list[FloatArray], normal: FloatArray, bound: float) -> list[FloatArray]:
    """What a half plane ``normal · x <= bound`` leaves of a convex polygon (Sutherland and Hodgman 1974)."""
    kept: list[FloatArray] = []
    for one, other in zip(corners, corners[1:] + corners[:1], strict=True):
        here, there = float(normal @ one) - bound, float(normal @ other) - bound
        if here <= 0.0:
            kept.append(one)
        if (here < 0.0 < there) or (there < 0.0 < here):
            kept.append(one + here / (here - there) * (other - one))
    return kept

"""What solvers of whole tool poses share: all images of their ways, the rest of the targets by search.

A position, or a position with a pitch, leaves six joints a continuum, which the numeric solver samples; it
also comes as near as it can to a pose that is out of reach. A tool straight up or down, with its roll by the
last joint, is a whole pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.facts import Reason
from armctl.kinematics.angles import (
    LIMIT_TOLERANCE,
    MOST_IMAGES,
    MOST_TURNS,
    TWO_PI,
    Images,
    all_images,
    distinct,
    rest_angle,
    rotation_angle,
    turns_inside,
)
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.explanations import SolvedArm, SolverOf, all_of, by_turns
from armctl.kinematics.families.numeric.descent import rotation_vectors, tool_motion
from armctl.kinematics.families.numeric.solver import NumericSolver
from armctl.kinematics.newton import newton_many
from armctl.kinematics.samples import checked_step
from armctl.kinematics.solutions import Solutions
from armctl.kinematics.solver import RollJoint, held_roll
from armctl.kinematics.target import Target

_SPREAD = 12
"""half of how many angles stand for a continuum"""
_ROUNDING = 2e-14
"""a miss that no step makes smaller"""
_HALF_KNOWN = 1e-6
"""how far off rounding may carry a double root, which has half of the digits only [rad]"""
_MET, _STEPS, _HELD = 1e-10, 4, 3
"""[m] or [rad]: what Newton steps leave of a pose that is met, how many they are, and rounds of them"""


class Configurations(NamedTuple):
    """Every configuration that has a pose, whatever the joint limits."""

    q: FloatArray
    """(k, n) [rad] at any of their images"""
    branch: NDArray[np.int8]
    """(k,) index into the branch names"""
    incomplete: Reason | None = None
    """why there are more"""
    double: bool = False
    """whether some may be double roots, or nearly"""


class _Images:
    """The images of configurations inside the limits, counted at once and listed when they are looked at."""

    def __init__(self, q: FloatArray, limits: FloatArray, start: FloatArray | None) -> None:
        self._arguments = q, limits, start
        first, last = turns_inside(q, limits)
        turns = last - first
        every = float(np.maximum(turns + 1.0, 0.0).prod(axis=1).sum())
        known = every <= MOST_IMAGES and turns.max(initial=0.0) < MOST_TURNS  # then none is left out
        self.left_out = 0 if known else self.listed.left_out
        self._count = round(every) if known else len(self.listed.q)

    @cached_property
    def listed(self) -> Images:
        return all_images(*self._arguments)

    def __len__(self) -> int:
        return self._count

    def __array__(self, dtype: object = None, copy: object = None) -> FloatArray:
        return self.listed.q


class _BranchOfImages:
    """The branch of each image."""

    def __init__(self, branch: NDArray[np.int8], images: _Images) -> None:
        self._branch, self._images = branch, images

    def __len__(self) -> int:
        return len(self._images)

    def __array__(self, dtype: object = None, copy: object = None) -> NDArray[np.int8]:
        return self._branch[self._images.listed.source]


class WholePoses:
    """How the solver of one arm answers. Immutable; safe in several threads."""

    def __init__(
        self,
        chain: Chain,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
        branch_names: tuple[str, ...],
        roll: RollJoint | None,
        solver_of: SolverOf,
    ) -> None:
        self._arguments = chain, limits, energy, titles
        self._limits, self._roll = limits, roll
        joint = None if roll is None else roll.index
        self.arm = SolvedArm(
            branch_names, chain, energy, (), limits, joint, titles=tuple(titles), solver_of=solver_of
        )

    @cached_property
    def _search(self) -> NumericSolver:
        return NumericSolver(*self._arguments)

    def solve(
        self,
        target: Target,
        step: float,
        start: FloatArray | None,
        every_way: Callable[[FloatArray, FloatArray | None], Configurations],
    ) -> Solutions:
        """As ``InverseKinematics.solve``, by ``every_way`` of a tool pose (4, 4) with that start.

        With the tool straight up or down the roll joint turns it about the vertical: the ways of any
        rotation, with that joint at the roll asked for.
        """
        checked_step(step)
        limits, roll = self._limits, self._roll
        if target.rotation is not None:
            pose = pose_of(target.position, target.rotation)
            ways = every_way(pose, start)
            beside = _moved_onto_limits(self.arm.chain, pose, ways, limits)
        elif target.up is not None and roll is not None and (target.roll is None or roll.angles(target.roll)):
            pose = pose_of(target.position, np.diag([1.0, target.up, target.up]))
            held, limits = held_roll(roll, target.roll)[1], limits.copy()
            limits[roll.index] = -math.inf, math.inf
            ways = every_way(pose, start)
            beside = _moved_onto_limits(self.arm.chain, pose, ways, limits)
            limits[roll.index] = held
            ways, beside = (_with_joint(one, roll.index, held) for one in (ways, beside))
        else:
            return self._search.solve(target, step, start)
        images = _Images(ways.q, limits, start)
        left_out, q, branch = images.left_out, images, _BranchOfImages(ways.branch, images)
        if len(beside.q):
            more = all_images(beside.q, limits, start)
            there = np.asarray(images)
            new = [np.abs(there - one).max(axis=1).min(initial=math.inf) > _HALF_KNOWN for one in more.q]
            if any(new):
                left_out += more.left_out
                q = np.concatenate([there, more.q[new]])
                branch = np.concatenate([branch, beside.branch[more.source[new]]])
        if len(q) == 0:
            approach = self._search.solve if target.rotation is None else self._search.approach
            return approach(target, step, start)
        return Solutions(self.arm, target, q, branch, incomplete=all_of(ways.incomplete, by_turns(left_out)))

    def spread(self, joint: int, start: FloatArray | None) -> FloatArray:
        """(m,) angles inside the limits of a joint that may be at any [rad], that of ``start`` (n,) too."""
        low, high = self._limits[joint].tolist()
        middle, half = 0.5 * (low + high), min(0.5 * (high - low), math.pi)
        values = [middle + half * k / _SPREAD for k in range(-_SPREAD, _SPREAD + 1)]
        values.append(rest_angle(low, high))
        if start is not None:
            values.append(min(max(float(start[joint]), low), high))
        return np.unique(values)


def misses(chain: Chain, poses: FloatArray, q: FloatArray) -> FloatArray:
    """By how much configurations (k, n) miss a pose each, or one for all, (..., 4, 4): (k,) [m] or [rad]."""
    T = chain.forward(q)
    turned = rotation_vectors(T[:, :3, :3] @ np.swapaxes(poses[..., :3, :3], -1, -2))
    away = np.linalg.norm(T[:, :3, 3] - poses[..., :3, 3], axis=1)
    return np.maximum(away, np.linalg.norm(turned, axis=1))


def _moved_onto_limits(
    chain: Chain, pose: FloatArray, ways: Configurations, limits: FloatArray
) -> Configurations:
    """Ways a little beyond limits (n, 2) [rad], moved onto them where they meet the pose so; no others.

    Two ways that are nearly one, as of an elbow that is nearly straight, are known to half of their digits:
    what is on a limit may come out beyond it.
    """
    none = Configurations(np.empty((0, chain.n)), np.empty(0, dtype=np.int8))
    if not ways.double:
        return none
    low, high = limits.T
    with np.errstate(invalid="ignore"):  # a joint without limits
        up, down = (low - ways.q) % TWO_PI, (ways.q - high) % TWO_PI
    move = np.where(up < _HALF_KNOWN, up, np.where(down < _HALF_KNOWN, -down, 0.0))
    beside, joint = np.nonzero(np.abs(move) > LIMIT_TOLERANCE)
    if len(beside) == 0:
        return none
    held = np.arange(chain.n) == joint[:, None]
    there = polished(chain, pose, ways.q[beside] + held * move[beside], 1.0, _STEPS, held)
    met = np.flatnonzero(misses(chain, pose, there) < _ROUNDING)
    met = met[distinct(there[met])]
    return Configurations(there[met], ways.branch[beside[met]])


def _with_joint(ways: Configurations, index: int, angle: float) -> Configurations:
    q = ways.q.copy()
    q[:, index] = angle
    return ways._replace(q=q)


def pose_of(position: FloatArray, rotation: FloatArray) -> FloatArray:
    """``T_base_tool`` (4, 4) of a position (3,) [m] and a rotation (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def turned_onto(
    chain: Chain, limits: FloatArray, pose: FloatArray, q: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Configurations (k, n) on a point [rad], and by what angle (k,) each misses the rotation of a pose.

    Those that nearly have it are brought onto it, where they meet ``pose`` (4, 4) inside limits (n, 2): a
    nearly straight elbow has half of its digits where a distance tells it, and the rotation tells the rest.
    """
    off = _turned(chain, pose, q)
    near = np.flatnonzero((off > _ROUNDING) & (off < _HALF_KNOWN))
    if len(near) == 0:
        return q, off
    there, held = q[near], np.zeros((len(near), chain.n), dtype=np.bool_)
    for _ in range(_HELD):  # joints that come to their limits stay there
        free = polished(chain, pose, there, 1.0, _STEPS, held)
        there = np.clip(free, *limits.T)
        held |= there != free
    met = misses(chain, pose, there) < _MET
    q = q.copy()
    q[near[met]] = there[met]
    return q, _turned(chain, pose, q)


def _turned(chain: Chain, pose: FloatArray, q: FloatArray) -> FloatArray:
    return rotation_angle(chain.forward(q)[:, :3, :3].swapaxes(1, 2) @ pose[:3, :3])


def polished(
    chain: Chain,
    poses: FloatArray,
    q: FloatArray,
    reach: float,
    steps: int,
    held: NDArray[np.bool_] | None = None,
) -> FloatArray:
    """Configurations (k, n) [rad] after Newton steps, each as long as it gets nearer to its pose.

    ``poses`` (k, 4, 4), or one (4, 4) for all; lengths are taken over the ``reach`` [m]. Joints that are
    ``held`` (k, n) stay.
    """
    R, t = np.swapaxes(poses[..., :3, :3], -1, -2), poses[..., :3, 3]

    def rows(q: FloatArray) -> tuple[FloatArray, FloatArray]:
        motion = tool_motion(chain, q)
        off = np.concatenate([(motion.position - t) / reach, rotation_vectors(motion.rotation @ R)], axis=1)
        J = np.concatenate([motion.linear / reach, motion.axes], axis=1)
        return off, J if held is None else np.where(held[:, None], 0.0, J)

    return newton_many(rows, q, steps)

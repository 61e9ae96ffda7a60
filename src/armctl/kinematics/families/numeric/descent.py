"""Damped Newton descent inside a box, many starts at once, and what it is used for.

The box is an active set: a joint at a limit that is pushed against it is held; a joint that a step would
carry over its limit goes onto it, and the others are solved for again with that move known.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import skew_part
from armctl.kinematics.chain import Chain
from armctl.kinematics.samples import even_spread
from armctl.kinematics.target import straight_up
from armctl.lazy_dataclass import dataclass

# What a numeric search drives to zero: residuals of the tool pose with their derivatives, in batches.

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
"""of each of x, y, z, the two others"""
Rows = tuple[FloatArray, FloatArray]
"""residuals (k, m) and their derivatives by the joint angles (k, m, n)"""
Cost = tuple[FloatArray, FloatArray, FloatArray]
"""cost (k,), gradient (k, n) and second derivatives (k, n, n)"""


@dataclass(frozen=True, slots=True)
class ToolMotion:
    """Where the tool is and how each joint moves it, for k configurations, in the base frame."""

    q: FloatArray
    """(k, n) the configurations [rad]"""
    rotation: FloatArray
    """(k, 3, 3) ``R_base_tool``"""
    position: FloatArray
    """(k, 3) [m]"""
    linear: FloatArray
    """(k, 3, n) velocity of the tool point for one rad/s of each joint [m/rad]"""
    axes: FloatArray
    """(k, 3, n) joint axes, unit vectors: the angular velocity for one rad/s of each joint"""

    @property
    def approach(self) -> FloatArray:
        """(k, 3) the tool's z axis."""
        return self.rotation[:, :, 2]


def tool_motion(chain: Chain, q: FloatArray) -> ToolMotion:
    """Tool pose and Jacobian columns of configurations ``q`` (k, n) [rad] in one pass."""
    *links, (x, y, z, tool) = chain.walk(q)
    axes = _first_last([axis for _, _, axis, _ in links])
    arms = _first_last([tool - origin for *_, origin in links])
    return ToolMotion(q, _first_last([x, y, z]), tool.T, crossed(axes, arms), axes)


def _first_last(columns: list[FloatArray]) -> FloatArray:
    """Columns (3, k) as (k, 3, columns)."""
    return np.ascontiguousarray(np.moveaxis(np.stack(columns, axis=1), -1, 0))


def crossed(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of (k, 3, n) or (k, 3, 1) columns; ``numpy.cross`` takes ten times as long for few."""
    return a.take(_NEXT, 1) * b.take(_LAST, 1) - a.take(_LAST, 1) * b.take(_NEXT, 1)


def second_derivatives(motion: ToolMotion, weights: FloatArray, columns: FloatArray) -> FloatArray:
    """Second derivatives (k, n, n) of ``weights · v``, weights (k, 3), by the joint angles.

    ``columns`` (k, 3, n) are ∂v/∂q of a vector v on the tool: ∂²v/∂q_i∂q_j = z_i x ∂v/∂q_j for i ≤ j.
    """
    return _mirrored(np.swapaxes(crossed(weights[:, :, None], motion.axes), 1, 2) @ columns)


def _mirrored(matrices: FloatArray) -> FloatArray:
    """Symmetric matrices with the upper triangles of others (k, n, n)."""
    upper = np.triu(matrices)
    return upper + np.swapaxes(np.triu(upper, 1), 1, 2)


class Goal(ABC):
    """One wish about the tool pose: met where its ``rows`` are zero, else ``cost`` is minimised."""

    @abstractmethod
    def rows(self, motion: ToolMotion) -> Rows:
        """Residuals, zero where the goal is met."""

    def curvature(self, motion: ToolMotion, weights: FloatArray) -> FloatArray:
        """Second derivatives (k, n, n) of the residuals, summed with ``weights`` (k, m); 0 where left out."""
        n = motion.axes.shape[2]
        return np.zeros((len(weights), n, n))

    def cost(self, motion: ToolMotion) -> Cost:
        """The distance from the goal as a smooth number, least where it is met best: half the square."""
        r, J = self.rows(motion)
        gradient = (r[:, None, :] @ J)[:, 0]
        return 0.5 * (r * r).sum(axis=1), gradient, _square(J) + self.curvature(motion, r)


@dataclass(frozen=True, slots=True)
class PositionGoal(Goal):
    """The tool point at a point, in units of the arm's reach."""

    point: FloatArray
    """(3,) base frame [m]"""
    reach: float
    """[m]; makes a metre comparable to a radian"""

    def rows(self, motion: ToolMotion) -> Rows:
        """Offset of the tool point over the reach: (k, 3)."""
        return (motion.position - self.point) / self.reach, motion.linear / self.reach

    def curvature(self, motion: ToolMotion, weights: FloatArray) -> FloatArray:
        """Of the offset."""
        return second_derivatives(motion, weights, motion.linear / self.reach)


@dataclass(frozen=True, slots=True)
class PitchGoal(Goal):
    """The approach axis at an elevation above the horizontal, short of straight up or down."""

    pitch: float
    """[rad], inside ±90°"""

    def rows(self, motion: ToolMotion) -> Rows:
        """Elevation of the approach axis less the pitch: (k, 1) [rad]."""
        a = motion.approach
        flat = np.maximum(np.hypot(a[:, 0], a[:, 1]), 1e-12)
        elevation = np.arctan2(a[:, 2], flat)
        slope = crossed(motion.axes, a[:, :, None])[:, 2:3] / flat[:, None, None]
        return (elevation - self.pitch)[:, None], slope

    def curvature(self, motion: ToolMotion, weights: FloatArray) -> FloatArray:
        """Of the elevation: with s its sine, s''/cos + s s' s'ᵀ/cos³."""
        a = motion.approach
        flat = np.maximum(np.hypot(a[:, 0], a[:, 1]), 1e-6)[:, None, None]
        turned = crossed(motion.axes, a[:, :, None])
        slope = turned[:, 2:3]
        up = np.zeros(a.shape)
        up[:, 2] = weights[:, 0]
        bend = (weights * a[:, 2:3])[:, :, None] * np.swapaxes(slope, 1, 2) * slope
        return second_derivatives(motion, up, turned) / flat + bend / flat**3


@dataclass(frozen=True, slots=True)
class UprightGoal(Goal):
    """The approach axis straight up or down."""

    up: float
    """+1 or -1"""

    def rows(self, motion: ToolMotion) -> Rows:
        """Rotation vector that would bring the approach axis there, negative: (k, 3) [rad]."""
        a = motion.approach
        axis = np.stack([a[:, 1], -a[:, 0], np.zeros(len(a))], axis=1) * self.up  # a x up
        sine = np.linalg.norm(axis, axis=1)
        angle = np.arctan2(sine, a[:, 2] * self.up)
        axis[sine == 0.0, 0] = 1.0  # opposite: any horizontal axis will do
        turn = axis * (angle / np.where(sine == 0.0, 1.0, sine))[:, None]
        across = np.eye(3) - a[:, :, None] * a[:, None, :]
        return -turn, across @ motion.axes

    def cost(self, motion: ToolMotion) -> Cost:
        """One less the cosine of the angle to go."""
        a = motion.approach
        turned = crossed(motion.axes, a[:, :, None])
        weights = np.zeros(a.shape)
        weights[:, 2] = -self.up
        gradient = -self.up * turned[:, 2]
        return 1.0 - self.up * a[:, 2], gradient, second_derivatives(motion, weights, turned)


@dataclass(frozen=True, slots=True)
class RotationGoal(Goal):
    """The tool frame turned as asked for."""

    rotation: FloatArray
    """(3, 3) ``R_base_tool``"""

    def rows(self, motion: ToolMotion) -> Rows:
        """Rotation vector from the rotation asked for to the tool's: (k, 3) [rad]."""
        return rotation_vectors(motion.rotation @ self.rotation.T), motion.axes

    def cost(self, motion: ToolMotion) -> Cost:
        """One less the cosine of the angle between the two: (3 - trace R Rᵀ_goal) / 2."""
        off = motion.rotation @ self.rotation.T
        trace = np.trace(off, axis1=1, axis2=2)
        Z = motion.axes
        gradient = np.einsum("kin,ki->kn", Z, skew_part(off))
        curvature = trace[:, None, None] * _square(Z) - np.swapaxes(Z, 1, 2) @ off @ Z
        return (3.0 - trace) / 2, gradient, _mirrored(curvature) / 2


@dataclass(frozen=True, slots=True)
class Turns:
    """The sum of what all joints turn, each turn ``t`` as √(t² + rounding²): smooth where it is 0."""

    begin: FloatArray
    """(n,) from where [rad]"""
    weights: FloatArray
    """(n,) of a radian of each joint"""
    rounding: float
    """[rad]"""

    def cost(self, motion: ToolMotion) -> Cost:
        """The sum, to be minimised."""
        turned = motion.q - self.begin
        size = np.sqrt(turned**2 + self.rounding**2)
        curvature = (self.weights * self.rounding**2 / size**3)[:, :, None] * np.eye(len(self.begin))
        return size @ self.weights, self.weights * turned / size, curvature


@dataclass(frozen=True, slots=True)
class Together(Goal):
    """Two goals at once, to be met: of what the rows say, ``cost`` leaves out the curvature."""

    first: Goal
    second: Goal

    def rows(self, motion: ToolMotion) -> Rows:
        """The rows of both."""
        (r, J), (s, K) = self.first.rows(motion), self.second.rows(motion)
        return np.concatenate([r, s], axis=1), np.concatenate([J, K], axis=1)


@dataclass(frozen=True, slots=True)
class LimitsGoal(Goal):
    """Every joint inside its limits."""

    limits: FloatArray
    """(n, 2) [rad]"""

    def rows(self, motion: ToolMotion) -> Rows:
        """How far each joint is beyond its limits: (k, n) [rad], signed."""
        beyond = motion.q - np.clip(motion.q, *self.limits.T)
        return beyond, (beyond != 0.0)[:, :, None] * np.eye(beyond.shape[1])


def pitch_goal(pitch: float) -> Goal | None:
    """The goal for a pitch [rad] in ±90°, None where no axis can have such an elevation."""
    if (up := straight_up(pitch)) is not None:
        return UprightGoal(up)
    return PitchGoal(pitch) if abs(pitch) < math.pi / 2 else None


def rotation_vectors(rotations: FloatArray) -> FloatArray:
    """Rotation vectors (k, 3) [rad] of rotations (k, 3, 3); angles in 0..pi."""
    sines = skew_part(rotations)
    sine = np.linalg.norm(sines, axis=1)
    angle = np.arctan2(sine, (np.trace(rotations, axis1=1, axis2=2) - 1.0) / 2)
    vectors = sines * np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 1.0)[:, None]
    for k in np.flatnonzero((angle > 3.0) & (sine < 1e-4)):  # half a turn: the axis is in the symmetric part
        square = rotations[k] + rotations[k].T + np.eye(3) * (1.0 - np.trace(rotations[k]))
        axis = square[:, int(np.argmax(np.diag(square)))]
        axis = axis / np.linalg.norm(axis)
        vectors[k] = axis * math.copysign(angle[k], axis @ sines[k])
    return vectors


def _square(J: FloatArray) -> FloatArray:
    return np.swapaxes(J, 1, 2) @ J


IndexArray = NDArray[np.intp]
Objective = Callable[[FloatArray, IndexArray], Cost]
"""(k, n) configurations and which starts they belong to -> their cost with its derivatives"""
_LEAST_DAMPING, _MOST_DAMPING = 1e-12, 1e9
_PATIENCE = 8


class StoppingRule(NamedTuple):
    """When a descent stops."""

    iterations: int
    floor: float = 0.0
    """a cost that counts as zero"""
    progress: float = 0.0
    """least relative decrease in eight iterations; a start with less has come to a minimum"""
    indefinite: bool = False
    """True where the second derivatives are exact, and so may be those of a saddle"""


def descend(objective: Objective, q: FloatArray, box: FloatArray, effort: StoppingRule) -> FloatArray:
    """Where starts ``q`` (k, n) come to on the way down (k, n), never outside a ``box`` ([k,] n, 2)."""
    q, boxes = q.copy(), np.broadcast_to(box, (*q.shape, 2))
    live: IndexArray = np.arange(len(q))
    f, g, H = objective(q, live)
    damping = np.full(len(q), 1e-2)
    before = f.copy()
    for iteration in range(1, effort.iterations + 1):
        live = live[(f[live] > effort.floor) & (damping[live] < _MOST_DAMPING)]
        if effort.progress > 0.0 and iteration % _PATIENCE == 0:
            live = live[f[live] < (1.0 - effort.progress) * before[live]]
            before[live] = f[live]
        if len(live) == 0:
            break
        trial = _step(q[live], g[live], H[live], boxes[live], damping[live], effort.indefinite)
        f_new, g_new, H_new = objective(trial, live)
        better = f_new < f[live]
        won, lost = live[better], live[~better]
        q[won], f[won], g[won], H[won] = trial[better], f_new[better], g_new[better], H_new[better]
        damping[won] = np.maximum(0.15 * damping[won], _LEAST_DAMPING)
        damping[lost] *= 6.0
        still = np.abs(trial[~better] - q[lost]).max(axis=1, initial=0.0) < 1e-15
        damping[lost[still]] = _MOST_DAMPING
    return q


def _step(
    q: FloatArray, g: FloatArray, H: FloatArray, box: FloatArray, damping: FloatArray, indefinite: bool
) -> FloatArray:
    """The minimum of the damped quadratic model inside the box, as (k, n) configurations."""
    low, high = box[..., 0], box[..., 1]
    n = q.shape[1]
    held = ((q <= low) & (g >= 0.0)) | ((q >= high) & (g <= 0.0))
    move = np.zeros(q.shape)
    if indefinite:
        curvature = np.linalg.eigvalsh(np.where(held[:, :, None] | held[:, None, :], 0.0, H))[:, 0]
        damping = damping + np.maximum(0.0, -1.5 * curvature)
    largest = np.maximum(1.0, np.abs(np.diagonal(H, axis1=1, axis2=2)).max(axis=1))
    damped = H + (damping * largest)[:, None, None] * np.eye(n)  # never singular: joints may share an axis
    for _ in range(n + 1):
        free = ~held
        matrix = np.where(free[:, :, None] & free[:, None, :], damped, 0.0)
        matrix += held[:, :, None] * np.eye(n)
        known = (H @ np.where(held, move, 0.0)[:, :, None])[:, :, 0]
        right = np.where(free, -g - known, move)
        move = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
        over = free & ((q + move < low) | (q + move > high))
        if not over.any():
            break
        held = held | over
        move = np.where(over, np.clip(q + move, low, high) - q, move)
    return np.clip(q + move, low, high)


_COUNT = 2048


class Starts:
    """An even spread of configurations of one arm, always the same, with their tool poses. Immutable."""

    def __init__(self, chain: Chain, limits: FloatArray) -> None:
        low, high = limits.T
        self._q = low + even_spread(_COUNT, np.full(chain.n, 0.5)) * (high - low)
        self._motion = tool_motion(chain, self._q)
        upper = even_spread(_COUNT, np.full(chain.n, 0.5)) > 0.5
        self._part = upper @ 2 ** np.arange(chain.n)
        """which joints are in the upper half of their range, as bits"""

    def nearest_of_parts(self, goal: Goal, box: FloatArray) -> FloatArray:
        """(k, n) as ``nearest_first``, one for every choice of a half of each joint's range.

        Beside the base axis the nearest of all may lie on one side of it, and the minimum on the other.
        """
        rows = goal.rows(self._motion)[0]
        order = np.argsort((rows * rows).sum(axis=1), kind="stable")
        return np.clip(self._q[order[np.unique(self._part[order], return_index=True)[1]]], *box.T)

    def nearest_first(self, goal: Goal, count: int, box: FloatArray) -> FloatArray:
        """(count, n) of them [rad] with the tool nearest to a goal, best first, put into a box (n, 2)."""
        rows = goal.rows(self._motion)[0]
        return np.clip(self._q[np.argsort((rows * rows).sum(axis=1), kind="stable")[:count]], *box.T)


# Meeting goals inside joint limits: all of them from many starts, or one strictly before another.
# ``q`` are (k, n) starts inside the ``box`` (n, 2); what comes back (k, n) is inside it too [rad].

_SEARCH = StoppingRule(iterations=80, floor=0.5e-26, progress=0.02)
_POLISH = StoppingRule(iterations=60, floor=0.5e-28)
_NEAREST = StoppingRule(iterations=150, indefinite=True)
_INNER = StoppingRule(iterations=40, indefinite=True)
_STIFFNESS = 1e3
_OUTER = 8
_ROUGH, _ROUGH_OUTER = StoppingRule(iterations=8, indefinite=True), 3


def meet(chain: Chain, goal: Goal, q: FloatArray, box: FloatArray, polish: bool = False) -> FloatArray:
    """Drive a goal's residuals as low as they come; ``polish``: to the last digit, however slowly."""

    def objective(q: FloatArray, _: IndexArray) -> Cost:
        r, J = goal.rows(tool_motion(chain, q))
        transposed = np.swapaxes(J, 1, 2)
        return 0.5 * (r * r).sum(axis=1), (transposed @ r[:, :, None])[:, :, 0], transposed @ J

    return descend(objective, q, box, _POLISH if polish else _SEARCH)


def come_nearest(chain: Chain, goal: Goal, q: FloatArray, box: FloatArray) -> FloatArray:
    """The local minima of a goal's cost."""
    return descend(lambda q, _: goal.cost(tool_motion(chain, q)), q, box, _NEAREST)


def come_nearest_holding(
    chain: Chain, order: Goal, wish: Goal | Turns, q: FloatArray, box: FloatArray, *, roughly: bool = False
) -> FloatArray:
    """The local minima of the cost of ``wish`` where ``order`` is met exactly, as the starts should already.

    The method of multipliers: each descent minimises the wish plus a stiff spring on the order, and the
    spring's rest length then takes up what was left of it. ``roughly``: the order is met all the same, the
    wish only nearly.
    """
    slack = np.zeros_like(order.rows(tool_motion(chain, q))[0])

    def objective(q: FloatArray, which: IndexArray) -> Cost:
        motion = tool_motion(chain, q)
        f, g, H = wish.cost(motion)
        r, J = order.rows(motion)
        pull = _STIFFNESS * (r + slack[which])
        transposed = np.swapaxes(J, 1, 2)
        f = f + 0.5 * (pull * (r + slack[which])).sum(axis=1)
        g = g + (transposed @ pull[:, :, None])[:, :, 0]
        return f, g, H + _STIFFNESS * (transposed @ J) + order.curvature(motion, pull)

    effort, rounds = (_ROUGH, _ROUGH_OUTER) if roughly else (_INNER, _OUTER)
    for _ in range(rounds):
        q = descend(objective, q, box, effort)
        left = order.rows(tool_motion(chain, q))[0]
        slack += left
        if np.abs(left).max() < 1e-11:
            break
    return meet(chain, order, q, box, polish=True)

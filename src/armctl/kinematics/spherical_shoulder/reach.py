"""Why a spherical shoulder and elbow cannot reach a target, with numbers."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, central_image
from armctl.kinematics.solutions import all_needs, millimetres, needs
from armctl.kinematics.spherical_shoulder.geometry import SphericalShoulder
from armctl.kinematics.spherical_shoulder.orientation import ToolPosture
from armctl.kinematics.spherical_shoulder.swivel import Swivel

_ROUNDS = 3
_VALUES = (1441, 401)
"""values of θ1 in the first round, a quarter of a degree apart, and in the finer ones about the best"""


class SphericalReach:
    """Explains refusals of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: SphericalShoulder, limits: FloatArray, titles: Sequence[str]) -> None:
        self._geometry, self._limits, self._titles = geometry, limits, titles

    def of_position(self, distance: float, postures: list[tuple[float, Swivel]]) -> str:
        """Why a position has no solution.

        Args:
            distance: of the target from the shoulder [m].
            postures: elbow angles inside their limits that have this distance, each with its swivel.
        """
        nearest, farthest = self._geometry.reach
        where = f"the target would be {1000 * distance:.1f} mm from the shoulder"
        bends = self._geometry.bends(distance)
        if not bends and distance > farthest:
            return (
                f"too far by {millimetres(distance - farthest)} mm: {where}, "
                f"the arm reaches {1000 * farthest:.1f} mm"
            )
        if not bends:
            return (
                f"inside the dead zone, too near by {millimetres(nearest - distance)} mm: {where}, "
                f"the arm folds no closer than {1000 * nearest:.1f} mm"
            )
        if postures:
            said = all_needs(self._titles, self._limits, self._least_excess(postures))
            said = said or "a shoulder joint would have to leave them by less than 0.01°"
        else:
            limits = self._limits[3].tolist()
            angles = (central_image(bend - self._geometry.offset, *limits) for bend in bends)
            said = needs(self._titles[3], self._limits[3], *angles)
        return f"within the links' reach, but joint limits forbid it: {said}"

    def of_pitch(self, ends: list[tuple[float, ToolPosture]], roll: float | None) -> str:
        """Why a pitch has no solution at a position that has some.

        Args:
            ends: pitches [rad] at the ends of what the arm can hold, each with its posture.
            roll: angle of the roll joint [rad], where it makes a difference to the pitch.
        """
        pitches = [math.degrees(pitch) for pitch, _ in ends]
        nearest = math.degrees(min(ends, key=lambda end: end[1].miss)[0])
        said = f"{min(pitches) + 0.0:.2f}° … {max(pitches) + 0.0:.2f}°"
        held = "" if roll is None else f" with {self._titles[4]} at {math.degrees(roll) + 0.0:.2f}°"
        return (
            f"that pitch is impossible here: at this point the arm holds its tool at {said}{held}, "
            f"the nearest to it is {nearest + 0.0:.2f}°"
        )

    def _least_excess(self, postures: list[tuple[float, Swivel]]) -> list[tuple[int, float]]:
        """Joints outside their limits, and what they need [rad], where the sum of it is least."""
        low, high = self._limits[:3, :1], self._limits[:3, 1:]
        middle = 0.5 * (low + high)
        best, least = np.zeros(3), math.inf
        for _, swivel in postures:
            centre, reach = float(middle[0, 0]), math.pi
            for k in range(_ROUNDS):
                count = _VALUES[min(k, 1)]
                first = np.linspace(centre - reach, centre + reach, count)
                for q in swivel.sheets(first):
                    if not q.size:
                        continue
                    near = q - TWO_PI * np.rint((q - middle) / TWO_PI)
                    excess = np.maximum(0.0, np.maximum(low - near, near - high)).sum(axis=0)
                    i = int(np.argmin(excess))
                    if excess[i] < least:
                        best, least, centre = near[:, i], float(excess[i]), float(q[0, i])
                reach *= 2.0 / (count - 1)
        return [
            (joint, float(best[joint]))
            for joint in range(3)
            if not low[joint, 0] - LIMIT_TOLERANCE <= best[joint] <= high[joint, 0] + LIMIT_TOLERANCE
        ]


# The nearest point that the tool can reach with a spherical shoulder and an elbow.
#
# With the other joints still, the squared distance over one joint is ``A + B cos θ + C sin θ``, so the best
# angle inside its limits has a closed form. Turning the joints to it one after the other never goes uphill;
# from a grid of starts over the whole range of every joint that finds the valley, and a Newton descent within
# the limits its bottom, where each joint is at a limit or at rest.

_GRID = 5
"""starting values a joint"""
_SEARCH_ROUNDS = (6, 24)
"""rounds over all joints: of every start, then of the best"""
_KEPT = 40
_POLISHED = 6
_DESCENT_STEPS = 60
_STANDING = 1e-13
"""a Newton step as short as this is the bottom [rad]"""
_DISTINCT = 1e-3
"""distances that differ by less lead to the same valley, mostly [of the distance]"""


class SphericalNearest:
    """Nearest reachable points of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: SphericalShoulder, limits: FloatArray) -> None:
        self._limits = limits[:4]
        self._axes = np.array([*geometry.axes, geometry.elbow_axis])
        self._upper, self._fore = np.array(geometry.upper), np.array(geometry.fore)
        self._centre = np.array(geometry.centre)
        self._starts = _grid(self._limits)
        self._starts.flags.writeable = False

    def solve(self, position: FloatArray) -> FloatArray:
        """The configuration (4,) inside the limits whose tip comes nearest to a position (3,) [rad]."""
        target = position - self._centre
        q = self._starts.copy()
        for rounds, kept in zip(_SEARCH_ROUNDS, (_KEPT, _POLISHED), strict=True):
            for _ in range(rounds):
                self._round(q, target)
            distance = np.linalg.norm(self._tips(q) - target, axis=1)
            q = q[_spread(distance, kept)]
        return min((self.descend(one, position) for one in q), key=lambda one: self.miss(one, position))

    def miss(self, q: FloatArray, position: FloatArray) -> float:
        """Distance of the tip of one configuration (4,) from a position (3,) [m]."""
        return float(np.linalg.norm(self._tips(q[None])[0] + self._centre - position))

    def _round(self, q: FloatArray, target: FloatArray) -> None:
        """Turn each joint in turn to its best angle, elbow first."""
        rest = np.broadcast_to(target, (len(q), 3))
        seen = [rest]  # the target as each joint's own frame sees it
        for k in range(3):
            seen.append(_turned(seen[-1], self._axes[k], -q[:, k]))
        self._best(q, 3, np.broadcast_to(self._fore, seen[3].shape), seen[3] - self._upper)
        hand = self._upper + _turned(np.broadcast_to(self._fore, seen[3].shape), self._axes[3], q[:, 3])
        for k in (2, 1, 0):
            self._best(q, k, hand, seen[k])
            hand = _turned(hand, self._axes[k], q[:, k])

    def _best(self, q: FloatArray, joint: int, turning: FloatArray, fixed: FloatArray) -> None:
        """The angle of one joint inside its limits that turns a vector nearest to another."""
        axis = self._axes[joint]
        cosine = np.einsum("mi,mi->m", turning, fixed) - (turning @ axis) * (fixed @ axis)
        x, y, z = axis.tolist()
        across = turning @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        sine = np.einsum("mi,mi->m", fixed, across)
        low, high = self._limits[joint]
        middle = 0.5 * (low + high)
        best = np.arctan2(sine, cosine)
        moves = np.hypot(sine, cosine) > 1e-12  # else every angle is as good
        best -= TWO_PI * np.rint((best - middle) / TWO_PI)
        q[:, joint] = np.where(moves, np.clip(best, low, high), q[:, joint])

    def _tips(self, q: FloatArray) -> FloatArray:
        """(m, 3) tips of configurations (m, 4), from the shoulder [m]."""
        tip = self._upper + _turned(np.broadcast_to(self._fore, (len(q), 3)), self._axes[3], q[:, 3])
        for k in (2, 1, 0):
            tip = _turned(tip, self._axes[k], q[:, k])
        return tip

    def descend(self, q: FloatArray, position: FloatArray) -> FloatArray:
        """From one configuration (4,) down to the nearest one about it, by Newton's method within the limits.

        Damped where the distance is not convex.
        """
        target, damping = position - self._centre, 1e-12
        miss, gradient, hessian = self._model(q, target)
        value = float(miss @ miss)
        for _ in range(_DESCENT_STEPS):
            held = ((q <= self._limits[:, 0]) & (gradient > 0)) | ((q >= self._limits[:, 1]) & (gradient < 0))
            free = np.flatnonzero(~held)
            if len(free) == 0 or np.abs(gradient[free]).max() < 1e-16:
                break
            # a direction along which nothing changes, or which curves down, is left by the size of its curve
            sizes, directions = np.linalg.eigh(hessian[np.ix_(free, free)])
            slope = directions.T @ gradient[free]
            step = -directions @ (slope / (np.abs(sizes) + damping))
            if np.abs(step).max() < _STANDING:
                break
            trial = q.copy()
            trial[free] += np.clip(step, -0.5, 0.5)
            trial = np.clip(trial, self._limits[:, 0], self._limits[:, 1])
            next_miss, next_gradient, next_hessian = self._model(trial, target)
            next_value = float(next_miss @ next_miss)
            if next_value < value:
                q, value, gradient, hessian = trial, next_value, next_gradient, next_hessian
                damping = max(1e-12, 0.1 * damping)
            elif damping > 1e3:
                break
            else:
                damping = max(1e-6, 10.0 * damping)
        return q

    def _model(self, q: FloatArray, target: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """What the tip misses the target by, and gradient and Hessian of half its square."""
        fore = _turned(self._fore[None], self._axes[3], q[3:])
        frame = np.concatenate([self._axes[3:], fore, self._upper + fore])  # axes, then levers to the tip
        for k in (2, 1, 0):
            frame = _turned(np.concatenate([self._axes[k : k + 1], frame]), self._axes[k], q[k : k + 1])
        axes, levers = frame[:4], frame[[5, 5, 5, 4]]
        J = np.asarray(np.cross(axes, levers), dtype=np.float64)
        miss = levers[0] - target
        # second derivatives, for a joint and one beyond it
        bends = axes @ np.asarray(np.cross(J, miss), dtype=np.float64).T
        return miss, J @ miss, J @ J.T + np.triu(bends) + np.triu(bends, 1).T


def _grid(limits: FloatArray) -> FloatArray:
    """(m, 4) configurations all over the limits (4, 2)."""
    pairs: list[tuple[float, float]] = [(low, high) for low, high in limits.tolist()]
    values = [np.linspace(low, high, _GRID if high > low else 1).tolist() for low, high in pairs]
    return np.array(list(itertools.product(*values)), dtype=np.float64)


def _turned(v: FloatArray, axis: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors (m, 3), each turned about one unit axis by its own angle (m,), or all by one (1,) [rad]."""
    x, y, z = axis.tolist()
    across = v @ np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # axis x v
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return v * c + across * s + (v @ axis)[:, None] * (1.0 - c) * axis


def _spread(distance: FloatArray, count: int) -> NDArray[np.intp]:
    """Indices of the shortest distances, such that are alike left out while there are others."""
    order = np.argsort(distance)
    gaps = np.diff(distance[order], prepend=-math.inf) > _DISTINCT * float(distance.max())
    chosen = np.concatenate([order[gaps], order[~gaps]])
    return chosen[:count]

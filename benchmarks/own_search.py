"""The best configuration on a target, by a search of its own: scipy's SLSQP from many starts.

It shares nothing with armctl's solvers. It multiplies out where the tool is, from the joint axes at the zero
pose.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from armctl.arrays import FloatArray
from armctl.robot import Robot

_MET = 1e-7
"""what a search may leave of a target, lengths in units of 0.1 m"""
_OPTIONS = {"maxiter": 150, "ftol": 1e-11}
Best = tuple[float, FloatArray]
"""a cost, infinite where the target was not met, and the configuration (n,) [rad]"""


class _Zero(NamedTuple):
    """An arm at the zero pose, in the base frame."""

    points: FloatArray
    """(m, 3) on the axes of all links [m]"""
    axes: FloatArray
    """(m, 3) unit vectors"""
    across: FloatArray
    """(m, 3, 3) the cross products by the axes"""
    twice: FloatArray
    """and their squares"""
    turns: FloatArray
    """(m, n) by how much each link turns with each joint"""
    home: FloatArray
    """(4, 4) the tool"""


class _Pose(NamedTuple):
    rotation: FloatArray
    """(3, 3)"""
    tip: FloatArray
    """(3,) [m]"""
    moves: FloatArray
    """(3, n) how each joint moves the tool"""
    turns: FloatArray
    """(3, n) how each joint turns it"""


@dataclass(frozen=True, eq=False)
class Search:
    """One arm and one target: a point (3,) [m], with a pitch [rad], a rotation (3, 3), or neither."""

    robot: Robot
    point: FloatArray
    pitch: float | None = None
    rotation: FloatArray | None = None
    _last: dict[bytes, _Pose] = field(default_factory=dict[bytes, _Pose], init=False, repr=False)

    @cached_property
    def _zero(self) -> _Zero:
        chain = self.robot.chain
        points, axes = chain.axes()
        x, y, z = np.transpose(axes)
        o = np.zeros_like(x)
        across = np.moveaxis(np.array([[o, -z, y], [z, o, -x], [-y, x, o]]), 2, 0)
        turns = np.eye(chain.n) if chain.coupling is None else np.array(chain.coupling)
        home = chain.forward(np.zeros(chain.n))
        return _Zero(np.array(points), np.array(axes), across, across @ across, turns, home)

    def pose(self, q: FloatArray) -> _Pose:
        """At ``q`` (n,) [rad]; the last one is kept, for which several are asked."""
        key = q.tobytes()
        if (last := self._last.get(key)) is None:
            last = self._pose(q)
            self._last.clear()
            self._last[key] = last
        return last

    def _pose(self, q: FloatArray) -> _Pose:
        zero = self._zero
        angles = (zero.turns @ q)[:, None, None]
        turned = np.eye(3) + np.sin(angles) * zero.across + (1.0 - np.cos(angles)) * zero.twice
        moved = zero.points - (turned @ zero.points[:, :, None])[:, :, 0]
        R, t = np.eye(3), np.zeros(3)
        places, directions = np.empty_like(moved), np.empty_like(moved)
        for i in range(len(moved)):
            directions[i], places[i] = R @ zero.axes[i], R @ zero.points[i] + t
            t, R = R @ moved[i] + t, R @ turned[i]
        tip = R @ zero.home[:3, 3] + t
        (a, b, c), (x, y, z) = directions.T, (tip - places).T
        J = np.array([b * z - c * y, c * x - a * z, a * y - b * x])
        return _Pose(R @ zero.home[:3, :3], tip, J @ zero.turns, directions.T @ zero.turns)

    def rows(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By how much ``q`` (n,) misses the target, and the derivatives."""
        R, tip, J, Z = self.pose(q)
        r, D = 10.0 * (tip - self.point), 10.0 * J
        if self.pitch is not None:
            r = np.append(r, R[2, 2] - math.sin(self.pitch))
            D = np.vstack([D, np.cross(Z.T, R[:, 2])[:, 2]])
        if self.rotation is not None:
            r, D = np.append(r, _skew(R @ self.rotation.T)), np.vstack([D, Z])
        return r, D

    def time(self, q: FloatArray, start: FloatArray) -> float:
        """[s] that the slowest joint takes by a cubic from rest to rest."""
        way = np.abs(q - start)
        by_speed, by_acceleration = way / self.robot.speed_limits, way / self.robot.acceleration_limits
        return float(np.maximum(1.5 * by_speed, np.sqrt(6.0 * by_acceleration)).max())

    def travel(self, q: FloatArray, start: FloatArray) -> float:
        """Σ |change| / speed [s]."""
        return float((np.abs(q - start) / self.robot.speed_limits).sum())

    def shortest_time(self, start: FloatArray, begin: FloatArray) -> Best:
        """From one configuration on."""
        n, one = len(start), np.eye(len(start))
        speed, acceleration = self.robot.speed_limits / 1.5, self.robot.acceleration_limits / 6.0

        def room(x: FloatArray) -> FloatArray:
            way, T = x[:n] - start, x[n]
            most = speed * T, acceleration * T * T
            return np.concatenate([m - sign * way for m in most for sign in (1.0, -1.0)])

        def slopes(x: FloatArray) -> FloatArray:
            most = speed, 2.0 * acceleration * x[n]
            return np.vstack([np.column_stack([-sign * one, m]) for m in most for sign in (1.0, -1.0)])

        first = np.append(begin, self.time(begin, start) + 1e-3)
        q = self._from(
            first, lambda x: float(x[n]), lambda _: np.append(np.zeros(n), 1.0), np.eye(n, n + 1),
            np.zeros(n), [*self.robot.limits.tolist(), (0.0, None)],
            [{"type": "ineq", "fun": room, "jac": slopes}],
        )  # fmt: skip
        return self._best(q, lambda q: self.time(q, start))

    def least_travel(self, start: FloatArray, begin: FloatArray) -> Best:
        """From one configuration on."""
        n, one = len(start), np.eye(len(start))
        weights = 1.0 / self.robot.speed_limits
        slope = np.append(np.zeros(n), weights)
        bounds = [*self.robot.limits.tolist(), *[(0.0, None)] * n]
        sides = np.block([[-one, one], [one, one]])
        room = {
            "type": "ineq",
            "fun": lambda x: sides @ x + np.append(start, -start),
            "jac": lambda _: sides,
        }
        first = np.append(begin, np.abs(begin - start) + 1e-3)
        q = self._from(
            first, lambda x: float(slope @ x), lambda _: slope, np.eye(n, 2 * n), np.zeros(n), bounds, [room]
        )
        return self._best(q, lambda q: self.travel(q, start))

    def nearest_rotation(self, rotation: FloatArray, begin: FloatArray) -> Best:
        """The least angle [rad] from a rotation (3, 3) on the point, from one configuration on."""

        def cost(q: FloatArray) -> float:
            return (3.0 - float(np.trace(self.pose(q)[0] @ rotation.T))) / 2.0

        def slope(q: FloatArray) -> FloatArray:
            R, _, _, Z = self.pose(q)
            return _skew(R @ rotation.T) @ Z

        n = self.robot.n
        q = self._from(begin, cost, slope, np.eye(n), np.zeros(n), self.robot.limits.tolist(), [])
        return self._best(q, lambda q: turned(self.pose(q)[0] @ rotation.T))

    def _from(
        self,
        first: FloatArray,
        cost: Callable[[FloatArray], float],
        slope: Callable[[FloatArray], FloatArray],
        turns: FloatArray,
        zero: FloatArray,
        bounds: list[Any],
        others: list[dict[str, Any]],
    ) -> FloatArray:
        """(n,) where a search from unknowns x ends, the configuration being ``zero + turns x``."""
        met = {
            "type": "eq",
            "fun": lambda x: self.rows(zero + turns @ x)[0],
            "jac": lambda x: self.rows(zero + turns @ x)[1] @ turns,
        }
        found: Any = minimize(
            cost,
            first,
            jac=slope,
            method="SLSQP",
            bounds=bounds,
            constraints=[met, *others],
            options=_OPTIONS,
        )
        return np.clip(turns @ found.x + zero, *self.robot.limits.T)

    def _best(self, q: FloatArray, cost: Callable[[FloatArray], float]) -> Best:
        there = np.abs(self.rows(q)[0]).max() < _MET and self.robot.chain.keeps_turns(q)
        if there and self.rotation is not None:  # what ``rows`` has of a turn is 0 at half a turn, too
            there = turned(self.pose(q)[0] @ self.rotation.T) < 1.0
        return (cost(q), q) if there else (math.inf, q)


def turned(rotation: FloatArray) -> float:
    """The angle of a rotation (3, 3) [rad]."""
    return math.atan2(float(np.linalg.norm(_skew(rotation))), (float(np.trace(rotation)) - 1.0) / 2.0)


def least(one: Callable[[FloatArray], Best], starts: Iterable[FloatArray]) -> Best:
    """The best that a search finds from some starts."""
    return min((one(start) for start in starts), key=lambda best: best[0])


def _skew(m: FloatArray) -> FloatArray:
    return 0.5 * np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])

"""The best of a continuum of solutions: the best of some of them, continued downhill.

By sequential quadratic programming (SLSQP of scipy; D. Kraft, 1988). Least travel and shortest time become
smooth with more unknowns. Travel: each joint turns by ``p - m``, neither negative, and Σ (p + m) / speed is
least. Time: a time T is least in which every joint can make its way, |q - start| ≤ way(T).
The only module of this package that asks scipy.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import skew_part
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import CUBIC_PEAKS, EnergyModel, rest_to_rest_times
from armctl.kinematics.newton import Rows, newton, target_rows
from armctl.kinematics.target import Target

_BEGUN = (4, 0.2), (12, 1.0)
"""how many of the best are continued, and how far they are from each other [rad]: a few of the very best, and
then some of other kinds"""
_ROUNDS, _PRECISION = 60, 1e-11
"""of a search, and what its last round still gained"""
_POLISH = 6
"""Newton steps at most"""
_MOVED = 1e-6
"""a joint that turned by less stands where it was [rad]"""
_MET = 1e-10
"""what Newton steps leave of a target that is met, in [m] and [rad]"""
_SINGULAR = 1e-9
_ROUNDING = 1e-14


class _Problem(NamedTuple):
    """Unknowns x, of which ``zero + turns x`` is the configuration."""

    begin: Callable[[FloatArray], FloatArray]
    """x of a configuration (n,)"""
    cost: Callable[[FloatArray], tuple[float, FloatArray]]
    """and its slope"""
    bounds: FloatArray
    """(k, 2) of x"""
    zero: FloatArray
    """(n,)"""
    turns: FloatArray
    """(n, k)"""
    others: tuple[dict[str, Any], ...] = ()
    """what must not be negative"""


@dataclass(frozen=True, eq=False)
class OnTarget:
    """The configurations of an arm inside its limits that meet a target. Immutable."""

    chain: Chain
    limits: FloatArray
    """(n, 2) [rad]; of joints that are held, what they are held at"""
    target: Target
    up: FloatArray
    """(3,) what a pitch is measured against"""

    @cached_property
    def rows(self) -> Rows:
        """By how much a configuration (n,) misses the target (m,), and the derivatives (m, n)."""
        return target_rows(self.chain, self.target, self.up)

    @property
    def spare(self) -> int:
        """How many more joints turn than the target takes."""
        asked = 3 if self.target.pitch is None else 4 if self.target.up is None else 5
        asked = asked if self.target.rotation is None else 6
        return int(np.count_nonzero(self.limits[:, 0] < self.limits[:, 1])) - asked

    def least_travel(self, q: FloatArray, start: FloatArray, weights: FloatArray) -> FloatArray:
        """Configurations (m, n) [rad] of less Σ weight |q - start|, continued from the best of (k, n)."""
        low, high = self.limits.T - start
        least, most = np.append(low, -high), np.append(high, -low)
        bounds = np.maximum(np.stack([least, most], axis=1), 0.0)
        both = np.hstack([np.eye(len(start)), -np.eye(len(start))])

        def begin(q: FloatArray) -> FloatArray:
            return np.append(np.maximum(q - start, 0.0), np.maximum(start - q, 0.0))

        problem = _Problem(begin, _linear(np.append(weights, weights)), bounds, start, both)
        return self._continued(self._seeds(q, np.abs(q - start) @ weights, start), start, problem)

    def shortest_time(self, q: FloatArray, start: FloatArray, model: EnergyModel) -> FloatArray:
        """Configurations (m, n) [rad] of a shorter motion from a start, continued from the best of (k, n)."""
        n = len(start)
        speed, acceleration = model.speed_limits / CUBIC_PEAKS[0], model.acceleration_limits / CUBIC_PEAKS[1]

        def times(q: FloatArray) -> FloatArray:
            limits = model.speed_limits, model.acceleration_limits
            return rest_to_rest_times(np.abs(q - start), CUBIC_PEAKS, *limits).max(axis=-1)

        least = times(q).min()

        def begin(q: FloatArray) -> FloatArray:
            return np.append(q, max(times(q), least))  # no time would leave a joint no way, however it turned

        def room(x: FloatArray) -> FloatArray:
            way, time = x[:n] - start, x[n]
            ways = speed * time, acceleration * time * time
            return np.concatenate([most + sense * way for most in ways for sense in (-1.0, 1.0)])

        def slopes(x: FloatArray) -> FloatArray:
            one = np.eye(n)
            ways = speed, 2.0 * acceleration * x[n]
            return np.vstack([np.column_stack([sense * one, most]) for most in ways for sense in (-1.0, 1.0)])

        problem = _Problem(
            begin,
            _linear(np.append(np.zeros(n), 1.0)),
            np.vstack([self.limits, [0.0, math.inf]]),
            np.zeros(n),
            np.eye(n, n + 1),
            ({"type": "ineq", "fun": room, "jac": slopes},),
        )
        return self._continued(self._seeds(q, times(q), start), start, problem)

    def nearest_rotation(self, q: FloatArray, rotation: FloatArray) -> FloatArray:
        """Configurations (m, n) [rad] that turn the tool as nearly as can be to a rotation (3, 3).

        Each continued from one of (k, n).
        """

        def cost(x: FloatArray) -> tuple[float, FloatArray]:
            """One less the cosine of the angle."""
            off = self.chain.forward(x)[:3, :3] @ rotation.T
            return (3.0 - float(np.trace(off))) / 2.0, skew_part(off) @ self.chain.jacobian(x)[3:]

        n = self.chain.n
        problem = _Problem(np.copy, cost, self.limits, np.zeros(n), np.eye(n))
        return self._continued(list(q), None, problem)

    def _continued(
        self, seeds: Sequence[FloatArray], start: FloatArray | None, problem: _Problem
    ) -> FloatArray:
        """(m, n) where the least cost of a problem is found on the target, from some configurations (n,)."""
        minimize = import_module("scipy.optimize").minimize  # takes long to import, and few need it
        warnings.filterwarnings("ignore", "Values in x were outside bounds")  # by rounding, and clipped
        zero, turns = problem.zero, problem.turns

        def missed(x: FloatArray) -> FloatArray:
            return self.rows(zero + turns @ x)[0]

        def slopes(x: FloatArray) -> FloatArray:
            return self.rows(zero + turns @ x)[1] @ turns

        met = {"type": "eq", "fun": missed, "jac": slopes}
        found: list[FloatArray] = []
        for one in seeds:
            answer = minimize(
                problem.cost, np.clip(problem.begin(one), *problem.bounds.T), jac=True, method="SLSQP",
                bounds=problem.bounds.tolist(), constraints=(met, *problem.others),
                options={"maxiter": _ROUNDS, "ftol": _PRECISION},
            )  # fmt: skip
            x = np.asarray(answer.x, dtype=np.float64)
            there = self._polished(zero + turns @ x, start) if np.isfinite(x).all() else None
            if there is not None:
                found.append(there)
        return np.reshape(found, (-1, self.chain.n))

    def _seeds(self, q: FloatArray, cost: FloatArray, start: FloatArray) -> list[FloatArray]:
        """The best of some configurations (k, n), not near to each other; and the start itself."""
        seeds: list[FloatArray] = []
        order = np.argsort(cost, kind="stable")
        for count, apart in _BEGUN:
            rest = order
            for one in seeds:
                rest = rest[np.abs(q[rest] - one).max(axis=1) > apart]
            while len(rest) and len(seeds) < count:
                seeds.append(q[rest[0]])
                rest = rest[np.abs(q[rest] - seeds[-1]).max(axis=1) > apart]
        return [*seeds, np.clip(start, *self.limits.T)]

    def _polished(self, q: FloatArray, start: FloatArray | None) -> FloatArray | None:
        """Brought onto the target, if it is near: joints at a limit or at the start stay if they can."""
        low, high = self.limits.T
        q = np.clip(q, low, high)
        inside = (q > low + _MOVED) & (q < high - _MOVED)
        begin = np.full(len(q), math.inf) if start is None else np.clip(start, low, high)
        away = np.abs(q - begin) > _MOVED
        for free in (inside & away, inside | (low < high)):

            def rows(q: FloatArray, free: NDArray[np.bool_] = free) -> tuple[FloatArray, FloatArray]:
                off, slopes = self.rows(q)
                return off, slopes * free

            there, missed = newton(
                rows, np.where(away, q, begin), _POLISH, rank=_SINGULAR, gain=math.inf, still=_ROUNDING,
                limits=self.limits,
            )  # fmt: skip
            if missed < _MET:
                return there
        return None


def _linear(slope: FloatArray) -> Callable[[FloatArray], tuple[float, FloatArray]]:
    """The cost ``slope`` x."""

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        return float(slope @ x), slope

    return cost

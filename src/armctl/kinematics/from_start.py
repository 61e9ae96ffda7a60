"""Least travel and shortest time over a continuum: the best of some solutions, continued downhill.

Both are smooth problems once they are written with more unknowns (sequential quadratic programming, SLSQP of
scipy, D. Kraft, 1988). Travel: each joint turns by ``p - m``, neither negative, and Σ (p + m) / speed is
least. Time: a time T is least in which every joint can make its way, |q - start| ≤ way(T).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import CUBIC_PEAKS, EnergyModel, rest_to_rest_times
from armctl.kinematics.target import Target

_BEGUN = 4
"""how many of the best are continued"""
_APART = 0.2
"""those nearer to each other lead to the same [rad]"""
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


@dataclass(frozen=True, eq=False)
class Continuum:
    """The configurations of an arm inside its limits that meet a target. Immutable."""

    chain: Chain
    limits: FloatArray
    """(n, 2) [rad]; of joints that are held, what they are held at"""
    target: Target
    up: FloatArray
    """(3,) what a pitch is measured against"""

    @property
    def spare(self) -> int:
        """How many more joints turn than the target takes."""
        asked = 3 if self.target.pitch is None else 4 if self.target.up is None else 5
        asked = asked if self.target.rotation is None else 6
        return int(np.count_nonzero(self.limits[:, 0] < self.limits[:, 1])) - asked

    def least_travel(self, q: FloatArray, start: FloatArray, weights: FloatArray) -> FloatArray:
        """Configurations (m, n) [rad] of less Σ weight |q - start| (n,), continued from the best of (k, n)."""
        low, high = self.limits.T - start
        bounds = np.stack([np.append(np.maximum(low, 0.0), np.maximum(-high, 0.0)),
                           np.append(np.maximum(high, 0.0), np.maximum(-low, 0.0))], axis=1)  # fmt: skip
        both = np.hstack([np.eye(len(start)), -np.eye(len(start))])

        def begin(q: FloatArray) -> FloatArray:
            return np.append(np.maximum(q - start, 0.0), np.maximum(start - q, 0.0))

        return self._continued(
            q, np.abs(q - start) @ weights, start, begin, np.append(weights, weights), bounds, both, ()
        )

    def shortest_time(self, q: FloatArray, start: FloatArray, model: EnergyModel) -> FloatArray:
        """Configurations (m, n) [rad] of shorter motions from a start (n,), continued from the best of (k, n)."""
        n = len(start)
        speed, acceleration = model.speed_limits / CUBIC_PEAKS[0], model.acceleration_limits / CUBIC_PEAKS[1]

        def times(q: FloatArray) -> FloatArray:
            limits = model.speed_limits, model.acceleration_limits
            return rest_to_rest_times(np.abs(q - start), CUBIC_PEAKS, *limits).max(axis=-1)

        def room(x: FloatArray) -> FloatArray:
            way, time = x[:n] - start, x[n]
            ways = speed * time, acceleration * time * time
            return np.concatenate([most + sense * way for most in ways for sense in (-1.0, 1.0)])

        def slopes(x: FloatArray) -> FloatArray:
            one = np.eye(n)
            ways = speed, 2.0 * acceleration * x[n]
            return np.vstack([np.column_stack([sense * one, most]) for most in ways for sense in (-1.0, 1.0)])

        return self._continued(
            q, times(q), start, lambda q: np.append(q, times(q)), np.append(np.zeros(n), 1.0),
            np.vstack([self.limits, [0.0, math.inf]]), np.eye(n, n + 1),
            ({"type": "ineq", "fun": room, "jac": slopes},), zero=np.zeros(n),
        )  # fmt: skip

    def _continued(
        self, q: FloatArray, cost: FloatArray, start: FloatArray, begin: Callable[[FloatArray], FloatArray],
        slope: FloatArray, bounds: FloatArray, turns: FloatArray,
        others: Sequence[dict[str, Any]], zero: FloatArray | None = None,
    ) -> FloatArray:  # fmt: skip
        """(m, n) where the least of ``slope`` x is found, from the best of ``q`` (k, n) by their ``cost``.

        Of unknowns x inside ``bounds`` the configuration is ``zero + turns x``, with zero the start unless it
        is given.
        """
        zero = start if zero is None else zero
        minimize = import_module("scipy.optimize").minimize  # takes long to import, and few need it
        met = {
            "type": "eq",
            "fun": lambda x: self._rows(zero + turns @ x)[0],
            "jac": lambda x: self._rows(zero + turns @ x)[1] @ turns,
        }
        found: list[FloatArray] = []
        for one in self._seeds(q, cost, start):
            x = np.clip(begin(one), *bounds.T)
            answer = minimize(
                lambda x: float(slope @ x), x, jac=lambda _: slope, method="SLSQP",
                bounds=bounds.tolist(), constraints=(met, *others),
                options={"maxiter": _ROUNDS, "ftol": _PRECISION},
            )  # fmt: skip
            there = self._polished(zero + turns @ np.asarray(answer.x, dtype=np.float64), start)
            if there is not None:
                found.append(there)
        return np.reshape(found, (-1, len(start)))

    def _seeds(self, q: FloatArray, cost: FloatArray, start: FloatArray) -> list[FloatArray]:
        """The best of some configurations (k, n), not near to each other; and the start itself."""
        seeds: list[FloatArray] = []
        order = np.argsort(cost, kind="stable")
        while len(order) and len(seeds) < _BEGUN:
            seeds.append(q[order[0]])
            order = order[np.abs(q[order] - seeds[-1]).max(axis=1) > _APART]
        return [*seeds, np.clip(start, *self.limits.T)]

    def _polished(self, q: FloatArray, start: FloatArray) -> FloatArray | None:
        """Brought onto the target, if it is near: joints at a limit, or where they started, stay if they can."""
        low, high = self.limits.T
        q = np.clip(q, low, high)
        inside = (q > low + _MOVED) & (q < high - _MOVED)
        away = np.abs(q - start) > _MOVED
        for free in (inside & away, inside | (low < high)):
            there = np.where(away, q, np.clip(start, low, high))
            for _ in range(_POLISH):
                r, J = self._rows(there)
                if np.abs(r).max() < _ROUNDING:
                    break
                there = there - free * (np.linalg.pinv(J * free, rcond=_SINGULAR) @ r)
                there = np.clip(there, low, high)
            if np.abs(self._rows(there)[0]).max() < _MET:
                return there
        return None

    def _rows(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By how much a configuration (n,) misses the target (m,), and the derivatives (m, n)."""
        T, J = self.chain.forward(q), self.chain.jacobian(q)
        target = self.target
        rows, slopes = [T[:3, 3] - target.position], [J[:3]]
        if target.rotation is not None:
            off = T[:3, :3] @ target.rotation.T
            rows.append(0.5 * np.array([off[2, 1] - off[1, 2], off[0, 2] - off[2, 0], off[1, 0] - off[0, 1]]))
            slopes.append(J[3:])
        elif target.pitch is not None:
            approach = T[:3, 2]
            turned = np.cross(J[3:], approach[:, None], axis=0)
            wish = np.linalg.svd(self.up[None])[2][1:] if target.up is not None else self.up[None]
            rows.append(wish @ approach - (0.0 if target.up is not None else math.sin(target.pitch)))
            slopes.append(wish @ turned)
        return np.concatenate(rows), np.concatenate(slopes)

"""Poses of a spherical-wrist arm at which rounding needs care: near singular postures and near joint limits.

What the closed form gives is made exact on the arm itself by Newton steps, angles that only rounding has put
outside a limit are put onto it, and of each continuum one posture is found: the one nearest to where the arm
stands, or to rest. Each posture is found once, at any of its images.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.facts import Reason
from armctl.facts.targets import AnyAngle, OneLine
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, distinct, rest_angle, turns_inside, within
from armctl.kinematics.chain import Chain
from armctl.kinematics.families.spherical_wrist.closed_form import (
    CLIPPED,
    ON_AXIS,
    ClosedForm,
    Placed,
    Three,
    Wrist,
)
from armctl.kinematics.newton import newton

_MET = 5e-10
"""what a posture may miss its pose by [m], [rad]"""
_ROUNDING = 1e-12
"""an angle clipped by less than this is as good as inside [rad]"""
_LEAST = 1e-16
"""less cannot be missed [m], [rad]; near a double root 1e-12 are angles of 1e-6"""
_STEPS, _SINGULAR = 11, 1e-9
_TURNED = 2.9
"""trace of a turn by less than a fifth of a radian"""
_VALUES = {1: 721, 2: 37}
"""how many angles are tried of one joint that is free, and of each of two"""


class CarefulSolutions(NamedTuple):
    """What there is at one pose."""

    q: FloatArray
    """(k, 6) joint angles [rad], each posture once"""
    branches: list[int]
    continua: tuple[Reason, ...]
    """every continuum of which only one posture is listed"""


class _Arm(NamedTuple):
    angles: Three
    """θ1, φ2, φ3 [rad]"""
    way: int
    free: tuple[int, ...]
    """of the first two joints those whose axis goes through W, so that they may be at any angle"""


class CarefulSolver:
    """One arm inside its limits. Immutable; safe in several threads."""

    def __init__(self, closed: ClosedForm, chain: Chain, limits: FloatArray, titles: Sequence[str]) -> None:
        self._closed, self._chain, self._limits, self._titles = closed, chain, limits, titles
        self._low, self._high = limits.T

    def solve(self, pose: FloatArray, start: FloatArray | None) -> CarefulSolutions:
        """Every posture that has a tool pose (4, 4) and an image inside the limits."""
        placed = self._closed.place(pose[:3, 3].tolist(), pose[:3, :3])
        rest = np.array([rest_angle(*pair) for pair in self._limits.tolist()]) if start is None else start
        rest = self._closed.geometry.order(rest)
        postures: list[FloatArray] = []
        branches: list[int] = []
        continua: list[tuple[Reason, ...]] = []
        for arm in self._arms(placed):
            for flip, wrist, q in self._postures(arm, placed, pose, rest):
                postures.append(q)
                branches.append(2 * arm.way + flip)
                continua.append(tuple(self._told(arm.free, wrist.coupled)))
        q = np.array(postures).reshape(-1, 6)
        kept: list[int] = distinct(q).tolist()
        told = dict.fromkeys(one for k in kept for one in continua[k])
        return CarefulSolutions(q[kept], [branches[k] for k in kept], tuple(told))

    def _arms(self, placed: Placed) -> Iterator[_Arm]:
        x, y, z = placed.centre
        on_first = math.hypot(x, y) < ON_AXIS
        centre = (0.0, 0.0, z) if on_first else placed.centre
        closed = self._closed
        for first, third, way in closed.pairs(centre)[0]:
            arm = closed.refined(centre, (first, closed.second(centre, first, third)[0], third))
            away = closed.second(centre, arm[0], arm[2])[1]
            yield _Arm(arm, way, (0,) * on_first + (1,) * (away < ON_AXIS))

    def _postures(
        self, arm: _Arm, placed: Placed, pose: FloatArray, rest: FloatArray
    ) -> Iterator[tuple[int, Wrist, FloatArray]]:
        """Those of one posture of the first three joints, of a continuum the one nearest to ``rest`` (6,)."""
        closed = self._closed
        o2, o3, _ = closed.geometry.offsets
        wanted = {0, 1}
        for first, second in self._angles(arm, rest):
            turned = first, second, arm.angles[2]
            for wrist in closed.wrists(closed.turned_back(placed.rotation, turned)):
                if wrist.flip not in wanted:
                    continue
                fourth, fifth, sixth = self._uncoupled(wrist, rest) if wrist.coupled else wrist.angles
                q = np.array([first, second - o2, turned[2] - o3, fourth, fifth, sixth])
                for admitted in self._admitted(closed.geometry.order(q), pose):
                    yield wrist.flip, wrist, admitted
                    if arm.free or wrist.coupled:
                        wanted.discard(wrist.flip)
                        break
            if not wanted:
                return

    def _angles(self, arm: _Arm, rest: FloatArray) -> Iterator[tuple[float, ...]]:
        """θ1 and φ2 [rad] of a posture; where they are free all there are, the nearest to ``rest`` first."""
        choices: list[list[float]] = []
        offsets = (0.0, self._closed.geometry.offsets[0])
        for joint in (0, 1):
            if joint not in arm.free:
                choices.append([arm.angles[joint]])
                continue
            at = float(rest[joint])
            low, high = self._limits[self._closed.geometry.joint(joint)].tolist()
            shares = np.arange(_VALUES[len(arm.free)]) / (_VALUES[len(arm.free)] - 1.0)
            values = np.append(low + shares * (high - low), at)
            values = values[np.argsort(np.abs(values - at), kind="stable")]
            choices.append((values + offsets[joint]).tolist())
        return itertools.product(*choices)

    def _uncoupled(self, wrist: Wrist, rest: FloatArray) -> Three:
        """θ4 and θ6 [rad] nearest to ``rest``, where only their sum or their difference counts."""
        joint, sign = self._closed.geometry.joint, wrist.coupled
        fourth, fifth, sixth = wrist.angles
        (low4, high4), (low6, high6) = self._limits[joint(3)].tolist(), self._limits[joint(5)].tolist()
        rest4, rest6 = float(rest[3]), float(rest[5])
        constant = fourth + sign * sixth
        least, best = math.inf, wrist.angles
        middle = round((rest4 + sign * rest6 - constant) / TWO_PI)
        for turns in range(middle - 8, middle + 9):
            total = constant + turns * TWO_PI
            ends = sorted((total - sign * low6, total - sign * high6))
            low, high = max(low4, ends[0]), min(high4, ends[1])
            if low > high + CLIPPED:
                continue
            at = min(max(0.5 * (rest4 + total - sign * rest6), low), high)
            other = sign * (total - at)
            away = (at - rest4) ** 2 + (other - rest6) ** 2
            if away < least:
                least, best = away, (at, fifth, other)
        return best

    def _admitted(self, q: FloatArray, pose: FloatArray) -> list[FloatArray]:
        """A posture (6,) made exact, and with angles clipped that rounding alone put outside; or neither."""
        if self._at_limits(q) is None:
            return []
        none: NDArray[np.bool_] = np.zeros(6, dtype=np.bool_)
        exact, missed = self._polished(q, pose, none)
        image = self._at_limits(exact)
        if image is None:
            return []
        inside = np.clip(image, self._low, self._high)
        over = np.maximum(image - self._high, self._low - image)
        met = [inside] if missed <= _MET and within(exact, self._low, self._high, _ROUNDING).all() else []
        if over.max() <= _ROUNDING and met:
            return met
        for held in (over > 0.0, over > -LIMIT_TOLERANCE, over > -CLIPPED):
            found, _ = self._polished(inside, pose, held)
            found = np.clip(found, self._low, self._high)
            if np.abs(self._off(found, pose)[0]).max() <= _MET:
                return [found, *([exact] if met else [])]
        return [exact] if met else []

    def _at_limits(self, q: FloatArray) -> FloatArray | None:
        """Of each angle (6,) the image farthest out, at most ``CLIPPED`` outside; None: there is none."""
        first, last = turns_inside(q, self._limits, CLIPPED)
        if (first > last).any():
            return None
        first, last = q + TWO_PI * first, q + TWO_PI * last
        return np.where(self._low - first > last - self._high, first, last)

    def _off(self, q: FloatArray, pose: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(6,) [m] and rotation vector [rad] from a pose that is nearly there to that of a posture (6,).

        And the derivatives (6, 6).
        """
        T, J = self._chain.pose_and_jacobian(q)
        m = (T[:3, :3] @ pose[:3, :3].T).tolist()
        if m[0][0] + m[1][1] + m[2][2] < _TURNED:
            return np.full(6, math.inf), J
        turn = m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]
        return np.concatenate([T[:3, 3] - pose[:3, 3], 0.5 * np.array(turn)]), J

    def _polished(self, q: FloatArray, pose: FloatArray, held: NDArray[np.bool_]) -> tuple[FloatArray, float]:
        """Where Newton steps of the joints that are not held lead, and what is missed there [m], [rad]."""

        def rows(q: FloatArray) -> tuple[FloatArray, FloatArray]:
            off, J = self._off(q, pose)
            return off, np.where(held, 0.0, J)

        return newton(rows, q, _STEPS, rank=_SINGULAR, gain=0.5, still=_LEAST)

    def _told(self, free: tuple[int, ...], coupled: float) -> Iterator[Reason]:
        joint = self._closed.geometry.joint
        for k in free:
            yield AnyAngle(self._titles[joint(k)], "centre of wrist")
        if coupled:
            first, second = sorted((joint(3), joint(5)))
            joints = self._titles[first], self._titles[second]
            yield OneLine(joints, "sum" if coupled > 0.0 else "difference")

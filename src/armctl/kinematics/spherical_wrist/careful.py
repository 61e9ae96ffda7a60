"""Poses of a spherical-wrist arm at which rounding needs care: near singular postures and near joint limits.

What the closed form gives is made exact on the arm itself by Newton steps, angles that only rounding has put
outside a limit are put onto it, and of each continuum one posture is listed: the one nearest to where the
arm stands, or to rest.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, rest_angle
from armctl.kinematics.chain import Chain
from armctl.kinematics.numeric.goals import PositionGoal, RotationGoal, Together, tool_motion
from armctl.kinematics.spherical_wrist.closed_form import CLIPPED, ON_AXIS, ClosedForm, Placed, Three, Wrist
from armctl.kinematics.target import Target

_MET = 5e-10
"""what a posture may miss its pose by [m], [rad]"""
_GOOD = 1e-12
"""what cannot be bettered [m], [rad]"""
_STEPS = 8
_SAME = 1e-6
"""configurations this near to each other are one [rad]"""
_VALUES = {1: 721, 2: 37}
"""how many angles are tried of one joint that is free, and of each of two"""


class Found(NamedTuple):
    """What there is at one pose."""

    q: FloatArray
    """(k, 6) joint angles [rad]"""
    branches: list[int]
    continua: tuple[str, ...]
    """a sentence for each continuum of which only one posture is listed"""


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
        self._middle = 0.5 * (self._low + self._high)

    def solve(self, target: Target, placed: Placed, start: FloatArray | None) -> Found:
        """Every posture inside the limits that has a pose, once: its images nearest to their middle."""
        assert target.rotation is not None  # noqa: S101
        goal = Together(PositionGoal(target.position, 1.0), RotationGoal(target.rotation))
        rest = np.array([rest_angle(*pair) for pair in self._limits.tolist()]) if start is None else start
        rest = self._closed.geometry.order(rest)
        kept: list[tuple[FloatArray, int]] = []
        continua: set[str] = set()
        for arm in self._arms(placed):
            for flip, wrist, q in self._postures(arm, placed, goal, rest):
                branch = 2 * arm.way + flip
                if any(np.abs(np.remainder(q - other + math.pi, TWO_PI) - math.pi).max() < _SAME
                       for other, _ in kept):  # fmt: skip
                    continue
                kept.append((q, branch))
                continua.update(self._told(arm.free, wrist.coupled))
        return Found(np.array([q for q, _ in kept]).reshape(-1, 6), [b for _, b in kept], tuple(continua))

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
        self, arm: _Arm, placed: Placed, goal: Together, rest: FloatArray
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
                admitted = self._admitted(closed.geometry.order(q), goal)
                if admitted is not None:
                    yield wrist.flip, wrist, admitted
                    if arm.free:
                        wanted.discard(wrist.flip)
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
            if low > high + LIMIT_TOLERANCE:
                continue
            at = min(max(0.5 * (rest4 + total - sign * rest6), low), high)
            other = sign * (total - at)
            away = (at - rest4) ** 2 + (other - rest6) ** 2
            if away < least:
                least, best = away, (at, fifth, other)
        return best

    def _admitted(self, q: FloatArray, goal: Together) -> FloatArray | None:
        """A posture (6,) at the images nearest to the middle of the limits; None where it is outside them."""
        near = self._middle + np.remainder(q - self._middle + math.pi, TWO_PI) - math.pi
        over = np.maximum(near - self._high, self._low - near)
        if over.max() > CLIPPED:
            return None
        start = np.clip(near, self._low, self._high)
        none: NDArray[np.bool_] = np.zeros(6, dtype=np.bool_)
        for held in (none, over > -LIMIT_TOLERANCE, over > -CLIPPED):
            found, missed = self._polished(start, goal, held)
            inside = np.clip(found, self._low, self._high)
            if np.abs(inside - found).max() > 0.0:
                missed = float(np.abs(goal.rows(tool_motion(self._chain, inside[None]))[0]).max())
            if missed <= _MET:
                return inside
        return None

    def _polished(self, q: FloatArray, goal: Together, held: NDArray[np.bool_]) -> tuple[FloatArray, float]:
        """Where Newton steps of the joints that are not held lead, and what is missed there [m], [rad]."""
        best, least = q, math.inf
        for _ in range(_STEPS):
            rows, J = goal.rows(tool_motion(self._chain, q[None]))
            missed = float(np.abs(rows).max())
            if not missed < least:
                break
            best, least = q, missed
            if missed < _GOOD:
                break
            free = np.where(held, 0.0, J[0])
            steps: FloatArray = np.asarray(np.linalg.lstsq(free, rows[0], rcond=1e-9)[0], dtype=np.float64)
            q = q - steps
        return best, least

    def _told(self, free: tuple[int, ...], coupled: float) -> Iterator[str]:
        joint = self._closed.geometry.joint
        for k in free:
            yield (
                f"the wrist's centre is on the axis of {self._titles[joint(k)]}, which may be at any angle: "
                "one is listed"
            )
        if coupled:
            what = "sum" if coupled > 0.0 else "difference"
            first, second = sorted((joint(3), joint(5)))
            yield (
                f"the axes of {self._titles[first]} and {self._titles[second]} are one line here, so that "
                f"only the {what} of their angles counts: one pair is listed"
            )

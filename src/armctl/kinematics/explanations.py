"""What all answers of an arm share, why a target is not reached, why solutions may be missing."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import ArrayRecord, FloatArray
from armctl.facts import AngleNeeded, Reason, Several, WrongUnit
from armctl.facts.targets import HeldAtLimit, LostAtLimit, MayTurn, MoreByTurns, NearestPoint, PointReached
from armctl.kinematics.angles import SAME_ROTATION
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.newton import moving_joints, uncertainties
from armctl.kinematics.samples import DEFAULT_STEP
from armctl.kinematics.target import Target, elevation, seem_degrees, seems_of_another_unit
from armctl.lazy_dataclass import dataclass

_ON_LIMIT, _LEVER = 1e-6, 1e-3
"""so near to a limit a joint is at it [rad]; what a turn must bring at least to count as nearer [m/rad]"""
_BESIDE, _LISTED = 1e-4, 1e-6
"""how far beyond its limits an arm is solved for what rounding took there; which solutions are one [rad]"""


class _Solver(Protocol):
    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Any: ...


SolverOf = Callable[[Chain, FloatArray, EnergyModel, Sequence[str]], _Solver | None]
"""Of a chain, its limits (n, 2) [rad], its energy model and the titles of its joints."""


@dataclass(frozen=True, eq=False)
class SolvedArm(ArrayRecord):
    """What all solutions of one arm share."""

    branch_names: tuple[str, ...]
    chain: Chain
    energy: EnergyModel
    pitch_joints: tuple[int, ...] = ()
    limits: FloatArray | None = None
    """(n, 2) joint limits [rad]"""
    roll_joint: int | None = None
    """index of the joint whose own angle is the roll"""
    roll_moves_tip: bool = False
    """True where the tool point lies beside the axis of that joint"""
    titles: tuple[str, ...] = ()
    """of the joints, for messages"""
    up: FloatArray | None = None
    """(3,) what a pitch is measured against; None: z of the base frame"""
    solver_of: SolverOf | None = None
    """makes the solver of the same arm inside other limits; None where it searches"""

    @property
    def upward(self) -> FloatArray:
        """(3,) what a pitch is measured against."""
        return np.array([0.0, 0.0, 1.0]) if self.up is None else self.up

    @cached_property
    def widened(self) -> _Solver | None:
        """The solver of the same arm inside limits that are a little wider; None where it searches."""
        if self.solver_of is None or self.limits is None:
            return None
        moves = np.ptp(self.limits, axis=1)[:, None] > 0.0
        wide = np.where(moves, self.limits + _BESIDE * np.array([-1.0, 1.0]), self.limits)
        return self.solver_of(self.chain, wide, self.energy, self.titles)

    def title(self, joint: int) -> str:
        """What messages call a joint."""
        return self.titles[joint] if self.titles else f"joint {joint + 1}"


def angle_needed(title: str, limits: NDArray[np.float64] | Sequence[float], *angles: float) -> AngleNeeded:
    """A joint that would have to leave its limits (2,) for one of some angles [rad]."""
    low, high = map(float, limits)
    return AngleNeeded(title, tuple(map(float, angles)), low, high)


def angles_needed(
    titles: Sequence[str], limits: NDArray[np.float64], needed: Sequence[tuple[int, float]]
) -> tuple[AngleNeeded, ...]:
    """Joints that would have to leave their limits (n, 2): index and angle [rad] of each."""
    return tuple(angle_needed(titles[joint], limits[joint], angle) for joint, angle in needed)


def refusal(reason: Reason, arm: SolvedArm, target: Target, nearest: Reason | None = None) -> Reason:
    """``reason``, and what can be reached instead, if that is given.

    And the question for the unit, where the target's numbers are hardly meant.
    """
    asked = seems_of_another_unit(math.hypot(*target.point), arm.chain.length)
    unit = WrongUnit() if asked or seem_degrees(target.roll or 0.0) else None
    more = [one for one in (nearest, unit) if one is not None]
    return Several((reason, *more)) if more else reason


def nearest_point(
    arm: SolvedArm, target: Target, q: FloatArray, point: FloatArray, away_m: float
) -> NearestPoint | PointReached:
    """What is reached, a ``point`` (3,) by ``q`` (n,) [rad], so far from the target [m]; 0: the target."""
    if not away_m:
        return PointReached()
    x, y, z = point.tolist()
    orientation = _orientation(arm, target, q)
    held = () if orientation == "pitch kept" else _holding_limits(arm, target, q, point)
    return NearestPoint((x, y, z), away_m, orientation, held)


def _holding_limits(
    arm: SolvedArm, target: Target, q: FloatArray, point: FloatArray
) -> tuple[HeldAtLimit, ...]:
    """Which joints stand at limits, beyond which the tool would come nearer to the target."""
    if arm.limits is None or arm.chain.coupling is not None:
        return ()
    away = point - target.position
    nearer = -(arm.chain.jacobian(q)[:3].T @ away) / np.linalg.norm(away)
    if target.roll is not None and arm.roll_joint is not None:
        nearer[arm.roll_joint] = 0.0
    low, high = arm.limits.T
    held = (low < high) & (
        ((q <= low + _ON_LIMIT) & (nearer < -_LEVER)) | ((q >= high - _ON_LIMIT) & (nearer > _LEVER))
    )
    return tuple(HeldAtLimit(arm.title(j), float(q[j])) for j in np.flatnonzero(held).tolist())


def _orientation(arm: SolvedArm, target: Target, q: FloatArray) -> Literal["", "pitch kept", "any"]:
    """Where the nearest configuration has the pitch that was asked for: another one may come nearer."""
    if target.rotation is not None:
        return "any"
    if target.pitch is None:
        return ""
    up = arm.upward
    aim = arm.chain.forward(q)[:3, 2]
    rise = float(aim @ up)
    pitch = math.atan2(rise, float(np.linalg.norm(aim - rise * up)))  # exact near 90°, too
    return "pitch kept" if abs(pitch - elevation(target.pitch)) < SAME_ROTATION else ""


def all_of(*reasons: Reason | None) -> Reason | None:
    """Reasons as one, as far as they are there."""
    there = tuple(one for one in reasons if one is not None)
    return Several(there) if len(there) > 1 else next(iter(there), None)


def by_turns(count: int) -> MoreByTurns | None:
    """Solutions that differ by whole turns and are not listed, where there are any."""
    return MoreByTurns(count) if count else None


def which_move(arm: SolvedArm, target: Target, q: FloatArray, held: list[int]) -> MayTurn | None:
    """Which joints may move while the target is met, as at ``q`` (k, n) [rad]; of the ``held`` ones none."""
    if arm.limits is None or arm.chain.coupling is not None or not len(q):
        return None
    moving = moving_joints(arm.chain, arm.limits, target, q, held, arm.upward)
    return MayTurn(tuple(arm.title(k) for k in moving)) if moving else None


def lost_at_a_limit(
    arm: SolvedArm, target: Target, listed: FloatArray, held: list[int]
) -> LostAtLimit | None:
    """Which solution rounding may have taken beyond the limits; ``listed`` (k, n) [rad] are there.

    The arm is solved inside limits that are a little wider. How far rounding carries a solution depends
    on how nearly singular it is.
    """
    limits = arm.limits
    if arm.widened is None or limits is None:
        return None
    found = arm.widened.solve(target, DEFAULT_STEP)
    if found.free_joint is not None:
        return None
    q = found.q[found.residual_rad < SAME_ROTATION]
    beyond = np.abs(q - np.clip(q, *limits.T))
    beyond[:, held] = 0.0
    known = uncertainties(arm.chain, limits, target, q, held, arm.upward)
    counted = np.delete(np.arange(arm.chain.n), held)
    for i in np.flatnonzero(beyond.max(axis=1, initial=0.0) <= known):
        apart = np.abs(listed - q[i])[:, counted].max(axis=1, initial=0.0)
        if apart.min(initial=math.inf) > max(_LISTED, known[i]):
            return LostAtLimit(arm.titles[int(beyond[i].argmax())])
    return None

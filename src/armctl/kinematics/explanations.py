"""Why a target is not reached, and why solutions may be missing from a list."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.facts import Reason, Several, WrongUnit
from armctl.facts.targets import AngleNeeded, HeldAtLimit, NearestPoint, PointReached
from armctl.kinematics.angles import SAME_ROTATION
from armctl.kinematics.newton import moving_joints, uncertainties
from armctl.kinematics.samples import DEFAULT_STEP
from armctl.kinematics.target import elevation, seem_degrees, seems_of_another_unit

if TYPE_CHECKING:
    from armctl.kinematics.solutions import Solutions

_ON_LIMIT, _LEVER = 1e-6, 1e-3
"""so near to a limit a joint is at it [rad]; what a turn must bring at least to count as nearer [m/rad]"""
_BESIDE, _LISTED = 1e-4, 1e-6
"""how far beyond its limits an arm is solved for what rounding took there; which solutions are one [rad]"""


def angle_needed(title: str, limits: NDArray[np.float64] | Sequence[float], *angles: float) -> AngleNeeded:
    """A joint that would have to leave its limits (2,) for one of some angles [rad]."""
    low, high = map(float, limits)
    return AngleNeeded(title, tuple(map(float, angles)), low, high)


def angles_needed(
    titles: Sequence[str], limits: NDArray[np.float64], needed: Sequence[tuple[int, float]]
) -> tuple[AngleNeeded, ...]:
    """Joints that would have to leave their limits (n, 2): index and angle [rad] of each."""
    return tuple(angle_needed(titles[joint], limits[joint], angle) for joint, angle in needed)


def refusal(solutions: Solutions, *, instead: bool = True) -> Reason | None:
    """Why there is no solution, ``instead`` with what can be reached; None when solved.

    And the question for the unit, where the target's numbers are hardly meant.
    """
    if solutions.bare_reason is None:
        return None
    target, nearest = solutions.target, _nearest(solutions) if instead else None
    asked = seems_of_another_unit(math.hypot(*target.point), solutions.arm.chain.length)
    unit = WrongUnit() if asked or seem_degrees(target.roll or 0.0) else None
    more = [one for one in (nearest, unit) if one is not None]
    return Several((solutions.bare_reason, *more)) if more else solutions.bare_reason


def _nearest(solutions: Solutions) -> NearestPoint | PointReached | None:
    """What can be reached; None: not known."""
    point = solutions.nearest_m
    if point is None:
        return None
    if not solutions.nearest_away_m:
        return PointReached()
    x, y, z = map(float, point)
    orientation = _orientation(solutions)
    held = () if orientation == "pitch kept" else _holding_limits(solutions)
    return NearestPoint((x, y, z), solutions.nearest_away_m, orientation, held)


def _holding_limits(solutions: Solutions) -> tuple[HeldAtLimit, ...]:
    """Which joints stand at limits, beyond which the tool would come nearer to the target."""
    arm, q, point = solutions.arm, solutions.nearest_q, solutions.nearest_m
    if q is None or point is None or arm.limits is None or arm.chain.coupling is not None:
        return ()
    away = point - solutions.target.position
    nearer = -(arm.chain.jacobian(q)[:3].T @ away) / np.linalg.norm(away)
    if solutions.target.roll is not None and arm.roll_joint is not None:
        nearer[arm.roll_joint] = 0.0
    low, high = arm.limits.T
    held = (low < high) & (
        ((q <= low + _ON_LIMIT) & (nearer < -_LEVER)) | ((q >= high - _ON_LIMIT) & (nearer > _LEVER))
    )
    return tuple(HeldAtLimit(arm.title(j), float(q[j])) for j in np.flatnonzero(held).tolist())


def _orientation(solutions: Solutions) -> Literal["", "pitch kept", "any"]:
    """Where the nearest configuration has the pitch that was asked for: another one may come nearer."""
    target, q = solutions.target, solutions.nearest_q
    if target.rotation is not None:
        return "any"
    if target.pitch is None or q is None:
        return ""
    up = solutions.arm.upward
    aim = solutions.arm.chain.forward(q)[:3, 2]
    rise = float(aim @ up)
    pitch = math.atan2(rise, float(np.linalg.norm(aim - rise * up)))  # exact near 90°, too
    return "pitch kept" if abs(pitch - elevation(target.pitch)) < SAME_ROTATION else ""


def why_incomplete(solutions: Solutions, limits: FloatArray) -> str | None:
    """Why solutions inside ``limits`` (n, 2) [rad] may be missing from the list; None where none is."""
    given = solutions.arm.roll_joint if solutions.target.roll is not None else None
    # any angle of these counts as the same solution, or they are given one
    held = [k for k in (solutions.free_joint, solutions.free_roll, given) if k is not None]
    return _moving(solutions, limits, held) or _at_a_limit(solutions, limits, held)


def _moving(solutions: Solutions, limits: FloatArray, held: list[int]) -> str | None:
    """Which joints may move while the target is met."""
    arm = solutions.arm
    if not solutions.success or arm.chain.coupling is not None:
        return None
    moving = moving_joints(arm.chain, limits, solutions.target, solutions.q, held, arm.upward)
    if not moving:
        return None
    names = [arm.title(k) for k in moving]
    if len(names) == 1:
        return f"{names[0]} may turn while the tool stays: of a continuum some are listed"
    joints = f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{joints} may turn together while the tool stays: of a continuum some are listed"


def _at_a_limit(solutions: Solutions, limits: FloatArray, held: list[int]) -> str | None:
    """Which solution rounding may have taken beyond the limits.

    The arm is solved inside limits that are a little wider. How far rounding carries a solution depends
    on how nearly singular it is.
    """
    arm, target = solutions.arm, solutions.target
    if arm.solver_of is None or solutions.free_joint is not None:
        return None
    wide = np.where(np.ptp(limits, axis=1)[:, None] > 0.0, limits + _BESIDE * np.array([-1.0, 1.0]), limits)
    solver = arm.solver_of(arm.chain, wide, arm.energy, arm.titles)
    found = None if solver is None else solver.solve(target, DEFAULT_STEP)
    if found is None or found.free_joint is not None:
        return None
    q = found.q[found.residual_rad < SAME_ROTATION]
    beyond = np.abs(q - np.clip(q, *limits.T))
    beyond[:, held] = 0.0
    known = uncertainties(arm.chain, limits, target, q, held, arm.upward)
    counted = np.delete(np.arange(arm.chain.n), held)
    for i in np.flatnonzero(beyond.max(axis=1, initial=0.0) <= known):
        apart = np.abs(solutions.q - q[i])[:, counted].max(axis=1, initial=0.0)
        if apart.min(initial=math.inf) > max(_LISTED, known[i]):
            title = arm.titles[int(beyond[i].argmax())]
            return f"a solution with {title} at its limit may be missing: rounding decides about it"
    return None

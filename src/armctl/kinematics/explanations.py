"""Why a target is not reached, and why solutions may be missing from a list, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.facts.reasons import decimals_apart
from armctl.kinematics.angles import SAME_ROTATION, in_degrees
from armctl.kinematics.newton import moving_joints, uncertainties
from armctl.kinematics.samples import DEFAULT_STEP
from armctl.kinematics.target import degrees_hint, elevation, length_hint

if TYPE_CHECKING:
    from armctl.kinematics.solutions import Solutions

_WITH_PITCH = " with that pitch"
_ON_LIMIT, _LEVER = 1e-6, 1e-3
"""so near to a limit a joint is at it [rad]; what a turn must bring at least to count as nearer [m/rad]"""
_SEEN_MM = 0.05
"""what one decimal shows as more than 0.0 [mm]"""
_BESIDE, _LISTED = 1e-4, 1e-6
"""how far beyond its limits an arm is solved for what rounding took there; which solutions are one [rad]"""


def millimetres(metres: float) -> str:
    """A length [m] as a number of mm: with one decimal, or two digits of one that would read as 0.0."""
    length = 1000.0 * metres
    return f"{length:.1f}" if abs(length) >= _SEEN_MM else f"{length:.2g}"


def too_far(miss: float, where: str, limit: str, length: float) -> str:
    """Text for a target beyond a greatest length by ``miss``, both [m]."""
    return f"too far by {millimetres(miss)} mm: {where}, {limit} {1000 * length:.1f} mm"


def too_near(miss: float, where: str, limit: str, length: float) -> str:
    """Text for a target inside a least length by ``miss``, both [m]."""
    return (
        f"inside the dead zone, too near by {millimetres(miss)} mm: {where}, {limit} {1000 * length:.1f} mm"
    )


def all_needs(titles: Sequence[str], limits: NDArray[np.float64], needed: Sequence[tuple[int, float]]) -> str:
    """Text for joints that would leave their limits: index and angle [rad] of each, ``limits`` (n, 2)."""
    return " and ".join(needs(titles[joint], limits[joint], angle) for joint, angle in needed)


def needs(title: str, limits: NDArray[np.float64] | Sequence[float], *angles: float) -> str:
    """Text for a joint that would leave its limits: ``limits`` (2,) and alternative ``angles`` [rad]."""
    low, high, *needed = (math.degrees(float(value)) + 0.0 for value in (*limits, *angles))
    digits = max(decimals_apart(angle, low, high) for angle in needed)
    said = " or ".join(dict.fromkeys(f"{angle:z.{digits}f}°" for angle in needed))
    return f"{title} needs {said}, its limits are {low:z.{digits}f}° … {high:z.{digits}f}°"


def off_rotation(off: float) -> str:
    """Text for a configuration whose rotation misses by an angle [rad] the one that was asked for."""
    return (
        "the arm reaches that point, but not in that orientation: the nearest that was found there is "
        f"{in_degrees(off, '.3g')} off"
    )


def unit_hint(solutions: Solutions) -> str:
    """What to ask about the target's numbers, where they are hardly meant."""
    target = solutions.target
    return length_hint(math.hypot(*target.point), solutions.arm.chain.length) or degrees_hint(
        target.roll or 0.0
    )


def explanation(solutions: Solutions) -> str:
    """Why there is no solution, and the nearest reachable point [mm]; empty when solved."""
    refusal, point = solutions.refusal, solutions.nearest_m
    if refusal is None or point is None:
        return solutions.reason or ""
    hint = unit_hint(solutions)
    if not solutions.nearest_away_m:
        return f"{refusal}; the point itself can be reached{hint}"
    x, y, z = 1000.0 * point
    nearest = f"({x:z.1f}, {y:z.1f}, {z:z.1f}) mm, {millimetres(solutions.nearest_away_m)} mm away"
    pitched = _at_the_pitch(solutions)
    holding = "" if pitched == _WITH_PITCH else _holding_limits(solutions)
    inside = "inside the joint limits " if holding else ""
    return f"{refusal}; {inside}the nearest reachable point{pitched} is {nearest}{holding}{hint}"


def _holding_limits(solutions: Solutions) -> str:
    """Which joints stand at limits, beyond which the tool would come nearer to the target."""
    arm, q, point = solutions.arm, solutions.nearest_q, solutions.nearest_m
    if q is None or point is None or arm.limits is None or arm.chain.coupling is not None:
        return ""
    away = point - solutions.target.position
    nearer = -(arm.chain.jacobian(q)[:3].T @ away) / np.linalg.norm(away)
    if solutions.target.roll is not None and arm.roll_joint is not None:
        nearer[arm.roll_joint] = 0.0
    low, high = arm.limits.T
    held = (low < high) & (
        ((q <= low + _ON_LIMIT) & (nearer < -_LEVER)) | ((q >= high - _ON_LIMIT) & (nearer > _LEVER))
    )
    words = [f"{arm.title(j)} is at its limit of {in_degrees(q[j])}" for j in np.flatnonzero(held).tolist()]
    return f", where {' and '.join(words)}" if words else ""


def _at_the_pitch(solutions: Solutions) -> str:
    """Where the nearest configuration has the pitch that was asked for: another one may come nearer."""
    target, q = solutions.target, solutions.nearest_q
    if target.rotation is not None:
        return ", whatever the orientation,"
    if target.pitch is None or q is None:
        return ""
    up = solutions.arm.upward
    aim = solutions.arm.chain.forward(q)[:3, 2]
    rise = float(aim @ up)
    pitch = math.atan2(rise, float(np.linalg.norm(aim - rise * up)))  # exact near 90°, too
    return _WITH_PITCH if abs(pitch - elevation(target.pitch)) < SAME_ROTATION else ""


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

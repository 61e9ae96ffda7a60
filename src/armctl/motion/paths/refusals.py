"""What is said of a line or an arc that the tool cannot follow: the place, the reason, what to do instead."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, MotionRefusedError, UnreachableError
from armctl.facts import (
    AngleNeeded,
    AtLimit,
    BeyondReach,
    BranchEnds,
    OnCurve,
    PitchDecided,
    Reason,
    SingularStart,
    TooFewJoints,
)
from armctl.facts.angles import DEGREE
from armctl.kinematics import DEFAULT_STEP, Solutions, Target
from armctl.kinematics.angles import LIMIT_TOLERANCE
from armctl.kinematics.families.numeric.solver import link_bound
from armctl.kinematics.families.whole_pose import pose_of
from armctl.lazy_dataclass import dataclass
from armctl.motion.clearance import stands_clear
from armctl.motion.paths.tool_curve import NO_WAY_M, ToolCurve
from armctl.motion.paths.tool_orientation import PitchRows, ToolRotation, TurnRows, elevations
from armctl.motion.paths.tool_walk import TILT, StepBudget, ToolTask, Walk
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.preflight import passes
from armctl.motion.timing import timed
from armctl.robot import Robot

_SAMPLES = 1025
_BEYOND = 1e-4
"""how far past the end of a branch it is asked whether anything reaches there (share of the curve)"""
_TURNING = 1e-6
"""a turn of the tool [rad/m], and a share of the way, that count as none"""
_SHOWN, _TOLD = 0.0005, 0.01 * DEGREE
"""how far off a place with one decimal of a percent is (share of the curve), and what may come of it [rad]"""
_OTHER_STEPS, _CHECKED_STEPS = 40, 10
"""for other branches that are tried for one refusal, so that it comes at once; what a pre-flight counts as"""
_TURNED = 1e-6
"""how far off a rotation a solution does not have it any more [rad]"""


@dataclass(frozen=True, slots=True, eq=False)
class PathPlace:
    """Where on a curve it is, and what is wrong there."""

    s: float
    """way gone [m]"""
    fraction: float
    """share of the whole way, 0 … 1"""
    point: FloatArray
    """(3,) tool point, base frame [m]"""
    joint: int | None = None
    """index of the joint that cannot do what it would have to"""
    needed: float | None = None
    """the angle farthest beyond its limits that it would need on the rest of the curve [rad]"""


class _PlacedError(ArmctlError):
    section = "a-line-or-an-arc-is-refused"

    def __init__(self, reason: OnCurve, place: PathPlace, before: PiecewisePolynomial | None) -> None:
        super().__init__(reason)
        self.on_curve = reason
        self.place = place
        self.before = before
        """q(s) as far as the place; None where it cannot be left"""

    @property
    def freer(self) -> Literal["kept", "free"] | None:
        """The tool pitch with which the whole curve can be followed all the same; None: with neither."""
        if self.on_curve.freer is None:
            return None
        return "kept" if self.on_curve.freer == "pitch kept" else "free"


class ToolPathRefusedError(_PlacedError, MotionRefusedError):
    """A joint limit, the end of a branch or a singularity on the way."""


class ToolPathUnreachableError(_PlacedError, UnreachableError):
    """A stretch of the curve that the arm does not reach at all."""


def pitch_refusal(
    robot: Robot, wish: PitchRows, curve: ToolCurve, path: PiecewisePolynomial
) -> MotionRefusedError | None:
    """For a path on which the pitch, which the position decides, is not the one asked for."""
    s = np.linspace(0.0, curve.length, _SAMPLES)
    poses = robot.forward(path(s))
    if (wish.tilt(path(s), poses, s) <= TILT).all():
        return None
    seen = elevations(robot, poses)
    return MotionRefusedError(PitchDecided(curve.kind, float(seen.min()), float(seen.max())))


def beyond_links(robot: Robot, curve: ToolCurve) -> Reason | None:
    """Why the end of a curve is too far or too near for the links alone, however the tool is turned.

    None: that is not known.
    """
    return link_bound(robot.chain).violation(curve.positions(curve.length), robot.joints[0].title)


@dataclass(frozen=True, eq=False)
class Attempt:
    """A curve that could not be followed."""

    robot: Robot
    curve: ToolCurve
    start: FloatArray
    """(n,) [rad]"""
    walked: Walk
    turn: TurnRows | None
    """what is asked of the tool besides its position"""
    chosen: bool
    """the joints leave a choice of ways, and other ways may lead farther than the best that was found"""
    pitch: PitchRows | None
    """what is asked of the pitch, where the position decides it"""
    lead: Callable[[FloatArray, StepBudget], PiecewisePolynomial | None]
    """q(s) along the whole curve from another start (n,) [rad] inside the limits; None: none was found"""

    @property
    def searched(self) -> bool:
        """Whether such targets are searched for, not solved: that takes long, and some may be missing."""
        solver = self.robot.inverse_kinematics
        return not solver.complete or (solver.searches_parts and not isinstance(self.turn, ToolRotation))

    @property
    def searches(self) -> bool:
        """Whether an answer to what has no exact solution is searched for, which takes too long here."""
        solver = self.robot.inverse_kinematics
        return solver.searches_parts or not solver.complete

    @property
    def held(self) -> str:
        """What is asked for besides the position, in a word; empty: nothing."""
        return "" if self.turn is None else "rotation" if isinstance(self.turn, ToolRotation) else "pitch"

    def target(self, s: float) -> Target:
        """What the tool is asked for at ``s`` [m]."""
        point = self.curve.positions(s)
        if self.turn is None:
            return Target.of(point)
        if isinstance(self.turn, ToolRotation):
            return Target.of(point, rotation=self.turn.at(s))
        return Target.of(point, self.turn.elevation(s))

    def whole_target(self, s: float) -> Target:
        """As ``target``, with what is asked for besides or is left as it is at the start."""
        target, roll_joint = self.target(s), self.robot.inverse_kinematics.roll_joint
        if self.pitch is not None:
            target = target._replace(pitch=self.pitch.elevation(s))
        if roll_joint is not None and target.rotation is None:
            target = target._replace(roll=float(self.start[roll_joint]))
        return target

    def reached(self, s: float) -> bool | None:
        """Whether any configuration has what is asked for at ``s`` [m], limits not looked at.

        None: only a search would tell, which takes too long. Why not is not asked: where the roll is free,
        that takes 0.1 s.
        """
        target, solver = self.target(s), self.robot.inverse_kinematics
        if self.searches and target.rotation is not None:
            return solver.reaches(pose_of(target.position, target.rotation))
        return None if self.searched else bool(self.robot.branches(*target)) or solver.meets(target)

    def unmet(self, s: float) -> Solutions | None:
        """What is answered where no configuration has what is asked for at ``s`` [m]; None: one has."""
        target = self.target(s)
        if self.robot.branches(*target):
            return None
        solutions = self.solve(target)
        return None if solutions.met else solutions

    @cached_property
    def beyond(self) -> Reason | None:
        """Why the end of the curve is too far or too near for the links alone; None: that is not known."""
        return beyond_links(self.robot, self.curve)

    def solve(self, target: Target) -> Solutions:
        """The solutions of a target inside the limits."""
        return self.robot.inverse_kinematics.solve(target, DEFAULT_STEP)


def turn_refusal(tried: Attempt, task: ToolTask) -> ToolPathRefusedError | None:
    """There are too few joints for the orientation; None: that is not the reason.

    Says how fast the tool would turn besides, at least, with its point on the curve.
    """
    robot, curve, walked, rows = tried.robot, tried.curve, tried.walked, tried.turn
    if not isinstance(rows, ToolRotation):
        return None
    s, q, slope = 0.0, tried.start, np.zeros(robot.n)
    if walked.knots:
        s, q, slope = walked.knots[-1].s, walked.knots[-1].q, walked.knots[-1].slope
    ahead = _BEYOND * curve.length
    jacobian = robot.jacobian(q + ahead * slope)[:, task.moving]
    along, turn = curve.derivatives(min(s + ahead, curve.length))[1], rows.rates(s)[0]
    rates = np.linalg.pinv(jacobian[:3]) @ along
    free = np.linalg.svd(jacobian[:3])[2][3:].T  # moves no tool point
    turns, off = jacobian[3:] @ free, turn - jacobian[3:] @ rates
    besides = float(np.linalg.norm(off - turns @ np.linalg.pinv(turns) @ off))
    if besides < _TURNING or float(np.linalg.norm(jacobian[:3] @ rates - along)) > _TURNING:
        return None
    solver = robot.inverse_kinematics
    has_plane = solver.plane is not None and solver.roll_joint is not None
    place = PathPlace(s, s / curve.length, curve.positions(s))
    why = TooFewJoints(curve.kind, len(task.moving), bool(turn.any()), besides, has_plane)
    return ToolPathRefusedError(_on(curve, place, why), place, _before(walked.path, s))


def limit_refusal(tried: Attempt, path: PiecewisePolynomial, s: float, k: int) -> ToolPathRefusedError:
    """Joint ``k`` leaves its limits at ``s`` [m], the first of those that do on the path that was walked."""
    robot, curve = tried.robot, tried.curve
    beyond = _beyond_limits(robot, path)
    worst = max((one for one in beyond if one.joint == k), key=lambda one: one.excess)
    place = PathPlace(s, s / curve.length, curve.positions(s), k, worst.angle)
    at = float(path(s)[k])
    limit = min(robot.limits[k].tolist(), key=lambda bound: abs(bound - at))
    needs = tuple(_needed(tried, path, one) for one in beyond)
    why = AtLimit(
        curve.kind, robot.joints[k].title, limit, needs, tried.chosen, tuple(_other_branches(tried))
    )
    return ToolPathRefusedError(_on(curve, place, why), place, _before(path, s))


class _Need(NamedTuple):
    """The farthest that a joint is beyond one of its limits."""

    joint: int
    angle: float
    """[rad]"""
    s: float
    """where [m]"""
    excess: float
    """[rad]"""


def _beyond_limits(robot: Robot, path: PiecewisePolynomial) -> list[_Need]:
    """All joints that leave their limits on a path, in the order in which they are farthest beyond."""
    low, high = path.extremes_by_piece()
    found: list[_Need] = []
    for joint, (lower, upper) in enumerate(robot.limits.tolist()):
        for extremes, excess in ((low, lower - low[:, joint]), (high, high[:, joint] - upper)):
            piece = int(excess.argmax())
            if excess[piece] > LIMIT_TOLERANCE:
                angle = float(extremes[piece, joint])
                found.append(_Need(joint, angle, _place_of(path, piece, joint, angle), float(excess[piece])))
    return sorted(found, key=lambda one: one.s)


def _place_of(path: PiecewisePolynomial, piece: int, joint: int, value: float) -> float:
    """Where in a piece one coordinate is nearest to an extreme value of it."""
    begin, end = path.breaks[piece : piece + 2].tolist()
    for _ in range(4):
        x = np.linspace(begin, end, 65)
        i = int(np.abs(path(x)[:, joint] - value).argmin())
        begin, end = float(x[max(i - 1, 0)]), float(x[min(i + 1, 64)])
    return 0.5 * (begin + end)


def _needed(tried: Attempt, path: PiecewisePolynomial, need: _Need) -> AngleNeeded:
    joint, share = tried.robot.joints[need.joint], round(100.0 * need.s / tried.curve.length, 1)
    # near the end of a branch a joint turns so fast that the place, as it is said, does not tell the angle
    off = _SHOWN * tried.curve.length
    around = path(np.clip([need.s - off, need.s + off], path.breaks[0], path.breaks[-1]))[:, need.joint]
    turns_fast = share < 100.0 and np.abs(around - need.angle).max() > _TOLD
    return AngleNeeded(joint.title, () if turns_fast else (need.angle,), joint.lower, joint.upper, share)


def end_refusal(tried: Attempt) -> ToolPathRefusedError | ToolPathUnreachableError:
    """The branch ends: out of reach, or no smooth motion leads on."""
    robot, curve, walked = tried.robot, tried.curve, tried.walked
    if not walked.knots:
        place = PathPlace(0.0, 0.0, curve.positions(0.0))
        return ToolPathRefusedError(_on(curve, place, SingularStart(curve.kind)), place, None)
    last = walked.knots[-1]
    s, before = last.s, _before(walked.path, last.s)
    place = PathPlace(s, s / curve.length, curve.positions(s))
    why = _out_of_reach(tried, s)
    if why is not None:
        return ToolPathUnreachableError(_on(curve, place, why), place, before)
    k = int((np.abs(last.slope) / robot.speed_limits).argmax())
    title, rate = robot.joints[k].title, abs(float(last.slope[k]))
    branches = tuple(_other_branches(tried))
    why = BranchEnds(curve.kind, title, rate, tried.beyond, tried.chosen, branches)
    return ToolPathRefusedError(_on(curve, place, why), replace(place, joint=k), before)


def _out_of_reach(tried: Attempt, s: float) -> BeyondReach | None:
    """Why no branch reaches the curve just beyond ``s`` [m], limits not looked at; None: one does."""
    curve = tried.curve
    if tried.reached(min(curve.length, s + _BEYOND * curve.length)) is not False:
        return None
    leaves = BeyondReach(curve.kind, tried.held)
    if tried.searches:
        return replace(leaves, percent=100, why=tried.beyond) if tried.beyond else leaves
    if tried.held == "pitch" and tried.turn is not None and tried.turn.rates(s).any():
        return leaves  # farther on it is another pitch
    # clearer than just beyond: far out, at whole percents, so that the figures hold where they say
    percent, first = 100, math.floor(100.0 * s / curve.length) + 1
    while percent >= first:
        there = 0.01 * percent * curve.length
        solutions = tried.unmet(there)
        if solutions is not None:
            why = solutions.refusal
            if solutions.success:
                why = tried.robot.off_rotation(solutions, solutions[int(solutions.residual_rad.argmin())])
            return replace(leaves, percent=percent, why=why)
        if percent == first:
            break
        percent = (percent + first) // 2
    return leaves


def _other_branches(tried: Attempt) -> list[str]:
    """Names of branches from which the arm follows the whole curve; none where that is not known.

    From the nearest image of each: those that differ by whole turns may come to a limit.
    """
    q, target = tried.start, tried.whole_target(0.0)
    solver = tried.robot.inverse_kinematics
    if tried.searched or not solver.meets(tried.whole_target(tried.curve.length)):
        return []
    solutions = tried.solve(target)
    if not (solutions.success and solutions.complete and solutions.free_joint is None):
        return []  # a continuum of starts, or perhaps not all of them
    # of a branch the image nearest to where the arm stands: the one that it would go to
    starts: dict[str, FloatArray] = {}
    away = np.abs(solutions.q - q).max(axis=1)
    for i in np.argsort(away, kind="stable").tolist():
        if solutions.residual_rad[i] < _TURNED:
            starts.setdefault(str(solutions.branch[i]), solutions.q[i])
    mine = solutions.branch_of(q)
    effort = StepBudget(_OTHER_STEPS)
    others = [name for name in starts if name != mine]  # the nearest first
    return sorted(name for name in others if _may_be_followed(tried, starts[name], effort))


def _may_be_followed(tried: Attempt, start: FloatArray, effort: StepBudget) -> bool:
    """Whether the arm is known to follow the whole curve from a start (n,) [rad], clear of all in the way."""
    if effort.left <= 0 or not stands_clear(tried.robot, start):
        return False
    path = tried.lead(start, effort)
    if path is None:
        return False
    effort.left -= _CHECKED_STEPS
    return passes(tried.robot, timed(tried.robot, path), tool_path=True)


def _on(curve: ToolCurve, place: PathPlace, why: Reason) -> OnCurve:
    x, y, z = place.point.tolist()
    return OnCurve(curve.kind, place.fraction, (x, y, z), why)


def _before(path: PiecewisePolynomial | None, s: float) -> PiecewisePolynomial | None:
    """A path as far as ``s`` [m]; None where that is no way at all."""
    if path is None or s < NO_WAY_M:
        return None
    return path.cut(np.append(path.breaks[path.breaks < s], s))

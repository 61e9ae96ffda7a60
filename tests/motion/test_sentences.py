"""Every figure and every "another branch" of refusals and warnings, recomputed by plain code of its own.

A kind of reason that nothing here knows fails, and so does a sentence with a number that nothing has checked.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.motion.sentence_kit import (
    body_pieces,
    degrees_near,
    features,
    followed,
    gravity_torques,
    isotropy,
    nearest,
    overlap,
    slopes,
    tools,
)

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, InputError
from armctl.facts import (
    AngleLimit,
    AngleNeeded,
    Blocked,
    Overload,
    RateLimit,
    Reason,
    Several,
    Singular,
    say,
    targets,
)
from armctl.motion import Finding, PointToPoint, Trajectory, plan_arc, plan_line, plan_spline, preflight
from armctl.motion.paths.refusals import ToolPathRefusedError, ToolPathUnreachableError
from armctl.robot import Robot, load_robot, shipped_robots

LONG = bool(os.environ.get("ARMCTL_LONG"))
ARMS = shipped_robots() if LONG else ("uzuner", "scorbot", "humanoid")
EACH = int(os.environ.get("ARMCTL_SENTENCES", "1000")) if LONG else 3
"""sentences of each kind, an arm"""
NUMBER = r"-?\d+(?:\.\d+)?"


def joint_of(robot: Robot, title: str) -> int:
    return [joint.title for joint in robot.joints].index(title)


def check_limits(robot: Robot, k: int, low: str, high: str) -> None:
    assert degrees_near(float(low), robot.limits[k, 0]) and degrees_near(float(high), robot.limits[k, 1])


def inside(robot: Robot, rng: np.random.Generator) -> FloatArray:
    """(n,) a configuration inside all limits."""
    while True:
        q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1])
        C = robot.chain.coupling
        if all(
            one.lower <= float(C[one.link] @ q) <= one.upper
            for one in robot.chain.turn_limits
            if C is not None
        ):
            return q


# Refused targets.


class Asked:
    """A target that was refused."""

    def __init__(
        self,
        robot: Robot,
        rng: np.random.Generator,
        point: FloatArray,
        pitch: float | None = None,
        roll: float | None = None,
    ) -> None:
        solutions = robot.inverse(point, pitch, roll)
        self.robot, self.rng, self.point, self.pitch, self.roll = robot, rng, point, pitch, roll
        self.why, self.rolls_aside = parts(solutions.refusal), solutions.arm.roll_moves_tip

    @classmethod
    def anywhere(cls, robot: Robot, rng: np.random.Generator) -> Asked:
        low, high = robot.limits.T
        there = tools(robot, rng.uniform(low, high, (1, robot.n)))[0, :3, 3]
        size = float(np.linalg.norm(there))
        point: FloatArray = there + rng.uniform(-1, 1, 3) * size * rng.choice([0.1, 0.5, 1.5])
        if rng.random() < 0.3:  # near the base axis
            point[:2] = rng.uniform(-0.05, 0.05, 2)
        pitch = float(rng.uniform(-1.5, 1.5)) if rng.random() < 0.3 else None
        return cls(robot, rng, point, pitch, float(rng.uniform(-4, 4)) if rng.random() < 0.1 else None)

    def away(
        self,
        limits: FloatArray,
        *,
        pitched: bool,
        near: dict[int, float] | None = None,
        between: dict[int, tuple[float, float]] | None = None,
        until: float | None = None,
    ) -> float:
        """How far off the arm stays inside some limits [m]: brute force, also from joints at given angles."""
        pitched = pitched and self.pitch is not None
        goal = np.append(self.point, math.sin(self.pitch or 0.0)) if pitched else self.point
        first = self.rng.uniform(limits[:, 0], limits[:, 1], (60 if near else 1, self.robot.n))
        for k, angle in (near or {}).items():
            first[:, k] = angle
        return nearest(
            self.robot, goal, limits, self.rng, pitched=pitched, first=first, between=between, until=until
        )

    def at_its_roll(self, rolled: float | None) -> FloatArray:
        """(n, 2) a whole turn for each joint, but for a roll that moves the tip: ``rolled``, or as asked."""
        wide = wide_open(self.robot)
        if rolled is not None:
            wide[-1] = rolled
        elif self.roll is not None and self.rolls_aside:
            wide[-1] = self.roll
        return wide

    def holds(
        self, point: Sequence[float], pitch: float | None, limits: FloatArray, starts: int = 60
    ) -> bool:
        """Whether the arm can hold its tool somewhere, and at a pitch."""
        goal = np.array([*point, *(() if pitch is None else (math.sin(pitch),))])
        near = nearest(
            self.robot, goal, limits, self.rng, pitched=pitch is not None, starts=starts, until=_SAME
        )
        return near < _SAME


_SAME = 1e-5
"""[m]: what brute force leaves of a distance"""


def parts(reason: Reason | None) -> list[Reason]:
    """A reason and those that follow it."""
    if isinstance(reason, Several):
        return [part for one in reason.reasons for part in parts(one)]
    return [] if reason is None else [reason]


def wide_open(robot: Robot) -> FloatArray:
    """(n, 2) a whole turn for each joint that is not held [rad]."""
    held = (robot.limits[:, 0] == robot.limits[:, 1])[:, None]
    return np.where(held, robot.limits, [-math.pi, math.pi])


def beside_base_axis(robot: Robot, point: FloatArray) -> float:
    """How far a point (3,) is from the upright axis of joint 1 [m], which need not go through the origin."""
    q = np.array([robot.pose("home")] * 2)
    q[1, 0] += np.pi
    middle = robot.forward(q)[:, :2, 3].mean(axis=0)
    return math.hypot(*(point[:2] - middle))


def check_reasons(asked: Asked, reasons: list[Reason], rolled: float | None = None) -> None:
    """All that is said of a target, or of the arm with its last joint at a roll."""
    robot, left = asked.robot, iter(reasons)
    for reason in left:
        match reason:
            case targets.NearestPoint():
                check_nearest(asked, reason, reasons[0])
            case targets.PointReached():
                assert asked.away(robot.limits, pitched=False, until=1e-6) < 1e-6, reasons
            case targets.AtRoll(joint, roll, inner):
                assert joint_of(robot, joint) == robot.n - 1
                check_reasons(asked, parts(inner), roll)
            case targets.Besides(inner):
                check_reasons(asked, parts(inner), rolled)
            case targets.OutOfReach(side=None) | targets.OutOfBound():
                check_links(asked, reason, rolled)
            case targets.OutOfReach():
                check_links(asked, reason, rolled, next(left))
            case targets.InsideCylinder(radius, distance) | targets.BesideAxis(radius, distance):
                assert beside_base_axis(robot, asked.point) == pytest.approx(distance, abs=1e-9)
                wide = asked.at_its_roll(rolled)
                assert distance < radius and asked.away(wide, pitched=True, between={}) > 1e-6
            case targets.LimitsForbid(ways, pitched):
                for way in ways:
                    check_needs(asked, way.needs, pitched=pitched)
            case targets.JointsNeeded(needs, least=True):
                check_needs(asked, needs, pitched=True)
            case AngleNeeded(joint, (angle,), low, high):
                assert asked.roll is not None and [low, high] == robot.limits[joint_of(robot, joint)].tolist()
                assert abs(math.remainder(angle - asked.roll, math.tau)) < 1e-9, reasons
            case _:
                check_pitch(asked, reason)


def check_links(
    asked: Asked,
    why: targets.OutOfReach | targets.OutOfBound,
    rolled: float | None,
    held: Reason | None = None,
) -> None:
    robot, wide = asked.robot, asked.at_its_roll(rolled)
    if why.distance_m is not None:
        assert (why.distance_m - why.length_m) * (1 if why.far else -1) == pytest.approx(why.miss_m, abs=1e-9)
    if held is not None:  # the base stays inside its limits: with them the figure is another one
        assert isinstance(held, targets.JointsNeeded)
        ((base, (angle,), low, high),) = ((n.joint, n.angles, n.low, n.high) for n in held.needs)
        assert joint_of(robot, base) == 0 and [low, high] == robot.limits[0].tolist()
        assert not low <= angle <= high
        assert asked.away(wide, pitched=False, between={}) < why.miss_m - _SAME
        wide[0] = robot.limits[0]
    exact = isinstance(why, targets.OutOfReach) and not why.pitched
    if rolled is None and exact and (why.distance_m is None or why.point == "target"):
        assert asked.away(wide, pitched=False, between={}) == pytest.approx(why.miss_m, abs=_SAME), why
    else:  # a bound, or a wrist at a pitch: the links alone do not reach it
        assert asked.away(wide, pitched=True, between={}) > 1e-6, why


def check_nearest(asked: Asked, why: targets.NearestPoint, first: Reason) -> None:
    robot, pitched = asked.robot, why.orientation == "pitch kept"
    assert math.dist(why.point_m, asked.point) == pytest.approx(why.away_m, abs=1e-9)
    pitch = asked.pitch if pitched else None
    assert asked.holds(why.point_m, pitch, robot.limits, 300 if pitched else 60), why
    # with a pitch kept, or a roll that moves the tool point, others may be nearer; never the other way
    if pitched or (asked.roll is not None and asked.rolls_aside) or not robot.inverse_kinematics.complete:
        return
    assert asked.away(robot.limits, pitched=False) >= why.away_m - _SAME, why
    wide = robot.limits.copy()
    for one in why.held:  # without the limits that hold the tool off it comes nearer; without such, links do
        k = joint_of(robot, one.joint)
        assert np.abs(robot.limits[k] - one.limit).min() < 1e-6, why
        wide[k] += [-0.1, 0.1]
    if why.held:
        assert asked.away(wide, pitched=False) < why.away_m - 1e-6, why
        return
    match first:
        case targets.OutOfReach(far=True, miss_m=miss, distance_m=float(), point="target", side=None):
            assert why.away_m == pytest.approx(miss, abs=_SAME), first  # one figure for one thing
        case _:
            pass


def check_pitch(asked: Asked, why: Reason) -> None:
    robot, wide = asked.robot, np.tile([-math.pi, math.pi], (asked.robot.n, 1))
    match why:
        case targets.PitchOutside(low, high, near):
            assert low <= near <= high and asked.away(robot.limits, pitched=True) > 1e-6, why
            assert all(asked.holds(asked.point, pitch, robot.limits) for pitch in (low, high)), why
        case targets.PitchByPosition(pitches):
            assert asked.away(wide, pitched=True) > 1e-6, why
            assert all(asked.holds(asked.point, pitch, wide) for pitch in pitches), why
        case targets.PitchNotFound(_, pitch, near):
            assert asked.pitch == pitch and asked.away(robot.limits, pitched=True) > 1e-7, why
            assert asked.holds(asked.point, near, robot.limits, 300), why
        case targets.NotFound():
            assert asked.away(robot.limits, pitched=True) > 1e-7, why
        case targets.NoneWithoutLimits():
            assert asked.away(wide_open(robot), pitched=True) > 1e-7, why
        case targets.PitchOfRods(kept, pitch):
            q = asked.rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (5, robot.n))
            assert tools(robot, q)[:, 2, 2] == pytest.approx(math.sin(kept), abs=1e-9)
            assert asked.pitch == pitch
        case _:
            assert isinstance(why, targets.NoSuchAngle | targets.NotInOrientation), why


def widened(robot: Robot, needs: Sequence[AngleNeeded], at: int = 0) -> tuple[FloatArray, dict[int, float]]:
    """Limits (n, 2) with those of all the joints named as wide as is said, and what these need [rad]."""
    wide, near = robot.limits.copy(), dict[int, float]()
    for need in needs:
        if need.joint in {one.name for one in robot.chain.turn_limits}:
            continue
        k, angle = joint_of(robot, need.joint), need.angles[at % len(need.angles)]
        assert [need.low, need.high] == robot.limits[k].tolist() and not need.low < angle < need.high, needs
        near[k] = angle
        wide[k] = min(need.low, angle - 1e-5), max(need.high, angle + 1e-5)
    return wide, near


def check_needs(asked: Asked, needs: Sequence[AngleNeeded], *, pitched: bool) -> None:
    """With the limits of all the joints named widened to what is said, the arm gets there."""
    for which in range(max((len(need.angles) for need in needs), default=0)):
        wide, near = widened(asked.robot, needs, which)
        between = {one.link: (one.lower, one.upper) for one in asked.robot.chain.turn_limits}
        for one in asked.robot.chain.turn_limits:
            for angle in (need.angles[0] for need in needs if need.joint == one.name):
                assert not one.lower < angle < one.upper, needs
                between[one.link] = min(one.lower, angle - 1e-5), max(one.upper, angle + 1e-5)
        assert asked.away(wide, pitched=pitched, near=near, between=between, until=1e-6) < 1e-6, needs


@pytest.mark.parametrize("name", ARMS)
def test_of_targets(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(len(name))
    checked = 0
    while checked < EACH:
        asked = Asked.anywhere(robot, rng)
        check_reasons(asked, asked.why)
        checked += bool(asked.why)


@pytest.mark.parametrize("point", [(-0.1458, -0.0261, 0.9279), (-0.1843, -0.0349, 0.9379)])
def test_a_target_that_the_base_cannot_face_is_too_far_by_one_figure(point: tuple[float, ...]) -> None:
    """Facing it the arm would come nearer than over the back, which is all that the base allows."""
    asked = Asked(load_robot("scorbot"), np.random.default_rng(1), np.array(point))
    far, held, *_ = asked.why
    assert isinstance(far, targets.OutOfReach) and far.side == "over the back"
    assert isinstance(held, targets.JointsNeeded) and held.side == "facing" and held.needs[0].joint == "Waist"
    check_reasons(asked, asked.why)


# Refused orientations.


def check_orientation(
    robot: Robot, pose: FloatArray, q: FloatArray, why: list[Reason], rng: np.random.Generator
) -> None:
    there = tools(robot, q[None])[0]
    assert np.abs(there[:3, 3] - pose[:3, 3]).max() < 1e-9, why
    off = math.acos(min((np.trace(there[:3, :3].T @ pose[:3, :3]) - 1) / 2, 1.0))
    assert isinstance(why[0], targets.OffRotation) and why[0].angle == pytest.approx(off, rel=1e-3)
    goal = np.concatenate([pose[:3, 3], pose[:3, :3].ravel()])
    assert nearest(robot, goal, robot.limits, rng, turned=True) > 1e-7, why
    match why[1:]:
        case [targets.OrientationImpossible(proven)]:
            if proven:  # a pose 1e-8 m too far costs 1e-4 rad at the point
                assert nearest(robot, goal, wide_open(robot), rng, turned=True, starts=200) > 1e-9, why
        case [targets.OrientationNeeds(way)]:
            wide, near = widened(robot, way.needs)
            first = rng.uniform(*robot.limits.T, (200, robot.n))
            for k, angle in near.items():
                first[:, k] = angle
            assert nearest(robot, goal, wide, rng, turned=True, first=first, until=1e-6) < 1e-6, why
        case _:
            raise AssertionError(why)


@pytest.mark.parametrize("name", (*ARMS, *(() if LONG else ("ar4",))))
def test_of_orientations(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(300 + len(name))
    checked = 0
    while checked < EACH:
        pose = tools(robot, inside(robot, rng)[None])[0]
        axis = rng.normal(size=3)
        pose[:3, :3] = (
            Rotation.from_rotvec(axis * rng.uniform(0, 2.0) / np.linalg.norm(axis)).as_matrix()
            @ (pose[:3, :3])
        )
        solutions = robot.inverse(pose[:3, 3], rotation=pose[:3, :3])
        assert solutions.success, solutions.explanation
        if why := parts(robot.off_rotation(solutions, solutions[0])):
            check_orientation(robot, pose, solutions[0], why, rng)
            checked += 1


# Lines and arcs.

PLACE = re.compile(
    rf"at ({NUMBER}) s, (\d+) % of the (line|arc) \(x ({NUMBER}), y ({NUMBER}), z ({NUMBER}) mm\): (.*)"
)
NEED = re.compile(rf"at ({NUMBER}) % (.+?) would need ({NUMBER})°, its limits are ({NUMBER})° … ({NUMBER})°")

FREER = re.compile(r"; with (the tool \w+ free|only the tool pitch kept) the arm can follow it$")
BEFORE_THE_END = re.compile(
    rf"before this branch ends, (.+?) would have to leave its limits of ({NUMBER})° … ({NUMBER})°"
)


class Led:
    """A line or an arc from a random start."""

    def __init__(self, robot: Robot, rng: np.random.Generator) -> None:
        self.robot, self.rng = robot, rng
        self.start: FloatArray = inside(robot, rng)
        self.tool = tools(robot, self.start[None])[0]
        begin, size = self.tool[:3, 3], float(np.linalg.norm(self.tool[:3, 3]))
        self.end: FloatArray = begin + rng.uniform(-0.5, 0.5, 3) * size
        self.kept = (
            bool(rng.random() < 0.7) and robot.inverse_kinematics.pitch_and_roll(self.start)[0] is not None
        )
        self.via = begin + rng.uniform(-0.3, 0.3, 3) * size if rng.random() < 0.3 else None

    def plan(self, start: FloatArray, mode: Literal["kept", "free"] | None = None) -> Trajectory:
        mode = mode or ("kept" if self.kept else "free")
        if self.via is None:
            return plan_line(self.robot, start, self.end, pitch=mode)
        return plan_arc(self.robot, start, self.via, self.end, pitch=mode)

    def points(self, shares: FloatArray) -> FloatArray:
        """(k, 3) of the curve; the circle through three points by its centre."""
        a, c = self.tool[:3, 3], self.end
        if self.via is None:
            return a + shares[:, None] * (c - a)
        b = self.via
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal)
        rows = np.array([b - a, c - a, normal])
        right = [0.5 * (b @ b - a @ a), 0.5 * (c @ c - a @ a), normal @ a]
        centre = np.linalg.solve(rows, right)
        x = a - centre
        y = np.cross(normal, x)
        sweep = math.atan2((c - centre) @ y, (c - centre) @ x) % math.tau
        angle = sweep * shares[:, None]
        return centre + np.cos(angle) * x + np.sin(angle) * y

    @property
    def held(self) -> list[int]:
        roll = self.robot.inverse_kinematics.roll_joint
        still = np.flatnonzero(self.robot.limits[:, 0] == self.robot.limits[:, 1]).tolist()
        return sorted({*still, *([] if roll is None else [roll])})

    @property
    def pitched(self) -> bool:
        """Whether the pitch is one of the equations: three joints cannot turn the tool besides."""
        return self.kept and self.robot.n - len(self.held) > 3

    @property
    def decided(self) -> bool:
        """As many equations as joints: the branch decides the way."""
        return self.robot.n - len(self.held) == 3 + self.pitched

    def walk(self, start: FloatArray, share: float, count: int = 160) -> FloatArray | None:
        sine = float(self.tool[2, 2]) if self.pitched else None
        return followed(self.robot, start, self.points(np.linspace(0.0, share, count)), sine, self.held)


def check_led(led: Led, error: ToolPathRefusedError | ToolPathUnreachableError) -> None:
    whole = str(error)
    if freer := FREER.search(whole):
        led.plan(led.start, "free" if freer[1].endswith("free") else "kept")
    found = PLACE.fullmatch(FREER.sub("", whole))
    assert found is not None, whole
    percent, said = float(found[2]), found[7]
    share = error.place.fraction
    point = led.points(np.array([share]))[0]
    assert abs(percent - 100 * share) <= 0.51
    assert np.abs(1000 * point - [float(value) for value in found.groups()[3:6]]).max() <= 0.06, str(error)
    if said.startswith("here it leaves"):
        check_reach_words(led, said)
    elif "is at its limit of" in said:
        check_limit_words(led, share, said, str(error))
    elif fast := re.search(rf"(?:^|, )([^,]+) would have to turn by ({NUMBER})° a mm, and more just", said):
        assert ("on the best way that was found, " in said) != led.decided, str(error)
        if share > 0 and error.before is not None and led.decided:
            q = error.before(error.before.high)
            assert isotropy_with_pitch(led, q) < 1e-3, str(error)
            moving = [k for k in range(led.robot.n) if k not in led.held]
            J = slopes(lambda q: features(led.robot, q, pitched=led.pitched), q[None])[0][:, moving]
            before, behind = led.points(np.array([share - 1e-6, share + 1e-6]))
            along = np.append(behind - before, 0.0)[: len(J)] / np.linalg.norm(behind - before)
            rate = abs(np.linalg.lstsq(J, along, rcond=None)[0][moving.index(joint_of(led.robot, fast[1]))])
            assert abs(math.degrees(rate) / 1000 - float(fast[2])) <= 0.5 + 0.02 * float(fast[2]), str(error)
    else:
        assert "stands in a singularity" in said and isotropy_with_pitch(led, led.start) < 1e-3, str(error)
    check_other_branches(led, str(error))


def isotropy_with_pitch(led: Led, q: FloatArray) -> float:
    moving = [k for k in range(led.robot.n) if k not in led.held]
    J = slopes(lambda q: features(led.robot, q, pitched=led.pitched), q[None])[0][:, moving]
    J[:3] /= np.linalg.norm(led.tool[:3, 3])
    sizes = np.linalg.svd(J, compute_uv=False)
    return float(sizes[min(J.shape) - 1] / sizes[0])


def check_limit_words(led: Led, share: float, said: str, text: str) -> None:
    robot = led.robot
    at = re.match(rf"(?:on the best way that was found, )?(.+?) is at its limit of ({NUMBER})°; ", said)
    assert at is not None, text
    k, limit = joint_of(robot, at[1]), float(at[2])
    assert any(degrees_near(limit, bound) for bound in robot.limits[k]), text
    needs = NEED.findall(said)
    ends = BEFORE_THE_END.findall(said)
    assert len(needs) + len(ends) == said.count(" would "), text
    named = {joint_of(robot, title) for title in [*(need[1] for need in needs), *(end[0] for end in ends)]}
    assert k in named, text
    for title, low, high in ends:
        check_limits(robot, joint_of(robot, title), low, high)
    for _, title, angle, low, high in needs:
        check_limits(robot, joint_of(robot, title), low, high)
        assert not float(low) < float(angle) < float(high), text
    if "on the best way" in said:
        assert not led.decided
        return  # which way that is, nobody else can say
    if not led.decided:
        return
    way = led.walk(led.start, max(share, 1e-6))
    if way is None:  # beside a straight elbow the first steps must be small
        way = led.walk(led.start, max(share, 1e-6), 1600)
    assert way is not None, text
    slope = np.abs(way[-1] - way[-2])[k] * len(way) / max(share, 1e-6)
    within = math.radians(0.02) + slope * 1e-4
    assert abs(way[-1, k] - math.radians(limit)) <= within, text
    over = np.maximum(robot.limits[:, 0] - way, way - robot.limits[:, 1])
    assert (over <= max(1e-3, within)).all(), text
    for place, title, angle, *_ in needs:
        way = led.walk(led.start, float(place) / 100, 400)
        if way is None:
            continue  # small steps do not pass as near to a singularity
        j = joint_of(robot, title)
        slope = abs(way[-1, j] - way[-2, j]) * 400 * 100 / max(float(place), 0.1)
        within = 0.02 + math.degrees(slope * 0.0005)
        assert abs(math.degrees(way[-1, j]) - float(angle)) <= within, (text, math.degrees(way[-1, j]))
        over = (way < robot.limits[:, 0] - 1e-6) | (way > robot.limits[:, 1] + 1e-6)
        assert set(np.flatnonzero(over.any(axis=0)).tolist()) <= named, text


def check_reach_words(led: Led, said: str) -> None:
    found = re.fullmatch(r"here it leaves what the arm reaches(?: with that pitch)?; at (\d+) %, (.*)", said)
    if found is None:
        assert said.endswith("; move the line") or said.endswith("; move the arc"), said
        return
    pitch = math.asin(float(np.clip(led.tool[2, 2], -1, 1))) if "with that pitch" in said else None
    asked = Asked(led.robot, led.rng, led.points(np.array([float(found[1]) / 100]))[0], pitch)
    # of what is searched for only the bound is said
    reasons = next(some for some in (asked.why, asked.why[:1]) if found[2] == say(Several(tuple(some)), "en"))
    check_reasons(asked, reasons)


def check_other_branches(led: Led, text: str) -> None:
    found = re.search(r"start on another branch \((.*) follows? the whole", text)
    if found is None:
        assert "another branch" not in text
        return
    robot = led.robot
    roll = robot.inverse_kinematics.roll_joint
    solutions = robot.inverse(
        led.tool[:3, 3],
        robot.inverse_kinematics.pitch_and_roll(led.start)[0] if led.kept else None,
        None if roll is None else float(led.start[roll]),
    )
    mine = solutions.branch_of(led.start)
    for name in found[1].split(" or "):
        assert name != mine, text
        starts = solutions.q[solutions.branch == name]
        assert len(starts), text
        start = starts[np.abs(starts - led.start).max(axis=1).argmin()]  # the nearest of its images
        assert np.abs(tools(robot, start[None])[0, :3, 3] - led.tool[:3, 3]).max() < 1e-9
        led.plan(start)  # and with all that a plan checks
        if led.decided:
            way = led.walk(start, 1.0, 200)
            if way is not None:
                kept = (way >= robot.limits[:, 0] - 1e-6) & (way <= robot.limits[:, 1] + 1e-6)
                assert kept.all(), text


@pytest.mark.parametrize("name", ARMS)
def test_of_lines_and_arcs(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(100 + len(name))
    checked = 0
    while checked < EACH:
        led = Led(robot, rng)
        try:
            led.plan(led.start)
        except (ToolPathRefusedError, ToolPathUnreachableError) as error:
            check_led(led, error)
            checked += 1
        except InputError:
            raise
        except ArmctlError:
            continue  # the pre-flight's, below


def test_a_way_that_was_chosen_is_not_said_to_be_all_there_is() -> None:
    """With a pitch of its own the arm would stand straight; with another one it would not."""
    start = [-0.7710712417709595, 2.38297004085192, -1.447441799674391, -0.4541368889338473, -0.53232299369]
    via, end = [-0.004007934561, -0.107380667264, 0.352919769577], [0.102039644699, -0.1694759577, 0.487133]
    with pytest.raises(ToolPathRefusedError, match=r"on the best way that was found, Elbow .* singularity"):
        plan_arc(load_robot("uzuner"), start, via, end, pitch="free")


# The pre-flight.


def motions(robot: Robot, rng: np.random.Generator) -> Iterator[tuple[Trajectory, bool]]:
    a, b, c = (inside(robot, rng) for _ in range(3))
    yield PointToPoint.lasting(a, b, float(rng.uniform(0.2, 4.0))), False
    yield PointToPoint.lasting(a, b + 0.2 * rng.random(robot.n), 5.0), True
    yield plan_spline(robot, [a, b, c], checked=False), True


def deepest_mm(robot: Robot, motion: Trajectory) -> float:
    """How deep any piece is below the floor that may not be [mm], at many times of a motion."""

    def depths(q: FloatArray) -> FloatArray:
        lowest = [corners[..., 2].min(axis=1) - margin for corners, margin in body_pieces(robot, q)]
        return 1000 * (robot.floor_z - np.column_stack([*lowest, tools(robot, q)[:, 2, 3]]))

    hulls = [piece.hull for piece in robot.collision.capsules]
    radii = [piece.radius for piece in robot.collision.capsules]
    thick = [radius if hull is None else hull.thickness for hull, radius in zip(hulls, radii, strict=True)]
    thick = 1000 * np.array([*thick, 0.0])
    still = np.array([piece.link < 0 for piece in robot.collision.capsules] + [False])
    posed = depths(np.array(list(robot.poses.values()))).max(axis=0)
    allowed = np.maximum(np.clip(posed, 0.0, thick), depths(motion.start[None])[0]) + 0.5
    found = depths(motion.sample(np.linspace(0.0, motion.duration, 241)).q)
    return float(np.where((found > allowed) & ~still, found, -math.inf).max())


def check_finding(robot: Robot, motion: Trajectory, finding: Finding, payload: float) -> None:
    assert finding.time is not None
    state = motion.sample(np.array([finding.time]))
    q, reason = state.q[0], finding.reason
    titles = [joint.title for joint in robot.joints]
    match reason:
        case AngleLimit(part, angle, low, high, between_links=True):
            (limit,) = (one for one in robot.chain.turn_limits if one.name == part)
            assert (low, high) == (limit.lower, limit.upper) and not low <= angle <= high
            assert angle == pytest.approx(float(q @ np.array(robot.chain.coupling)[limit.link]), abs=1e-3)
        case AngleLimit(part, angle, low, high):
            k = titles.index(part)
            assert [low, high] == robot.limits[k].tolist() and not low <= angle <= high
            assert angle == pytest.approx(q[k], abs=1e-6)
        case RateLimit(part, rate, value, limit):
            k, order = titles.index(part), ("speed", "acceleration", "jerk").index(rate)
            limits = (robot.speed_limits, robot.acceleration_limits, robot.jerk_limits)[order]
            told = abs((state.velocity, state.acceleration, state.jerk)[order][0, k])
            assert limit == limits[k] < value == pytest.approx(told, rel=0.01, abs=1e-3)
            assert value / reason.longer ** (order + 1) <= limit * 1.001
        case Blocked("floor", part, depth_m=depth):
            pieces = zip(robot.collision.capsules, body_pieces(robot, q[None]), strict=True)
            lowest = [float(c[..., 2].min()) - margin for piece, (c, margin) in pieces if piece.part == part]
            if part == "the tool":
                lowest = [*lowest, tools(robot, q[None])[0, 2, 3]]
            assert min(abs(robot.floor_z - height - depth) for height in lowest) <= 1e-5
            assert 1000 * depth >= deepest_mm(robot, motion) - 0.2
        case Blocked("self-collision", part, other, depth):
            bodies = [(corners[0], margin) for corners, margin in body_pieces(robot, q[None])]
            pieces = robot.collision.capsules
            depths = [
                overlap(bodies[i], bodies[j])
                for i, j in robot.collision.pairs
                if (pieces[j].part, pieces[i].part) == (part, other)
            ]
            # of hulls armctl knows a lower bound of the gap: the way out that it found, or a little more
            longer = 5e-4 if any(piece.hull is not None for piece in pieces) else 1e-5
            assert any(-1e-5 <= depth - one <= longer for one in depths)
        case Singular(ratio):
            assert ratio == pytest.approx(isotropy(robot, q), abs=5e-4)
        case Overload(part, torque=torque, stall=stall):
            k = titles.index(part)
            assert torque == pytest.approx(gravity_torques(robot, q, payload)[k], abs=1e-3)
            assert stall == robot.joints[k].stall_torque
        case _:
            assert finding.kind == "rest", finding


@pytest.mark.parametrize("name", ARMS)
def test_of_the_preflight(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(200 + len(name))
    checked = 0
    while checked < 3 * EACH:
        for motion, tool_path in motions(robot, rng):
            payload = float(rng.uniform(0.0, 1.0))
            for finding in preflight(robot, motion, payload, tool_path=tool_path):
                check_finding(robot, motion, finding, payload)
                checked += 1

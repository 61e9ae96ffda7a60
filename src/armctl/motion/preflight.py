"""Pre-flight: all checks of one motion, before the arm makes it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, pairwise
from typing import Literal, NamedTuple

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError
from armctl.facts import (
    AngleLimit,
    Found,
    MotionEndsMoving,
    Overload,
    Rate,
    RateLimit,
    Reason,
    Singular,
    SpeedJump,
    advice,
    say,
    what,
)
from armctl.kinematics import GravityModel
from armctl.kinematics.frames import LinkFrames
from armctl.kinematics.target import checked_number
from armctl.kinematics.velocity import NEAR
from armctl.motion.clearance import FLOOR_TOLERANCE_M, Gaps, sources
from armctl.motion.trajectory import JoinedTrajectory, KnowsPeaks, Trajectory, joined_peaks, peaks_of
from armctl.robot import Robot

_TRAVEL = math.radians(6)
"""No joint moves farther between two samples, as far as the peaks of the motion are known."""
_MOST, _MOST_IN_ALL = 4000, 40_000
_FINEST_S = 1e-3
_FEWEST = 32
_LOOKS, _NARROWED = 17, 3
"""times that are looked at, and how often, to find the worst place between two samples"""
_AS_DEEP_M = 5e-5
"""how much less deep a gap may be at the time that is told"""

Severity = Literal["error", "warning"]
"""error: the motion is refused. warning: it is shown, and the motion may be run."""
Kind = Literal[
    "limits",
    "reach",
    "speed",
    "acceleration",
    "jerk",
    "rest",
    "floor",
    "obstacle",
    "self-collision",
    "singularity",
    "torque",
    "program",
]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong with a motion or a program."""

    reason: Reason
    time: float | None = None
    """when it is worst, from the start of the motion [s]; None: not a matter of time"""
    part: str = ""
    """the joint, or the part of the arm"""
    kind: Kind = "program"
    """which check found it"""
    severity: Severity = "error"
    step: int | None = None
    """index of the program's step; None: no step, or the program as a whole"""
    digits: int = 2
    """decimals with which the text says the time"""

    @property
    def what(self) -> str:
        """What is wrong, with numbers, in words."""
        return what(self.reason)

    @property
    def mend(self) -> str:
        """What to do about it; empty where ``what`` says it."""
        return advice(self.reason)

    @property
    def fact(self) -> Found:
        """All of it as one reason, for an error that carries it."""
        return Found(self.reason, self.part, self.time, self.digits, self.step)

    def __str__(self) -> str:
        return say(self.fact)


def require_robot(robot: object) -> None:
    """Raises ``InputError`` for anything else, such as a name."""
    if not isinstance(robot, Robot):
        raise InputError(f"a robot is loaded with armctl.load_robot(NAME), it is not {robot!r}")


def preflight(
    robot: Robot,
    trajectory: Trajectory,
    payload_kg: float | None = None,
    *,
    tool_path: bool = False,
    at_rest: bool = True,
) -> list[Finding]:
    """Check one motion: errors first, then warnings, each in the order of time.

    - Limits of joints and of angles between links, speed and acceleration, by the peaks of the trajectory;
      jerk, where the profile limits it. The arm is at rest at both ends (``at_rest``), and has the same
      speed on both sides of each seam.
    - Floor, obstacles and self-collision, over the whole motion, with jaws where they are
      (``Robot.gripping``).
    - Singularities of the tool point, at the samples: an error where a ``tool_path`` needs the direction that
      is lost, else a warning.
    - Gravity torque (with ``payload_kg`` instead of the robot file's) against stall torque, at the samples.
      The ``effort`` of a URDF file only warns.
    Raises ``InputError``: the trajectory has another number of joints, or a value that is not finite.
    """
    motion, links, findings = _but_for_gaps(robot, trajectory, payload_kg, tool_path, at_rest)
    found = [*findings, *_gap_findings(motion, links)]
    return sorted(found, key=lambda finding: (finding.severity != "error", finding.time or 0.0))


def passes(
    robot: Robot,
    trajectory: Trajectory,
    payload_kg: float | None = None,
    *,
    tool_path: bool = False,
    warned: bool = True,
) -> bool:
    """Whether ``preflight`` finds no error, and no warning either unless ``warned``.

    Quicker than to ask what it finds: nobody asks here where a gap is deepest. Raises as ``preflight``.
    """
    motion, links, findings = _but_for_gaps(robot, trajectory, payload_kg, tool_path, at_rest=True)
    if any(not warned or finding.severity == "error" for finding in findings):
        return False
    return all(_closed(motion, source, links) is None for source in sources(robot))


def _but_for_gaps(
    robot: Robot, trajectory: Trajectory, payload_kg: float | None, tool_path: bool, at_rest: bool
) -> tuple[SampledMotion, LinkFrames, Iterator[Finding]]:
    """The samples of a motion, where the links are at them, and all that is found but for closed gaps."""
    require_robot(robot)
    motion = SampledMotion(robot, trajectory)
    if payload_kg is not None and checked_number(payload_kg, "a payload") < 0.0:
        raise InputError(f"a payload must be at least 0 kg, got {payload_kg}")
    links = robot.body_frames(motion.q)
    findings = chain(
        _limit_findings(motion),
        _turn_findings(motion),
        *(_rate_findings(motion, kind) for kind in _RATES),
        _seam_findings(motion),
        _rest_findings(motion) if at_rest else (),
        _singularity_findings(motion, tool_path=tool_path),
        _torque_findings(motion, links, payload_kg),
    )
    return motion, links, findings


def require_clear(
    robot: Robot,
    trajectory: Trajectory,
    payload_kg: float | None = None,
    *,
    tool_path: bool = False,
) -> None:
    """Raise ``MotionRefusedError`` with the first error of ``preflight``, and how many more there are."""
    findings = preflight(robot, trajectory, payload_kg, tool_path=tool_path)
    count = sum(finding.severity == "error" for finding in findings)
    if count:
        raise MotionRefusedError(replace(findings[0].fact, more=count - 1))


def require_gaps(robot: Robot, trajectory: Trajectory) -> None:
    """Raise ``MotionRefusedError`` where a motion would touch something, and check nothing else.

    For the rest of a motion that was checked already, with its jaws elsewhere or another part between them.
    """
    motion = SampledMotion(robot, trajectory)
    for finding in _gap_findings(motion, robot.body_frames(motion.q)):
        raise MotionRefusedError(finding.fact)


class SampledMotion:
    """The m samples of a motion, and its extremes between them.

    Where a trajectory knows its peaks, no joint moves more than 6° between two samples; another one is
    sampled every millisecond, at most 4,000 times. Each part of a joined trajectory is sampled alone.
    """

    def __init__(self, robot: Robot, trajectory: Trajectory) -> None:
        """InputError: another number of joints, or a value that is not finite."""
        if not isinstance(trajectory, Trajectory):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise InputError(f"a motion is a trajectory, not {trajectory!r}")
        if trajectory.start.shape != (robot.n,) or trajectory.end.shape != (robot.n,):
            raise InputError(f"{robot.name} has {robot.n} joints, the trajectory has {len(trajectory.start)}")
        parts = trajectory.leaves() if isinstance(trajectory, JoinedTrajectory) else [(trajectory, 0.0)]
        times, speeds = list[FloatArray](), list[FloatArray]()
        states: list[tuple[FloatArray, FloatArray, FloatArray]] = []
        left, peaks = _MOST_IN_ALL, [peaks_of(part) for part, _ in parts]
        for (part, begins), speed in zip(parts, [one.speed for one in peaks], strict=True):
            duration = part.duration
            if not (math.isfinite(duration) and duration >= 0):
                raise InputError(f"a trajectory cannot take {duration} s")
            if isinstance(part, KnowsPeaks):
                travel = min(float(speed.max()) * duration / _TRAVEL, _MOST)
                count = max(2 * math.ceil(0.5 * travel), 2)
            else:
                count = min(max(math.ceil(duration / _FINEST_S), _FEWEST), _MOST)
            left -= count - 2  # the fewest
            if left < 0:
                raise InputError(
                    f"a motion of {len(parts)} parts that needs more than {_MOST_IN_ALL} samples is too long "
                    "to check; join fewer"
                )
            time = np.linspace(0.0, duration, count + 1) if duration else np.zeros(1)
            state = part.sample(time)
            times.append(begins + time)
            speeds.append(np.broadcast_to(speed, (len(time), robot.n)))
            states.append((state.q, state.velocity, state.acceleration))
            for name, values in zip(("angle", "speed", "acceleration"), states[-1], strict=True):
                if values.shape != (len(time), robot.n) or not np.isfinite(values).all():
                    raise InputError(f"the trajectory gives a joint {name} that is not a finite number")
        self.robot, self.trajectory = robot, trajectory
        self.time = np.concatenate(times)
        """(m,) rising [s]"""
        self.q, self.velocity, self.acceleration = map(np.concatenate, zip(*states, strict=True))
        """(m, n) [rad], [rad/s], [rad/s²]"""
        self.speed = np.concatenate(speeds)
        """(m, n) largest joint speeds of the part that each sample belongs to [rad/s]"""
        self.peaks = joined_peaks(peaks)
        ends = [
            (begins, state[1]) for (_, begins), state in zip(parts, states, strict=True) if len(state[1]) > 1
        ]
        self.seams = [(at, after[0] - before[-1]) for (_, before), (at, after) in pairwise(ends)]
        """when each part but the first begins [s], and how far the joint speeds jump there (n,) [rad/s]"""

    def told(self, time: float, holds: Callable[[float], bool]) -> tuple[float, int]:
        """A time as a text says it [s], and its decimals: hundredths, if it holds there, or finer."""
        for digits in (2, 3, 4):
            rounded = min(round(time, digits), float(self.time[-1]))
            if holds(rounded):
                return rounded, digits
        return time, 4

    def beside(self, at: int) -> tuple[float, float]:
        """The times of the samples before and behind one [s]."""
        return float(self.time[max(at - 1, 0)]), float(self.time[min(at + 1, len(self.time) - 1)])

    def least_at(self, measure: Callable[[FloatArray], FloatArray], begin: float, end: float) -> float:
        """When a measure of the motion at times (m,) [s] is least between two samples [s]."""
        when = begin
        for _ in range(_NARROWED):
            times = np.linspace(begin, end, _LOOKS)
            at = int(measure(times).argmin())
            begin, when, end = times[[max(at - 1, 0), at, min(at + 1, _LOOKS - 1)]].tolist()
        return when

    def rates(self, time: FloatArray, order: int) -> FloatArray:
        """(m, n) size of one of ``_RATES`` of the joints [rad/s], [rad/s²], [rad/s³] at times (m,) [s]."""
        state = self.trajectory.sample(time)
        return np.abs((state.velocity, state.acceleration, state.jerk)[order])


# Joint limits, speeds, accelerations and jerks, rest at both ends.

_RATES: tuple[Rate, ...] = ("speed", "acceleration", "jerk")
_ANGLE_TOLERANCE = 1e-9
_RATE_TOLERANCE = 1e-6
_REST_SPEED = 1e-6
_MOST_TIMES = 400
"""times that are looked at for the place of a peak"""
_AS_FAST = 0.999


def _limit_findings(motion: SampledMotion) -> Iterator[Finding]:
    robot, peaks = motion.robot, motion.peaks
    lower, upper = robot.limits.T
    below, above = lower - peaks.low, peaks.high - upper
    for j in np.flatnonzero(np.maximum(below, above) > _ANGLE_TOLERANCE).tolist():
        joint, sense = robot.joints[j], 1.0 if below[j] >= above[j] else -1.0
        worst = peaks.low[j] if sense > 0.0 else peaks.high[j]
        yield Finding(
            AngleLimit(joint.title, float(worst), joint.lower, joint.upper),
            _when_least(motion, j, sense),
            joint.title,
            "limits",
        )


def _turn_findings(motion: SampledMotion) -> Iterator[Finding]:
    """Angles between links of a parallel linkage beyond their limits."""
    chain = motion.robot.chain
    if not chain.turn_limits:
        return
    excess = chain.turn_excess(motion.q)
    change = np.diff(motion.time)[:, None] * (motion.speed[1:] @ np.abs(chain.turn_rows()).T)
    most = excess.max(axis=0) + 0.5 * change.max(axis=0, initial=0.0)
    for k in np.flatnonzero(most > 0.0).tolist():
        limit = chain.turn_limits[k]

        def room(time: FloatArray, k: int = k) -> FloatArray:
            return -chain.turn_excess(motion.trajectory.sample(time).q)[:, k]

        at = int(excess[:, k].argmax())
        when = motion.least_at(room, *motion.beside(at))
        if room(np.array([when]))[0] < -_ANGLE_TOLERANCE:
            turn = float(chain.turns(motion.trajectory.sample(np.array([when])).q)[0, limit.link])
            yield Finding(
                AngleLimit(limit.name, turn, limit.lower, limit.upper, between_links=True),
                when,
                limit.name,
                "limits",
            )


def _when_least(motion: SampledMotion, j: int, sense: float) -> float:
    """When the angle of joint ``j`` times ``sense`` is least [s]."""
    beside = motion.beside(int((sense * motion.q[:, j]).argmin()))
    return motion.least_at(lambda time: sense * motion.trajectory.sample(time).q[:, j], *beside)


def _rate_findings(motion: SampledMotion, kind: Rate) -> Iterator[Finding]:
    """Joints whose speed, acceleration or jerk is over its limit."""
    robot, peaks = motion.robot, motion.peaks
    order = _RATES.index(kind)
    most = (peaks.speed, peaks.acceleration, peaks.jerk)[order]
    limits = (robot.speed_limits, robot.acceleration_limits, robot.jerk_limits)[order]
    over = [] if most is None else np.flatnonzero(most > limits * (1 + _RATE_TOLERANCE)).tolist()
    if most is None or not over:
        return
    rates = motion.rates(motion.time, order)
    for j in over:
        when, digits = _when_most(motion, order, j, int(rates[:, j].argmax()))
        title = robot.joints[j].title
        reason = RateLimit(title, kind, float(most[j]), float(limits[j]))
        yield Finding(reason, when, title, kind, digits=digits)


def _when_most(motion: SampledMotion, order: int, j: int, at: int) -> tuple[float, int]:
    """When joint ``j`` is fastest, near the sample at which it is [s]; as ``SampledMotion.told``."""
    (begin, end), when = motion.beside(at), float(motion.time[at])
    most = float(motion.rates(np.array([when]), order)[0, j])
    for digits in (2, 3, 4):
        count = np.arange(math.ceil(begin * 10**digits), math.floor(end * 10**digits) + 1)
        times = count[:: len(count) // _MOST_TIMES + 1] / 10**digits
        rates = motion.rates(times, order)[:, j]
        if rates.max(initial=0.0) >= _AS_FAST * most:
            return float(times[rates.argmax()]), digits
    return when, 2


def _seam_findings(motion: SampledMotion) -> Iterator[Finding]:
    """Joints whose speed jumps where one part of a joined trajectory ends and the next begins."""
    for when, jump in motion.seams:
        j = int(np.abs(jump).argmax())
        if abs(jump[j]) > _REST_SPEED:
            title = motion.robot.joints[j].title
            yield Finding(SpeedJump(title, float(abs(jump[j]))), when, title, "acceleration")


def _rest_findings(motion: SampledMotion) -> Iterator[Finding]:
    ends: tuple[tuple[int, Literal["starts", "ends"]], ...] = ((0, "starts"), (-1, "ends"))
    for k, end in ends:
        speeds = np.abs(motion.velocity[k])
        j = int(speeds.argmax())
        if speeds[j] > _REST_SPEED:
            title = motion.robot.joints[j].title
            yield Finding(
                MotionEndsMoving(title, end, float(speeds[j])), float(motion.time[k]), title, "rest"
            )


# Does the arm keep clear of the floor, of obstacles and of itself over the whole motion?

_TOO_FAST = 2.0
"""times the speed limits: a motion beyond is refused for its speed, and nothing else is proven of it"""
_BLOCK = 4096
"""intervals that are halved at once, so that memory stays bounded"""


def _gap_findings(motion: SampledMotion, links: LinkFrames) -> Iterator[Finding]:
    """Gaps that are closed too far, each kind's deepest."""
    for source in sources(motion.robot):
        closed = _closed(motion, source, links)
        if closed is not None:
            yield _deepest(motion, source, closed)


@dataclass(frozen=True, slots=True)
class _Closed:
    """Gaps that are closed too far somewhere in a motion, and where that was seen."""

    allowed: FloatArray
    """(k, 1) how far each gap may be closed [m]"""
    intervals: FloatArray
    """(2 + 3k, m) when intervals begin and end [s], by how much each gap is open beyond ``allowed`` at both
    times, and by how much it may change between them [m]"""


def _closed(motion: SampledMotion, source: Gaps, links: LinkFrames) -> _Closed | None:
    """Check that gaps stay open; one that starts closed must not close further. ``links``: at the samples.

    With gaps g₀ and g₁ at two samples and a change of at most D (levers times joint speeds) between them, a
    gap is at least (g₀ + g₁ - D) / 2 there. Where that does not prove it open, the interval is halved. Told
    are the samples, if a gap is closed too far at any of them, else the first halves that show one.
    """
    if not len(source.levers):
        return None
    speed = np.minimum(motion.speed[1:], _TOO_FAST * motion.robot.speed_limits)
    change = source.levers @ (speed * np.diff(motion.time)[:, None]).T
    gaps = source.gaps(links, _enough(change))
    allowed = np.minimum(gaps[:, :1], source.closed[:, None]) - FLOOR_TOLERANCE_M
    slack = gaps - allowed
    if slack.min() < 0.0:
        return _Closed(allowed, _intervals(motion, slack, change))
    if (slack[:, :-1] + slack[:, 1:] - change >= -2.0 * source.missed_m).all():  # most motions
        return None
    k = len(gaps)
    blocks = [_intervals(motion, slack, change)]
    while blocks:
        block = blocks.pop()
        _, at_begin, at_end, change = np.split(block, [2, 2 + k, 2 + 2 * k])
        doubtful = np.flatnonzero((0.5 * (at_begin + at_end - change) < -source.missed_m).any(axis=0))
        if len(doubtful) > _BLOCK:
            blocks += [block[:, doubtful[_BLOCK:]], block[:, doubtful[:_BLOCK]]]
        elif len(doubtful):
            early = block[:, doubtful]
            middle = 0.5 * (early[0] + early[1])
            early[2 + 2 * k :] *= 0.5
            frames = motion.robot.body_frames(motion.trajectory.sample(middle).q)
            never = 0.5 * (early[2 : 2 + k] + early[2 + k : 2 + 2 * k]) >= early[2 + 2 * k :]
            enough = np.where(never, -np.inf, 0.5 * early[2 + 2 * k :])
            slack = np.where(never, np.inf, source.gaps(frames, enough) - allowed)
            late = early.copy()
            early[1], early[2 + k : 2 + 2 * k] = middle, slack
            late[0], late[2 : 2 + k] = middle, slack
            blocks.append(np.hstack([early, late]))
            if slack.min() < 0.0:
                return _Closed(allowed, blocks[-1])
    return None


def _intervals(motion: SampledMotion, slack: FloatArray, change: FloatArray) -> FloatArray:
    """As ``_Closed.intervals``, between the samples of a motion."""
    return np.vstack([motion.time[:-1], motion.time[1:], slack[:, :-1], slack[:, 1:], change])


def _enough(change: FloatArray) -> FloatArray:
    """(k, m) [m] beyond which gaps at samples prove all between, where they change by (k, m - 1) at most."""
    most = np.zeros((len(change), change.shape[1] + 1))
    most[:, :-1] = change
    most[:, 1:] = np.maximum(most[:, 1:], change)
    return 0.5 * most


def _deepest(motion: SampledMotion, source: Gaps, closed: _Closed) -> Finding:
    """The deepest of the gaps that are closed too far."""
    allowed, k = closed.allowed, len(closed.allowed)
    begin, end, at_begin, at_end, change = np.split(closed.intervals, [1, 2, 2 + k, 2 + 2 * k])

    def depths_at(time: FloatArray, enough: FloatArray) -> FloatArray:
        """(k, m) the gaps that are closed too far [m], others infinite; exact below ``enough`` (k, 1) [m]."""
        gaps = source.gaps(motion.robot.body_frames(motion.trajectory.sample(time).q), enough)
        return np.where(gaps < allowed, gaps, np.inf)

    slacks = np.minimum(at_begin, at_end)
    known = np.where(slacks < 0.0, slacks + allowed, np.inf)
    part, at = map(int, np.unravel_index(known.argmin(), known.shape))
    least = float(known[part, at])
    when = float((begin if at_begin[part, at] <= at_end[part, at] else end)[0, at])
    # where between two samples it may be deeper than at any, the deepest first
    lowest = (0.5 * (at_begin + at_end - change) + allowed).min(axis=0)
    lowest[at] = -np.inf
    near = np.flatnonzero(lowest <= least)
    near = near[np.argsort(lowest[near], kind="stable")[: source.most_near]]
    shares = np.linspace(0.0, 1.0, _LOOKS)[:, None]
    times = (begin[0, near] + shares * (end[0, near] - begin[0, near])).ravel()
    depths = depths_at(times, np.full((k, 1), least))
    if depths.min() < least:
        part, at = map(int, np.unravel_index(depths.argmin(), depths.shape))
        least, when = float(depths[part, at]), float(times[at])
    this_one = np.where(np.arange(k) == part, 0.0, -np.inf)[:, None]

    def depth_at(time: FloatArray) -> FloatArray:
        return depths_at(time, this_one)[part]

    step = float((end - begin)[0, near].max()) / (_LOOKS - 1)
    around = np.clip([when - step, when + step], motion.time[0], motion.time[-1])
    when = motion.least_at(depth_at, *around.tolist())
    least = min(float(depth_at(np.array([when]))[0]), least)
    when, digits = motion.told(when, lambda time: depth_at(np.array([time]))[0] < least + _AS_DEEP_M)
    gap = float(depth_at(np.array([when]))[0])
    links = motion.robot.body_frames(motion.trajectory.sample(np.array([when])).q)
    depth = source.depth(part, links, -(gap if math.isfinite(gap) else least))
    return Finding(source.blocked(part, depth), when, source.parts[part], source.kind, digits=digits)


# Does the tool lose a direction? The isotropy is the smallest over the largest singular value of the tool
# point's Jacobian.

_LOST = 0.005
"""isotropy below which a tool path that needs the hardest direction is refused"""
_STRAINED = 0.25 / _LOST
"""Joint travel per tool travel, in units of the best direction's, that shows that a path needs it."""


def _singularity_findings(motion: SampledMotion, *, tool_path: bool) -> Iterator[Finding]:
    """At most one."""
    # A joint motion passes any singularity; a warning tells where it ends at one (below ``NEAR``). A path of
    # the tool is checked all the way: an error where it takes the direction that is lost.
    robot = motion.robot
    q, time = (motion.q, motion.time) if tool_path else (motion.q[-1:], motion.time[-1:])
    isotropy, largest = isotropy_of(robot, robot.jacobian(q))
    if isotropy.min() >= NEAR or robot.always_singular:
        return
    at, is_lost = int(isotropy.argmin()), False
    lost = np.flatnonzero(isotropy[1:] < _LOST) + 1
    if len(lost):
        tool = robot.forward(q)[:, :3, 3]
        way = np.linalg.norm(tool[lost] - tool[lost - 1], axis=1)
        turn = np.linalg.norm(q[lost] - q[lost - 1], axis=1)
        lost = lost[turn * largest[lost] > _STRAINED * way]
    if len(lost):
        at, is_lost = int(lost[isotropy[lost].argmin()]), True

    def isotropy_at(time: float) -> float:
        return float(isotropy_of(robot, robot.jacobian(motion.trajectory.sample(np.array([time])).q))[0][0])

    when, digits = motion.told(float(time[at]), lambda time: isotropy_at(time) < (_LOST if is_lost else NEAR))
    severity: Severity = "error" if is_lost else "warning"
    reason = Singular(isotropy_at(when), is_lost)
    yield Finding(reason, when, "the tool", "singularity", severity, digits=digits)


def isotropy_of(robot: Robot, jacobians: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of Jacobians (m, 6, n): the isotropy, and the largest singular value [m/rad], (m,) each."""
    J = jacobians[:, :3, robot.limits[:, 0] < robot.limits[:, 1]]
    singular = np.sqrt(np.maximum(np.linalg.eigvalsh(J @ J.swapaxes(1, 2)), 0.0))
    return singular[:, 0] / np.maximum(singular[:, 2], 1e-150), singular[:, 2]


# Can the joints hold the arm and what it carries?

_WARM = 0.5
"""Above this share of its stall torque a motor is told of: held for long, it gets hot."""
_TORQUE_TOLERANCE = 1e-3


def _torque_findings(motion: SampledMotion, links: LinkFrames, payload_kg: float | None) -> Iterator[Finding]:
    """Static gravity torque of each joint against its stall torque."""
    # More than the stall torque is an error, unless the motion starts there and it gets no worse.
    robot = motion.robot
    if not robot.gravity.weighs or not any(joint.stall_torque for joint in robot.joints):
        return
    gravity = robot.gravity if payload_kg is None else replace(robot.gravity, payload_kg=payload_kg)
    for j, (joint, torque) in enumerate(zip(robot.joints, np.abs(gravity.torque_of(links)), strict=True)):
        stall = joint.stall_torque
        if not stall:
            continue
        at, allowed = int(torque.argmax()), max(float(torque[0]), stall) * (1 + _TORQUE_TOLERANCE)
        if torque[at] <= _WARM * stall:
            continue
        over = bool(torque[at] > allowed)
        least = allowed if over else _WARM * stall
        when, digits = motion.told(float(motion.time[at]), partial(_holds_more, motion, gravity, j, least))
        most = _torque_at(motion, gravity, j, when)
        effort = joint.torque_is_effort
        reason = Overload(joint.title, joint.name, most, stall, gravity.counted, over, effort)
        severity: Severity = "error" if over and not effort else "warning"
        yield Finding(reason, when, joint.title, "torque", severity, digits=digits)


def _torque_at(motion: SampledMotion, gravity: GravityModel, j: int, time: float) -> float:
    """Size of the static torque of joint ``j`` [N·m]."""
    return abs(float(gravity.torque(motion.trajectory.sample(time).q)[j]))


def _holds_more(motion: SampledMotion, gravity: GravityModel, j: int, least: float, time: float) -> bool:
    return _torque_at(motion, gravity, j, time) > least


class Unchecked(NamedTuple):
    """Something that the pre-flight cannot judge."""

    kind: Kind
    """of the findings that are missing"""
    text: str
    """what, and why"""


def not_checked(robot: Robot) -> tuple[Unchecked, ...]:
    """What the pre-flight cannot judge: the file gives no figures for it, or parts touch all the time."""
    touching = tuple(Unchecked("self-collision", text) for text in robot.collision.notes)
    if not robot.gravity.weighs:
        why = f"the file of {robot.name} gives no masses of links"
        why = f"gravity torque: {why}, so there are no loads and no least-torque either"
        return (Unchecked("torque", why), *touching)
    unknown = [joint.title for joint in robot.joints if joint.stall_torque is None]
    if not unknown:
        return touching
    which = "any joint" if len(unknown) == robot.n else ", ".join(unknown)
    why = f"gravity torque: the file of {robot.name} gives no stall torque of {which}"
    return (Unchecked("torque", why), *touching)

"""Pre-flight: all checks of one motion, before the arm makes it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
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
from armctl.lazy_dataclass import dataclass
from armctl.motion.clearance import closed_gaps, deepest_gap, sources
from armctl.motion.trajectory import SampledMotion, Trajectory
from armctl.robot import Robot

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
    return all(closed_gaps(motion, source, links) is None for source in sources(robot))


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


def _gap_findings(motion: SampledMotion, links: LinkFrames) -> Iterator[Finding]:
    """Gaps that are closed too far, each kind's deepest."""
    for source in sources(motion.robot):
        if (closed := closed_gaps(motion, source, links)) is not None:
            reason, when, digits, part = deepest_gap(motion, source, closed)
            yield Finding(reason, when, part, source.kind, digits=digits)


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

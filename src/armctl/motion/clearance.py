"""Gaps between parts of the arm and what they must stay away from: the floor, obstacles, the arm itself.

Each kind has k gaps: ``parts`` are their names, ``levers`` (k, n) how much each changes at most [m/rad],
``closed`` (k,) how far each may be closed all the same, 0 or negative [m].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import accumulate, product
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import FloatArray
from armctl.facts import Blocked
from armctl.kinematics.frames import LinkFrames
from armctl.lazy_dataclass import dataclass
from armctl.motion.trajectory import LOOKS, SampledMotion
from armctl.robot import Robot
from armctl.robot.body.arm_body import CLEAR_M
from armctl.robot.body.collision import NEAR_M

FLOOR_TOLERANCE_M = 5e-4
"""How far a part may dip below the floor, or into anything else: less than a servo arm can tell."""

_TOUCHES_M = 1e-9
"""Where it is only asked whether anything touches, gaps beyond need not be exact."""


class Floor:
    """Heights above the floor of the pieces that joints raise or lower (``Robot.undersides``).

    What lies on the floor, or nearer to it than it is thick, in the home or the rest pose may be as low
    as there, but never its axis, or the middle of a hull.
    """

    kind: ClassVar[Literal["floor"]] = "floor"
    missed_m: ClassVar[float] = 1e-3
    """how much deeper a dip between two samples may be before it is sure to be found"""
    most_near: ClassVar[int] = 64
    """intervals between samples in which the deepest place is looked for"""

    def __init__(self, robot: Robot) -> None:
        self._robot, self._undersides = robot, robot.undersides
        self.levers = np.array([one.levers for one in self._undersides]).reshape(-1, robot.n)
        self.parts = tuple(one.part for one in self._undersides)
        thickness = np.array([one.thickness for one in self._undersides])
        self._below = np.array([[one.radius + robot.floor_z] for one in self._undersides]).reshape(-1, 1)
        self._by_link = [
            (link, which, *_joined([self._undersides[k].points for k in which]))
            for link in dict.fromkeys(one.link for one in self._undersides)
            for which in [[k for k, one in enumerate(self._undersides) if one.link == link]]
        ]
        rests = np.array([one.rests for one in self._undersides]) - robot.floor_z
        self.closed = np.clip(rests, -thickness, 0.0)

    def clearance(self, q: ArrayLike) -> FloatArray:
        """(..., k) heights above the floor [m] at ``q`` (..., n) [rad], negative below it; k may be 0."""
        q = self._robot.chain.checked(q)
        links = self._robot.body_frames(q.reshape(-1, self._robot.n))
        return self.gaps(links).T.reshape(*q.shape[:-1], len(self._undersides))

    def gaps(self, links: LinkFrames, enough: ArrayLike = NEAR_M) -> FloatArray:
        """(k, m) heights [m] at m configurations; all exact."""
        heights = np.empty((len(self._undersides), links.origin[0].shape[-1]))
        for link, which, points, begins in self._by_link:
            above = np.minimum.reduceat(points @ links.rotation[link][2], begins, axis=0)
            heights[which] = above + links.origin[link][2]
        return heights - self._below

    def depth(self, part: int, links: LinkFrames, about: float) -> float:
        """How deep a gap is closed at the first configuration [m], exact where ``gaps`` says ``about`` so."""
        return about

    def blocked(self, part: int, depth_m: float) -> Blocked:
        """What is wrong where gap ``part`` is closed by ``depth_m``."""
        return Blocked(self.kind, self.parts[part], "", depth_m)


def _joined(arrays: Sequence[FloatArray]) -> tuple[FloatArray, list[int]]:
    """Points (k, 3) behind each other, and where those of each array begin."""
    begins = [0, *accumulate(map(len, arrays))][:-1]
    return np.concatenate(arrays), begins


class Obstacles:
    """Gaps between the pieces that joints move and the obstacles of the robot file."""

    kind: ClassVar[Literal["obstacle"]] = "obstacle"
    missed_m: ClassVar[float] = 1e-3
    most_near: ClassVar[int] = 64

    def __init__(self, robot: Robot) -> None:
        self._model, self._obstacles = robot.collision, robot.obstacles
        moving = list(self._model.moving)
        self.parts = tuple(self._model.capsules[i].part for _ in robot.obstacles for i in moving)
        self.levers = np.tile(self._model.levers[moving], (len(robot.obstacles), 1))
        self.closed = np.zeros(len(self.parts))
        hulls = [bool(robot.shapes) and self._model.capsules[i].hull is not None for i in moving]
        self._fitted = hulls * len(robot.obstacles)

    def gaps(self, links: LinkFrames, enough: ArrayLike = NEAR_M) -> FloatArray:
        """(k, m) [m] at m configurations, negative inside an obstacle; lower bounds beyond ``NEAR_M``."""
        return self._model.gaps_around(links)

    def depth(self, part: int, links: LinkFrames, about: float) -> float:
        """As ``Floor.depth``."""
        obstacle, piece = divmod(part, len(self._model.moving))
        known = self._model.depth_in(links, self._obstacles[obstacle], self._model.moving[piece])
        return about if known is None else known

    def blocked(self, part: int, depth_m: float) -> Blocked:
        """As ``Floor.blocked``."""
        return Blocked(self.kind, self.parts[part], self._other(part), depth_m, self._fitted[part])

    def _other(self, part: int) -> str:
        return self._obstacles[part // len(self._model.moving)].title


class SelfCollision:
    """Gaps between the arm's pieces (``Robot.collision``), each named by the one nearer to the tool."""

    kind: ClassVar[Literal["self-collision"]] = "self-collision"
    missed_m: ClassVar[float] = 0.5e-3
    most_near: ClassVar[int] = 4  # surfaces take a millisecond each time

    def __init__(self, robot: Robot) -> None:
        self._model, self._of_shapes = robot.collision, bool(robot.shapes)
        self.levers = self._model.pair_levers
        self.closed = self._model.closed

    @cached_property
    def parts(self) -> tuple[str, ...]:
        """Names, which only a refusal needs."""
        return tuple(self._model.capsules[j].part for _, j in self._model.pairs)

    def gaps(self, links: LinkFrames, enough: ArrayLike = NEAR_M) -> FloatArray:
        """(k, m) [m] at m configurations, negative where a pair overlaps; lower bounds beyond ``enough``."""
        return self._model.gaps(links, enough)

    def depth(self, part: int, links: LinkFrames, about: float) -> float:
        """As ``Floor.depth``; where surfaces decide, or more than at rest is wrong, it stays ``about`` so."""
        known = None
        if not self._model.by_surface[part] and self.closed[part] == 0.0:
            known = self._model.depth(links, part)
        return about if known is None else known

    def blocked(self, part: int, depth_m: float) -> Blocked:
        """As ``Floor.blocked``."""
        by_surface = bool(self._model.by_surface[part])
        hulls = (self._model.capsules[i].hull for i in self._model.pairs[part])
        return Blocked(
            self.kind,
            self.parts[part],
            self._other(part),
            depth_m - CLEAR_M if by_surface else depth_m,
            fitted=self._of_shapes and any(hull is not None for hull in hulls),
            at_rest_m=-float(self.closed[part]),
            surfaces=by_surface,
        )

    def _other(self, part: int) -> str:
        return self._model.capsules[self._model.pairs[part][0]].part


Gaps = Floor | Obstacles | SelfCollision


def sources(robot: Robot) -> tuple[Gaps, ...]:
    """All that an arm must stay clear of."""
    return (*kept_out(robot), SelfCollision(robot))


def kept_out(robot: Robot) -> tuple[Floor | Obstacles, ...]:
    """What is around an arm: no part of it may be there, whichever way it came."""
    return Floor(robot), *((Obstacles(robot),) if robot.obstacles else ())


def touching(around: Sequence[Gaps], robot: Robot, q: FloatArray) -> Blocked | None:
    """What of an arm at ``q`` (n,) [rad] would be where it may not be, in one place; None: nothing."""
    links = robot.body_frames(q[None])
    for source in around:
        gaps = source.gaps(links, _TOUCHES_M)[:, 0]
        lacks = gaps - source.closed + FLOOR_TOLERANCE_M < 0.0
        if lacks.any():
            part = int(np.where(lacks, gaps, np.inf).argmin())
            return source.blocked(part, source.depth(part, links, -float(gaps[part])))
    return None


def stands_clear(robot: Robot, q: FloatArray) -> bool:
    """Whether an arm may stand at ``q`` (n,) [rad]."""
    return bool(robot.chain.keeps_turns(q)) and touching(sources(robot), robot, q) is None


def ends_clear(robot: Robot, start: FloatArray, q: FloatArray) -> NDArray[np.bool_]:
    """(k,) whether a motion from ``start`` (n,) [rad] may end at each of ``q`` (k, n) [rad].

    Where the arm touches something at rest or at the start, it may touch it as much at the end.
    """
    clear = robot.chain.keeps_turns(q)
    frames = robot.body_frames(np.concatenate([start[None], q]))
    for source in sources(robot):
        gaps = source.gaps(frames, _TOUCHES_M)
        allowed = np.minimum(gaps[:, :1], source.closed[:, None]) - FLOOR_TOLERANCE_M
        clear &= (gaps[:, 1:] >= allowed).all(axis=0)
    return clear


_QUARTER = np.pi / 2
_MOST_TURNED, _TURNED = 4, 10
"""joints of a suggested pose that are a quarter turn from zero, at most so many of the first ones"""
_ROOM_M = 0.002
"""A suggested pose is so far above the floor."""
_AT_ONCE = 32
"""poses that are tried together for what takes long"""


def clear_rest(robot: Robot) -> tuple[FloatArray, str] | None:
    """As ``clear_pose``, where the robot's own poses excuse nothing; with its angles [degrees] as written."""
    q = clear_pose(replace(robot, poses={}))
    if q is None:
        return None
    return q, f"[{', '.join(f'{angle:g}' for angle in robot.shown(q).round(2).tolist())}]"


def clear_pose(robot: Robot) -> FloatArray | None:
    """A pose (n,) [rad] that touches nothing, few joints a quarter turn from zero; None: there is none."""
    zero = np.clip(np.zeros(robot.n), *robot.limits.T)
    choices = [
        [(0, at), *((1, k * _QUARTER) for k in (-1, 1) if joint < _TURNED and low <= k * _QUARTER <= high)]
        for joint, (at, (low, high)) in enumerate(zip(zero.tolist(), robot.limits.tolist(), strict=True))
    ]
    turned = sorted(
        (
            (sum(turns for turns, _ in one), [angle for _, angle in one])
            for one in product(*choices)
            if sum(turns for turns, _ in one) <= _MOST_TURNED
        ),
        key=lambda one: one[0],
    )
    q = np.array([angles for _, angles in turned])
    q = q[robot.chain.keeps_turns(q)]
    *around, itself = sources(robot)
    for source in around:  # most of them fall here, which is asked soon
        q = q[_keeps_out(source, robot, q, _ROOM_M if source.kind == "floor" else 0.0)]
    for begin in range(0, len(q), _AT_ONCE):
        some = q[begin : begin + _AT_ONCE]
        found = np.flatnonzero(_keeps_out(itself, robot, some, 0.0))
        if len(found):
            return some[found[0]].copy()
    return None


def _keeps_out(source: Gaps, robot: Robot, q: FloatArray, room: float) -> NDArray[np.bool_]:
    """(k,) whether an arm at each of ``q`` (k, n) [rad] touches nothing of a kind, by ``room`` [m]."""
    least = source.closed[:, None] + room
    return np.logical_and.reduce(source.gaps(robot.body_frames(q), least + _TOUCHES_M) >= least, axis=0)


# Does the arm keep clear of the floor, of obstacles and of itself over the whole motion?

_AS_DEEP_M = 5e-5
"""how much less deep a gap may be at the time that is told"""
_TOO_FAST = 2.0
"""times the speed limits: a motion beyond is refused for its speed, and nothing else is proven of it"""
_BLOCK = 4096
"""intervals that are halved at once, so that memory stays bounded"""


@dataclass(frozen=True, slots=True)
class ClosedGaps:
    """Gaps that are closed too far somewhere in a motion, and where that was seen."""

    allowed: FloatArray
    """(k, 1) how far each gap may be closed [m]"""
    intervals: FloatArray
    """(2 + 3k, m) when intervals begin and end [s], by how much each gap is open beyond ``allowed`` at both
    times, and by how much it may change between them [m]"""


def closed_gaps(motion: SampledMotion, source: Gaps, links: LinkFrames) -> ClosedGaps | None:
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
        return ClosedGaps(allowed, _intervals(motion, slack, change))
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
                return ClosedGaps(allowed, blocks[-1])
    return None


def _intervals(motion: SampledMotion, slack: FloatArray, change: FloatArray) -> FloatArray:
    """As ``ClosedGaps.intervals``, between the samples of a motion."""
    return np.vstack([motion.time[:-1], motion.time[1:], slack[:, :-1], slack[:, 1:], change])


def _enough(change: FloatArray) -> FloatArray:
    """(k, m) [m] beyond which gaps at samples prove all between, where they change by (k, m - 1) at most."""
    most = np.zeros((len(change), change.shape[1] + 1))
    most[:, :-1] = change
    most[:, 1:] = np.maximum(most[:, 1:], change)
    return 0.5 * most


class DeepestGap(NamedTuple):
    """The gap that is closed farthest in a motion."""

    blocked: Blocked
    time: float
    """when, as a text says it [s]"""
    digits: int
    """decimals of that time"""
    part: str


def deepest_gap(motion: SampledMotion, source: Gaps, closed: ClosedGaps) -> DeepestGap:
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
    shares = np.linspace(0.0, 1.0, LOOKS)[:, None]
    times = (begin[0, near] + shares * (end[0, near] - begin[0, near])).ravel()
    depths = depths_at(times, np.full((k, 1), least))
    if depths.min() < least:
        part, at = map(int, np.unravel_index(depths.argmin(), depths.shape))
        least, when = float(depths[part, at]), float(times[at])
    this_one = np.where(np.arange(k) == part, 0.0, -np.inf)[:, None]

    def depth_at(time: FloatArray) -> FloatArray:
        return depths_at(time, this_one)[part]

    step = float((end - begin)[0, near].max()) / (LOOKS - 1)
    around = np.clip([when - step, when + step], motion.time[0], motion.time[-1])
    when = motion.least_at(depth_at, *around.tolist())
    least = min(float(depth_at(np.array([when]))[0]), least)
    when, digits = motion.told(when, lambda time: depth_at(np.array([time]))[0] < least + _AS_DEEP_M)
    gap = float(depth_at(np.array([when]))[0])
    links = motion.robot.body_frames(motion.trajectory.sample(np.array([when])).q)
    depth = source.depth(part, links, -(gap if math.isfinite(gap) else least))
    return DeepestGap(source.blocked(part, depth), when, digits, source.parts[part])

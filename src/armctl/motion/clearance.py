"""Gaps between parts of the arm and what they must stay away from: the floor, obstacles, the arm itself.

Each kind has k gaps: ``parts`` are their names, ``levers`` (k, n) how much each changes at most [m/rad],
``closed`` (k,) how far each may be closed all the same, 0 or negative [m].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from itertools import accumulate, product
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import FloatArray
from armctl.facts import Blocked
from armctl.kinematics.frames import LinkFrames
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
    return q, f"[{', '.join(f'{angle:g}' for angle in np.degrees(q).round(2).tolist())}]"


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

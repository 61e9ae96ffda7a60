"""The pieces of an arm that are kept apart from each other and from what is around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics.chain import Chain
from armctl.robot.hulls import Hull
from armctl.robot.look.pieces import Mount, link_name
from armctl.robot.parts import Look
from armctl.robot.shape import FINGER, PALM, TIP_LENGTH, TIP_RADIUS, bars, tool_length, width
from armctl.robot.surfaces import Surface

Openings = tuple[float, float]
"""between which a gripper is, 0 (closed) to 1"""
ANY_OPENING: Openings = (0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Capsule(ArrayRecord):
    """A piece of the arm's body: all points within a radius of a segment, or a hull inside that."""

    link: int
    """index of its link; -1: the base; beyond the links: of ``ArmBody.mounts``"""
    start: FloatArray
    """(3,) in the link's frame (``LinkFrames``) [m]"""
    end: FloatArray
    """(3,) [m]"""
    radius: float
    """[m]"""
    part: str
    """what a user calls it"""
    hull: Hull | None = None
    """what is kept apart instead, inside the capsule, where the piece was fitted to shapes"""
    surface: Surface | None = None
    """what is inside the hull: it decides where hulls overlap"""

    @property
    def corners(self) -> FloatArray:
        """(k, 3) of the hull, or both ends of the axis [m]."""
        return np.array([self.start, self.end]) if self.hull is None else self.hull.corners

    @property
    def as_hull(self) -> Hull:
        """The hull of the mesh, or the axis with the radius round it."""
        return Hull(self.corners, np.empty((0, 3)), self.radius) if self.hull is None else self.hull


@dataclass(frozen=True, slots=True)
class ArmBody:
    """The pieces of an arm, and what is to be said of them."""

    capsules: tuple[Capsule, ...]
    notes: tuple[str, ...] = ()
    unused: tuple[int, ...] = ()
    """which of the arm's shapes could not be read, or have another unit"""
    mounts: tuple[Mount, ...] = ()
    """frames of capsules that move with two links: their indices follow those of the links"""
    solids: tuple[int, ...] = ()
    """which solid of a look each capsule is of"""


def capsule(
    chain: Chain, titles: Sequence[str], frame: int, ends: tuple[ArrayLike, ArrayLike], radius: float
) -> Capsule:
    """A capsule between two points (3,) [m] of a frame, an index into ``chain.places``."""
    link, T = chain.places[frame]
    start, end = (moved(T, point) for point in ends)
    return Capsule(link, start, end, radius, link_name(link, titles))


def moved(T: FloatArray, point: ArrayLike) -> FloatArray:
    """A point (3,) [m] of a frame, as its pose T (4, 4) places it."""
    return T[:3, :3] @ np.asarray(point, dtype=np.float64) + T[:3, 3]


def shape_capsules(chain: Chain, look: Look, titles: Sequence[str], *, gripper: bool) -> tuple[Capsule, ...]:
    """The capsules of an arm as it is drawn; without a gripper it ends in a tip.

    A bar shorter than the links are wide lies inside the drum of its joint and is left out; bars in one
    line are one capsule. Round a square beam the capsule goes through its corners. The fingers are one
    capsule round both when they are closed; the palm is as wide as it is when they are open.
    """
    wide = width(chain, look)
    radius = wide * (0.5 if look.shape == "round" else math.sqrt(0.5))
    links: list[Capsule] = []
    for bar in bars(chain, tool_length(chain, look, gripper=gripper)):
        if bar.length > 1e-9:
            piece = capsule(chain, titles, bar.frame, (bar.start, bar.end), radius)
            if links and _goes_on(links[-1], piece):
                piece = replace(piece, start=links.pop().start)
            links.append(piece)
    links = [piece for piece in links if math.dist(piece.start, piece.end) >= wide]
    return (*links, *_hand(chain, wide, gripper=gripper))


def _goes_on(last: Capsule, piece: Capsule) -> bool:
    """Whether a piece of the same link goes on in the same direction where the last one ends."""
    before, after = last.end - last.start, piece.end - piece.start
    straight = before @ after > (1 - 1e-9) * np.linalg.norm(before) * np.linalg.norm(after)
    return last.link == piece.link and bool(straight) and np.allclose(last.end, piece.start, atol=1e-9)


def _hand(chain: Chain, wide: float, *, gripper: bool) -> list[Capsule]:
    """What ends at the tool point, along the tool's z."""
    link, T = chain.places[-1]

    def piece(start: tuple[float, float], end: tuple[float, float], radius: float, part: str) -> Capsule:
        return Capsule(link, moved(T, (0.0, *start)), moved(T, (0.0, *end)), radius, part)

    if not gripper:
        radius = 0.5 * TIP_RADIUS * wide  # half way along the cone
        return [piece((0, -TIP_LENGTH * wide), (0, -radius), radius, "the tool")]
    size = chain.length
    finger, palm = 0.5 * FINGER[0] * size, 0.5 * PALM[0] * size
    behind, half = -(FINGER[2] + 0.5 * PALM[2]) * size, 0.5 * PALM[1] * size - palm
    return [
        piece((-half, behind), (half, behind), palm, "the gripper"),
        piece((0, behind), (0, -finger), finger, "the gripper"),
    ]

"""The pieces of an arm that are kept apart from each other and from what is around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics.chain import Chain
from armctl.robot.hulls import Hull
from armctl.robot.look.pieces import Mount, link_name
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

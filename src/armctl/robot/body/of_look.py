"""The body of an arm that has a look: a hull round each convex solid of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from armctl.arrays import FloatArray
from armctl.lazy_dataclass import dataclass
from armctl.robot.body.arm_body import ArmBody, Capsule, Openings
from armctl.robot.body.fitting import hull_as_it_is, in_capsules
from armctl.robot.body.hulls import Hull
from armctl.robot.look.pieces import Jaw, Piece

_TURN = math.radians(10)
"""A jaw that turns farther is more than one hull."""
_FEWEST_FACES = 4
"""of a hull with an inside"""
_INSIDE_M = 1e-3
"""A hull that reaches no farther out of another one of its frame is left out: a motor in its bracket."""


@dataclass(frozen=True, slots=True, eq=False)
class _Solid:
    """A convex solid of a look."""

    link: int
    part: str
    hull: Hull
    """where it is drawn"""
    jaw: Jaw | None


class LookBody:
    """The convex solids of an arm's look."""

    def __init__(self, pieces: Sequence[Piece], links: int) -> None:
        """``links``: how many the arm has."""
        pieces = [piece for piece in pieces if piece.body]
        self._mounts = tuple(dict.fromkeys(piece.mount for piece in pieces if not piece.mount.is_link))
        self._solids: list[_Solid] = []
        for piece in pieces:
            mount = piece.mount
            link = mount.hangs if mount.is_link else links + self._mounts.index(mount)
            for corners in (corners for part in piece.parts for corners in part.corners):
                hull = hull_as_it_is(corners)
                still = (other.hull for other in self._solids if other.jaw is None and other.link == link)
                if piece.jaw is not None or not any(_inside(hull, other) for other in still):
                    self._solids.append(_Solid(link, piece.part, hull, piece.jaw))
        self.opens = any(solid.jaw is not None for solid in self._solids)
        """whether it depends on the opening of the gripper"""
        self._still = self._capsules(
            [(k, solid.hull) for k, solid in enumerate(self._solids) if solid.jaw is None]
        )

    def moves(self, *solids: int) -> bool:
        """Whether one of these solids is a jaw."""
        return any(self._solids[k].jaw is not None for k in solids)

    def at(self, openings: Openings) -> ArmBody:
        """The body with jaws where they are at the openings, and all between."""
        moved = [
            (k, hull_as_it_is(corners))
            for k, solid in enumerate(self._solids)
            if solid.jaw is not None
            for corners in _swept(solid.jaw, solid.hull.corners, *openings)
        ]
        found = sorted([*self._still, *self._capsules(moved)], key=lambda one: one[0])
        solids = tuple(k for k, _ in found)
        return ArmBody(tuple(one for _, one in found), mounts=self._mounts, solids=solids)

    def _capsules(self, hulls: Sequence[tuple[int, Hull]]) -> list[tuple[int, Capsule]]:
        """Capsules round hulls, each with the index of its solid."""
        found: list[tuple[int, Capsule]] = []
        for (k, _), one in zip(hulls, in_capsules([hull for _, hull in hulls]), strict=True):
            solid = self._solids[k]
            found.append((k, Capsule(solid.link, one.start, one.end, one.radius, solid.part, one.hull)))
        return found


def _swept(jaw: Jaw, corners: FloatArray, low: float, high: float) -> Iterator[FloatArray]:
    """Corners (k, 3) of what holds a jaw at the openings between two."""
    count = max(1, math.ceil(abs(high - low) * abs(jaw.angle) / _TURN))
    stops = [jaw.at(opening) for opening in np.linspace(low, high, count + 1).tolist()]
    placed = [corners @ R.T + way for R, way in stops]
    if low == high:
        yield placed[0]
        return
    for one, other in pairwise(placed):
        yield np.concatenate([one, other])


def _inside(one: Hull, other: Hull) -> bool:
    """Whether a hull adds nothing to another one of its frame; in a flat one nothing is inside."""
    if len(other.normals) < _FEWEST_FACES:
        return False
    heights = (other.corners @ other.normals.T).max(axis=0)
    return bool((one.corners @ other.normals.T <= heights + _INSIDE_M).all())

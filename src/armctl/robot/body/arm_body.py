"""The pieces of an arm that are kept apart from each other: capsules, hulls and triangles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import ArrayRecord, FloatArray
from armctl.errors import InputError, out_of_range
from armctl.kinematics.chain import Chain
from armctl.kinematics.target import as_numbers
from armctl.lazy_dataclass import dataclass
from armctl.robot.body.hulls import Hull
from armctl.robot.look.pieces import Mount, link_name
from armctl.robot.parts import Look
from armctl.robot.solids import Solid, block

# The triangles of links, and how far apart they are: a second look where convex hulls overlap.
#
# A hull bridges whatever is hollow, such as a fork. Distances of triangles are those of the library FCL
# (python-fcl, an optional dependency; without it hulls alone decide).

CLEAR_M = 1e-3
"""A distance of triangles counts from here on: the pre-flight lets parts dip by half a millimetre, and by as
much again between samples, so that surfaces never cut each other."""
_MOST_TRIANGLES = 20_000
"""of one piece; where there are more, corners are moved to a grid"""
_WELDED_M, _FINEST_M, _COARSEST_M = 1e-5, 2.5e-4, 4e-3
"""spacing of that grid; beyond, hulls decide"""
_BITS = 21
_MOST_STEPS = 1 << _BITS


def comparable() -> bool:
    """Whether the library is there."""
    return find_spec("fcl") is not None


@dataclass(frozen=True, slots=True)
class Surface:
    """Triangles of a piece of a link, in the link's frame."""

    points: bytes
    """(k, 3) little-endian float32 [m]"""
    faces: bytes
    """(f, 3) little-endian uint32, indices of points"""
    off: float
    """how far a point of the piece is from these triangles, at most [m]"""

    @classmethod
    def of(cls, triangles: FloatArray) -> Surface | None:
        """Of triangles (k, 3, 3) [m]; None: there are too many of them, or no library to compare them."""
        if not comparable():
            return None
        low = triangles.min(axis=(0, 1))
        spacing = max(_WELDED_M, float(np.ptp(triangles, axis=(0, 1)).max()) / (_MOST_STEPS - 1))
        while spacing <= _COARSEST_M:
            steps = np.rint((triangles.reshape(-1, 3) - low) / spacing).astype(np.int64)
            places, index = np.unique(_packed(steps), return_inverse=True)
            if len(places) < _MOST_STEPS:
                faces = np.unique(_packed(np.sort(index.reshape(-1, 3), axis=1)))
                if len(faces) <= _MOST_TRIANGLES:
                    points = low + spacing * _unpacked(places)
                    off = 0.5 * 3**0.5 * spacing
                    return cls(points.astype("<f4").tobytes(), _unpacked(faces).astype("<u4").tobytes(), off)
            spacing = max(_FINEST_M, 1.5 * spacing)
        return None

    def model(self) -> Any:
        """As FCL holds it."""
        points = np.frombuffer(self.points, "<f4").reshape(-1, 3).astype(np.float64)
        faces = np.frombuffer(self.faces, "<u4").reshape(-1, 3).astype(np.int32)
        model = _fcl().BVHModel()
        model.beginModel(len(faces), len(points))
        model.addSubModel(points, faces)
        model.endModel()
        return model


def _packed(rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(k,) a number for each of (k, 3) numbers below ``_MOST_STEPS``: they are sorted ten times as fast."""
    return (rows[:, 0] << 2 * _BITS) | (rows[:, 1] << _BITS) | rows[:, 2]


def _unpacked(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    mask = _MOST_STEPS - 1
    return np.stack([numbers >> 2 * _BITS, (numbers >> _BITS) & mask, numbers & mask], axis=1)


@cache
def _fcl() -> Any:
    return import_module("fcl")  # a tenth of a second that an arm without meshes does without


class SurfacePairs:
    """Distances between any two of some surfaces."""

    def __init__(self, surfaces: Sequence[Surface | None]) -> None:
        self._surfaces = surfaces
        self._models: dict[int, Any] = {}

    def distances(
        self, one: NDArray[np.intp], other: NDArray[np.intp], R: FloatArray, origin: FloatArray
    ) -> FloatArray:
        """Distances (k,) [m] between surfaces and others, lower bounds; 0 where they cut each other.

        ``R`` (k, 3, 3) and ``origin`` (k, 3) [m] place the frames of the others in those of the first. What
        is inside another, and cuts none of it, counts as apart from it: no motion comes there without a cut.
        """
        fcl, found = _fcl(), np.zeros(len(one))
        here, request, touch = fcl.Transform(), fcl.DistanceRequest(), fcl.CollisionRequest()
        for k, (i, j) in enumerate(zip(one.tolist(), other.tolist(), strict=True)):
            first = fcl.CollisionObject(self._model(i), here)
            second = fcl.CollisionObject(self._model(j), fcl.Transform(R[k], origin[k]))
            if not fcl.collide(first, second, touch, fcl.CollisionResult()):  # several times as fast
                found[k] = fcl.distance(first, second, request, fcl.DistanceResult()) - self._off(i, j)
        return np.maximum(found, 0.0)

    def _off(self, *pair: int) -> float:
        return sum(one.off for k in pair if (one := self._surfaces[k]) is not None)

    def _model(self, k: int) -> Any:
        surface = self._surfaces[k]
        if k not in self._models and surface is not None:
            self._models[k] = surface.model()
        return self._models[k]


Openings = tuple[float, float]
"""between which a gripper is, 0 (closed) to 1"""
ANY_OPENING: Openings = (0.0, 1.0)
BODY_ASSUMED = "the body: convex hulls of the shapes that are drawn (armctl check says how closely)"
"""a line of ``assumed`` that ``with_body`` has more to say about"""
BODY_GUESSED = (
    "the body: guessed from the lengths of the links, so what is called clear may touch. "
    "Give the arm a look: 'armctl new NAME --from ROBOT --look' prints the guess to go on from"
)
"""what is said of an arm whose body is a guess (``Robot.body_is_guessed``)"""


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


# A part that the arm carries between its jaws, as large as a step or a person says.

CARRIED = "the carried part"
"""what refusals call it"""
THINNEST_PART_MM, LARGEST_PART_MM = 0.1, 1000.0
"""no edge is shorter, or longer"""
Edges = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CarriedPart:
    """A box round what is between the jaws: its edges are along x, y and z of the tool frame.

    The middle of the box is at the tool point. It moves with the tool, until the gripper moves again.
    ``InputError``: an edge is shorter than ``THINNEST_PART_MM``, or longer than ``LARGEST_PART_MM``.
    """

    edges_mm: Edges
    """along x, y and z of the tool frame [mm]"""

    def __post_init__(self) -> None:
        for axis, edge in zip("xyz", self.edges_mm, strict=True):
            if not THINNEST_PART_MM <= edge <= LARGEST_PART_MM:
                words = out_of_range(edge, THINNEST_PART_MM, LARGEST_PART_MM, "mm")
                raise InputError(f"part_mm: the edge along {axis} of the tool, {words}")

    @classmethod
    def of(cls, part_mm: Sequence[float] | None) -> Self | None:
        """The part with these three edges [mm]; None: nothing is carried. ``InputError`` as above."""
        if part_mm is None:
            return None
        edges = as_numbers(part_mm, "part_mm")
        if edges.shape != (3,):
            raise InputError(
                f"part_mm must be three edges in mm, along x, y and z of the tool, got {part_mm!r}"
            )
        x, y, z = edges.tolist()
        return cls((x, y, z))

    def __str__(self) -> str:
        return edge_words(self.edges_mm)

    @property
    def solid(self) -> Solid:
        """It as a mesh in the tool frame [m]."""
        x, y, z = self.edges_mm
        return block((x / 1000, y / 1000, z / 1000))

    def hung(self, chain: Chain) -> Capsule:
        """It as a piece of the link that the tool frame is in."""
        link, T = chain.places[-1]
        R, middle = T[:3, :3], T[:3, 3]
        half = np.array(self.edges_mm) / 2000
        long = int(half.argmax())
        ends = np.outer([-half[long], half[long]], R[:, long]) + middle
        radius = math.sqrt(float(half @ half - half[long] ** 2))
        hull = Hull(self.solid.vertices @ R.T + middle, np.vstack([R.T, -R.T]), 0.0)
        return Capsule(link, ends[0], ends[1], radius, CARRIED, hull)


def edge_words(edges_mm: Sequence[float | None]) -> str:
    """How large a part is, "20 × 30 × 40 mm"; an edge that is not given is a question mark."""
    return " × ".join("?" if edge is None else f"{edge:g}" for edge in edges_mm) + " mm"


def width(chain: Chain, look: Look) -> float:
    """Width of the links [m]."""
    return look.width * chain.length

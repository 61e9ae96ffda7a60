"""What rows of a look are on an arm: solids that hang on a link, on two links, or between two pins."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from armctl.arrays import ArrayRecord, FloatArray
from armctl.kinematics import Body
from armctl.kinematics.chain import Chain
from armctl.kinematics.frames import LinkFrames
from armctl.kinematics.subproblems import cross
from armctl.lazy_dataclass import dataclass
from armctl.robot.look.rows import (
    DENSITIES,
    MAKES,
    AnyRow,
    Bracket,
    Material,
    Motor,
    Paint,
    Plate,
    Rod,
    Spanned,
)
from armctl.robot.look.solids import Part, cut, outline_of, pair, parts, unit
from armctl.robot.solids import Solid

TOOL = "tool"
"""instead of a joint's name: the tool point"""
_ON_AXIS_MM, _PARALLEL = 20.0, 0.99
"""A motor whose shaft is so near to a joint's axis, and as parallel to it, is called after that joint."""
_SHORTEST_MM, _WIDEST_MM = 1e-3, 10_000
_SIDES = {"x": ("front", "rear"), "y": ("left", "right"), "z": ("upper", "lower")}


@dataclass(frozen=True, slots=True, eq=False)
class Pins(ArrayRecord):
    """Of a rod: it goes from a pin to one of another link."""

    near: FloatArray
    """(3,) in the frame of its mount [m]"""
    link: int
    """of the other pin; -1: the base"""
    far: FloatArray
    """(3,) in that link's frame [m]"""
    beside: FloatArray
    """(3,) across the rod, in the frame of its mount: how it is turned about itself"""


@dataclass(frozen=True, slots=True, eq=False)
class Mount(ArrayRecord):
    """A frame that moves with the arm: of a link, of a crank, or of a rod, along its x from the first pin."""

    hangs: int
    """its origin is the point of this link's joint; -1: the base"""
    turns: int
    """it turns with this link"""
    pins: Pins | None = None

    @property
    def is_link(self) -> bool:
        """Whether it is just the frame of a link."""
        return self.hangs == self.turns and self.pins is None

    @property
    def links(self) -> frozenset[int]:
        """All that move it."""
        return frozenset((self.hangs, self.turns, *(() if self.pins is None else (self.pins.link,))))

    def at(self, links: LinkFrames) -> tuple[FloatArray, FloatArray]:
        """Its rotation (3, 3, m) and origin (3, m) [m], base frame."""
        R, o = links.pose(self.turns)[0], links.pose(self.hangs)[1]
        if self.pins is None:
            return R, o
        here = np.einsum("ijm,j->im", R, self.pins.near) + o
        R_far, o_far = links.pose(self.pins.link)
        x = np.einsum("ijm,j->im", R_far, self.pins.far) + o_far - here
        x = x / np.linalg.norm(x, axis=0)
        y = np.einsum("ijm,j->im", R, self.pins.beside)
        y = y - (x * y).sum(axis=0) * x
        y /= np.linalg.norm(y, axis=0)
        return np.stack([x, y, np.array(cross(x, y))], axis=1), here


@dataclass(frozen=True, slots=True, eq=False)
class Jaw(ArrayRecord):
    """How a piece moves in its mount while the gripper opens from 0 to 1."""

    slide: FloatArray
    """(3,) [m]"""
    angle: float
    """[rad]"""
    axis: FloatArray
    """(3,) unit"""
    hinge: FloatArray
    """(3,) [m]"""

    def at(self, opening: float) -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3) and way (3,) [m] from where it is drawn."""
        x, y, z = self.axis.tolist()
        K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        angle = opening * self.angle
        R = np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * K @ K
        return R, opening * self.slide + self.hinge - R @ self.hinge


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """Solids of one colour that move as one."""

    row: int
    """index of the row that says it"""
    mount: Mount
    parts: tuple[Part, ...]
    """in the frame of the mount [m]"""
    part: str
    """what a user calls it"""
    jaw: Jaw | None = None
    body: bool = True
    """whether it is kept apart from others"""

    @property
    def color(self) -> Paint:
        """Of its solids."""
        return self.parts[0].color


class Drawing:
    """An arm as it stands while its look is described: where its links are then."""

    def __init__(self, chain: Chain, names: Sequence[str], titles: Sequence[str], pose: FloatArray) -> None:
        """``names`` and ``titles`` of the links; ``pose`` (n,) [rad]."""
        self.links = LinkFrames.at(chain, pose[None])
        self.indices: Mapping[str, int] = {name: i for i, name in enumerate(names)}
        self._titles = titles
        self.points = {name: 1000 * self.links.pose(i)[1][:, 0] for name, i in self.indices.items()}
        """(3,) of the joints and the tool, base frame [mm]"""
        self.points[TOOL] = 1000 * self.links.tool[:, 0]

    def wrong(self, row: AnyRow) -> list[tuple[str, str]]:
        """What cannot be in a row: the fields, and what is wrong with each."""
        found = list(self._wrong(row))
        if not found and isinstance(row, Spanned) and math.dist(*self._ends(row)) < _SHORTEST_MM:
            found = [("to", "both ends are in the same place: give to or to_mm, or from or from_mm")]
        return found

    def _wrong(self, row: AnyRow) -> Iterator[tuple[str, str]]:
        for key in ("joint", "turns_with", "to_joint"):
            name = getattr(row, key, None)
            if name is not None and name not in self.indices:
                yield key, f"there is no joint {name!r}; there are {', '.join(self.indices)}"
        for key, given in (("from", "from_"), ("to", "to")):
            name = getattr(row, given, None)
            if name is not None and name not in self.points:
                yield key, f"there is no joint {name!r}; there are {', '.join(self.points)}"
            if name is not None and getattr(row, f"{key}_mm") is not None:
                yield key, f"give {key} or {key}_mm, not both"
        if row.turns_with is not None and row.joint is None:
            yield "turns_with", "only what hangs on a joint turns with another link: give joint, too"
        for key in ("axis", "shaft", "case", "face"):
            if getattr(row, key, None) == (0.0, 0.0, 0.0):
                yield key, "a direction must not be 0, 0, 0"
                return
        if isinstance(row, Spanned) and not all(0 < width <= _WIDEST_MM for width in pair(row.width_mm)):
            yield "width_mm", f"must be more than 0 and at most {_WIDEST_MM}, not {row.width_mm!r}"
        if isinstance(row, Bracket) and 2 * row.thick_mm >= pair(row.width_mm)[0]:
            width = pair(row.width_mm)[0]
            yield "thick_mm", f"two cheeks of {row.thick_mm:g} mm do not fit into a width_mm of {width:g}"
        if isinstance(row, Motor) and abs(unit(row.shaft) @ unit(row.case)) > 1e-6:
            yield "case", f"must be across the shaft, which is {row.shaft!r}"
        if isinstance(row, Plate):
            try:
                cut(outline_of(row))
            except ValueError as cause:
                yield "outline_mm", str(cause)

    def pieces(self, index: int, row: AnyRow) -> Iterator[Piece]:
        """What a row stands for, and its mirror image."""
        start, end = self._ends(row)
        solids = tuple(parts(row, start, end))
        for image in range(1 if row.mirror is None else 2):
            M = np.eye(3)
            if image:
                axis = "xyz".index(row.mirror or "y")
                M[axis, axis] = -1.0
            mount, to_mount = self._mount(row, start, M)
            shown = (
                solids if isinstance(row, Rod) else [part.moved(to_mount @ M, (0, 0, 0)) for part in solids]
            )
            jaw, name = _jaw(row, to_mount, M), self._name(row, solids, M)
            groups: dict[Paint, list[Part]] = {}
            for part in shown:
                groups.setdefault(part.color, []).append(part.scaled(1e-3))
            for group in groups.values():
                yield Piece(index, mount, tuple(group), name, jaw, row.body)

    def _mount(self, row: AnyRow, start: FloatArray, M: FloatArray) -> tuple[Mount, FloatArray]:
        """Where a row, or its mirror image, hangs, and the rotation (3, 3) into there from the base."""
        hangs = self._index(row.joint)
        turns = hangs if row.turns_with is None else self._index(row.turns_with)
        back = self.links.pose(turns)[0][:, :, 0].T
        if not isinstance(row, Rod):
            return Mount(hangs, turns), back
        far = self._index(row.to_joint)
        there = self.links.pose(far)[0][:, :, 0].T @ M @ row.to_mm
        return Mount(hangs, turns, Pins(back @ M @ start / 1000, far, there / 1000, back @ unit("y"))), back

    def _index(self, name: str | None) -> int:
        return -1 if name is None else self.indices[name]

    def _ends(self, row: AnyRow) -> tuple[FloatArray, FloatArray]:
        """Where a row with two ends begins and ends, from its joint's point [mm]."""
        if not isinstance(row, Spanned):
            return np.zeros(3), np.zeros(3)
        at = np.zeros(3) if row.joint is None else self.points[row.joint]
        start, end = (
            self.points[name] - at if name is not None else np.array(mm or (0, 0, 0), dtype=np.float64)
            for name, mm in ((row.from_, row.from_mm), (row.to, row.to_mm))
        )
        if isinstance(row, Rod):
            end = self.points[row.to_joint] + end - at
        return start, end

    def _name(self, row: AnyRow, solids: Sequence[Part], M: FloatArray) -> str:
        """What a user calls it; of a pair that has a name of its own, or opens, each by its side."""
        name = row.name or self._usual_name(row)
        if row.mirror is None or not (row.name or _opens(row)):
            return name
        axis = "xyz".index(row.mirror)
        middle = np.concatenate([part.solid.vertices for part in solids]).mean(axis=0)
        if isinstance(row, Rod):  # its solids lie along the rod
            middle = self._ends(row)[0]
        side = _SIDES[row.mirror][int(M[axis, axis] * middle[axis] < 0)]
        return f"the {side} {name.removeprefix('the ')}"

    def _usual_name(self, row: AnyRow) -> str:
        if _opens(row):
            return "the jaw" if row.mirror else "the moving jaw"
        if isinstance(row, Motor):
            kind = "motor" if row.make.startswith("nema") else "servo"
            joint = self._driven(row)
            return f"the gripper {kind}" if joint is None else f"the {self._titles[joint].lower()} {kind}"
        if isinstance(row, Rod):
            return f"the rod to {self._titles[self._index(row.to_joint)].lower()}"
        return link_name(self._index(row.joint), self._titles)

    def _driven(self, row: Motor) -> int | None:
        """The joint on whose axis a motor's shaft lies."""
        at = np.array(row.at_mm) + (0.0 if row.joint is None else self.points[row.joint])
        best, nearest = None, _ON_AXIS_MM
        for name, i in self.indices.items():
            axis = self.links.pose(i)[0][:, 2, 0]
            if abs(axis @ unit(row.shaft)) > _PARALLEL:
                off = at - self.points[name]
                away = float(np.linalg.norm(off - (off @ axis) * axis))
                if away < nearest:
                    best, nearest = i, away
        return best


def link_name(link: int, titles: Sequence[str]) -> str:
    """What a user calls the link that a joint moves."""
    return "the base" if link < 0 else f"the link behind {titles[link].lower()}"


def _opens(row: AnyRow) -> bool:
    return row.open_mm is not None or row.open_deg != 0.0


def _jaw(row: AnyRow, to_mount: FloatArray, M: FloatArray) -> Jaw | None:
    """How it opens, in its mount. A mirror image ``M`` moves the other way: a turn changes its sense."""
    if not _opens(row):
        return None
    slide, hinge = (to_mount @ M @ np.array(at or (0, 0, 0)) / 1000 for at in (row.open_mm, row.hinge_mm))
    angle = math.radians(row.open_deg) * float(np.linalg.det(M))
    return Jaw(slide, angle, to_mount @ M @ unit(row.axis), hinge)


# Masses of an arm from its look: motors by their make, other parts by material and volume. An estimate.

MASSES_ASSUMED = (
    "masses of the links: from the look, motors by their make and other parts by material and volume"
)


def masses(
    chain: Chain, rows: Sequence[AnyRow], pieces: Sequence[Piece], material: Material
) -> tuple[Body, ...]:
    """A body for each piece that joints move.

    Hidden volume counts where solids overlap, and a hollow part has the density that its walls leave. A rod
    is taken to move with the link that it hangs on: level pieces of a parallelogram weigh on its joints as
    if they were at their pins.
    """
    return tuple(_bodies(chain, rows, pieces, material))


def _bodies(
    chain: Chain, rows: Sequence[AnyRow], pieces: Sequence[Piece], material: Material
) -> Iterator[Body]:
    for row in dict.fromkeys(piece.row for piece in pieces):
        said, own = rows[row], [piece for piece in pieces if piece.row == row]
        link = max(own[0].mount.hangs, own[0].mount.turns)
        if link < 0:
            continue
        # a row and its mirror image; the colours of one motor are pieces of their own
        volumes, centres = zip(*(_volume(part.solid) for piece in own for part in piece.parts), strict=True)
        volume, images = float(np.sum(volumes)), 1 if said.mirror is None else 2
        density = 1000.0 * DENSITIES[said.material or material]
        mass = images * MAKES[said.make].mass_kg if isinstance(said, Motor) else density * volume
        centre = np.average(np.array(centres), axis=0, weights=np.array(volumes))
        place = np.linalg.inv(chain.places[chain.joint_rows[link] + 1].T_link_frame)
        x, y, z = (place[:3, :3] @ centre + place[:3, 3]).tolist()
        yield Body(link, mass, (x, y, z))


def _volume(solid: Solid) -> tuple[float, FloatArray]:
    """Of a closed solid [m³], and its centre (3,) [m]: Gauss' theorem over its triangles."""
    a, b, c = solid.vertices[solid.faces].transpose(1, 0, 2)
    six = np.einsum("ij,ij->i", a, np.cross(b, c))
    volume = float(six.sum()) / 6
    return volume, (six[:, None] * (a + b + c)).sum(axis=0) / 24 / volume


def of_joints(chain: Chain, levers: FloatArray) -> FloatArray:
    """Levers of the links' turns (..., m) as those of the joints (..., n) [m/rad]."""
    return levers if chain.coupling is None else levers @ np.abs(chain.coupling)


def link_levers(chain: Chain, link: int, points: FloatArray) -> FloatArray:
    """How far points (p, 3) [m] in a link's frame move a radian of each link, at most: (m,) [m/rad]."""
    levers = np.zeros(len(chain.segments))
    aside = float(np.hypot(points[:, 0], points[:, 1]).max())
    away = float(np.linalg.norm(points, axis=1).max())
    for j in reversed(range(link + 1)):
        levers[j] = aside
        x, y, z = chain.segments[j][:3, 3].tolist()
        aside, away = math.hypot(x, y) + away, math.hypot(x, y, z) + away
    return levers


def mount_levers(chain: Chain, mount: Mount, points: FloatArray) -> FloatArray:
    """As ``link_levers``, of points (p, 3) [m] in the frame of a mount."""
    pins = mount.pins
    if pins is None:  # its origin moves with one link, and it turns with another
        at_joint = link_levers(chain, mount.hangs, np.zeros((1, 3)))
        about = np.zeros(len(chain.segments))
        about[: mount.turns + 1] = np.linalg.norm(points, axis=1).max()
        return at_joint + about
    near = mount_levers(chain, replace(mount, pins=None), pins.near[None])
    far = link_levers(chain, pins.link, pins.far[None])
    length = float(np.ptp(points[:, 0]))  # between its pins, or more: no less is needed of a bound
    aside = float(np.hypot(points[:, 1], points[:, 2]).max())
    beyond = max(float(-points[:, 0].min()), 0.0)
    turning = (near + far) / max(length - 2 * beyond, 1e-3)
    rolling = np.zeros(len(chain.segments))
    rolling[: max(mount.turns, pins.link) + 1] = 1.0
    return np.maximum(near, far) + (aside + beyond) * turning + aside * rolling

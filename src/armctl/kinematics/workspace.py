"""Where the tool point can be: points inside the limits, how far it comes, and the workspace cut open."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import within
from armctl.kinematics.chain import Chain
from armctl.kinematics.samples import greatest, joint_samples
from armctl.kinematics.velocity import manipulability
from armctl.lazy_dataclass import dataclass

BoolArray = NDArray[np.bool_]
_CANDIDATES_A_POINT = 16
_ROUNDS = 6
_INNER_SHARE = 3
"""one in so many cells of the inside keeps its point, every cell of the shell does"""


@dataclass(frozen=True, slots=True, eq=False)
class WorkspaceSamples:
    """Tool points of configurations inside the joint limits, evenly spread in space, denser in the shell."""

    q: FloatArray
    """(k, n) [rad]"""
    points: FloatArray
    """(k, 3) [m]"""
    manipulability: FloatArray
    """(k,) of the tool point's velocity (``velocity.manipulability``) [m³]; 0 at a singularity"""


@dataclass(frozen=True, slots=True)
class Extent:
    """How far the tool point comes inside the joint limits, in the base frame."""

    reach: float
    """farthest from the first joint's axis [m]"""
    lowest: float
    highest: float


def sample_workspace(chain: Chain, limits: FloatArray, count: int) -> WorkspaceSamples:
    """Sample the workspace inside joint limits (n, 2) with about ``count`` points; the same ones every time.

    Far more configurations are tried; space is divided into cells, and a cell keeps its first point.
    """
    q = joint_samples(limits, _CANDIDATES_A_POINT * count)
    q = q[chain.keeps_turns(q)]
    points = chain.forward(q)[:, :3, 3]
    kept = _spread(points, count)
    return WorkspaceSamples(q[kept], points[kept], manipulability(chain.jacobian(q[kept])[:, :3]))


def workspace_extent(chain: Chain, limits: FloatArray) -> Extent:
    """How far the tool comes sideways, down and up inside joint limits (n, 2)."""
    base, axes = chain.axes()

    def sideways(tips: FloatArray) -> FloatArray:
        return np.linalg.norm(np.cross(axes[0], tips - base[0]), axis=1)

    def most(measure: Callable[[FloatArray], FloatArray]) -> float:
        def value(q: FloatArray) -> FloatArray:
            return np.where(chain.keeps_turns(q), measure(chain.forward(q)[:, :3, 3]), -1e9)

        return greatest(value, limits)[0]

    return Extent(most(sideways), -most(lambda tips: -tips[:, 2]), most(lambda tips: tips[:, 2]))


def longest_levers(chain: Chain, limits: FloatArray) -> FloatArray:
    """How far the tool point can come from each joint's axis inside the limits (n, 2): (n,) [m]."""

    def lever(k: int) -> float:
        return greatest(lambda q: np.linalg.norm(chain.jacobian(q)[:, :3, k], axis=1), limits)[0]

    return np.array([lever(k) for k in range(chain.n)])


def _spread(points: FloatArray, count: int) -> NDArray[np.intp]:
    """Indices of about ``count`` points, one a cell at most, ascending."""
    low = points.min(axis=0)
    size: FloatArray = np.maximum(points.max(axis=0) - low, 1e-9)
    edge = float(np.cbrt(np.prod(np.maximum(size, 0.01 * size.max())) / count))
    kept = _one_a_cell(points - low, edge)
    for _ in range(_ROUNDS):
        if 0.9 * count <= len(kept) <= count:
            break
        edge *= (len(kept) / (0.95 * count)) ** 0.4
        kept = _one_a_cell(points - low, edge)
    return np.sort(kept)


def _one_a_cell(points: FloatArray, edge: float) -> NDArray[np.intp]:
    """The first point of every cell of the shell, and of some of the inside."""
    cells = (points / edge).astype(np.intp) + 1
    shape = cells.max(axis=0) + 2
    flat, first = np.unique(np.ravel_multi_index(cells.T, shape), return_index=True)
    full = np.zeros(shape, dtype=np.bool_)
    full.flat[flat] = True
    inner = full.copy()
    for axis in range(3):
        inner &= np.roll(full, 1, axis) & np.roll(full, -1, axis)
    shell = ~inner.flat[flat]
    return first[shell | (first % _INNER_SHARE == 0)]


# The workspace cut open by the plane of the first joint's axis and the tip.

Corner = tuple[int, int]
_PASSES = 2
_NEIGHBOURS = 2
"""corners to either side that a smoothed one is the mean of"""


def cell_outline(points: FloatArray, cell_m: float) -> tuple[FloatArray, ...]:
    """Closed lines (j, 2) [m] around all square cells that hold one of the points (k, 2) [m].

    A point lies in a full cell if, and only if, it is inside an odd number of them.
    """
    if len(points) == 0:
        return ()
    cells = np.floor(points / cell_m).astype(np.intp)
    low = cells.min(axis=0) - 1
    full = np.zeros(cells.max(axis=0) - low + 2, dtype=np.bool_)
    full[tuple((cells - low).T)] = True
    return tuple((np.array(line) + low) * cell_m for line in _lines(_sides(full)))


def smoothed(line: FloatArray) -> FloatArray:
    """A closed line (j, 2) without the steps of its cells: each point the mean of its neighbourhood."""
    corners = line[:-1]
    for _ in range(_PASSES):
        around = [np.roll(corners, shift, axis=0) for shift in range(-_NEIGHBOURS, _NEIGHBOURS + 1)]
        corners = np.mean(around, axis=0)
    return np.concatenate([corners, corners[:1]])


def enclosed_area(line: FloatArray) -> float:
    """Area inside a closed line (j, 2) [m²]; negative for a hole, which runs clockwise."""
    (x, y), (x_next, y_next) = line[:-1].T, line[1:].T
    return 0.5 * float((x * y_next - x_next * y).sum())


def _sides(full: NDArray[np.bool_]) -> dict[Corner, list[Corner]]:
    """From corner to corner along every side between a full and an empty cell, the full one on the left."""
    onward: dict[Corner, list[Corner]] = {}
    for (dx, dy), start, end in (
        ((0, -1), (0, 0), (1, 0)),
        ((1, 0), (1, 0), (1, 1)),
        ((0, 1), (1, 1), (0, 1)),
        ((-1, 0), (0, 1), (0, 0)),
    ):
        bare = full & ~np.roll(full, (-dx, -dy), (0, 1))
        for x, y in np.argwhere(bare).tolist():
            onward.setdefault((x + start[0], y + start[1]), []).append((x + end[0], y + end[1]))
    return onward


def _lines(onward: dict[Corner, list[Corner]]) -> list[list[Corner]]:
    """Sides strung together; as many lead to a corner as away from it, so every line closes."""
    lines: list[list[Corner]] = []
    while onward:
        line = [next(iter(onward))]
        while len(line) == 1 or line[-1] != line[0]:
            ways = onward[line[-1]]
            if len(ways) == 1:
                del onward[line[-1]]
            line.append(ways.pop())
        lines.append(line)
    return lines


_SAMPLES = 160_000
_CELLS = 96
"""across the sampled section"""
_SMALLEST_CELLS = 8
"""holes and islands of fewer cells are gaps in the sampling, not in the workspace"""


class Section(Protocol):
    """The section of one arm's workspace. Immutable; safe in several threads."""

    @property
    def exact(self) -> bool:
        """Whether the outline is the boundary itself, not that of sampled points."""
        ...

    def plane(self, q: FloatArray) -> FloatArray:
        """Pose ``T_base_plane`` (4, 4) [m] of the plane with the arm at ``q`` (n,) [rad].

        x leads away from the base axis, z along it; the tip is at y = 0.
        """
        ...

    def outline(self, q: FloatArray) -> tuple[FloatArray, ...]:
        """Closed lines (k, 2) in the plane's x and z [m]; a point inside an odd number of them is reached."""
        ...


class FirstAxis:
    """Cylindrical coordinates about the first joint's axis."""

    def __init__(self, chain: Chain, sense: Literal[-1, 1] = 1) -> None:
        """``sense`` −1: it is counted against the joint's own."""
        self._chain = chain
        points, axes = chain.axes()
        self.origin, self.axis = points[0], sense * axes[0]
        across = np.eye(3)[int(np.argmin(np.abs(axes[0])))]
        ahead = np.cross(axes[0], across)
        self.ahead = ahead / np.linalg.norm(ahead)
        self.left = np.cross(self.axis, self.ahead)

    def cylindrical(self, tips: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance from the axis, height along it, and direction about it [rad] of points (k, 3)."""
        away = tips - self.origin
        x, y = away @ self.ahead, away @ self.left
        return np.hypot(x, y), away @ self.axis, np.arctan2(y, x)

    def azimuth(self, q: FloatArray) -> float:
        """The direction of the tool point at ``q`` (n,) [rad]."""
        return float(self.cylindrical(self._chain.forward(q)[None, :3, 3])[2][0])

    def plane(self, q: FloatArray) -> FloatArray:
        """``T_base_plane`` (4, 4) [m]: x towards the tool point at ``q`` (n,) [rad], z along the axis."""
        azimuth = self.azimuth(q)
        forward = math.cos(azimuth) * self.ahead + math.sin(azimuth) * self.left
        T = np.eye(4)
        T[:3, :3] = np.column_stack([forward, np.cross(self.axis, forward), self.axis])
        T[:3, 3] = self.origin
        return T

    def place(self, rho: FloatArray, z: FloatArray, azimuth: FloatArray) -> FloatArray:
        """The points (k, 3) [m] of cylindrical coordinates (k,) each."""
        x, y = rho * np.cos(azimuth), rho * np.sin(azimuth)
        return self.origin + x[:, None] * self.ahead + y[:, None] * self.left + z[:, None] * self.axis


def _held_samples(chain: Chain, limits: FloatArray) -> FloatArray:
    """Tool points (k, 3) [m] of configurations with the first joint at zero."""
    held = limits.copy()
    held[0] = 0.0
    q = joint_samples(held, _SAMPLES)
    return chain.forward(q[chain.keeps_turns(q)])[:, :3, 3]


class SampledSection:
    """Of any arm: the smoothed outline of cells that hold sampled poses, turned into the plane."""

    exact = False

    def __init__(self, chain: Chain, limits: FloatArray) -> None:
        self._about, self._limits = FirstAxis(chain), limits
        self._rho, self._z, self._azimuth = self._about.cylindrical(_held_samples(chain, limits))
        self.cell_m = 2.0 * max(float(self._rho.max()), float(np.ptp(self._z)) / 2) / _CELLS

    def plane(self, q: FloatArray) -> FloatArray:
        """See ``Section``; the tip is in front of the axis."""
        return self._about.plane(q)

    def outline(self, q: FloatArray) -> tuple[FloatArray, ...]:
        """See ``Section``."""
        azimuth = self._about.azimuth(q)
        low, high = self._limits[0].tolist()
        front = within(azimuth - self._azimuth, low, high)
        back = within(azimuth + math.pi - self._azimuth, low, high)
        x = np.concatenate([self._rho[front], -self._rho[back]])
        z = np.concatenate([self._z[front], self._z[back]])
        lines = cell_outline(np.column_stack([x, z]), self.cell_m)
        smallest = _SMALLEST_CELLS * self.cell_m**2
        return tuple(smoothed(line) for line in lines if abs(enclosed_area(line)) > smallest)


# The workspace as a shell: cylindrical cells about the first joint's axis, and the surface between full and
# empty ones.

_SHELL_CELLS = 64
"""across the workspace, sideways and along the axis"""
_BINS = 360
"""of the direction about the axis, in which the first joint's range is counted"""
_SLICES = 36
"""of the half that is drawn"""
_UPRIGHT = math.cos(math.radians(2.0))
"""so far an axis leans at most whose workspace is cut at the floor"""
_HALF = 0.5
"""of a cell: between what is reached and what is not"""


@dataclass(frozen=True, slots=True, eq=False)
class CutShell:
    """A half of the workspace's surface, in the base frame."""

    vertices: FloatArray
    """(k, 3) [m]"""
    faces: NDArray[np.intp]
    """(m, 3) indices of vertices; counter-clockwise from outside, those farthest behind the cut first"""
    edge: FloatArray
    """(j, 2, 3) line segments along which it is cut open [m]"""


class WorkspaceShell:
    """Where the tool point can be, all about the first joint's axis. Immutable; safe in several threads.

    It is sampled: a cell is full where most of its neighbours hold a tool point. For arms whose first joint
    turns.
    """

    def __init__(self, chain: Chain, limits: FloatArray, floor_z: float = -math.inf) -> None:
        """``limits`` (n, 2) [rad]; below ``floor_z`` [m] there is none where the axis stands upright."""
        up = float(chain.axes()[1][0, 2])
        sense = -1 if up < 0 else 1
        self._about = FirstAxis(chain, sense)
        rho, z, azimuth = self._about.cylindrical(_held_samples(chain, limits))
        self.cell_m = max(2 * float(rho.max()), float(np.ptp(z))) / _SHELL_CELLS
        floor = floor_z - float(self._about.origin[2]) if abs(up) > _UPRIGHT else -math.inf
        self._is_cut_below = floor > float(z.min())
        self._low_z = floor if self._is_cut_below else float(z.min()) - 2 * self.cell_m
        above = z >= self._low_z
        i, j, k = self._cells(rho[above], z[above], azimuth[above])
        held = np.zeros((i.max(initial=0) + 3, j.max(initial=0) + 3, _BINS), dtype=np.bool_)
        held[i, j, k] = True
        full = _swept(held, *sorted((sense * limits[0]).tolist()))
        self._full = _blurred(full.astype(np.float32), edge_below=self._is_cut_below)

    def holds(self, points: FloatArray) -> BoolArray:
        """Whether points (k, 3) [m] are inside, to within a cell: (k,)."""
        i, j, k = self._cells(*self._about.cylindrical(points))
        wide, high, _ = self._full.shape
        known = (i < wide) & (j >= 0) & (j < high)
        values = self._full[np.where(known, i, 0), np.where(known, j, 0), k]
        return known & (values > _HALF)

    def _cells(
        self, rho: FloatArray, z: FloatArray, azimuth: FloatArray
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
        i, j = np.floor(rho / self.cell_m), np.floor((z - self._low_z) / self.cell_m)
        k = (azimuth / (2 * math.pi) * _BINS).round().astype(np.intp) % _BINS
        return i.astype(np.intp), j.astype(np.intp), k

    def plane(self, q: FloatArray) -> FloatArray:
        """``T_base_plane`` (4, 4) [m] in which it is cut with the arm at ``q`` (n,) [rad]; as a section's."""
        return self._about.plane(q)

    def cut(self, q: FloatArray, side: Literal[-1, 1]) -> CutShell:
        """The half on one side of the plane of the axis and the tool point at ``q`` (n,) [rad].

        ``side``: 1 is where y of the plane is positive.
        """
        azimuth = self._about.azimuth(q)
        width = math.pi / _SLICES
        centres = azimuth + side * width * (np.arange(_SLICES) + 0.5)
        # The share of each slice that is reached, from finer bins; the ends are doubled, so it is open there.
        fine = centres[:, None] + width * (np.arange(5) - 2) / 5
        bins = (fine / (2 * math.pi) * _BINS).round().astype(np.intp) % _BINS
        field = self._full[:, :, bins].mean(axis=-1)
        field = np.concatenate([field[..., :1], field, field[..., -1:]], axis=-1)
        field = np.concatenate([field[:1], field])  # the axis is no surface
        if self._is_cut_below:
            field = np.concatenate([field[:, :1], field], axis=1)
        places, faces, cells = _surface(field - _HALF)
        i, j, k = places.T
        rho = self.cell_m * np.maximum(i - 0.5, 0.0)
        z = self._low_z + self.cell_m * (j + (-0.5 if self._is_cut_below else 0.5))
        turned = azimuth + side * width * (k - 0.5)
        vertices = self._about.place(rho, z, turned)
        is_cut = (cells[:, 2] == 0) | (cells[:, 2] == _SLICES)
        if side > 0:  # across, along and around the axis are left-handed
            faces = faces[:, ::-1]
        away = -np.abs((vertices - self._about.origin) @ self.plane(q)[:3, 1])
        faces = faces[np.argsort(away[faces].mean(axis=1))]
        return CutShell(vertices, faces, vertices[_open_edges(faces, is_cut)])


def _swept(held: BoolArray, low: float, high: float) -> BoolArray:
    """What cells (a, b, bins) are reached, once those that are held by the other joints are turned [rad]."""
    bins = int(held.shape[2])
    first, last = (round(end / (2 * math.pi) * bins) for end in (low, high))
    width = min(last - first + 1, bins)
    ring = np.concatenate([held, held], axis=2).cumsum(axis=2, dtype=np.int32)
    ring = np.concatenate([np.zeros((*held.shape[:2], 1), dtype=np.int32), ring], axis=2)
    begins = np.roll(np.arange(bins), first + width - 1)
    return ring[:, :, begins + width] > ring[:, :, begins]


def _blurred(full: NDArray[np.float32], *, edge_below: bool) -> NDArray[np.float32]:
    """The mean of each cell and its neighbours sideways and along the axis: gaps in the samples close."""
    inner = np.pad(full, ((1, 0), (0, 0), (0, 0)), mode="edge")  # the axis has no other side
    across = np.divide(inner[:-1] + full + np.pad(full, ((0, 1), (0, 0), (0, 0)))[1:], 3, dtype=np.float32)
    below = np.pad(across, ((0, 0), (1, 0), (0, 0)), mode="edge" if edge_below else "constant")
    both = below[:, :-1] + np.pad(across, ((0, 0), (0, 1), (0, 0)))[:, 1:]
    return np.divide(both + across, 3, dtype=np.float32)


def _surface(field: FloatArray) -> tuple[FloatArray, NDArray[np.intp], NDArray[np.intp]]:
    """Where a field (a, b, c) is zero: vertices (k, 3) in cells, triangles (m, 3), each vertex's cell (k, 3).

    One vertex a cell of eight corners, at the mean of the crossings of its edges (naive surface nets, S. F.
    Gibson, "Constrained elastic surface nets", 1998). Triangles are counter-clockwise from the negative side.
    """
    shape = tuple(size - 1 for size in field.shape)
    total: FloatArray = np.zeros((*shape, 3))
    count: FloatArray = np.zeros(shape)
    crossings: list[BoolArray] = []
    for axis in range(3):
        here, there = (field.take(range(part, field.shape[axis] - 1 + part), axis=axis) for part in (0, 1))
        crossed = (here > 0) != (there > 0)
        crossings.append(crossed)
        along = np.where(crossed, here / np.where(crossed, here - there, 1.0), 0.0)
        place = np.stack(np.meshgrid(*(np.arange(float(n)) for n in crossed.shape), indexing="ij"), axis=-1)
        place[..., axis] += along
        place[~crossed] = 0.0
        others = [one for one in range(3) if one != axis]
        for first, second in ((0, 0), (0, 1), (1, 0), (1, 1)):
            part: list[slice] = [slice(None)] * 3
            part[others[0]] = slice(first, first + shape[others[0]])
            part[others[1]] = slice(second, second + shape[others[1]])
            total += place[tuple(part)]
            count += crossed[tuple(part)]
    cells = np.argwhere(count > 0)
    number = np.full(shape, -1, dtype=np.intp)
    number[tuple(cells.T)] = np.arange(len(cells))
    vertices: FloatArray = total[tuple(cells.T)] / count[tuple(cells.T)][:, None]
    faces: list[NDArray[np.intp]] = []
    for axis, crossed in enumerate(crossings):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        at = np.argwhere(crossed)
        at = at[(at[:, b] > 0) & (at[:, c] > 0) & (at[:, b] < shape[b]) & (at[:, c] < shape[c])]
        corners: list[NDArray[np.intp]] = []
        for back_b, back_c in ((1, 1), (0, 1), (0, 0), (1, 0)):
            cell = at.copy()
            cell[:, b] -= back_b
            cell[:, c] -= back_c
            corners.append(number[tuple(cell.T)])
        quads = np.stack(corners, axis=1)
        inward = field[tuple(at.T)] <= 0
        quads[inward] = quads[inward, ::-1]
        faces += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return vertices, np.concatenate(faces), cells


def _open_edges(faces: NDArray[np.intp], is_cut: BoolArray) -> NDArray[np.intp]:
    """(j, 2) vertices of the sides of triangles that belong to one only, and lie where it is cut."""
    sides = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    sides, count = np.unique(sides, axis=0, return_counts=True)
    return sides[(count == 1) & is_cut[sides].all(axis=1)]

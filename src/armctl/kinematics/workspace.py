"""Where the tool point can be: points inside the limits, how far it comes, and the workspace cut open."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import within
from armctl.kinematics.chain import Chain
from armctl.kinematics.samples import greatest, joint_samples
from armctl.kinematics.velocity import manipulability

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


class SampledSection:
    """Of any arm: the smoothed outline of cells that hold sampled poses, turned into the plane."""

    exact = False

    def __init__(self, chain: Chain, limits: FloatArray) -> None:
        self._chain, self._limits = chain, limits
        points, axes = chain.axes()
        self._origin, self._axis = points[0], axes[0]
        across = np.eye(3)[int(np.argmin(np.abs(axes[0])))]
        ahead = np.cross(axes[0], across)
        self._ahead = ahead / np.linalg.norm(ahead)
        held = limits.copy()
        held[0] = 0.0
        q = joint_samples(held, _SAMPLES)
        q = q[chain.keeps_turns(q)]
        self._rho, self._z, self._azimuth = self._cylindrical(chain.forward(q)[:, :3, 3])
        self.cell_m = 2.0 * max(float(self._rho.max()), float(np.ptp(self._z)) / 2) / _CELLS

    def plane(self, q: FloatArray) -> FloatArray:
        """See ``Section``; the tip is in front of the axis."""
        _, _, azimuth = self._cylindrical(self._chain.forward(q)[None, :3, 3])
        left = np.cross(self._axis, self._ahead)
        forward = math.cos(azimuth[0]) * self._ahead + math.sin(azimuth[0]) * left
        T = np.eye(4)
        T[:3, :3] = np.column_stack([forward, np.cross(self._axis, forward), self._axis])
        T[:3, 3] = self._origin
        return T

    def outline(self, q: FloatArray) -> tuple[FloatArray, ...]:
        """See ``Section``."""
        _, _, (azimuth,) = self._cylindrical(self._chain.forward(q)[None, :3, 3])
        low, high = self._limits[0].tolist()
        front = within(azimuth - self._azimuth, low, high)
        back = within(azimuth + math.pi - self._azimuth, low, high)
        x = np.concatenate([self._rho[front], -self._rho[back]])
        z = np.concatenate([self._z[front], self._z[back]])
        lines = cell_outline(np.column_stack([x, z]), self.cell_m)
        smallest = _SMALLEST_CELLS * self.cell_m**2
        return tuple(smoothed(line) for line in lines if abs(enclosed_area(line)) > smallest)

    def _cylindrical(self, tips: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance from the first axis, height along it, and direction about it of points (k, 3)."""
        away = tips - self._origin
        x, y = away @ self._ahead, away @ np.cross(self._axis, self._ahead)
        return np.hypot(x, y), away @ self._axis, np.arctan2(y, x)

"""Where the tool point can be: a cloud of points inside the limits, and how far it comes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.chain import Chain
from armctl.kinematics.samples import greatest, joint_samples
from armctl.kinematics.velocity import manipulability

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
_CANDIDATES_A_POINT = 16
_CHUNK = 4096
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
    """[m]"""
    highest: float
    """[m]"""


def sample_workspace(chain: Chain, limits: FloatArray, count: int) -> WorkspaceSamples:
    """Sample the workspace; the same points every time.

    Far more configurations than are asked for are tried; space is divided into cells, and a cell keeps the
    first point that falls into it: where many poses lead to the same place, one is enough.

    Args:
        chain: the arm.
        limits: (n, 2) joint limits [rad].
        count: about how many points to keep.
    """
    q = joint_samples(limits, _CANDIDATES_A_POINT * count)
    parts = range(0, len(q), _CHUNK)  # in parts: other threads get their turn in between
    points = np.concatenate([chain.forward(q[i : i + _CHUNK])[:, :3, 3] for i in parts])
    kept = _spread(points, count)
    measures = [
        manipulability(chain.jacobian(q[kept[i : i + _CHUNK]])[:, :3]) for i in range(0, len(kept), _CHUNK)
    ]
    return WorkspaceSamples(q[kept], points[kept], np.concatenate(measures))


def workspace_extent(chain: Chain, limits: FloatArray) -> Extent:
    """How far the tool comes sideways, down and up.

    Args:
        chain: the arm.
        limits: (n, 2) joint limits [rad].
    """
    base, axes = chain.axes()

    def sideways(q: FloatArray) -> FloatArray:
        return np.linalg.norm(np.cross(axes[0], chain.forward(q)[:, :3, 3] - base[0]), axis=1)

    def height(q: FloatArray) -> FloatArray:
        return chain.forward(q)[:, 2, 3]

    return Extent(
        reach=greatest(sideways, limits)[0],
        lowest=-greatest(lambda q: -height(q), limits)[0],
        highest=greatest(height, limits)[0],
    )


def longest_levers(chain: Chain, limits: FloatArray) -> FloatArray:
    """How far the tool point can come from each joint's axis inside the limits: (n,) [m].

    A joint that turns with ω alone moves the tip with ω times its distance from the axis, so this is the
    most that it can do.

    Args:
        chain: the arm.
        limits: (n, 2) joint limits [rad].
    """

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

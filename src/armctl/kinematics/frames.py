"""Frames of a chain: Denavit-Hartenberg rows, frames fixed to links, and where the links are."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.lazy_dataclass import dataclass

Convention = Literal["standard", "modified"]
_PARALLEL = 1e-14
"""sine of the angle below which an axis is along z"""


@dataclass(frozen=True, slots=True)
class DHRow:
    """One Denavit-Hartenberg row, in metres and radians.

    A row with ``joint=True`` turns by ``theta_rad + q``; a fixed row stays at ``theta_rad``.
    """

    a_m: float
    alpha_rad: float
    d_m: float
    theta_rad: float = 0.0
    joint: bool = True


class FixedFrame(NamedTuple):
    """A frame that is fixed to a link."""

    link: int
    """index of the joint that moves it; -1: the base"""
    T_link_frame: FloatArray
    """(4, 4), metres"""


def dh_frames(rows: Sequence[DHRow], convention: Convention) -> tuple[list[FloatArray], list[FixedFrame]]:
    """Of each row that turns, the transform (4, 4) ahead of it; the base, and the frame behind each row.

    Raises ``InputError``: no such convention, or a number that is not finite.
    """
    if convention not in ("standard", "modified"):
        raise InputError(f"DH convention {convention!r}: allowed are 'standard' and 'modified'")
    for i, row in enumerate(rows, 1):
        if not all(map(math.isfinite, (row.a_m, row.alpha_rad, row.d_m, row.theta_rad))):
            raise InputError(f"DH row {i} holds a value that is not a finite number: {row}")
    segments: list[FloatArray] = []
    T_link_frame = np.eye(4)
    places = [FixedFrame(-1, T_link_frame)]
    for row in rows:
        if convention == "modified":
            T_link_frame = T_link_frame @ _x_part(row)
        if row.joint:
            segments.append(T_link_frame)
            T_link_frame = np.eye(4)
        T_link_frame = T_link_frame @ _z_part(row)
        if convention == "standard":
            T_link_frame = T_link_frame @ _x_part(row)
        places.append(FixedFrame(len(segments) - 1, T_link_frame))
    return segments, places


def _x_part(row: DHRow) -> FloatArray:
    """Rx(alpha) and Tx(a), which commute: (4, 4)."""
    c, s = _exact_cos_sin(row.alpha_rad)
    return np.array([[1, 0, 0, row.a_m], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def _z_part(row: DHRow) -> FloatArray:
    """Rz(theta) and Tz(d), which commute: (4, 4)."""
    c, s = _exact_cos_sin(row.theta_rad)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, row.d_m], [0, 0, 0, 1.0]])


def _exact_cos_sin(angle: float) -> tuple[float, float]:
    """Cosine and sine, exact at whole quarter turns (cos(pi/2) in floats is 6e-17, not 0)."""
    quarter = angle / (math.pi / 2)
    if abs(quarter - round(quarter)) < 1e-14:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarter) % 4]
    return math.cos(angle), math.sin(angle)


class _Walked(Protocol):
    """A chain, which stands above: where its links are, from the base to the tool."""

    def checked(self, q: ArrayLike) -> FloatArray: ...
    def walk(self, q: FloatArray) -> Iterator[FloatArray]: ...


@dataclass(frozen=True, slots=True, eq=False)
class LinkFrames:
    """Where the links are in m configurations, entry by entry in memory. Link -1 is the base."""

    rotation: tuple[FloatArray, ...]
    """one a link, (3, 3, m): ``R_base_link``"""
    origin: tuple[FloatArray, ...]
    """one a link, (3, m): a point of its axis, base frame [m]"""
    tool: FloatArray
    """(3, m) the tool point, base frame [m]"""

    @classmethod
    def at(cls, chain: _Walked, q: ArrayLike) -> LinkFrames:
        """The links of ``chain`` at ``q`` (m, n) [rad]."""
        *links, (_, _, _, tool) = chain.walk(chain.checked(q))
        rotation = tuple(frame[:3].swapaxes(0, 1) for frame in links)
        return cls(rotation, tuple(origin for *_, origin in links), tool)

    def pose(self, link: int) -> tuple[FloatArray, FloatArray]:
        """Rotation (3, 3, m) and origin (3, m) [m] of a link (-1: the base), base frame."""
        if link < 0:
            m = self.tool.shape[1]
            return np.broadcast_to(np.eye(3)[:, :, None], (3, 3, m)), np.zeros((3, m))
        return self.rotation[link], self.origin[link]

    def and_also(self, more: Iterable[tuple[FloatArray, FloatArray]]) -> LinkFrames:
        """With other frames, as ``pose`` gives them, behind the links: they are numbered on."""
        rotations, origins = zip(*more, strict=True)
        return LinkFrames((*self.rotation, *rotations), (*self.origin, *origins), self.tool)

    def place(self, link: int, points: ArrayLike) -> FloatArray:
        """Points (p, 3) [m] in the frame of a link (-1: the base) as (3, p, m) [m] in the base frame."""
        points = np.asarray(points, dtype=np.float64)
        if link < 0:
            return np.broadcast_to(points.T[:, :, None], (3, len(points), self.tool.shape[1]))
        return np.matmul(points, self.rotation[link]) + self.origin[link][:, None, :]

    def relative(
        self, one: NDArray[np.intp], other: NDArray[np.intp], at: NDArray[np.intp]
    ) -> tuple[FloatArray, FloatArray]:
        """Rotations (k, 3, 3) and origins (k, 3) [m] of ``other`` links in the frames of ``one``, (k,) each.

        ``at`` (k,): in which of the m configurations. -1 among the links is the base.
        """
        R_base, o_base = self.pose(-1)
        R, o = np.stack([*self.rotation, R_base]), np.stack([*self.origin, o_base])
        back, there = R[one, :, :, at].transpose(0, 2, 1), o[other, :, at] - o[one, :, at]
        return back @ R[other, :, :, at], (back @ there[:, :, None])[:, :, 0]


def frame_along(axis: FloatArray) -> FloatArray:
    """(4, 4) a turn that takes z to a unit vector, the smallest there is."""
    x, y, z = axis.tolist()
    T = np.eye(4)
    if math.hypot(x, y) < _PARALLEL:
        T[1, 1] = T[2, 2] = math.copysign(1.0, z)
    elif z > -0.5:
        h = 1.0 / (1.0 + z)
        T[:3, :3] = [[1 - h * x * x, -h * x * y, x], [-h * x * y, 1 - h * y * y, y], [-x, -y, z]]
    else:  # half a turn about x first: 1 + z has no digits near -1
        h = 1.0 / (1.0 - z)
        T[:3, :3] = [[1 - h * x * x, h * x * y, x], [-h * x * y, h * y * y - 1, y], [x, -y, z]]
    return T

"""Serial chains of revolute joints given as Denavit-Hartenberg rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError
from armctl.kinematics.angles import half_angle_cos_sin
from armctl.kinematics.checks import as_numbers

FloatArray = NDArray[np.float64]
Convention = Literal["standard", "modified"]
_CHUNK = 8192


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


def _x_part(row: DHRow) -> FloatArray:
    """Rx(alpha) and Tx(a), which commute: (4, 4)."""
    c, s = _exact_cos_sin(row.alpha_rad)
    return np.array([[1, 0, 0, row.a_m], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1.0]])


def _z_part(theta: float, d: float) -> FloatArray:
    """Rz(theta) and Tz(d), which commute: (4, 4)."""
    c, s = _exact_cos_sin(theta)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1.0]])


def _exact_cos_sin(angle: float) -> tuple[float, float]:
    """Cosine and sine, exact at whole quarter turns (cos(pi/2) in floats is 6e-17, not 0)."""
    quarter = angle / (math.pi / 2)
    if abs(quarter - round(quarter)) < 1e-14:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarter) % 4]
    return math.cos(angle), math.sin(angle)


class DHChain:
    """Forward kinematics and Jacobian of a chain of DH rows.

    Standard (distal) rows are ``Rz(theta) Tz(d) Tx(a) Rx(alpha)``, modified (Craig, proximal)
    rows ``Rx(alpha) Tx(a) Rz(theta) Tz(d)``. Frames are named ``T_base_x``: x seen from the base.

    Inside, the rows are folded into one fixed transform ahead of each joint and one behind the
    last, so that every joint is a plain turn about z and fixed rows cost nothing.
    """

    def __init__(self, rows: Sequence[DHRow], convention: Convention = "standard") -> None:
        if convention not in ("standard", "modified"):
            raise InputError(f"DH convention {convention!r}: allowed are 'standard' and 'modified'")
        for i, row in enumerate(rows, 1):
            if not all(map(math.isfinite, (row.a_m, row.alpha_rad, row.d_m, row.theta_rad))):
                raise InputError(f"DH row {i} holds a value that is not a finite number: {row}")
        self.rows = tuple(rows)
        self.convention: Convention = convention
        self.joint_rows = tuple(i for i, row in enumerate(self.rows) if row.joint)
        if not self.joint_rows:
            raise InputError("a chain needs at least one row with a joint")
        self.segments, self.tail = self._fold()
        self._segment_tuples = tuple(map(_columns_of, self.segments))
        self._tail_tuples = _columns_of(self.tail)

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joint_rows)

    def _fold(self) -> tuple[tuple[FloatArray, ...], FloatArray]:
        segments: list[FloatArray] = []
        ahead = np.eye(4)
        for row in self.rows:
            if self.convention == "modified":
                ahead = ahead @ _x_part(row)
            if row.joint:
                segments.append(ahead)
                ahead = np.eye(4)
            ahead = ahead @ _z_part(row.theta_rad, row.d_m)
            if self.convention == "standard":
                ahead = ahead @ _x_part(row)
        return tuple(segments), ahead

    def checked(self, q: ArrayLike) -> FloatArray:
        """``q`` as an array ``(..., n)`` of finite numbers.

        Raises:
            InputError: wrong shape, text, NaN or infinity.
        """
        array = as_numbers(q, "joint angles")
        if array.ndim == 0 or array.shape[-1] != self.n:
            raise InputError(f"{self.n} joint angles are needed, got an array of shape {array.shape}")
        if not np.isfinite(array).all():
            raise InputError(f"joint angles must be finite numbers, got {q!r}")
        return array

    def forward(self, q: ArrayLike) -> FloatArray:
        """Pose of the tool frame.

        Args:
            q: (..., n) joint angles [rad].

        Returns:
            ``T_base_tool`` (..., 4, 4), translation in metres.

        Raises:
            InputError: ``q`` has the wrong shape or is not finite.
        """
        q = self.checked(q)
        if q.ndim == 1:
            return self._forward_one(q)
        T = np.zeros((*q.shape[:-1], 4, 4))
        flat, poses = q.reshape(-1, self.n), T.reshape(-1, 4, 4)
        for at in range(0, len(flat), _CHUNK):  # temporaries that stay in the processor's cache
            cut = slice(at, at + _CHUNK)
            for j, column in enumerate(self._columns(flat[cut])[-1]):
                for i, entry in enumerate(column):
                    poses[cut, i, j] = entry
        poses[:, 3, 3] = 1.0
        return T

    def _forward_one(self, q: FloatArray) -> FloatArray:
        """One pose in plain floats: a ufunc call costs more than the whole sum."""
        r = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        for segment, angle in zip(self._segment_tuples, q.tolist(), strict=True):
            r = _times(r, segment)
            c, s = math.cos(angle), math.sin(angle)
            (x0, x1, x2), (y0, y1, y2), z, p = r
            r = (
                (x0 * c + y0 * s, x1 * c + y1 * s, x2 * c + y2 * s),
                (y0 * c - x0 * s, y1 * c - x1 * s, y2 * c - x2 * s),
                z,
                p,
            )
        x, y, z, p = _times(r, self._tail_tuples)
        return np.array(
            [[x[0], y[0], z[0], p[0]], [x[1], y[1], z[1], p[1]], [x[2], y[2], z[2], p[2]], [0, 0, 0, 1.0]]
        )

    def _columns(self, q: FloatArray) -> list[_ArrayColumns]:
        """Frames ahead of each joint's turn, and the tool frame, as columns of arrays (or constants)."""
        frames: list[_ArrayColumns] = []
        frame: _ArrayColumns = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
        for k, segment in enumerate(self._segment_tuples):
            frame = _array_times(frame, segment)
            frames.append(frame)
            c, s = half_angle_cos_sin(q[..., k])
            x, y, z, p = frame
            frame = (
                tuple(_sum((xi, c), (yi, s)) for xi, yi in zip(x, y, strict=True)),
                tuple(_sum((yi, c), (xi, -s)) for xi, yi in zip(x, y, strict=True)),
                z,
                p,
            )
        frames.append(_array_times(frame, self._tail_tuples))
        return frames

    def frames(self, q: ArrayLike) -> FloatArray:
        """Poses of all frames: the base, then one behind each row.

        Args:
            q: (..., n) joint angles [rad].

        Returns:
            ``T_base_row`` (..., len(rows) + 1, 4, 4), metres; the last one is the tool frame.
        """
        q = self.checked(q)
        out = np.zeros((*q.shape[:-1], len(self.rows) + 1, 4, 4))
        out[..., 0, :, :] = np.eye(4)
        k = 0
        for i, row in enumerate(self.rows):
            if row.joint:
                c, s = np.cos(q[..., k]), np.sin(q[..., k])
                k += 1
            else:
                c, s = np.ones(q.shape[:-1]), np.zeros(q.shape[:-1])
            turn = np.zeros((*q.shape[:-1], 4, 4))
            turn[..., 0, 0] = turn[..., 1, 1] = c
            turn[..., 1, 0], turn[..., 0, 1] = s, -s
            turn[..., 2, 2] = turn[..., 3, 3] = 1.0
            z_part, x_part = _z_part(row.theta_rad, row.d_m), _x_part(row)
            step = turn @ z_part @ x_part if self.convention == "standard" else x_part @ turn @ z_part
            out[..., i + 1, :, :] = out[..., i, :, :] @ step
        return out

    def jacobian(self, q: ArrayLike) -> FloatArray:
        """Geometric Jacobian of the tool point in the base frame.

        Column i is ``(z_i x (p_tool - p_i), z_i)``: linear over angular velocity for one rad/s.

        Args:
            q: (..., n) joint angles [rad].

        Returns:
            (..., 6, n): metres over radians a radian.
        """
        q = self.checked(q)
        batch = q if q.ndim > 1 else q[None]
        frames = self._columns(batch)
        tip = frames[-1][3]
        J = np.zeros((*batch.shape[:-1], 6, self.n))
        for k, (_, _, z, p) in enumerate(frames[:-1]):
            lever = [t - o for t, o in zip(tip, p, strict=True)]
            J[..., 0, k] = z[1] * lever[2] - z[2] * lever[1]
            J[..., 1, k] = z[2] * lever[0] - z[0] * lever[2]
            J[..., 2, k] = z[0] * lever[1] - z[1] * lever[0]
            for i in range(3):
                J[..., 3 + i, k] = z[i]
        return J if q.ndim > 1 else J[0]

    def axes(self, q: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
        """Joint axes at ``q`` (default: all zero): points (n, 3) [m], unit directions (n, 3), base frame."""
        q = np.zeros(self.n) if q is None else self.checked(q)
        frames = self._columns(q[None])[:-1]
        points = np.array([[float(np.squeeze(v)) for v in frame[3]] for frame in frames])
        directions = np.array([[float(np.squeeze(v)) for v in frame[2]] for frame in frames])
        return points, directions


_Vector = tuple[float, float, float]
_Columns = tuple[_Vector, _Vector, _Vector, _Vector]
_Entry = float | FloatArray
_ArrayColumns = tuple[tuple[_Entry, ...], tuple[_Entry, ...], tuple[_Entry, ...], tuple[_Entry, ...]]


def _columns_of(T: FloatArray) -> _Columns:
    x, y, z, p = (tuple(map(float, T[:3, j])) for j in range(4))
    return x, y, z, p  # pyright: ignore[reportReturnType]


def _times(r: _Columns, b: _Columns) -> _Columns:
    (x0, x1, x2), (y0, y1, y2), (z0, z1, z2), (p0, p1, p2) = r
    bx, by, bz, bp = (
        (x0 * u + y0 * v + z0 * w, x1 * u + y1 * v + z1 * w, x2 * u + y2 * v + z2 * w) for u, v, w in b
    )
    return bx, by, bz, (bp[0] + p0, bp[1] + p1, bp[2] + p2)


def _sum(*terms: tuple[_Entry, _Entry]) -> _Entry:
    """Sum of products that leaves out what is exactly zero: most of a DH chain is."""
    total: _Entry = 0.0
    for a, b in terms:
        if (isinstance(a, float) and a == 0.0) or (isinstance(b, float) and b == 0.0):
            continue
        product = (
            b if isinstance(a, float) and a == 1.0 else a if isinstance(b, float) and b == 1.0 else a * b
        )
        total = product if isinstance(total, float) and total == 0.0 else total + product
    return total


def _array_times(r: _ArrayColumns, b: _Columns) -> _ArrayColumns:
    x, y, z, p = r

    def column(c: _Vector, extra: tuple[_Entry, ...] | None) -> tuple[_Entry, ...]:
        terms = [[(x[i], c[0]), (y[i], c[1]), (z[i], c[2])] for i in range(3)]
        if extra is not None:
            for i in range(3):
                terms[i].append((extra[i], 1.0))
        return tuple(_sum(*t) for t in terms)

    return column(b[0], None), column(b[1], None), column(b[2], None), column(b[3], p)

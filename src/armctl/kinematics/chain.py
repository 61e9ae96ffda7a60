"""Serial chains of revolute joints given as Denavit-Hartenberg rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError
from armctl.kinematics.compiled import ChainProgram, MatrixKernel, jacobian_kernel, pose_kernel, small_angles
from armctl.kinematics.target import as_numbers, require_finite

FloatArray = NDArray[np.float64]
Convention = Literal["standard", "modified"]
_FLOAT = np.dtype(np.float64)
_POSE_SHAPE = (4, 4)


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
        for fixed in (*self.segments, self.tail):
            fixed.flags.writeable = False
        self._one_shape = (self.n,)
        self._jacobian_shape = (6, self.n)
        program = ChainProgram(self.segments, self.tail)
        self._pose, self._jacobian = pose_kernel(program), jacobian_kernel(program)

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
        """``q`` as an array ``(..., n)`` of finite numbers; a copy.

        Raises:
            InputError: wrong shape, text, NaN or infinity.
        """
        numbers = self._numbers(q)
        require_finite(numbers, "joint angles")
        return numbers.copy() if numbers is q else numbers

    def checked_one(self, q: ArrayLike) -> FloatArray:
        """``q`` as one configuration (n,) of finite numbers; a copy.

        Raises:
            InputError: wrong shape, text, NaN or infinity.
        """
        numbers = self.checked(q)
        if numbers.ndim != 1:
            raise InputError(f"{self.n} joint angles are needed, got an array of shape {numbers.shape}")
        return numbers

    def _numbers(self, q: ArrayLike) -> FloatArray:
        """``q`` as an array ``(..., n)`` of numbers, finite or not; itself where it is one."""
        numbers = q if type(q) is np.ndarray and q.dtype is _FLOAT else as_numbers(q, "joint angles")
        if numbers.ndim == 0 or numbers.shape[-1] != self.n:
            raise InputError(f"{self.n} joint angles are needed, got an array of shape {numbers.shape}")
        return numbers

    def forward(self, q: ArrayLike) -> FloatArray:
        """Pose of the tool frame.

        Args:
            q: (..., n) joint angles [rad].

        Returns:
            ``T_base_tool`` (..., 4, 4), translation in metres.

        Raises:
            InputError: ``q`` has the wrong shape or is not finite.
        """
        return self._evaluated(self._pose, q, _POSE_SHAPE)

    def _evaluated(self, kernel: MatrixKernel, q: ArrayLike, shape: tuple[int, int]) -> FloatArray:
        """A matrix of each configuration: (..., n) -> (..., *shape)."""
        if (
            type(q) is np.ndarray and q.dtype is _FLOAT and q.shape == self._one_shape
        ):  # the door is 1 µs wide
            out = np.empty(shape)
            if kernel.one(out, *q.tolist()):
                return out
        many = self._numbers(q)
        if many.ndim == 1:
            out = np.empty(shape)
            if not kernel.one(out, *many.tolist()):
                kernel.one(out, *small_angles(many).tolist())
            return out
        flat = many.reshape(-1, self.n)
        out = np.zeros(
            (*shape, len(flat))
        )  # entry by entry in memory: contiguous to write, and to read a column
        kernel.many(flat, out)
        return np.moveaxis(out.reshape(*shape, *many.shape[:-1]), (0, 1), (-2, -1))

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
        return self._evaluated(self._jacobian, q, self._jacobian_shape)

    def axes(self, q: ArrayLike | None = None) -> tuple[FloatArray, FloatArray]:
        """Joint axes at ``q`` (default: all zero): points (n, 3) [m], unit directions (n, 3), base frame."""
        q = np.zeros(self.n) if q is None else self.checked(q)
        ahead = np.eye(4)
        frames: list[FloatArray] = []
        for segment, angle in zip(self.segments, q.tolist(), strict=True):
            ahead = ahead @ segment
            frames.append(ahead)
            ahead = ahead @ _z_part(angle, 0.0)
        stacked = np.array(frames)
        return stacked[:, :3, 3], stacked[:, :3, 2]

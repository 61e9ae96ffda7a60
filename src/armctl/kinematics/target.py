"""What inverse kinematics is asked for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import InputError
from armctl.kinematics.checks import as_numbers, checked_number, require_finite

FloatArray = NDArray[np.float64]
FARTHEST = 1000.0
"""a target farther off than this is a mistake in the unit [m]"""


@dataclass(frozen=True, slots=True)
class Target:
    """A tool pose, whole or in part, in the base frame. Make one with ``Target.of``, which checks it."""

    position: FloatArray
    """(3,) [m]"""
    pitch: float | None = None
    """angle of the approach axis above the horizontal [rad]; None: any"""
    roll: float | None = None
    """angle about the approach axis [rad]: the roll joint's own angle; None: any"""
    rotation: FloatArray | None = None
    """(3, 3) ``R_base_tool``, instead of pitch and roll"""

    @classmethod
    def of(
        cls,
        position_m: ArrayLike,
        pitch: float | None = None,
        roll: float | None = None,
        rotation: ArrayLike | None = None,
    ) -> Target:
        """Check and convert.

        Raises:
            InputError: text, NaN, infinity, a wrong shape, a matrix that is no rotation, or both a
                rotation and pitch or roll.
        """
        position = checked_position(position_m)
        if rotation is None:
            return cls(position, _angle(pitch, "pitch"), _angle(roll, "roll"), None)
        if pitch is not None or roll is not None:
            raise InputError("give either a rotation, or pitch and roll, not both")
        matrix = _finite(rotation, (3, 3), "the target rotation")
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-3 or np.linalg.det(matrix) < 0:
            raise InputError("the target rotation must be a right-handed orthonormal 3 x 3 matrix")
        u, _, vt = np.linalg.svd(matrix)
        return cls(position, None, None, u @ vt)  # the nearest true rotation: printed matrices are rounded


def _finite(value: ArrayLike, shape: tuple[int, ...], what: str) -> FloatArray:
    array = as_numbers(value, what)
    if array.shape != shape:
        raise InputError(f"{what} needs the shape {shape}, got {array.shape}")
    require_finite(array, what)
    return array


def checked_position(value: ArrayLike) -> FloatArray:
    """A tool point (3,) [m]; a copy.

    Raises:
        InputError: text, a wrong shape, NaN, infinity or a point beyond ``FARTHEST``.
    """
    if type(value) is np.ndarray and value.dtype == np.float64 and value.shape == (3,):  # most calls
        x, y, z = value.tolist()
        if x * x + y * y + z * z <= FARTHEST**2:  # false with NaN too
            return value.copy()
    position = _finite(value, (3,), "the target position")
    if np.abs(position).max() > FARTHEST:
        raise InputError(
            f"the target position is in metres, within {FARTHEST:.0f} m of the base; got {position.tolist()}"
        )
    return position


def _angle(value: float | None, what: str) -> float | None:
    return None if value is None else checked_number(value, what)


def checked_positions(value: ArrayLike) -> FloatArray:
    """Tool points (k, 3) [m].

    Raises:
        InputError: text, a wrong shape, NaN, infinity or a point beyond ``FARTHEST``; names the row.
    """
    what = "the target positions"
    positions = as_numbers(value, what)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise InputError(f"{what} need the shape (k, 3), got {positions.shape}")
    if np.einsum("ij,ij->", positions, positions) <= FARTHEST**2:  # the quickest look; false with NaN too
        return positions
    require_finite(positions, what)
    far = np.flatnonzero(np.abs(positions).max(axis=1) > FARTHEST)
    if len(far):
        raise InputError(
            f"{what} are in metres, within {FARTHEST:.0f} m of the base; "
            f"got {positions[far[0]].tolist()} in row {far[0]}"
        )
    return positions


def checked_column(value: ArrayLike, count: int, what: str) -> FloatArray:
    """An angle for each of ``count`` poses (count,) [rad], from as many or from one for all.

    Raises:
        InputError: text, a wrong shape, NaN or infinity; names the row.
    """
    column = as_numbers(value, what)
    if column.shape not in ((), (count,)):
        raise InputError(f"{what} needs one number, or one for each of {count} poses; got {column.shape}")
    require_finite(column, what, rows=True)
    return np.broadcast_to(column, (count,))

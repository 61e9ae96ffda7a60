"""What inverse kinematics is asked for, and the checks of numbers that come in from outside."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from math import inf, pi
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray, content, read_only
from armctl.errors import InputError
from armctl.facts.angles import in_degrees
from armctl.facts.english import WRONG_UNIT
from armctl.kinematics.angles import TWO_PI, rotation_from_rpy, wrapped


def as_numbers(value: ArrayLike, what: str) -> FloatArray:
    """``value`` as floats of any shape; ``InputError`` for text, booleans, complex numbers, ragged lists."""
    try:
        array = np.asarray(value)
    except (TypeError, ValueError) as cause:
        raise InputError(f"{what} must be numbers, got {value!r}") from cause
    if array.dtype.kind not in "iuf":
        raise InputError(f"{what} must be numbers, got {value!r}")
    return array.astype(np.float64)


def require_finite(array: FloatArray, what: str, *, rows: bool = False) -> None:
    """``InputError`` names the first NaN or infinity; ``rows``: a flat array holds a number a row."""
    finite = np.isfinite(array)
    if finite.all():
        return
    if array.ndim == 0 or (array.ndim == 1 and not rows):
        raise InputError(f"{what} must be finite numbers, got {array.tolist()}")
    row = int(np.argwhere(~finite)[0, 0])
    raise InputError(f"{what} must be finite numbers, got {array[row].tolist()} in row {row}")


# Numbers that are nearly certainly of another unit. Whoever is told may have typed millimetres or metres.

_FAR, _THOUSAND = (20.0, 3000.0), 1000.0
"""nobody means a target that is so many times as far off as the arm is long; one 1,000 times nearer, yes"""
_TURNS = 4 * pi
"""angles beyond are none that anybody means, where the joint does not turn so far [rad]"""


def seems_of_another_unit(away_m: float, length_m: float) -> bool:
    """Whether a target that is refused would be near the arm in mm, or in m where mm are counted.

    How far it is from the base, and how long the arm is, both [m].
    """
    low, high = (length_m * times for times in _FAR)
    metres = low / _THOUSAND <= _THOUSAND * away_m <= high / _THOUSAND
    return low <= away_m <= high or metres


def degrees_hint(*angles: float) -> str:
    """``; a wrong unit? …`` for angles [rad] that are refused; empty where they are no such angles."""
    return f"; {WRONG_UNIT}" if seem_degrees(*angles) else ""


def seem_degrees(*angles: float) -> bool:
    """Whether angles [rad] that are refused would be within a turn as degrees."""
    return bool(_TURNS < max(map(abs, angles), default=0.0) <= 360.0)


def checked_number(value: float, what: str) -> float:
    """``value`` as one finite float. Raises ``InputError`` for text, an array, NaN or infinity."""
    if type(value) is float and math.isfinite(value):
        return value
    array = as_numbers(value, what)
    if array.ndim != 0:
        raise InputError(f"{what} must be one number, got {value!r}")
    if not np.isfinite(array):
        raise InputError(f"{what} must be a finite number, got {value!r}")
    return float(array)


# What inverse kinematics is asked for.

_UPRIGHT = 1e-8
"""a pitch nearer to ±90° than this is taken as ±90° [rad]: the elevation has no derivative there"""
FARTHEST = 1000.0
"""a target farther off than this is a mistake in the unit [m]"""
_ROUNDED, _TRUE = 1e-3, 2e-14
"""how far from orthonormal a matrix may be that is taken as a rotation, and one that is taken as it is"""
_EYE, _BOTTOM = np.eye(3), np.array([0.0, 0.0, 0.0, 1.0])
_MATRIX = (3, 3)
_FLOAT, _POINT, _ARRAY, _FARTHEST_SQUARED = np.dtype(np.float64), (3,), np.ndarray, FARTHEST**2


class Target(NamedTuple):
    """A tool pose, whole or in part, in the base frame. Make one with ``Target.of``, which checks it."""

    point: tuple[float, float, float]
    """x, y, z [m]"""
    pitch: float | None = None
    """angle of the approach axis above the horizontal [rad], within a half turn; None: any"""
    roll: float | None = None
    """angle about the approach axis [rad]: the roll joint's own angle; None: any"""
    rotation: FloatArray | None = None
    """(3, 3) ``R_base_tool``, instead of pitch and roll"""

    def __eq__(self, other: object) -> bool:
        return content(tuple(self)) == content(other)

    def __ne__(self, other: object) -> bool:
        return not self == other

    def __hash__(self) -> int:
        return hash(content(tuple(self)))

    def __reduce__(self) -> tuple[Callable[..., Target], tuple[object, ...]]:
        """By ``of``, so that the rotation stays read-only."""
        return Target.of, tuple(self)

    @classmethod
    def of(
        cls,
        position_m: ArrayLike,
        pitch: float | None = None,
        roll: float | None = None,
        rotation: ArrayLike | None = None,
        quaternion_wxyz: ArrayLike | None = None,
    ) -> Target:
        """Check and convert.

        ``position_m``: (3,), or a whole pose ``T_base_tool`` (4, 4), both [m]. The orientation, if that is
        not part of it: pitch and roll [rad], or ``rotation`` (3, 3), or a quaternion (4,) that begins with w.
        Raises ``InputError``: text, NaN, infinity, a wrong shape, a matrix that is no rotation, or an
        orientation that is given twice.
        """
        if not is_point(position_m):
            position_m, turned = _taken_apart(position_m)
            if turned is not None:
                if not (pitch is roll is rotation is quaternion_wxyz is None):
                    raise InputError(
                        "a pose (4, 4) holds the orientation: leave pitch, roll, rotation and quaternion out"
                    )
                rotation = turned
        point = checked_point(position_m)
        if quaternion_wxyz is not None:
            if rotation is not None:
                raise InputError("give the orientation as a rotation or as a quaternion, not as both")
            rotation = rotation_from_quaternion(quaternion_wxyz)
        if rotation is None:
            if not (type(pitch) is float and -pi <= pitch <= pi) and pitch is not None:
                pitch = float(_within_half_turn(np.array([checked_number(pitch, "pitch")]))[0])
            if not (type(roll) is float and -inf < roll < inf) and roll is not None:
                roll = checked_number(roll, "roll")
            # in less time than cls(...)
            return tuple.__new__(cls, (point, pitch, roll, None))  # pyright: ignore[reportUnknownMemberType]
        if pitch is not None or roll is not None:
            raise InputError("give either a rotation, or pitch and roll, not both")
        if is_true_rotation(rotation):
            matrix = rotation.copy()
            matrix.flags.writeable = False
        else:
            matrix = read_only(checked_rotations(_not_a_quaternion(rotation), (3, 3), "the target rotation"))
        return tuple.__new__(cls, (point, None, None, matrix))  # pyright: ignore[reportUnknownMemberType]

    @property
    def up(self) -> float | None:
        """1 or -1 where the pitch asked for is straight up or down, else None."""
        return None if self.pitch is None else straight_up(self.pitch)

    @property
    def position(self) -> FloatArray:
        """(3,) the tool point [m]; a copy."""
        return np.array(self.point)


def _taken_apart(position_m: ArrayLike) -> tuple[FloatArray, FloatArray | None]:
    """A position as an array; of a pose (4, 4) the position (3,) and the rotation (3, 3)."""
    array = as_numbers(position_m, "the target position")
    if array.shape != (4, 4):
        return array, None
    if np.abs(array[3] - _BOTTOM).max() < _ROUNDED:
        return array[:3, 3].copy(), array[:3, :3]
    if np.abs(array[:, 3] - _BOTTOM).max() < _ROUNDED:
        raise InputError("the target pose has its position in the last row: give the transpose of it")
    raise InputError(f"the last row of a pose (4, 4) is 0, 0, 0, 1, not {array[3].tolist()}")


def _not_a_quaternion(rotation: ArrayLike) -> ArrayLike:
    """``InputError`` for four numbers: nobody knows whether w comes first (ROS and scipy put it last)."""
    if np.shape(rotation) == (4,):
        raise InputError(
            "the target rotation is a 3 x 3 matrix; give a quaternion as quaternion_wxyz, with w first "
            "(ROS and scipy put w last)"
        )
    return rotation


def straight_up(pitch: float) -> float | None:
    """1 or -1 for a pitch of ±90° [rad], None for any other."""
    return math.copysign(1.0, pitch) if abs(abs(pitch) - 0.5 * pi) <= _UPRIGHT else None


def checked_array(value: ArrayLike, shape: tuple[int, ...], what: str) -> FloatArray:
    """Finite numbers of one shape. Raises ``InputError`` for anything else."""
    array = as_numbers(value, what)
    if array.shape != shape:
        raise InputError(f"{what} must have the shape {shape}, got {array.shape}")
    require_finite(array, what)
    return array


def elevation(pitch: float) -> float:
    """The pitch [rad] within ±90° that the approach axis shows: beyond, the tool points back."""
    return math.atan2(math.sin(pitch), abs(math.cos(pitch)))


def is_point(value: ArrayLike) -> TypeGuard[FloatArray]:
    """True for an array (3,), which is what most calls are about."""
    return type(value) is np.ndarray and value.shape == _POINT


def checked_point(value: ArrayLike) -> tuple[float, float, float]:
    """A tool point x, y, z [m]. Raises ``InputError`` for any other value, or a point beyond ``FARTHEST``."""
    if type(value) is _ARRAY and value.dtype is _FLOAT and value.shape == _POINT:  # most calls
        point: list[float] = value.tolist()
    else:
        point = checked_array(value, _POINT, "the target position").tolist()
    x, y, z = point
    if x * x + y * y + z * z <= _FARTHEST_SQUARED:  # false with NaN too
        return x, y, z
    checked_array(value, _POINT, "the target position")
    raise InputError(
        f"the target position is {math.hypot(x, y, z):.6g} m from the base, farther than {FARTHEST:.0f} m"
        f"; {WRONG_UNIT}"
    )


def checked_positions(value: ArrayLike) -> FloatArray:
    """Tool points (k, 3) [m]. Raises as ``checked_point``, and names the row."""
    what = "the target positions"
    positions = as_numbers(value, what)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise InputError(f"{what} need the shape (k, 3), got {positions.shape}")
    if np.einsum("ij,ij->", positions, positions) <= FARTHEST**2:  # the quickest look; false with NaN too
        return positions
    require_finite(positions, what)
    far = np.flatnonzero(np.linalg.norm(positions, axis=1) > FARTHEST)
    if len(far):
        raise InputError(
            f"{what}: row {far[0]} is {np.linalg.norm(positions[far[0]]):.6g} m from the base, "
            f"farther than {FARTHEST:.0f} m; {WRONG_UNIT}"
        )
    return positions


def rotation_of(rpy: ArrayLike | None = None, quaternion: ArrayLike | None = None) -> FloatArray | None:
    """``R_base_tool`` (3, 3) of roll, pitch, yaw (3,) [rad], or of a quaternion (4,); None without both.

    ``Rz(yaw) Ry(pitch) Rx(roll)``; w, x, y, z of any length but 0. Raises ``InputError``: both are given, a
    wrong shape, a number that is not finite, an angle beyond a whole turn, or a quaternion of length 0.
    """
    if rpy is not None and quaternion is not None:
        raise InputError("give the orientation as roll, pitch and yaw, or as a quaternion, not as both")
    if rpy is not None:
        angles = checked_array(rpy, (3,), "roll, pitch and yaw")
        _require_one_turn(angles, "each of roll, pitch and yaw")
        return rotation_from_rpy(*angles.tolist())
    return None if quaternion is None else rotation_from_quaternion(quaternion)


def rotation_from_quaternion(quaternion: ArrayLike) -> FloatArray:
    """As ``rotation_of``, of a quaternion (4,)."""
    q = checked_array(quaternion, (4,), "the quaternion w, x, y, z")
    if not np.abs(q).max() > 0.0:
        raise InputError("the quaternion w, x, y, z has the length 0, which is no orientation")
    q = q / np.abs(q).max()
    w, x, y, z = (q / np.linalg.norm(q)).tolist()
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def is_true_rotation(value: ArrayLike) -> TypeGuard[FloatArray]:
    """True for an array (3, 3) that is a rotation to the last digits; in a fifth of numpy's time."""
    if not (type(value) is _ARRAY and value.dtype is _FLOAT and value.shape == _MATRIX):
        return False
    return _defect(value.tolist()) < _TRUE  # false with NaN too


def _defect(matrix: Iterable[Iterable[Any]]) -> Any:
    """How far 3 x 3 entries, numbers or arrays of numbers, are from those of a rotation, in all."""
    (a, b, c), (d, e, f), (g, h, i) = matrix
    lengths = abs(a * a + b * b + c * c - 1.0) + abs(d * d + e * e + f * f - 1.0)
    third = abs(b * f - c * e - g) + abs(c * d - a * f - h) + abs(a * e - b * d - i)
    return lengths + abs(a * d + b * e + c * f) + third


def checked_rotations(value: ArrayLike, shape: tuple[int, ...], what: str) -> FloatArray:
    """Rotations (..., 3, 3): of each matrix the nearest true rotation, since printed ones are rounded.

    Raises ``InputError`` for a wrong shape, an entry that is not finite, or a matrix that is no rotation.
    """
    matrices = checked_array(value, shape, what)
    off = _defect(np.moveaxis(matrices, (-2, -1), (0, 1))) >= _TRUE
    if not off.any():
        return matrices
    rounded = matrices[off]
    away = np.abs(rounded @ rounded.swapaxes(-1, -2) - _EYE).max(axis=(-1, -2))
    wrong = (away > _ROUNDED) | (np.linalg.det(rounded) < 0.0)
    if wrong.any():
        first = np.flatnonzero(off)[np.argmax(wrong)]
        row = "" if matrices.ndim == 2 else f", the one in row {first} is not"
        raise InputError(f"{what} must be a right-handed orthonormal 3 x 3 matrix{row}")
    u, _, vt = np.linalg.svd(rounded)
    matrices[off] = u @ vt
    return matrices


def checked_pitches(value: ArrayLike, count: int) -> FloatArray:
    """As ``checked_column``, of pitches; raises ``InputError`` for one beyond a whole turn, too."""
    pitches = checked_column(value, count, "the pitch")
    return pitches if np.abs(pitches).max(initial=0.0) <= math.pi else _within_half_turn(pitches, rows=True)


def _within_half_turn(pitches: FloatArray, *, rows: bool = False) -> FloatArray:
    """The same directions, within ±pi [rad]; more than a turn is a mistake in the unit."""
    _require_one_turn(pitches, "a pitch", rows=rows)
    return wrapped(pitches)


def _require_one_turn(angles: FloatArray, what: str, *, rows: bool = False) -> None:
    beyond = np.flatnonzero(np.abs(angles) > TWO_PI)
    if len(beyond):
        where = f" in row {beyond[0]}" if rows else ""
        got = float(angles[beyond[0]])
        raise InputError(
            f"{what} lies within one turn, -360° … 360°; got {got:.6g} rad{where}, "
            f"which is {in_degrees(got, '.6g')}{degrees_hint(got)}"
        )


def checked_column(value: ArrayLike, count: int, what: str) -> FloatArray:
    """An angle for each of ``count`` poses (count,) [rad], from as many or from one for all.

    Raises ``InputError`` for text, a wrong shape, NaN or infinity, and names the row.
    """
    column = as_numbers(value, what)
    if column.shape not in ((), (count,)):
        raise InputError(f"{what} needs one number, or one for each of {count} poses; got {column.shape}")
    require_finite(column, what, rows=True)
    return np.broadcast_to(column, (count,))

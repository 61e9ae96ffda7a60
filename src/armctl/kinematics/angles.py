"""Angles: wrapping, images inside limits, fast cosine and sine of arrays; rotations in other forms."""

from __future__ import annotations

import math
from math import remainder
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray

TWO_PI = 2.0 * math.pi
LIMIT_TOLERANCE = 1e-9
"""How far rounding may carry an angle over its limit [rad]; what is accepted is clipped back onto it."""
SAME_ROTATION = 1e-6
"""Rotations that differ by less are the same [rad]."""
_OPEN_END = 1e-8
"""how much less than a turn a widened joint has [rad]"""


def wrap(angle: float) -> float:
    """``angle`` [rad] brought into (-pi, pi]."""
    wrapped = remainder(angle, TWO_PI)
    return math.pi if wrapped <= -math.pi else wrapped


def wrapped(angles: FloatArray) -> FloatArray:
    """As ``wrap``, of an array [rad]; half a turn may come out as either of its ends."""
    return angles - TWO_PI * np.rint(angles / TWO_PI)


def rest_angle(low: float, high: float) -> float:
    """The angle between limits that is nearest to zero [rad]."""
    return min(max(0.0, low), high)


def central_image(angle: float, low: float, high: float) -> float:
    """The ``angle + 2 pi k`` nearest to the middle of limits [rad]."""
    middle = 0.5 * (low + high)
    return middle + remainder(angle - middle, TWO_PI)


def central_images(
    angle: FloatArray, low: FloatArray | float, high: FloatArray | float, out: FloatArray | None = None
) -> FloatArray:
    """As ``central_image``, of an array; limits of its shape or one that broadcasts to it. NaN stays."""
    turns = np.rint((angle - 0.5 * (low + high)) * (1.0 / TWO_PI))
    return np.subtract(angle, TWO_PI * turns, out=out)


def nearest_angle(angle: float, low: float, high: float) -> float:
    """The angle between limits that is nearest to any image of another one [rad]."""
    return min(max(central_image(angle, low, high), low), high)


def whole_turns(limits: FloatArray) -> FloatArray:
    """Limits (n, 2) [rad] widened to a whole turn about their middle; those of a joint that is held stay.

    They are a little less than a turn wide, so that half a turn is inside them once.
    """
    low, high = limits.T
    middle, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), math.pi)
    held = high - low < _SAME
    return np.where(held[:, None], limits, np.stack([middle - half + _OPEN_END, middle + half], axis=1))


def images(angle: float, low: float, high: float, tolerance: float = LIMIT_TOLERANCE) -> list[float]:
    """Every ``angle + 2 pi k`` inside ``[low, high]``, clipped onto the limits [rad]."""
    if high - low < TWO_PI - 2.0 * tolerance:  # the common case, at most one image
        if low <= angle <= high:
            return [angle]
        angle = central_image(angle, low, high)
        return [min(max(angle, low), high)] if low - tolerance <= angle <= high + tolerance else []
    first = math.ceil((low - tolerance - angle) / TWO_PI)
    last = math.floor((high + tolerance - angle) / TWO_PI)
    return [min(max(angle + TWO_PI * k, low), high) for k in range(first, last + 1)]


class Range(NamedTuple):
    """The limits of one joint, for ``fitted`` [rad]."""

    middle: float
    inside: float
    """an angle less than this from the middle is inside for sure"""
    outside: float
    """one farther than this is outside for sure"""

    @classmethod
    def of(cls, low: float, high: float, uncertain: float) -> Range:
        """Of two limits; ``uncertain``: how far outside rounding may put an angle."""
        half = 0.5 * (high - low)
        return cls(0.5 * (low + high), half - LIMIT_TOLERANCE, half + uncertain)


def fitted(angle: float, limits: Range) -> float:
    """As ``central_image``; NaN: that is outside; inf: too close to a limit to tell."""
    middle, inside, outside = limits
    x = remainder(angle - middle, TWO_PI)
    if -inside < x < inside:
        return middle + x
    return math.nan if x > outside or x < -outside else math.inf


def half_angle_cos_sin(angle: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cosine and sine of an array [rad] from one tangent of the half angle.

    numpy vectorises tan but not sin and cos; c = 2/(1+t²) - 1 and s = t·2/(1+t²) stay within 2 ulp of 1,
    however large t is.
    """
    sine = 0.5 * angle
    np.tan(sine, out=sine)
    cosine = sine * sine
    cosine += 1.0
    np.divide(2.0, cosine, out=cosine)
    sine *= cosine
    cosine -= 1.0
    return cosine, sine


_ON_CIRCLE = 1e-2
"""how far off the unit circle a root may lie, for rounding splits a double one: one too many is harmless"""


def trigonometric_zeros(values: FloatArray, degree: int) -> FloatArray:
    """Angles [rad] at which a trigonometric polynomial of a degree is zero, from evenly spaced values.

    ``values`` are those at 0, 2 pi / m, …, with m > 2 degree. The zeros are roots of a polynomial in
    exp(i x) on the unit circle; some that are near it are given too. None where it is zero everywhere.
    """
    size = np.abs(values).max()
    if size == 0.0:
        return np.empty(0)
    spectrum = np.fft.fft(values / size)
    z = np.roots(spectrum[np.arange(degree, -degree - 1, -1)])  # highest power first
    angles: FloatArray = np.arctan2(z.imag, z.real).astype(np.float64)
    return angles[np.abs(np.abs(z) - 1.0) < _ON_CIRCLE]


# Angles brought into joint limits: one, or arrays of them.


def nearest_image(angle: float, low: float, high: float) -> float | None:
    """The image of an angle [rad] inside the limits that is nearest to zero, clipped onto them; or None."""
    angle = remainder(angle, TWO_PI)
    if angle < low:
        if angle >= low - LIMIT_TOLERANCE:
            return low
        angle += TWO_PI * math.ceil((low - LIMIT_TOLERANCE - angle) / TWO_PI)
        return min(max(angle, low), high) if angle <= high + LIMIT_TOLERANCE else None
    if angle > high:
        if angle <= high + LIMIT_TOLERANCE:
            return high
        angle -= TWO_PI * math.ceil((angle - high - LIMIT_TOLERANCE) / TWO_PI)
        return min(max(angle, low), high) if angle >= low - LIMIT_TOLERANCE else None
    return angle


def into_limits(angle: FloatArray, low: float, high: float) -> NDArray[np.bool_]:
    """Move angles in place onto their images inside the limits, the one nearest to zero where there are more.

    Returns where there is one inside, or outside by no more than ``LIMIT_TOLERANCE``: clip what is used.
    False where the angle is NaN.
    """
    if high - low < TWO_PI:
        central_images(angle, low, high, out=angle)  # only this one can be inside
    else:
        angle -= TWO_PI * np.rint(angle * (1.0 / TWO_PI))
        if low > -math.pi:
            angle += TWO_PI * np.ceil(np.maximum(0.0, low - LIMIT_TOLERANCE - angle) / TWO_PI)
        if high < math.pi:
            angle -= TWO_PI * np.ceil(np.maximum(0.0, angle - high - LIMIT_TOLERANCE) / TWO_PI)
    return (angle >= low - LIMIT_TOLERANCE) & (angle <= high + LIMIT_TOLERANCE)


def within(
    angle: FloatArray, low: FloatArray | float, high: FloatArray | float, tolerance: float = LIMIT_TOLERANCE
) -> NDArray[np.bool_]:
    """Whether an image of each angle [rad] lies inside limits, as ``central_images``; no for NaN."""
    return np.abs(wrapped(angle - 0.5 * (low + high))) <= 0.5 * (high - low) + tolerance


def turns_inside(
    q: FloatArray, limits: FloatArray, tolerance: float = LIMIT_TOLERANCE
) -> tuple[FloatArray, FloatArray]:
    """The fewest and the most whole turns that keep ``q`` (..., n) [rad] inside limits (n, 2): (..., n) each.

    Whole numbers; the first is the larger one where no image is inside.
    """
    low, high = limits.T
    return np.ceil((low - tolerance - q) / TWO_PI), np.floor((high + tolerance - q) / TWO_PI)


def images_toward(q: FloatArray, limits: FloatArray, start: FloatArray) -> FloatArray:
    """The images inside limits (n, 2) of ``q`` (..., n) nearest to ``start`` (n,), clipped onto them [rad].

    All have one.
    """
    first, last = turns_inside(q, limits)
    return np.clip(q + TWO_PI * np.clip(np.rint((start - q) / TWO_PI), first, last), *limits.T)


MOST_IMAGES = 4096
"""how many images of a list of configurations ``all_images`` gives, unless it is told otherwise"""
MOST_TURNS = 16
"""how many whole turns of one joint, each way, are looked at"""


class Images(NamedTuple):
    """Configurations with all that differ from them by whole turns of joints."""

    q: FloatArray
    """(m, n) inside the limits [rad]; the images of one configuration stand together, the nearest first"""
    source: NDArray[np.intp]
    """(m,) row of the configuration that each is an image of"""
    left_out: int
    """how many more there are"""


def all_images(
    q: FloatArray, limits: FloatArray, start: FloatArray | None = None, most: int = MOST_IMAGES
) -> Images:
    """Every image inside limits (n, 2) of configurations (k, n) [rad], clipped onto the limits.

    A configuration without one is left out. Where there would be more than ``most``, each joint keeps that
    nearest to ``start`` (n,) [rad] and those nearest to zero, and ``left_out`` counts the others.
    """
    low, high = limits.T
    first, last = turns_inside(q, limits)
    every = float(np.maximum(last - first + 1.0, 0.0).prod(axis=1).sum())
    about = np.clip(np.rint(((0.0 if start is None else start) - q) / TWO_PI), first, last)
    first, last = np.maximum(first, about - MOST_TURNS), np.minimum(last, about + MOST_TURNS)
    count = np.maximum(last - first + 1.0, 0.0).astype(np.intp)
    turn = np.arange(float(count.max(initial=1)))
    angle: FloatArray = np.add(q[..., None], TWO_PI * (first[..., None] + turn))
    np.clip(angle, low[:, None], high[:, None], out=angle)
    angle[turn >= count[..., None]] = math.inf
    away = np.abs(angle)
    if start is not None:  # that nearest to the start first, then that nearest to zero
        aside = np.abs(angle - start[:, None])
        np.put_along_axis(away, away.argmin(axis=-1)[..., None], -1.0, axis=-1)
        np.put_along_axis(away, aside.argmin(axis=-1)[..., None], -2.0, axis=-1)
    ranked: FloatArray = np.take_along_axis(angle, away.argsort(axis=-1, kind="stable"), axis=-1)
    sizes: list[int] = count.max(axis=0, initial=0).tolist()
    while np.minimum(count, sizes).prod(axis=1, dtype=np.float64).sum() > most and max(sizes) > 1:
        sizes[sizes.index(max(sizes))] -= 1
    kept = np.minimum(count, sizes)
    ways = kept.prod(axis=1)
    source = np.repeat(np.arange(len(q)), ways)
    rest = np.arange(len(source)) - np.repeat(np.cumsum(ways) - ways, ways)
    found, width = np.empty((len(source), q.shape[1])), len(turn)
    for k in reversed(range(q.shape[1])):  # the last joint's images change fastest
        each = kept[:, k]
        if sizes[k] <= 1:  # most joints: nothing to choose
            found[:, k] = ranked[:, k, 0].take(source)
            continue
        rest, choice = np.divmod(rest, sizes[k] if (each == sizes[k]).all() else each.take(source))
        found[:, k] = ranked[:, k].ravel().take(source * width + choice)
    return Images(found, source, round(every - len(found)))


_SAME = 1e-6
"""configurations this near to each other are one [rad]"""


def turned_apart(q: FloatArray, other: FloatArray) -> FloatArray:
    """(...) [rad] by how much a joint differs at most between ``q`` (..., n) and ``other``, turns aside."""
    return np.abs(wrapped(q - other)).max(axis=-1)


def distinct(q: FloatArray, same: float = _SAME) -> NDArray[np.intp]:
    """Rows of ``q`` (k, n) [rad]: the first of those within ``same`` of each other, whole turns aside."""
    kept: list[int] = []
    left = np.arange(len(q))
    while len(left):
        kept.append(int(left[0]))
        left = left[turned_apart(q[left], q[left[0]]) > same]
    return np.array(kept, dtype=np.intp)


def each_once(q: FloatArray, same: float = _SAME) -> NDArray[np.intp]:
    """Rows of ``q`` (k, n) [rad]: each that is not within ``same`` of an earlier one, whole turns counted."""
    alike = np.abs(q[:, None] - q).max(axis=2) < same
    return np.flatnonzero(~np.tril(alike, -1).any(axis=1))


# Rotations in the forms that people and programs read.

_HALF_TURN_BACK = -math.pi + 1e-9
"""[rad]"""


def roll_pitch_yaw(rotation: FloatArray) -> FloatArray:
    """Roll, pitch, yaw (..., 3) [rad] of ``R = Rz(yaw) Ry(pitch) Rx(roll)`` (..., 3, 3).

    At pitch = ±90°, where only yaw ∓ roll is defined, yaw is 0. Half a turn is 180°, and not -180° where
    rounding would have it so.
    """
    sin_pitch = -rotation[..., 2, 0]
    cos_pitch = np.hypot(rotation[..., 2, 1], rotation[..., 2, 2])
    pitch = np.arctan2(sin_pitch, cos_pitch)
    locked = cos_pitch < 1e-9
    roll = np.where(
        locked,
        np.arctan2(-rotation[..., 1, 2], rotation[..., 1, 1]),
        np.arctan2(rotation[..., 2, 1], rotation[..., 2, 2]),
    )
    yaw = np.where(locked, 0.0, np.arctan2(rotation[..., 1, 0], rotation[..., 0, 0]))
    turns = np.stack([roll, pitch, yaw], axis=-1)
    return np.where(turns < _HALF_TURN_BACK, turns + TWO_PI, turns)


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> FloatArray:
    """``Rz(yaw) Ry(pitch) Rx(roll)`` (3, 3) from angles [rad]."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def quaternion_wxyz(rotation: FloatArray) -> FloatArray:
    """Unit quaternion (4,) ``w, x, y, z`` of one rotation (3, 3); w is not negative (Shepperd's method)."""
    m: list[list[float]] = rotation.tolist()  # plain numbers: a page asks for many, one at a time
    trace = m[0][0] + m[1][1] + m[2][2]
    squares = [trace, m[0][0], m[1][1], m[2][2]]
    k = max(range(4), key=squares.__getitem__)
    if k == 0:
        q = [1 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]
    else:
        i, j, h = k - 1, k % 3, (k + 1) % 3
        q = [m[h][j] - m[j][h], 0.0, 0.0, 0.0]
        q[1 + i] = 1 + m[i][i] - m[j][j] - m[h][h]
        q[1 + j] = m[j][i] + m[i][j]
        q[1 + h] = m[h][i] + m[i][h]
    norm = math.copysign(math.hypot(*q), -1.0 if q[0] < 0 else 1.0)
    return np.array([one / norm for one in q])


def quaternion_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton products (..., 4) ``a b`` of quaternions ``w, x, y, z``: b turns first."""
    w, x, y, z = np.moveaxis(a, -1, 0)
    W, X, Y, Z = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            w * W - x * X - y * Y - z * Z,
            w * X + x * W + y * Z - z * Y,
            w * Y - x * Z + y * W + z * X,
            w * Z + x * Y - y * X + z * W,
        ],
        axis=-1,
    )


def skew_part(matrix: FloatArray) -> FloatArray:
    """(..., 3) of matrices (..., 3, 3); for a rotation its axis, the sine of its angle long."""
    m = matrix
    pairs = ((2, 1), (0, 2), (1, 0))
    return 0.5 * np.stack([m[..., i, j] - m[..., j, i] for i, j in pairs], axis=-1)


def rotation_angle(rotation: FloatArray) -> FloatArray:
    """Angles (...) [rad] in 0..pi by which rotations (..., 3, 3) turn."""
    skew = rotation - np.swapaxes(rotation, -1, -2)
    sine = np.sqrt(0.5 * (skew * skew).sum(axis=(-2, -1)))
    return np.arctan2(sine, np.trace(rotation, axis1=-2, axis2=-1) - 1.0)

"""The triangle of the last two of three pitch joints while the first one is swept, in arrays.

Seen from the end of the first link the target lies at D. With

    v = (|D|² - l3² - l4²) / 2 = l3 l4 cos(bend),  S = √((l3 l4)² - v²) = l3 l4 sin(bend)

the angles are

    direction = arg D,  inner = atan2(S, l3² + v),  bend = atan2(S, v)

and their slopes along the sweep are algebraic. Seen from the first link, where w = -dv/dt,

    direction' = -1/2 + (l2² - |target|²) / 2|D|²,  bend' = w / S,  inner' = bend' (1/2 + (l4² - l3²) / 2|D|²)

Everything follows from one complex number, target · conjugate(first link) = u + i w.
"""

from __future__ import annotations

import cmath

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
# constants as arrays: a ufunc spends 0.25 µs a call on turning a float into one
_ONE, _MINUS_ONE, _HALF, _LEAST = np.array(1.0), np.array(-1.0), np.array(0.5), np.array(1e-60)


class SweepTriangle:
    """The formulas for one arm, the direction as a joint angle. Immutable; safe in several threads."""

    def __init__(self, geometry: YawPitchRoll, middle: float) -> None:
        """The triangle of an arm.

        Args:
            geometry: of the arm.
            middle: the direction is given within half a turn of this angle of the second pitch joint [rad].
        """
        l2, l3, l4 = geometry.lengths
        self._sense = geometry.signs[1]
        self._middle = np.array(middle)
        self._back = np.array(cmath.exp(-1j * geometry.plane_angle(1, middle)))
        self._l2_square, self._l3_square = np.array(l2 * l2), np.array(l3 * l3)
        self._twice_l3_square, self._mean = np.array(2 * l3 * l3), np.array(0.5 * (l3 * l3 + l4 * l4))
        self._per_product, self._product_square = np.array(1.0 / (l3 * l4)), np.array((l3 * l4) ** 2)
        self._unequal = np.array(0.25 * (l4 * l4 - l3 * l3))
        self._half_turn = np.array(0.5 * self._sense)

    def angles(self, target: complex, product: ComplexArray) -> FloatArray:
        """Direction, inner angle and bend (3, k) [rad]; inner angle and bend in [0, pi].

        Args:
            target: seen from the first pitch axis, forward + i up [m].
            product: target · conjugate(first link) (k,) [m²].
        """
        out = np.empty((3, len(product)))
        direction, inner, bend = out
        seen = product - self._l2_square  # D, from the first link, times its length
        seen *= self._back
        np.arctan2(seen.imag, seen.real, out=direction)
        if self._sense < 0:
            np.negative(direction, out=direction)
        direction += self._middle
        v = np.subtract(self._v(target), product.real, out=bend)
        distance = v + self._mean
        distance *= self._twice_l3_square
        np.maximum(distance, _LEAST, out=distance)  # folded onto the second axis any direction serves
        np.sqrt(distance, out=distance)
        np.add(v, self._l3_square, out=inner)
        inner /= distance
        v *= self._per_product
        cosines = out[1:]
        np.minimum(cosines, _ONE, out=cosines)
        np.maximum(cosines, _MINUS_ONE, out=cosines)
        np.arccos(cosines, out=cosines)
        return out

    def slopes(self, target: complex, product: ComplexArray, out: FloatArray) -> None:
        """Slopes of the three angles along the sweep.

        Args:
            target: as ``angles`` has it.
            product: the same, any shape.
            out: (3, *shape), written; huge where the target is out of reach.
        """
        direction, inner, bend = out
        v = self._v(target) - product.real
        np.multiply(v, v, out=direction)
        np.subtract(self._product_square, direction, out=direction)
        np.maximum(direction, _LEAST, out=direction)
        height = np.sqrt(direction, out=direction)
        np.divide(product.imag, height, out=bend)
        v += self._mean
        half_square = np.maximum(v, _LEAST, out=v)
        np.divide(self._unequal, half_square, out=inner)
        inner += _HALF
        inner *= bend
        square = target.real * target.real + target.imag * target.imag
        np.divide(0.25 * self._sense * (float(self._l2_square) - square), half_square, out=direction)
        direction -= self._half_turn

    def _v(self, target: complex) -> float:
        """What v is but for the product of target and first link [m²]."""
        square = target.real * target.real + target.imag * target.imag
        return 0.5 * (square + float(self._l2_square)) - float(self._mean)

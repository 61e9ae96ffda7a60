"""The exact least rotation: min Σ|θ| over the continuum of swivel postures.

Between the points where a joint passes zero the sum is smooth, so a minimum lies where a joint is at a
limit or at zero (the swivel's landmarks), or where the sum is stationary along the swivel. The swivel
turns the arm about t, which the shoulder joints do at the rates ``J⁻¹ t``, J = (j1, j2, j3) their axes. With
e_k = ±1 the senses of |θ_k| the sum is stationary where

    t · (e1 j2 x j3 + e2 j3 x j1 + e3 j1 x j2) = 0

With u = Rot(w1, -θ1) t this and the posture itself, ``u · Rot(w2, θ2) w3 = w3 · v``, are both of the form
``P + Q cos θ2 + T sin θ2 = 0``, P, Q and T being of the first degree in cos θ1 and sin θ1. To have a
common θ2 they need ``(P T' - P' T)² + (Q P' - Q' P)² = (Q T' - Q' T)²``: a polynomial of degree 8 in
exp(i θ1), whose roots are eigenvalues.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.spherical_shoulder.geometry import Vector, circle, cross, dot, plus
from armctl.kinematics.spherical_shoulder.swivel import Angles, Swivel

FloatArray = NDArray[np.float64]
_DEGREE = 4
_SAMPLES = 16
_ON_CIRCLE = 1e-2
"""how far off the unit circle a root may lie, for rounding splits a double one: one too many is harmless"""


def least_rotation(postures: Iterable[tuple[float, Swivel]]) -> FloatArray | None:
    """The configuration of least Σ|θ|.

    Args:
        postures: elbow angles inside their limits [rad], each with its swivel.

    Returns:
        (4,) shoulder joints and elbow [rad], or None when no posture is inside the limits.
    """
    best, best_energy = None, math.inf
    for elbow, swivel in postures:
        for angles in itertools.chain(swivel.landmarks(), _stationary(swivel)):
            energy = abs(angles[0]) + abs(angles[1]) + abs(angles[2]) + abs(elbow)
            if energy < best_energy:
                best, best_energy = (*angles, elbow), energy
    return None if best is None else np.array(best)


def _stationary(swivel: Swivel) -> list[Angles]:
    """Postures inside the limits at which the sum may be stationary."""
    w1, w2, w3 = swivel.geometry.axes
    first = np.linspace(0.0, 2.0 * math.pi, _SAMPLES, endpoint=False)
    c, s = np.cos(first), np.sin(first)
    k, across = dot(w2, w3), cross(w2, w3)
    level = plus(w3, w2, -k)

    def along(axis: Vector) -> FloatArray:
        a, b, d = circle(w1, axis, swivel.aim)
        return a + b * c + d * s

    u2 = along(w2)
    P, Q, T = k * u2 - dot(w3, swivel.hand), along(level), along(across)
    u12, beside = along(cross(w1, w2)), along(cross(w2, across))
    level1, across1 = along(cross(level, w1)), along(cross(across, w1))
    firsts: list[FloatArray] = []
    for e2, e3 in itertools.product((1.0, -1.0), repeat=2):  # e1 = 1: a common sign does not matter
        P1, Q1, T1 = (e3 - e2 * k) * u12, T + e2 * level1, beside + e2 * across1
        value = (P * T1 - P1 * T) ** 2 + (Q * P1 - Q1 * P) ** 2 - (Q * T1 - Q1 * T) ** 2
        firsts.append(_zeros(value))
    return swivel.inside(swivel.over_first(np.concatenate(firsts)))


def _zeros(value: FloatArray) -> FloatArray:
    """Angles [rad] of the zeros of a trigonometric polynomial of degree 4 from its 16 samples."""
    spectrum = np.fft.fft(value)
    coefficients = spectrum[np.arange(_DEGREE, -_DEGREE - 1, -1)]  # highest power of exp(i x) first
    size = np.abs(coefficients).max()
    if size == 0.0:
        return np.empty(0)
    z = np.roots(coefficients / size)
    angles: FloatArray = np.arctan2(z.imag, z.real).astype(np.float64)
    return angles[np.abs(np.abs(z) - 1.0) < _ON_CIRCLE]

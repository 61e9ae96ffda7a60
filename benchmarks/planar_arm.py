"""Arms by their planar geometry, written down from the papers' closed forms.

Nothing here comes from armctl: a wrong DH row shows as a disagreement before anything is timed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_DOWN = -0.5 * math.pi
"""bend that lays the tool of abaas and scorbot across the forearm at the zero pose"""


@dataclass(frozen=True)
class PlanarArm:
    """A yaw joint and three parallel pitch joints, by their planar geometry (metres, radians).

    ``x + i y = exp(i yaw_sign q0) (r + i lateral)`` and
    ``(r - shoulder_r) + i (z - shoulder_z) = sum_k lengths[k] exp(i (t_0 + ... + t_k))``
    with ``t_k = signs[k] q_(k+1) + offsets[k]``.
    """

    lateral: float
    shoulder_r: float
    shoulder_z: float
    lengths: tuple[float, float, float]
    limits: FloatArray
    """(4, 2) of the yaw and the pitch joints"""
    yaw_sign: int = 1
    signs: tuple[int, int, int] = (1, 1, 1)
    offsets: tuple[float, float, float] = (0.0, 0.0, 0.0)
    roll_limits: tuple[float, float] = (0.0, 0.0)

    def tip(self, q: FloatArray) -> FloatArray:
        """(..., 3) tool point of (..., 4 or 5) joint angles."""
        headings = np.cumsum(q[..., 1:4] * np.array(self.signs) + np.array(self.offsets), axis=-1)
        planar = (np.exp(1j * headings) * np.array(self.lengths)).sum(axis=-1)
        across = (planar.real + self.shoulder_r + 1j * self.lateral) * np.exp(1j * self.yaw_sign * q[..., 0])
        return np.stack([across.real, across.imag, planar.imag + self.shoulder_z], axis=-1)

    def pitch(self, q: FloatArray) -> FloatArray:
        """(...) elevation of the last link in [-pi/2, pi/2] at (..., 4 or 5) joint angles."""
        heading = (q[..., 1:4] * np.array(self.signs) + np.array(self.offsets)).sum(axis=-1)
        return np.arctan2(np.sin(heading), np.abs(np.cos(heading)))

    def random(self, rng: np.random.Generator, count: int) -> FloatArray:
        """(count, 5) joint angles inside the limits, the roll joint's among them."""
        limits = np.vstack([self.limits, self.roll_limits])
        return rng.uniform(limits[:, 0], limits[:, 1], (count, 5))


UZUNER = PlanarArm(
    lateral=0.00362,
    shoulder_r=0.0,
    shoulder_z=0.163,
    lengths=(0.125, 0.104, 0.101),
    limits=np.radians([[-102.8, 107.26], [-3.19, 146.831], [-84.36, 95.07], [-83.34, 86.75]]),
    roll_limits=(math.radians(-47.64), math.radians(47.32)),
)
ABAAS = PlanarArm(
    lateral=0.0,
    shoulder_r=0.0,
    shoulder_z=0.105,
    lengths=(0.105, 0.1, 0.15),
    limits=np.radians([[-180, 0], [0, 180], [-90, 90], [0, 180]]),
    offsets=(0.0, 0.0, _DOWN),
    roll_limits=(0.0, math.pi),
)
SCORBOT = PlanarArm(
    lateral=0.0,
    shoulder_r=0.025,
    shoulder_z=0.325,
    lengths=(0.222, 0.222, 0.135),
    limits=np.radians([[-155, 155], [-130, 35], [-130, 130], [-220, 40]]),
    signs=(-1, -1, -1),
    offsets=(0.0, 0.0, _DOWN),
    roll_limits=(-math.pi, math.pi),
)

"""The vertical plane in which parallel pitch joints move the tool; the first joint turns it.

    x + i y = exp(i s1 θ1) (r + i d)              d: lateral offset, constant
    (r - a1) + i (z - h) = Σ_k l_k exp(i (t_1 + … + t_k))      k over the pitch joints

where ``t_k = s_k θ_k + o_k`` is the plane angle of joint k: s_k = ±1 is the sense of its axis, o_k the
bend between the links at θ_k = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armctl.arrays import FloatArray


@dataclass(frozen=True)
class ToolPlane:
    """Where the pitch joints move the tool: lengths in metres, angles in radians."""

    origin: FloatArray
    """(3,) a point on the base axis, base frame"""
    frame: FloatArray
    """(3, 3) columns: forward, left, up at θ1 = 0, base frame"""
    yaw_sign: int
    lateral: float
    """d: how far the tool plane lies to the left of the base axis"""
    shoulder: complex
    """a1 + i h: first pitch axis in the tool plane"""
    lengths: tuple[float, ...]
    """l_k of the 2 or 3 links between the pitch joints and to the tool point"""
    signs: tuple[int, ...]
    """s_k of the pitch joints"""
    offsets: tuple[float, ...]
    """o_k of the pitch joints, in (-pi, pi]"""
    tool_angle: float | None
    """angle of the approach axis above the last link; None: it leaves the plane, so pitch means nothing"""
    roll_joint: int | None
    """index of the joint that rolls the tool about an axis through the tool point"""

    @property
    def pitch_joints(self) -> tuple[int, ...]:
        """Indices of the parallel pitch joints."""
        return tuple(range(1, 1 + len(self.lengths)))

    def plane_angle(self, k: int, joint_angle: float) -> float:
        """t_k of pitch joint k (0 is the shoulder) at a joint angle."""
        return self.signs[k] * joint_angle + self.offsets[k]

    def joint_angle(self, k: int, plane_angle: float) -> float:
        """θ of pitch joint k at a plane angle t_k; not wrapped."""
        return self.signs[k] * (plane_angle - self.offsets[k])

    def plane_limits(self, k: int, limits: FloatArray) -> tuple[float, float]:
        """Limits of t_k from the joint limits (n, 2)."""
        ends = [self.plane_angle(k, float(limits[1 + k, side])) for side in (0, 1)]
        return min(ends), max(ends)

    def way_to_circle(self, rho: float, z: float, radius: float, hand: complex = 0j) -> float:
        """How far a point at ``rho`` from the base axis is from what a circle about the shoulder sweeps [m].

        ``hand``: from the circle to the tool point, where the tool keeps its pitch. The plane stands beside
        the axis and turns about it, so the shortest way lies in none of its poses.
        """
        centre, reach, count = 0.0, math.pi, 1441
        away = np.empty(0)
        for _ in range(4):
            angles = np.linspace(centre - reach, centre + reach, count)
            tip = self.shoulder + hand + radius * np.exp(1j * angles)
            away = np.hypot(np.hypot(tip.real, self.lateral) - rho, tip.imag - z)
            centre = float(angles[away.argmin()])
            reach, count = 2.0 * reach / (count - 1), 41
        return float(away.min())

    def local_of(self, x: float, y: float, z: float) -> tuple[float, float, float]:
        """A point of the base frame as forward, left, up coordinates about the base axis [m]."""
        if self.upright:
            return x, y, z
        (x0, y0, z0), (fx, fy, fz), (lx, ly, lz), (ux, uy, uz) = self._floats
        x, y, z = x - x0, y - y0, z - z0
        return fx * x + fy * y + fz * z, lx * x + ly * y + lz * z, ux * x + uy * y + uz * z

    @cached_property
    def _floats(self) -> tuple[tuple[float, ...], ...]:
        """Origin, forward, left and up."""
        return tuple(tuple(row) for row in np.vstack([self.origin, self.frame.T]).tolist())

    @cached_property
    def upright(self) -> bool:
        """True where base coordinates are local ones."""
        return not self.origin.any() and bool((self.frame == np.eye(3)).all())

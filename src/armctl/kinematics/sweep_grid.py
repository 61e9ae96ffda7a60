"""The values that a swept joint takes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics.yaw_pitch_roll import YawPitchRoll

FloatArray = NDArray[np.float64]
DEFAULT_STEP = math.radians(0.01)
"""the paper's step of the swept joint [rad]"""
_MOST_VALUES = 2_000_000
_SLACK = 1e-6
"""how far outside a limit a multiple of the step may lie by rounding, in steps"""


@dataclass(frozen=True, slots=True)
class SweepGrid:
    """Values of the swept joint: whole multiples of the step inside its limits."""

    step: float
    start: float
    """the first plane angle; 0 on an empty grid"""
    joint: FloatArray
    """(m,) joint angles [rad], in the order of rising plane angle"""
    plane: FloatArray
    """(m,) plane angles t_2, rising"""
    link_x: FloatArray
    link_y: FloatArray
    """(m,) end of the first link [m]"""

    @classmethod
    def of(cls, geometry: YawPitchRoll, limits: tuple[float, float], step: float) -> SweepGrid:
        """The grid between joint limits [rad].

        Raises:
            InputError: ``step`` is not a positive angle, or so small that there are too many values.
        """
        low, high = limits
        if not (math.isfinite(step) and step > 0 and (high - low) / step <= _MOST_VALUES):
            least = math.degrees((high - low) / _MOST_VALUES)
            raise InputError(
                f"the step of the swept joint must be an angle of at least {least:.2g}°, got {step!r} rad"
            )
        first, last = math.ceil(low / step - _SLACK), math.floor(high / step + _SLACK)
        joint = np.clip(step * np.arange(first, last + 1, dtype=np.float64), low, high)
        if geometry.signs[0] < 0:
            joint = joint[::-1].copy()
        plane = geometry.signs[0] * joint + geometry.offsets[0]
        length = geometry.lengths[0]
        grid = cls(
            step, float(plane[0]) if len(plane) else 0.0, joint, plane,
            length * np.cos(plane), length * np.sin(plane),
        )  # fmt: skip
        for array in (grid.joint, grid.plane, grid.link_x, grid.link_y):
            array.flags.writeable = False
        return grid

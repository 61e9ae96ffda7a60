"""Values of the swept joint of three parallel pitch joints, and where the first link ends then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.grid import grid_values
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.panels import Panels, node_positions

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
_ON_GRID = 1e-4
"""how near to a value, in steps, an angle is on it"""
_LOST = 1e-6
"""the same [rad]: so near to a knot of the sweep the array formulas lose digits"""


@dataclass(frozen=True, slots=True)
class SweepGrid:
    """Values of the swept joint: those of ``grid_values``."""

    step: float
    start: float
    """the first plane angle"""
    last: int
    """the last index"""
    tolerance: float
    """how near to a value, in steps, an angle is on it"""
    joint: FloatArray
    """(m,) joint angles [rad], in the order of rising plane angle"""
    plane: FloatArray
    """(m,) plane angles t_2, rising"""
    link: ComplexArray
    """(m,) conjugate of the end of the first link, forward + i up [m]"""
    panels: Panels | None
    """None where the step is too coarse for them"""
    nodes: ComplexArray | None
    """(NODES + 1, panels) ``link`` at the nodes and, last, at the anchor of each panel"""

    def position(self, angle: float) -> tuple[float, int | None]:
        """Where a plane angle [rad] lies, in grid indices; and the value it falls on, but for rounding."""
        position = (angle - self.start) / self.step
        near = round(position)
        if abs(position - near) < self.tolerance and 0 <= near <= self.last:
            return position, near
        return position, None

    @classmethod
    def of(cls, geometry: YawPitchRoll, limits: tuple[float, float], step: float) -> SweepGrid:
        """The grid between joint limits [rad].

        Raises:
            InputError: ``step`` is so small that there are too many values.
        """
        joint = grid_values(*limits, step)
        if geometry.signs[0] < 0:
            joint = joint[::-1].copy()
        plane = geometry.signs[0] * joint + geometry.offsets[0]
        start, length = float(plane[0]), geometry.lengths[0]
        panels, nodes = Panels.of(step), None
        if panels is not None:
            nodes = _conjugate(length, start + step * node_positions(len(plane)))
        link = _conjugate(length, plane)
        for array in (joint, plane, link, *(() if nodes is None else (nodes,))):
            array.flags.writeable = False
        tolerance = max(_ON_GRID, _LOST / step)
        return cls(step, start, len(plane) - 1, tolerance, joint, plane, link, panels, nodes)


def _conjugate(length: float, angle: FloatArray) -> ComplexArray:
    out = np.empty(angle.shape, dtype=np.complex128)
    out.real, out.imag = length * np.cos(angle), -length * np.sin(angle)
    return out

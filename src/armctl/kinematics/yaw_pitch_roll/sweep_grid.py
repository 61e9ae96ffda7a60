"""Values of the swept joint of three parallel pitch joints, and where the first link ends then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.cos_sin import HAS_VECTOR_TRIGONOMETRY
from armctl.kinematics.grid import grid_values
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.panels import PANEL, node_positions

FloatArray = NDArray[np.float64]
_ON_GRID = 1e-4
"""how near to a value, in steps, an angle is on it"""
_LOST = 1e-6
"""the same [rad]: so near to a knot of the sweep the array formulas lose digits"""
_WIDEST_PANEL = 0.05
"""a wider panel is seldom a polynomial to machine precision [rad]"""


@dataclass(frozen=True, slots=True)
class SweepGrid:
    """Values of the swept joint: those of ``grid_values``."""

    step: float
    start: float
    """the first plane angle"""
    joint: FloatArray
    """(m,) joint angles [rad], in the order of rising plane angle"""
    plane: FloatArray
    """(m,) plane angles t_2, rising"""
    link_x: FloatArray
    link_y: FloatArray
    """(m,) end of the first link [m]"""
    nodes: FloatArray | None
    """(3, panels, NODES) plane angle and end of the first link at the nodes of each panel; None where the
    step is too coarse for ``panels.py``, or arc cosines are as cheap"""

    def first_link(self, start: int, stop: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Plane angles [rad] and end of the first link [m] on a range of the grid."""
        return self.plane[start:stop], self.link_x[start:stop], self.link_y[start:stop]

    def holds(self, angle: float) -> int | None:
        """Index of the value that a plane angle [rad] falls on, but for rounding; None where it does not."""
        position = (angle - self.start) / self.step
        near = round(position)
        on_grid = abs(position - near) < max(_ON_GRID, _LOST / self.step) and 0 <= near < len(self.plane)
        return near if on_grid else None

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
        nodes = None
        if step * PANEL <= _WIDEST_PANEL and not HAS_VECTOR_TRIGONOMETRY:
            angle = start + step * node_positions(len(plane))
            nodes = np.stack([angle, length * np.cos(angle), length * np.sin(angle)])
        grid = cls(step, start, joint, plane, length * np.cos(plane), length * np.sin(plane), nodes)
        for array in (grid.joint, grid.plane, grid.link_x, grid.link_y, *(() if nodes is None else (nodes,))):
            array.flags.writeable = False
        return grid

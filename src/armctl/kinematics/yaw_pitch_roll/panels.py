"""Smooth functions on a fine even grid, from their slopes at a few places of each panel.

A panel is ``PANEL`` neighbouring grid values. Over so short a range a smooth slope is a polynomial to machine
precision: its values at ``NODES`` Chebyshev nodes and the function's value at the anchor, one grid value
midway, give all the others by one matrix product. The slope of an angle is algebraic, so that only the
anchor costs arc functions. The last Chebyshev coefficients of the integral tell where that is so; where
they are not negligible (next to a square-root end) the values have to be computed one by one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
PANEL = 128
"""grid values in a panel"""
NODES = 16
"""exact slopes in a panel"""
ANCHOR = PANEL // 2
"""which grid value of a panel is the anchor"""
_WIDEST = 0.05
"""a wider panel is seldom a polynomial to machine precision [rad]"""
_NEGLIGIBLE = 2e-14
"""largest last coefficient of a function that counts as resolved: the error is no larger"""
_AT_ONCE = 120
"""panels in one matrix product: larger ones are spread over threads, which costs more than it brings"""
_TAIL = 3
"""how many last coefficients are looked at: one alone may vanish by symmetry"""


@dataclass(frozen=True, slots=True)
class Panels:
    """What turns slopes into values, for the panels of a grid of one step."""

    integral: FloatArray
    """(NODES + 1, PANEL) from slopes at the nodes and the value at the anchor to the values of a panel"""
    tail: FloatArray
    """(_TAIL, NODES) from slopes at the nodes to the last coefficients of the integral"""

    @classmethod
    def of(cls, step: float) -> Panels | None:
        """The panels of a grid's step; None where they would be too wide to be of use."""
        if step * PANEL > _WIDEST:
            return None
        half = 0.5 * (PANEL - 1)
        grid = np.arange(PANEL) / half - 1.0
        order = np.arange(NODES + 1)[:, None]
        coefficients = np.cos(order[:-1] * _node_angles()) * (2.0 / NODES)  # (order, node)
        coefficients[0] *= 0.5
        waves = np.cos(order * np.arccos(np.clip(grid, -1.0, 1.0)))
        # the integral of T_k is T_k+1 / 2(k+1) - T_k-1 / 2(k-1), that of T_0 is T_1
        risen = coefficients.copy()
        risen[0] *= 2.0
        risen[:-2] -= coefficients[2:]
        risen *= half * step / (2 * order[1:])
        panels = cls(
            integral=np.vstack([risen.T @ (waves[1:] - waves[1:, ANCHOR, None]), np.ones(PANEL)]),
            tail=risen[-_TAIL:].copy(),
        )
        for field in fields(panels):
            getattr(panels, field.name).flags.writeable = False
        return panels

    def integrated(self, slopes: FloatArray) -> FloatArray:
        """Functions on the grid (f, k · PANEL).

        Args:
            slopes: of f functions at the nodes of k panels, and last their values at the anchors:
                (f, NODES + 1, k).
        """
        slopes = slopes.transpose(0, 2, 1)
        functions, count, _ = slopes.shape
        out = np.empty((functions, count, PANEL))
        for k in range(0, count, _AT_ONCE):
            np.matmul(slopes[:, k : k + _AT_ONCE], self.integral, out=out[:, k : k + _AT_ONCE])
        return out.reshape(functions, -1)

    def unresolved(self, slopes: FloatArray) -> list[tuple[int, int]]:
        """Runs (begin, end) of panels where one of f functions is no polynomial to machine precision.

        Args:
            slopes: at the nodes of k panels: (f, NODES, k).
        """
        last = np.matmul(self.tail, slopes)
        np.abs(last, out=last)
        largest = np.maximum.reduce(last.reshape(-1, last.shape[2]))
        runs: list[tuple[int, int]] = []
        for panel in (largest > _NEGLIGIBLE).nonzero()[0].tolist():
            if runs and runs[-1][1] == panel:
                runs[-1] = (runs[-1][0], panel + 1)
            else:
                runs.append((panel, panel + 1))
        return runs


def node_positions(count: int) -> FloatArray:
    """Where nodes and anchor of each panel lie, in grid indices: (NODES + 1, panels) for ``count`` values."""
    begins = np.arange(0, count, PANEL, dtype=np.float64)
    nodes = 0.5 * (PANEL - 1) * (1.0 + np.cos(_node_angles()))
    return np.append(nodes, float(ANCHOR))[:, None] + begins


def _node_angles() -> FloatArray:
    return (np.arange(NODES, dtype=np.float64) + 0.5) * (math.pi / NODES)

"""Smooth functions on a fine even grid, from a few exact values a panel.

The grid is cut into panels of ``PANEL`` values. Over a panel a smooth function is a polynomial to machine
precision: its values at ``NODES`` Chebyshev nodes give all the others by one matrix product, ten times
cheaper than an arc cosine each. The last Chebyshev coefficients tell where that is so; where they are not
negligible (near a square-root end, across a jump of an angle, where a node is not a number) the values
have to be computed one by one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
PANEL = 192
"""grid values in a panel"""
NODES = 18
"""exact values in a panel"""
_NEGLIGIBLE = 2e-14
"""largest last coefficient of a function that counts as resolved: the error is no larger"""
_TAIL = 3
"""how many last coefficients are looked at: one alone may vanish by symmetry"""

_order = np.arange(NODES)
_node_angles = (2 * _order + 1) * np.pi / (2 * NODES)
_to_coefficients = np.cos(np.outer(_order, _node_angles)) * (2.0 / NODES)
_to_coefficients[0] *= 0.5
_INTERPOLATE = _to_coefficients.T @ np.cos(
    np.outer(_order, np.arccos(np.clip(2.0 * np.arange(PANEL) / (PANEL - 1) - 1.0, -1.0, 1.0)))
)
_LAST = np.ascontiguousarray(_to_coefficients[-_TAIL:].T)
for _array in (_INTERPOLATE, _LAST):
    _array.flags.writeable = False


def node_positions(count: int) -> FloatArray:
    """Where the nodes of each panel lie, in grid indices: (panels, NODES) for a grid of ``count`` values."""
    begins = np.arange(0, count, PANEL)[:, None]
    return begins + 0.5 * (PANEL - 1) * (1.0 + np.cos(_node_angles))


def interpolated(at_nodes: FloatArray) -> FloatArray:
    """Functions on the grid (f, panels · PANEL), given at the nodes (f, panels, NODES)."""
    functions, panels, _ = at_nodes.shape
    return (at_nodes.reshape(-1, NODES) @ _INTERPOLATE).reshape(functions, panels * PANEL)


def unresolved(at_nodes: FloatArray) -> list[tuple[int, int]]:
    """Runs (begin, end) of panels where one of the functions is no polynomial to machine precision."""
    tail = np.abs(at_nodes.reshape(-1, NODES) @ _LAST)
    resolved = (tail <= _NEGLIGIBLE).reshape(len(at_nodes), -1, _TAIL).all(axis=2).all(axis=0)
    rough = np.flatnonzero(~resolved).tolist()
    runs: list[tuple[int, int]] = []
    for panel in rough:
        if runs and runs[-1][1] == panel:
            runs[-1] = (runs[-1][0], panel + 1)
        else:
            runs.append((panel, panel + 1))
    return runs

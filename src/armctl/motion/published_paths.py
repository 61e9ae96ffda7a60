"""The two test paths of the uzuner paper."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_PEN_PLANE_M = 0.085


def arc() -> FloatArray:
    """The arc: (58, 3) points [m] of radius 200 mm about the base axis, -87° ... 87°, 85 mm high."""
    angle = np.radians(np.linspace(-87.0, 87.0, 58))
    return np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), np.full(58, _PEN_PLANE_M)])


def line() -> FloatArray:
    """The line: (29, 3) points [m] at x = 220 mm, y = -196 ... 196 mm by 14 mm, 85 mm high."""
    y = np.arange(-196.0, 197.0, 14.0) / 1000
    return np.column_stack([np.full(29, 0.22), y, np.full(29, _PEN_PLANE_M)])

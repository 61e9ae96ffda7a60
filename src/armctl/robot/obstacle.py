"""Things around the arm that it must stay out of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """A box along the axes of the base frame: a table, a wall, a conveyor."""

    title: str
    low: FloatArray
    """(3,) its lower corner, base frame [m]"""
    high: FloatArray
    """(3,) its upper corner [m]"""

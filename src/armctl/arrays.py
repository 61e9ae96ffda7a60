"""The array type of the whole package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""float64; every docstring gives its shape, and the unit and frame of its numbers"""

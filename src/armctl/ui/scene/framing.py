"""From how far away a camera has all of something in its picture."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def framed(
    points: FloatArray, away: FloatArray, fov: float, aspect: float, filled: float
) -> tuple[FloatArray, FloatArray]:
    """Where a camera stands and looks so that points fill the given part of its picture.

    Args:
        points: (k, 3) what shall be seen [m].
        away: (3,) the direction from what is seen to the camera, not along z; of any length.
        fov: the picture's vertical angle of view [rad].
        aspect: the picture's width by its height.
        filled: the part of width or height, whichever is short, that the points may take at most (0 … 1).

    Returns:
        (3,) the camera's position and (3,) the point in the middle of the picture [m]; z is up in it.
    """
    back = away / np.linalg.norm(away)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])  # to the right, up, towards the camera
    seen = points @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    x, y, nearer = (seen - middle).T
    high = filled * math.tan(0.5 * fov)
    distance = float((nearer + np.maximum(np.abs(x) / (high * aspect), np.abs(y) / high)).max())
    centre: FloatArray = middle @ axes
    return centre + distance * back, centre

"""Joint angles as sliders and fields show them."""

from __future__ import annotations

import math

import numpy as np

from armctl.arrays import FloatArray
from armctl.robot import Joint, Robot


def held_at(joint: Joint) -> str | None:
    """What the controls of a joint say whose limits are one and the same angle; None: it can turn."""
    return f"held at {round(math.degrees(joint.lower), 2):g}°" if joint.lower == joint.upper else None


def slider_limits(robot: Robot) -> FloatArray:
    """(n, 2) ends of the sliders [degrees]: the limits, or the hundredth next to them inside."""
    exact = np.degrees(robot.limits)
    low, high = np.ceil(100 * exact[:, 0] - 1e-9) / 100, np.floor(100 * exact[:, 1] + 1e-9) / 100
    return np.where((low < high)[:, None], np.stack([low, high], axis=1), exact)


def slider_degrees(robot: Robot, q: FloatArray) -> list[float]:
    """``q`` (n,) [rad] as slider positions: degrees rounded to 0.01, inside the limits."""
    low, high = slider_limits(robot).T
    return np.clip(np.round(np.degrees(q), 2), low, high).tolist()

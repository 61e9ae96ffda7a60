"""Angles that are no joint's, as people read and write them: in degrees.

A joint's value is shown and read by its joint (``armctl.robot.joint``).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, overload

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

DEGREE = math.pi / 180.0
"""[rad]"""
_RADIAN = 180.0 / math.pi
"""[degrees]"""


@overload
def to_degrees(angle: float) -> float: ...
@overload
def to_degrees(angle: NDArray[np.float64]) -> NDArray[np.float64]: ...
def to_degrees(angle: float | NDArray[np.float64]) -> float | NDArray[np.float64]:
    """An angle, or an array of some, [rad] in degrees."""
    return angle * _RADIAN


@overload
def from_degrees(angle_deg: float) -> float: ...
@overload
def from_degrees(angle_deg: float | None) -> float | None: ...
def from_degrees(angle_deg: float | None) -> float | None:
    """An angle of so many degrees [rad]; None stays None."""
    return None if angle_deg is None else angle_deg * DEGREE


def in_degrees(angle: float, spec: str = ".2f") -> str:
    """An angle [rad] as text, such as ``12.50°``, never ``-0.00°``; ``spec``: how its number is written."""
    return f"{to_degrees(angle):z{spec}}°"

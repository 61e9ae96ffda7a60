"""How a length is told."""

from __future__ import annotations

_SEEN_MM = 0.05
"""what one decimal shows as more than 0.0 [mm]"""


def millimetres(metres: float) -> str:
    """A length [m] as a number of mm: with one decimal, or two digits of one that would read as 0.0."""
    length = 1000.0 * metres
    return f"{length:.1f}" if abs(length) >= _SEEN_MM else f"{length:.2g}"

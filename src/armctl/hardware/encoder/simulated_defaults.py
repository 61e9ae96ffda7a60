"""What the firmware takes for granted until a host has told it otherwise: a rebuilt Scorbot."""

from __future__ import annotations

from collections.abc import Mapping

_KEYS = ("min", "max", "vmax", "amax", "kp", "ki", "kd", "brk", "ferr",
         "stall", "hdir", "hv", "hpos", "hord", "hmode", "inv", "minv", "sinv", "dmax")  # fmt: skip
"""in the order in which SHOW tells them"""
_AXES = (
    (-22000, 22000, 2840, 11400, 1200, 2000, 16, 200, 600, 300, 1, 900, 0, 6, 0, 0, 0, 0, 255),
    (-8000, 10800, 2950, 11800, 1200, 2000, 16, 200, 600, 300, 1, 900, 0, 2, 0, 0, 0, 0, 255),
    (-25600, 4000, 2950, 11800, 1200, 2000, 16, 200, 600, 300, 1, 900, 0, 3, 0, 0, 0, 0, 255),
    (-3900, 3400, 2300, 9200, 2500, 4000, 26, 200, 400, 300, 1, 800, 0, 4, 0, 0, 0, 0, 255),
    (-5100, 5100, 2900, 11800, 2500, 4000, 26, 200, 400, 300, 1, 800, 0, 5, 0, 0, 0, 0, 255),
    (0, 1700, 1600, 8000, 1000, 1000, 13, 200, 400, 200, -1, 800, 0, 1, 1, 0, 0, 0, 255),
)

FIRMWARE_DEFAULTS: tuple[Mapping[str, int], ...] = tuple(dict(zip(_KEYS, row, strict=True)) for row in _AXES)
"""by axis; ``firmware/encoder/settings.cpp`` says the same"""

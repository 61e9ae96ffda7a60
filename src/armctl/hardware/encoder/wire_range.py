"""The numbers that a configuration line may carry (firmware/README.md, CFG)."""

from __future__ import annotations

import math

from armctl.errors import InputError

WIRE_RANGES: dict[str, tuple[int, int]] = {
    "min": (-1_000_000, 1_000_000),
    "max": (-1_000_000, 1_000_000),
    "hpos": (-1_000_000, 1_000_000),
    "vmax": (1, 20_000),
    "hv": (1, 20_000),
    "amax": (1, 65_535),
    "kp": (0, 32_767),
    "ki": (0, 32_767),
    "kd": (0, 32_767),
    "brk": (0, 255),
    "dmax": (1, 255),
    "ferr": (1, 30_000),
    "stall": (20, 5_000),
    "hord": (0, 6),
    "hdir": (-1, 1),
    "hmode": (0, 1),
    "inv": (0, 1),
    "minv": (0, 1),
    "sinv": (0, 1),
}


def check_wire(axis: int, name: str, value: float, key: str, per_unit: float = 1.0) -> None:
    """Refuse a value that does not fit its key.

    Args:
        axis: whose setting it is.
        name: what the user calls it.
        value: in the user's unit.
        key: how the board calls it.
        per_unit: board units in one of the user's.

    Raises:
        InputError: not finite, or outside what the board takes.
    """
    low, high = WIRE_RANGES[key]
    if not math.isfinite(value) or not low <= value * per_unit <= high:
        raise InputError(
            f"axis {axis}: {name} {value:g} is outside {low / per_unit:g} … {high / per_unit:g}, "
            "which is what an encoder board takes"
        )

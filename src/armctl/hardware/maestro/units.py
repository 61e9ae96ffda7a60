"""Between SI-like units of a pulse (µs, µs/s, µs/s²) and the integers of the Maestro's protocol."""

from __future__ import annotations

import math

from armctl.errors import InputError

QUARTERS_PER_US = 4
SPEED_UNIT_US_PER_S = 25.0  # 0.25 µs in 10 ms
ACCELERATION_UNIT_US_PER_S2 = 312.5  # 0.25 µs in 10 ms, each 80 ms

MAX_TARGET = 0x3FFF  # quarter µs; all that 2 x 7 bits hold
MAX_SPEED = 0x3FFF
MAX_ACCELERATION = 255

# 140 x 25.0 computed from degrees may come out as 3499.9999999: not a reason to lose a whole unit.
_ROUNDING_SLACK = 1e-6


def us_to_quarters(pulse_us: float) -> int:
    """The nearest quarter µs of a pulse width [µs].

    Raises:
        InputError: not finite, not positive, or longer than the protocol holds.
    """
    if not math.isfinite(pulse_us) or not 0.0 < pulse_us <= MAX_TARGET / QUARTERS_PER_US:
        raise InputError(
            f"pulse width {pulse_us} µs cannot be sent; allowed is more than 0 up to "
            f"{MAX_TARGET / QUARTERS_PER_US} µs"
        )
    # At least 1: rounding to 0 would switch the pulses off, which is another command altogether.
    return max(1, round(pulse_us * QUARTERS_PER_US))


def quarters_to_us(quarters: int) -> float:
    """Quarter µs to µs."""
    return quarters / QUARTERS_PER_US


def speed_to_units(speed_us_per_s: float | None) -> int:
    """A speed limit [µs/s] as the board takes it; None is unlimited (0 on the wire).

    Rounds down, so that the board never runs faster than the limit; whoever streams setpoints at
    the limit should plan with ``units_to_speed`` of the result, or the board lags behind. The
    exceptions: a limit below one unit becomes one unit (25 µs/s), because 0 would mean *unlimited*;
    a limit above the field becomes the largest value, because unlimited must be asked for.

    Raises:
        InputError: not finite or not positive.
    """
    return _limit_to_units("speed", "µs/s", speed_us_per_s, SPEED_UNIT_US_PER_S, MAX_SPEED)


def acceleration_to_units(acceleration_us_per_s2: float | None) -> int:
    """An acceleration limit [µs/s²] as the board takes it; None is unlimited (0 on the wire).

    Rounds like ``speed_to_units``: down, but never to 0 and never above 255 (79 687.5 µs/s²).

    Raises:
        InputError: not finite or not positive.
    """
    return _limit_to_units(
        "acceleration", "µs/s²", acceleration_us_per_s2, ACCELERATION_UNIT_US_PER_S2, MAX_ACCELERATION
    )


def units_to_speed(units: int) -> float | None:
    """The speed limit [µs/s] that the board enforces for ``units``; None for 0, unlimited."""
    return units * SPEED_UNIT_US_PER_S if units else None


def units_to_acceleration(units: int) -> float | None:
    """The acceleration limit [µs/s²] that the board enforces for ``units``; None for 0, unlimited."""
    return units * ACCELERATION_UNIT_US_PER_S2 if units else None


def _limit_to_units(what: str, unit: str, limit: float | None, size: float, largest: int) -> int:
    if limit is None:
        return 0
    if not math.isfinite(limit) or limit <= 0.0:
        raise InputError(
            f"{what} limit {limit} {unit} makes no sense; give a positive number, or None for no limit"
        )
    return min(largest, max(1, math.floor(limit / size + _ROUNDING_SLACK)))

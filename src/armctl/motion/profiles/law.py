"""How a way is spread over time: laws from rest to rest, as short as the limits allow.

All four are polynomials in pieces of the way gone ``s(t)``, from 0 to the length:

- *cubic*: ``s = L (3 u² - 2 u³)``, the papers' "planned movement". Its speed is largest at the middle,
  ``1.5 L / T``, its acceleration at the ends, ``6 L / T²``.
- *quintic*: ``s = L (10 u³ - 15 u⁴ + 6 u⁵)``, the motion of least jerk (Flash and Hogan 1985). Largest
  speed ``1.875 L / T``, acceleration ``10 / √3 L / T²``, jerk ``60 L / T³``.
- *trapezoid*: full acceleration, full speed, full brake: the shortest with limited acceleration.
- *s-curve*: the shortest with limited jerk as well: seven phases, some of which may be empty (Biagiotti
  and Melchiorri, Trajectory Planning for Automatic Machines and Robots, section 3.4).
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from armctl.errors import InputError
from armctl.motion.polynomial import PiecewisePolynomial

ProfileName = Literal["cubic", "quintic", "trapezoid", "s-curve"]
PROFILES: tuple[ProfileName, ...] = ("cubic", "quintic", "trapezoid", "s-curve")

CUBIC_SPEED, CUBIC_ACCELERATION = 1.5, 6.0
QUINTIC_SPEED, QUINTIC_ACCELERATION, QUINTIC_JERK = 1.875, 10 / math.sqrt(3), 60.0


def law_over(
    length: float, speed: float, acceleration: float, jerk: float, profile: ProfileName
) -> PiecewisePolynomial:
    """The shortest motion over a length, from rest to rest.

    Args:
        length: of the way, positive.
        speed: largest.
        acceleration: largest, without sign.
        jerk: largest, without sign; the cubic and the trapezoid jump in acceleration and do not keep it.
        profile: which law.

    Returns:
        s(t), one coordinate, t from 0 [s].

    Raises:
        InputError: a length or a limit that is not positive, or a profile that is none.
    """
    for what, value in (("length", length), ("speed", speed), ("acceleration", acceleration), ("jerk", jerk)):
        if not value > 0:
            raise InputError(f"a motion needs a positive {what}, got {value}")
    match profile:
        case "cubic":
            time = max(CUBIC_SPEED * length / speed, math.sqrt(CUBIC_ACCELERATION * length / acceleration))
            return _one_piece(length, time, (0.0, 0.0, 3.0, -2.0))
        case "quintic":
            time = max(
                QUINTIC_SPEED * length / speed,
                math.sqrt(QUINTIC_ACCELERATION * length / acceleration),
                (QUINTIC_JERK * length / jerk) ** (1 / 3),
            )
            return _one_piece(length, time, (0.0, 0.0, 0.0, 10.0, -15.0, 6.0))
        case "trapezoid":
            return _trapezoid(length, speed, acceleration)
        case "s-curve":
            return _s_curve(length, speed, acceleration, jerk)
    raise InputError(f"there is no profile {profile!r}; choose among {', '.join(PROFILES)}")


def _one_piece(length: float, time: float, shape: tuple[float, ...]) -> PiecewisePolynomial:
    powers = [length * c / time**p for p, c in enumerate(shape)]
    return PiecewisePolynomial([0.0, time], np.array(powers)[None, :, None])


def _trapezoid(length: float, speed: float, acceleration: float) -> PiecewisePolynomial:
    peak = min(speed, math.sqrt(length * acceleration))  # a triangle where the way is short
    ramp = peak / acceleration
    cruise = max(length / peak - ramp, 0.0)
    return _phases(length, ((ramp, acceleration, 0.0), (cruise, 0.0, 0.0), (ramp, -acceleration, 0.0)))


def _s_curve(length: float, speed: float, acceleration: float, jerk: float) -> PiecewisePolynomial:
    if speed * jerk >= acceleration**2:
        bend, ramp = acceleration / jerk, acceleration / jerk + speed / acceleration
    else:  # the speed is met before the acceleration
        bend = math.sqrt(speed / jerk)
        ramp = 2 * bend
    cruise = length / speed - ramp
    if cruise < 0:  # the speed is not met
        cruise = 0.0
        if length >= 2 * acceleration**3 / jerk**2:
            bend = acceleration / jerk
            ramp = bend / 2 + math.sqrt((bend / 2) ** 2 + length / acceleration)
        else:  # nor the acceleration
            bend = (length / (2 * jerk)) ** (1 / 3)
            ramp = 2 * bend
    flat, push = max(ramp - 2 * bend, 0.0), jerk * bend
    return _phases(
        length,
        (
            (bend, 0.0, jerk),
            (flat, push, 0.0),
            (bend, push, -jerk),
            (cruise, 0.0, 0.0),
            (bend, 0.0, -jerk),
            (flat, -push, 0.0),
            (bend, -push, jerk),
        ),
    )


def _phases(length: float, phases: tuple[tuple[float, float, float], ...]) -> PiecewisePolynomial:
    """Phases of (duration, acceleration at its beginning, jerk), one after another, from rest.

    What lies beyond the middle is counted from the end, so that the end is met as exactly as the start.
    """
    count = len(phases)
    forward: list[tuple[float, float]] = [(0.0, 0.0)]  # way and speed at each seam
    for duration, push, twist in phases[: count // 2]:
        way, rate = forward[-1]
        forward.append(
            (
                way + duration * (rate + duration * (push / 2 + duration * twist / 6)),
                rate + duration * (push + duration * twist / 2),
            )
        )
    # the motion is symmetric: the second half's seams mirror the first half's
    seams = forward + [(length - way, rate) for way, rate in forward[::-1]]
    breaks, rows = [0.0], list[tuple[float, float, float, float]]()
    for (duration, push, twist), (way, rate) in zip(phases, seams, strict=False):
        if breaks[-1] + duration > breaks[-1]:
            breaks.append(breaks[-1] + duration)
            rows.append((way, rate, push / 2, twist / 6))
    return PiecewisePolynomial(breaks, np.array(rows)[:, :, None])

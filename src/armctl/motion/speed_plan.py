"""How fast a path may be followed: speed and acceleration limits of the joints, as limits along the path.

With ``q(s)`` and the rate ``r = ds/dt``, a joint's speed is ``q' r`` and its acceleration
``q'' r² + q' dr/dt``. The path is cut into regions; in each one the largest ``|q'|`` and ``|q''|`` give
a largest rate and, at that rate, the acceleration that is left along the path. Between the regions, one
pass backward and one forward (as machine tools look ahead) give the largest rates that can be reached and
braked from. What comes out is never over a limit; it is as fast as the limits allow but for the share of
the acceleration that is kept for the curvature, or not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.polynomial import PiecewisePolynomial

FloatArray = NDArray[np.float64]

_CURVATURE_SHARE = 0.7
"""Of a joint's acceleration: what the curvature of the path may take. The rest is left for speeding up."""
_MARGIN = 1e-9
_SHORTEST = 1e-12


class TooFastError(InputError):
    """A path is begun faster than it can be braked on."""


@dataclass(frozen=True, slots=True, eq=False)
class PathLimits:
    """Largest rate and acceleration in each of m regions of a path."""

    breaks: FloatArray
    """(m + 1,) of the path variable"""
    rate: FloatArray
    """(m,) largest rate"""
    acceleration: FloatArray
    """(m,) largest change of the rate, at any rate up to the largest"""

    @classmethod
    def of(
        cls,
        path: PiecewisePolynomial,
        speed: FloatArray,
        acceleration: FloatArray,
        rate_cap: float | FloatArray = math.inf,
        regions: int = 1,
    ) -> PathLimits:
        """Limits of a path from those of the joints.

        Args:
            path: q(s), (n,) [rad].
            speed: (n,) largest joint speeds [rad/s].
            acceleration: (n,) largest joint accelerations [rad/s²].
            rate_cap: a largest rate besides; a number, or (k,) one a piece of the path.
            regions: cut each piece of the path into that many.

        Raises:
            InputError: a cap that is not positive.
        """
        caps = np.repeat(np.broadcast_to(rate_cap, len(path.coefficients)), regions)
        if not (caps > 0).all():
            raise InputError(f"the speed along a path must be positive, got {caps.min()}")
        fine = path.refined(regions)
        slope = fine.derivative().bound_by_piece()
        bend = fine.derivative().derivative().bound_by_piece()
        with np.errstate(divide="ignore"):
            rate = np.minimum((speed / slope).min(axis=1), caps)
            rate = np.minimum(rate, np.sqrt((_CURVATURE_SHARE * acceleration / bend).min(axis=1)))
            if not np.isfinite(rate).all():  # nothing moves there: any rate will do
                rate = np.where(np.isfinite(rate), rate, np.diff(fine.breaks) / _MARGIN)
            left = ((acceleration - bend * rate[:, None] ** 2) / slope).min(axis=1)
        most = rate * rate / np.diff(fine.breaks)
        return cls(fine.breaks, rate * (1 - _MARGIN), np.minimum(left, 1e3 * most) * (1 - _MARGIN))


@dataclass(frozen=True, slots=True, eq=False)
class SpeedPlan:
    """The fastest rates at the breaks of a path that its limits allow."""

    limits: PathLimits
    rates: FloatArray
    """(m + 1,) rate at each break"""

    @classmethod
    def fastest(cls, limits: PathLimits, first: float = 0.0, last: float = 0.0) -> SpeedPlan:
        """Plan from one rate to another.

        Args:
            limits: of the path.
            first: rate at its beginning.
            last: largest rate at its end; what can be reached is taken where it is less.

        Raises:
            TooFastError: ``first`` is more than the path can brake from.
        """
        rates = brake(limits, last)
        if first > rates[0] * (1 + 1e-6) + 1e-12:
            raise TooFastError(
                f"a path cannot be begun at the rate {first:.6g}; the most is {rates[0]:.6g}: begin it slower"
            )
        return cls(limits, speed_up(limits, rates, min(first, float(rates[0]))))

    def law(self) -> PiecewisePolynomial:
        """The path variable over time [s], from 0; a trapezoid of the rate in each region."""
        breaks, steps = [0.0], list[tuple[float, float, float]]()
        limits = self.limits
        rows = zip(
            limits.breaks[:-1].tolist(),
            np.diff(limits.breaks).tolist(),
            limits.rate.tolist(),
            limits.acceleration.tolist(),
            self.rates[:-1].tolist(),
            self.rates[1:].tolist(),
            strict=True,
        )
        for begin, length, cap, push, first, last in rows:
            s = begin
            for duration, rate, change in _trapezoid(length, cap, push, first, last):
                breaks.append(breaks[-1] + duration)
                if breaks[-1] == breaks[-2]:
                    breaks.pop()
                    continue
                steps.append((s, rate, 0.5 * change))
                s += duration * (rate + 0.5 * change * duration)
        return PiecewisePolynomial(breaks, np.array(steps)[:, :, None])


def brake(limits: PathLimits, last: float) -> FloatArray:
    """(m + 1,) largest rates at the breaks from which the end can be met at the rate ``last``."""
    rates = [min(last, float(limits.rate[-1]))]
    regions = zip(
        np.diff(limits.breaks)[::-1].tolist(),
        limits.acceleration[::-1].tolist(),
        [*limits.rate[-2::-1].tolist(), math.inf],
        limits.rate[::-1].tolist(),
        strict=True,
    )
    for length, push, before, here in regions:
        rates.append(min(before, here, math.sqrt(rates[-1] ** 2 + 2 * push * length)))
    return np.array(rates[::-1])


def speed_up(limits: PathLimits, rates: FloatArray, first: float) -> FloatArray:
    """(m + 1,) the same, where the path is begun at the rate ``first``."""
    reached = [first]
    for length, push, most in zip(
        np.diff(limits.breaks).tolist(), limits.acceleration.tolist(), rates[1:].tolist(), strict=True
    ):
        reached.append(min(most, math.sqrt(reached[-1] ** 2 + 2 * push * length)))
    return np.array(reached)


def _trapezoid(
    length: float, cap: float, push: float, first: float, last: float
) -> list[tuple[float, float, float]]:
    """(duration, rate at its beginning, change of the rate) of up to three phases over a region."""
    if push <= 0:
        return [(2 * length / (first + last), first, 0.0)]
    peak = min(cap, math.sqrt(max(push * length + 0.5 * (first * first + last * last), 0.0)))
    peak = max(peak, first, last)
    up, down = (peak - first) / push, (peak - last) / push
    rest = length - 0.5 * (first + peak) * up - 0.5 * (peak + last) * down
    phases: list[tuple[float, float, float]] = []
    if up > 0:
        phases.append((up, first, push))
    if rest > _SHORTEST * length:
        phases.append((rest / peak, peak, 0.0))
    if down > 0:
        phases.append((down, peak, -push))
    return phases

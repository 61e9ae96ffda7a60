"""From one configuration to another: all joints together by one law, or each for itself.

How a way is spread over time: laws from rest to rest, as short as the limits allow. All four are polynomials
in pieces of the way gone ``s(t)``, from 0 to the length:

- *cubic*: ``s = L (3 u² - 2 u³)``, the papers' "planned movement". Its speed is largest at the middle,
  ``1.5 L / T``, its acceleration at the ends, ``6 L / T²``.
- *quintic*: ``s = L (10 u³ - 15 u⁴ + 6 u⁵)``, the motion of least jerk (Flash and Hogan 1985). Largest speed
  ``1.875 L / T``, acceleration ``10 / √3 L / T²``, jerk ``60 L / T³``.
- *trapezoid*: full acceleration, full speed, full brake: the shortest with limited acceleration.
- *s-curve*: the shortest with limited jerk as well: seven phases, some of which may be empty (Biagiotti and
  Melchiorri, Trajectory Planning for Automatic Machines and Robots, section 3.4).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray, lock
from armctl.errors import InputError, MotionRefusedError
from armctl.facts.reasons import decimals_apart
from armctl.kinematics.energy import CUBIC_PEAKS, rest_to_rest_times
from armctl.kinematics.target import as_numbers, checked_number, require_finite
from armctl.lazy_dataclass import dataclass
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.trajectory import KnowsPeaks, Peaks, Sample, as_times
from armctl.robot import Robot

ProfileName = Literal["cubic", "quintic", "trapezoid", "s-curve"]
PROFILES: tuple[ProfileName, ...] = ("cubic", "quintic", "trapezoid", "s-curve")
NOWHERE = 1e-12
"""no joint turns so little on purpose [rad]"""
_ROUNDING = 1e-9
_SPARE_MS = 1e-9
"""so little below a whole millisecond is one [ms]"""
_MET = 1e-6
"""so little below a limit it is met (share)"""
_LONGEST_S = 1e7
"""of a motion that is asked for"""
_INSTANT = 1e-9
"""a duration that is none [s]"""


@dataclass(frozen=True, slots=True)
class _Shape:
    """A law of one polynomial."""

    powers: tuple[float, ...]
    """of u = t / T, lowest first, for a way of 1"""
    peaks: tuple[float, ...]
    """largest speed, acceleration and, where the law keeps the jerk limit, jerk, for a way and a time of 1"""

    def over(self, way: FloatArray, time: float) -> PiecewisePolynomial:
        """Ways (n,) in a time [s]."""
        powers = np.array(self.powers) / time ** np.arange(len(self.powers))
        return PiecewisePolynomial([0.0, time], (powers[:, None] * way)[None])


_SHAPES: dict[ProfileName, _Shape] = {
    "cubic": _Shape((0.0, 0.0, 3.0, -2.0), CUBIC_PEAKS),
    "quintic": _Shape((0.0, 0.0, 0.0, 10.0, -15.0, 6.0), (1.875, 10 / math.sqrt(3), 60.0)),
}


def law_over(
    length: float, speed: float, acceleration: float, jerk: float, profile: ProfileName
) -> PiecewisePolynomial:
    """The shortest motion over a length, from rest to rest: s(t), one coordinate, t from 0 [s].

    Length and limits are positive. The cubic and the trapezoid do not keep the jerk limit.
    Raises ``InputError`` for a profile that is none.
    """
    if checked_profile(profile) in _SHAPES:
        shape, way = _SHAPES[profile], np.array([length])
        limits = np.array([[speed], [acceleration], [jerk]])
        return shape.over(way, float(rest_to_rest_times(way, shape.peaks, *limits)[0]))
    if profile == "trapezoid":
        peak = min(speed, math.sqrt(length * acceleration))  # a triangle where the way is short
        ramp = peak / acceleration
        cruise = max(length / peak - ramp, 0.0)
        return _phases(length, ((ramp, acceleration, 0.0), (cruise, 0.0, 0.0), (ramp, -acceleration, 0.0)))
    return _s_curve(length, speed, acceleration, jerk)


def checked_profile(profile: object) -> ProfileName:
    """``profile``; ``InputError`` where it is none."""
    for known in PROFILES if isinstance(profile, str) else ():
        if profile == known:
            return known
    raise InputError(f"there is no profile {profile!r}; choose among {', '.join(PROFILES)}")


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
    up = ((bend, 0.0, jerk), (flat, push, 0.0), (bend, push, -jerk))
    down = ((bend, 0.0, -jerk), (flat, -push, 0.0), (bend, -push, jerk))
    return _phases(length, (*up, (cruise, 0.0, 0.0), *down))


def _phases(length: float, phases: tuple[tuple[float, float, float], ...]) -> PiecewisePolynomial:
    """Phases of (duration, acceleration at its beginning, jerk), one after another, from rest to rest."""
    way, rate = 0.0, 0.0
    forward = [(way, rate)]  # at each seam
    for duration, push, twist in phases[: len(phases) // 2]:
        way += duration * (rate + duration * (push / 2 + duration * twist / 6))
        rate += duration * (push + duration * twist / 2)
        forward.append((way, rate))
    # the second half mirrors the first, so that the end is met as exactly as the start
    seams = forward + [(length - way, rate) for way, rate in forward[::-1]]
    breaks, rows = [0.0], list[tuple[float, float, float, float]]()
    for (duration, push, twist), (way, rate) in zip(phases, seams, strict=False):
        if breaks[-1] + duration > breaks[-1]:
            breaks.append(breaks[-1] + duration)
            rows.append((way, rate, push / 2, twist / 6))
    return PiecewisePolynomial(breaks, np.array(rows)[:, :, None])


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PointToPoint(KnowsPeaks):
    """A motion of all joints from rest to rest; ``plan``, ``each_for_itself`` and ``lasting`` make one."""

    start: FloatArray
    """(n,) [rad], read-only"""
    end: FloatArray
    """(n,) [rad], read-only"""
    duration: float
    """[s]; 0 for a motion that goes nowhere"""
    way: PiecewisePolynomial | None
    """(n,) way gone from the start over time [rad], monotonous; None for a motion that takes no time"""

    def made_of(self) -> tuple[FloatArray, FloatArray, float, PiecewisePolynomial | None]:
        """See ``ByContent``."""
        return self.start, self.end, self.duration, self.way

    def __post_init__(self) -> None:
        """The ends may come out of a pickle."""
        lock(self.start)
        lock(self.end)

    @classmethod
    def lasting(
        cls, start: ArrayLike, end: ArrayLike, duration: float, profile: ProfileName = "cubic"
    ) -> PointToPoint:
        """From ``start`` to ``end`` (n,) [rad] in a given time [s], by a profile that needs no limits."""
        first, last = checked_ends(start, end)
        lasts = checked_duration(duration)
        if lasts == 0 and bool((first != last).any()):
            raise InputError(f"a motion cannot take {duration} s")
        if checked_profile(profile) not in _SHAPES:
            raise InputError(f"the shape of a {profile} depends on the limits; plan it")
        return cls(first, last, lasts, _SHAPES[profile].over(last - first, lasts) if lasts else None)

    @classmethod
    def plan(
        cls,
        robot: Robot,
        start: ArrayLike,
        end: ArrayLike,
        duration_s: float | None = None,
        profile: ProfileName = "cubic",
    ) -> PointToPoint:
        """Plan from ``start`` to ``end`` (n,) [rad] within the robot's limits; all joints arrive together.

        The shortest duration [s] is that of the joint that needs longest; the others are slowed down to it.
        Raises ``InputError`` for no motion, ``MotionRefusedError`` for too short a duration: with the joint,
        what it would need and the shortest.
        """
        first, last = checked_ends(start, end, robot.n)
        travel = last - first
        shape = _SHAPES.get(checked_profile(profile))
        laws: list[PiecewisePolynomial | None] = []
        if shape is not None:
            way = np.where(np.abs(travel) > NOWHERE, np.abs(travel), 0.0)
            limits = robot.speed_limits, robot.acceleration_limits, robot.jerk_limits
            times = rest_to_rest_times(way, shape.peaks, *limits)
        else:
            laws = _laws(robot, travel, profile)
            times = np.array([0.0 if law is None else law.high for law in laws])
        duration = float(times.max())
        if duration_s is not None:
            duration = lasting_s(
                duration_s,
                duration,
                lambda asked, text: _too_short(robot, travel, asked, text, times, laws, profile),
                profile,
            )
        if duration == 0:
            return cls(first, last, 0.0, None)
        if shape is not None:
            return cls(first, last, duration, shape.over(travel, duration))
        slowed = [None if law is None else law.scaled(duration / law.high) for law in laws]
        return cls(first, last, duration, _joined(np.sign(travel), slowed, duration))

    @classmethod
    def each_for_itself(cls, robot: Robot, start: ArrayLike, end: ArrayLike) -> PointToPoint:
        """The papers' "normal movement": each joint at its own speed, and then waits for the others."""
        first, last = checked_ends(start, end, robot.n)
        laws = _laws(robot, last - first, "trapezoid")
        duration = max(0.0 if law is None else law.high for law in laws)
        way = _joined(np.sign(last - first), laws, duration) if duration else None
        return cls(first, last, duration, way)

    @property
    def peaks(self) -> Peaks:
        """Extremes of the whole motion, exact: no joint turns back on its way."""
        low, high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)
        if self.way is None:
            return Peaks(low, high, *np.zeros((3, len(low))))
        rate = self.way.derivative()
        push = rate.derivative()
        jerk = _largest(push.derivative()) if self.way.is_smooth_from_rest() else None
        return Peaks(low, high, _largest(rate), _largest(push), jerk)

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        if type(t) is float and self.way is not None and 0.0 < t < self.duration:
            gone, velocity, acceleration, jerk = self.way.derivatives(t, 3)
            return Sample(self._between_ends(gone), velocity, acceleration, jerk)
        time = as_times(t)
        if self.way is None:
            q = np.where((time < self.duration)[..., None], self.start, self.end)
            return Sample(q, np.zeros_like(q), np.zeros_like(q), np.zeros_like(q))
        gone, velocity, acceleration, jerk = self.way.derivatives(time, 3)
        inside = ((time >= 0.0) & (time <= self.duration))[..., None]
        moving = inside & ((time > 0.0) & (time < self.duration))[..., None]
        q = self._between_ends(gone)
        q = np.where(moving, q, np.where((time <= 0.0)[..., None], self.start, self.end))
        return Sample(q, velocity * moving, acceleration * inside, jerk * inside)

    def _between_ends(self, gone: FloatArray) -> FloatArray:
        """Where the joints are (..., n) [rad]: no rounding may carry one beyond its ends."""
        low, high = np.minimum(self.start, self.end), np.maximum(self.start, self.end)
        return np.minimum(np.maximum(self.start + gone, low), high)


def _largest(values: PiecewisePolynomial) -> FloatArray:
    """(n,) without sign."""
    return np.abs(values.extremes_by_piece()).max(axis=(0, 1))


def checked_duration(duration: float) -> float:
    """A duration [s]; what is too short to divide by is 0. InputError: no number, or not from 0 to 1e7."""
    checked = checked_number(duration, "the duration of a motion")
    if checked < 0:
        raise InputError(f"a motion cannot take {duration} s; leave it open for the shortest")
    if checked > _LONGEST_S:
        raise InputError(f"a motion cannot take {checked:.6g} s; {_LONGEST_S:.0f} s at most")
    return checked if checked > _INSTANT else 0.0


def lasting_s(
    duration: float,
    shortest: float,
    too_short: Callable[[float, str], str],
    profile: ProfileName = "trapezoid",
    *,
    exact: bool = True,
) -> float:
    """A duration [s] that is asked for; ``MotionRefusedError`` where it is under the profile's shortest.

    ``too_short``: says why, from the duration and its text, which does not read as the shortest one.
    """
    checked = checked_duration(duration)
    if checked < shortest * (1 - _ROUNDING):
        words = shortest_words(shortest, profile, exact=exact)
        digits = decimals_apart(checked, _told_s(shortest), least=3)
        raise MotionRefusedError(f"{too_short(checked, f'{checked:.{digits}f} s')}; {words}")
    return max(checked, shortest)


def shortest_words(shortest: float, profile: ProfileName = "trapezoid", *, exact: bool = True) -> str:
    """The shortest duration [s] in words, rounded up: what is read there may be asked for.

    ``exact``: no motion of this profile takes less; only the trapezoid is the shortest of all.
    """
    by = "" if profile == "trapezoid" else f"with the profile {profile} "
    which = "shortest possible duration" if exact else "shortest duration (near the shortest possible)"
    return f"{by}the {which} is {_told_s(shortest):.3f} s"


def _told_s(shortest: float) -> float:
    return math.ceil(1000 * shortest - _SPARE_MS) / 1000


def stopping_s(robot: Robot) -> float:
    """What the slowest joint needs from its full speed to rest on a straight way [s]; more on a bend."""
    return float((robot.speed_limits / robot.acceleration_limits).max())


def checked_ends(start: ArrayLike, end: ArrayLike, n: int | None = None) -> tuple[FloatArray, FloatArray]:
    """Both ends (n,) [rad] as new arrays that cannot be written to; InputError for anything else."""
    first, last = as_numbers(start, "joint angles"), as_numbers(end, "joint angles")
    if first.ndim != 1 or first.shape != last.shape or first.size == 0:
        raise InputError(
            f"start and end need the same number of joint angles, got {first.shape} and {last.shape}"
        )
    for angles in (first, last):
        require_finite(angles, "joint angles")
    if n is not None and len(first) != n:
        raise InputError(f"{n} joint angles are needed, got {len(first)}")
    first.flags.writeable = last.flags.writeable = False
    return first, last


def _laws(robot: Robot, travel: FloatArray, profile: ProfileName) -> list[PiecewisePolynomial | None]:
    """The shortest law of each joint; None for one that stands."""
    ways = np.abs(travel).tolist()
    limits = np.array([robot.speed_limits, robot.acceleration_limits, robot.jerk_limits]).T.tolist()
    return [
        None if way <= NOWHERE else law_over(way, *most, profile=profile)
        for way, most in zip(ways, limits, strict=True)
    ]


def _joined(
    sign: FloatArray, laws: Sequence[PiecewisePolynomial | None], duration: float
) -> PiecewisePolynomial:
    """One polynomial of all joints over ``duration``; a law that ends before waits at its end."""
    seams = np.concatenate([[0.0, duration], *(law.breaks for law in laws if law is not None)])
    seams = np.unique(np.minimum(seams, duration))
    c = np.zeros((len(seams) - 1, 4, len(laws)))  # the laws that need seams are cubics at most
    for k, law in enumerate(laws):
        if law is None:
            continue
        arrives = int(np.searchsorted(seams, min(law.high, duration)))
        part = law.cut(seams[: arrives + 1]).coefficients[:, :, 0]
        c[:arrives, : part.shape[1], k] = sign[k] * part
        c[arrives:, 0, k] = sign[k] * law(law.high)[0]
    return PiecewisePolynomial(seams, c)


def _too_short(
    robot: Robot,
    travel: FloatArray,
    duration: float,
    told: str,
    times: FloatArray,
    laws: Sequence[PiecewisePolynomial | None],
    profile: ProfileName,
) -> str:
    """Which joint cannot, and which of its limits it would pass; the duration [s] is ``told`` so."""
    i = int(times.argmax())
    joint = robot.joints[i]
    way = joint.shown(abs(float(travel[i])))
    if duration == 0:
        return f"{joint.title}: cannot move in 0 s"
    limits = [joint.shown(limit) for limit in (joint.speed, joint.acceleration, joint.jerk)]
    units = ("°/s", "°/s²", "°/s³")
    motion = f"{joint.title}: {way:.2f}° in {told}"
    law = laws[i] if laws else None
    if law is not None:
        # the shortest law meets some limits; the others do not make it longer
        rates = [law := law.derivative() for _ in range(2 if profile == "trapezoid" else 3)]
        peaks = [joint.shown(float(rate.bound_by_piece().max())) for rate in rates]
        met = [k for k, peak in enumerate(peaks) if peak > limits[k] * (1 - _MET)]
        *first, last = [f"{limits[k]:.1f} {units[k]}" for k in met]
        said = f"limits of {', '.join(first)} and {last}" if first else f"limit of {last}"
        return f"{motion} is too fast for its {said}"
    needs = [peak * way / duration ** (k + 1) for k, peak in enumerate(_SHAPES[profile].peaks)]
    # the limit that asks for the longest time: speed by the first power, acceleration by the second ...
    k = max(range(len(needs)), key=lambda k: (needs[k] / limits[k]) ** (1 / (k + 1)))
    digits = decimals_apart(needs[k], limits[k], least=1)
    return f"{motion} needs {needs[k]:.{digits}f} {units[k]}, its limit is {limits[k]:.{digits}f} {units[k]}"

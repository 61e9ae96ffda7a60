"""What every timed motion is: a function of time that can be sampled and checked before it is run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sample:
    """Joint state at one time, or at many: (..., n) rad, rad/s, rad/s², rad/s³."""

    q: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    jerk: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Peaks:
    """The extremes of a whole motion, exact or never passed: (n,) each."""

    low: FloatArray
    """smallest joint angles [rad]"""
    high: FloatArray
    """largest joint angles [rad]"""
    speed: FloatArray
    """largest joint speeds [rad/s]"""
    acceleration: FloatArray
    """largest joint accelerations, without sign [rad/s²]"""


class Trajectory(Protocol):
    """A motion of all joints over ``0 ... duration`` seconds. Immutable.

    What the arm is given is at rest at both ends; the pieces of a blended program are not.
    """

    @property
    def duration(self) -> float:
        """Seconds; 0 for a motion that goes nowhere."""
        ...

    @property
    def start(self) -> FloatArray:
        """Where it starts (n,) [rad]."""
        ...

    @property
    def end(self) -> FloatArray:
        """Where it ends (n,) [rad]."""
        ...

    def sample(self, t: float | FloatArray) -> Sample:
        """State at ``t`` [s], a number or (k,); outside the duration it holds the nearer end."""
        ...


@runtime_checkable
class KnowsPeaks(Protocol):
    """A trajectory that knows its extremes without being sampled."""

    @property
    def peaks(self) -> Peaks:
        """Extremes of the whole motion."""
        ...

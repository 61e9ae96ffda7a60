"""What every timed motion is: a function of time that can be sampled and checked before it is run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Sample:
    """Joint state at one time, or at many: (..., n) rad, rad/s, rad/s²."""

    q: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class Trajectory(Protocol):
    """A motion of all joints over ``0 ... duration`` seconds; at rest at both ends. Immutable."""

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

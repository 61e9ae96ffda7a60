"""What inverse kinematics answers for many poses at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class BatchSolutions:
    """The branches of k poses, a column a branch."""

    q: FloatArray
    """(k, b, n) joint angles [rad]; NaN where a branch has no solution inside the limits"""
    found: NDArray[np.bool_]
    """(k, b) where it has one"""
    branch_names: tuple[str, ...]
    """(b,)"""

    @property
    def count(self) -> NDArray[np.intp]:
        """(k,) how many branches of each pose have a solution."""
        return self.found.sum(axis=1)

    def __len__(self) -> int:
        return len(self.q)

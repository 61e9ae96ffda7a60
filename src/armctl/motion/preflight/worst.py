"""The worst of each motion, kept while its samples go by."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


class Worst:
    """For each of N motions how bad it gets, when, and what goes with it; badness up to 0 does not count."""

    def __init__(self, motions: int) -> None:
        self.badness = np.zeros(motions)
        """(N,); 0 where nothing was found"""
        self.time = np.zeros(motions)
        """(N,) [s]"""
        self.which = np.zeros(motions, dtype=np.intp)
        """(N,) index of the part"""
        self.figure = np.zeros(motions)
        """(N,) what is to be told"""

    @property
    def found(self) -> IntArray:
        """Indices of the motions that something was found in."""
        return np.flatnonzero(self.badness > 0.0)

    def look(
        self, motion: IntArray, time: FloatArray, badness: FloatArray, which: IntArray, figure: FloatArray
    ) -> None:
        """Take in samples, (m,) each; of samples that are equally bad the earliest counts."""
        bad = np.flatnonzero(badness > self.badness[motion])
        if not len(bad):
            return
        # With an index that comes again the last assignment stands: the worst go last, of equals the first.
        bad = bad[np.lexsort((-time[bad], badness[bad]))]
        at = motion[bad]
        self.badness[at], self.time[at] = badness[bad], time[bad]
        self.which[at], self.figure[at] = which[bad], figure[bad]

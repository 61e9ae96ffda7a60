"""A printed figure beside the recomputed one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Comparison:
    """One printed figure and what armctl computes for it, in the print's own unit."""

    what: str
    unit: str
    printed: tuple[float, ...]
    computed: tuple[float, ...]
    tolerance: float
    """largest difference that the print's rounding allows"""
    digits: int = 3
    """decimals worth showing"""

    @property
    def difference(self) -> float:
        """Largest difference between a printed figure and the computed one."""
        return max(abs(a - b) for a, b in zip(self.printed, self.computed, strict=True))

    @property
    def agrees(self) -> bool:
        """True when the figure is reproduced within the print's rounding."""
        return self.difference <= self.tolerance


@dataclass(frozen=True, slots=True)
class Improvement:
    """Where the paper's own method is inexact: its error, and armctl's."""

    what: str
    unit: str
    paper: float
    armctl: float


@dataclass(frozen=True, slots=True)
class Report:
    """One paper's figures."""

    robot: str
    title: str
    comparisons: tuple[Comparison, ...]
    errata: tuple[str, ...]
    """where the print is wrong, and what is right"""
    improvements: tuple[Improvement, ...] = ()

    @property
    def agrees(self) -> bool:
        """True when all figures are reproduced."""
        return all(one.agrees for one in self.comparisons)


def floats(values: Iterable[float]) -> tuple[float, ...]:
    """Plain floats, as a ``Comparison`` holds them."""
    return tuple(float(value) for value in values)

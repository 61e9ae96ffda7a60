"""A printed figure beside the recomputed one."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Comparison:
    """One printed figure and what armctl computes for it, in the print's own unit."""

    what: str
    unit: str
    printed: tuple[float, ...]
    computed: tuple[float, ...]
    tolerance: float
    """largest difference that the print's last digit allows"""
    digits: int = 3
    """decimals worth showing"""

    @property
    def difference(self) -> float:
        """Largest difference between a printed figure and the computed one."""
        return max(abs(a - b) for a, b in zip(self.printed, self.computed, strict=True))

    @property
    def agrees(self) -> bool:
        """True when every printed digit is reproduced."""
        return self.difference <= self.tolerance


@dataclass(frozen=True, slots=True)
class Report:
    """One paper's figures."""

    robot: str
    title: str
    comparisons: tuple[Comparison, ...]
    errata: tuple[str, ...]
    """where the print is wrong, and what is right"""

    @property
    def agrees(self) -> bool:
        """True when all figures are reproduced."""
        return all(one.agrees for one in self.comparisons)

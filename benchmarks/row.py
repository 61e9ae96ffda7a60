"""One line of the table: a piece of work, what armctl is held against, and the goal."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Literal


class NotMeasuredError(Exception):
    """A reference cannot be had here; the message says why, and the table shows it."""


@dataclass(frozen=True)
class Goal:
    """A bound on armctl against its reference.

    ``time`` bounds armctl's time as a multiple of the reference's from above, ``speed`` how many times
    faster armctl must be from below, ``share`` the share of targets that armctl must solve from below.
    """

    of: Literal["time", "speed", "share"]
    bound: float

    def is_met(self, figure: float) -> bool:
        return figure <= self.bound if self._is_upper else figure >= self.bound

    def said(self, figure: float) -> str:
        """The figure in the goal's own terms."""
        if self.of == "share":
            return f"{100 * figure:.4g} %"
        number = f"{figure:,.0f}" if figure >= 1000 else f"{figure:.3g}"
        return f"{number} × {'the time' if self.of == 'time' else 'as fast'}"

    def __str__(self) -> str:
        return f"{'≤' if self._is_upper else '≥'} {self.said(self.bound)}"

    @property
    def _is_upper(self) -> bool:
        return self.of == "time"


@dataclass(frozen=True)
class Row:
    """What was measured, or why it was not."""

    work: str
    reference: str
    reference_us: float | None = None
    armctl_us: float | None = None
    spread: float | None = None
    """how far the middle round lies above the best one, the larger of both sides, as a share"""
    ratio: float | None = None
    """in the goal's terms; without a goal, how many times as fast armctl is"""
    goal: Goal | None = None
    missing: str = ""
    """why there is no figure, where there is none"""

    @property
    def met(self) -> bool | None:
        """None where there is no goal, or nothing was measured."""
        return None if self.goal is None or self.ratio is None else self.goal.is_met(self.ratio)

    @property
    def said(self) -> str:
        """The ratio in words; a dash where nothing was measured."""
        if self.ratio is None:
            return "–"
        return (self.goal or Goal("speed", 1.0)).said(self.ratio)

    @property
    def verdict(self) -> str:
        """One line that names the row, its figure and its goal."""
        return f"{self.work}, against {self.reference}: {self.said}, goal {self.goal}"

    def as_json(self) -> dict[str, object]:
        fields: dict[str, object] = asdict(self)
        return fields | {"goal": None if self.goal is None else str(self.goal), "met": self.met}

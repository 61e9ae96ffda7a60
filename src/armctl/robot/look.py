"""How an arm is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Color = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Look:
    """Colours (red, green, blue 0..255) and proportions; the links themselves come from the DH rows."""

    links: tuple[Color, ...] = (
        (52, 73, 94),
        (41, 128, 185),
        (230, 126, 34),
        (39, 174, 96),
        (142, 68, 173),
    )
    """one a joint, used over and over where there are more joints"""
    joints: Color = (60, 60, 65)
    shape: Literal["round", "square"] = "round"
    """cross-section of the links"""
    width: float = 0.052
    """width of the links as a fraction of the arm's reach"""

"""What a check finds on the paths of a program."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from armctl.facts.reasons import Reason


@dataclass(frozen=True, slots=True)
class PathTurn(Reason):
    """Which way a program goes at a step."""

    step: int
    """index"""
    way: Literal["then", "else", "pass", "cell"]
    number: int = 0
    """of the pass or cell, from 1"""


@dataclass(frozen=True, slots=True)
class OnPath(Reason):
    """What is wrong on one path of a program."""

    turns: tuple[PathTurn, ...]
    reason: Reason


@dataclass(frozen=True, slots=True)
class CellOutsideGrid(Reason):
    """A point in the frame of a cell, where there is none."""


@dataclass(frozen=True, slots=True)
class UnknownFrame(Reason):
    """A step names a user frame that the program has not."""

    name: str
    known: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class FrameNamedBase(Reason):
    """A user frame with the name of the base frame."""


@dataclass(frozen=True, slots=True)
class NeverComes(Reason):
    """Nothing can bring about what a step waits for: only a later step could."""

    what: str


@dataclass(frozen=True, slots=True)
class NeverEnds(Reason):
    """A loop that no pass can end."""


@dataclass(frozen=True, slots=True)
class Unbounded(Reason):
    """A loop that nothing in the program bounds."""


@dataclass(frozen=True, slots=True)
class PathsLeftOut(Reason):
    """A program with more paths than a check walks."""

    most: int
    """steps that were walked"""

"""What a check finds on the paths of a program."""

from __future__ import annotations

from typing import Literal

from armctl.facts.reasons import Reason
from armctl.lazy_dataclass import dataclass

PathWay = Literal["then", "else", "pass", "cell"]


@dataclass(frozen=True, slots=True)
class PathTurn(Reason):
    """Which way a program goes at a step."""

    step: int
    """index"""
    way: PathWay
    number: int = 0
    """of the pass or cell, from 1"""
    program: str = ""
    """the called program whose step it is; empty: the one that was started"""


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


# What is wrong with programs that call others.


Part = Literal["", "open", "approach", "down", "grip", "let go", "held", "gone", "settle", "retreat"]
"""of a pick or place step; empty: of no such step, or all of it"""


@dataclass(frozen=True, slots=True)
class CalledStep(Reason):
    """A step of a called program."""

    program: str
    """as seen from the program that was started, without suffix"""
    step: int
    """index"""


@dataclass(frozen=True, slots=True)
class InStep(Reason):
    """What is wrong inside a step that is made of others: which program it calls, or which part of it."""

    calls: tuple[CalledStep, ...]
    """from the outermost called program to the innermost"""
    doing: Part
    reason: Reason


@dataclass(frozen=True, slots=True)
class CallMissing(Reason):
    """A called program is not there."""

    program: str
    place: Literal["beside", "saved", "sent"]
    """where it was looked for: beside the file that calls it, among the saved ones, in what was sent"""


@dataclass(frozen=True, slots=True)
class CallUnread(Reason):
    """A called program cannot be read."""

    program: str
    why: str


@dataclass(frozen=True, slots=True)
class CallCircle(Reason):
    """A program that calls itself, over others or not."""

    chain: tuple[str, ...]
    """from the program that was started; the last one is called a second time"""


@dataclass(frozen=True, slots=True)
class CallTooDeep(Reason):
    """Programs that call each other more often than they may."""

    chain: tuple[str, ...]
    most: int


@dataclass(frozen=True, slots=True)
class CallTooLong(Reason):
    """A program that has too many steps, with those that it calls."""

    most: int

"""Serial motion: a named list of steps that the arm runs once, N times or for ever."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import Literal, Self

import msgspec

from armctl.documents import DocumentKind
from armctl.errors import InputError, ProgramError
from armctl.facts import UnmatchedBlock
from armctl.program.base_steps import Step
from armctl.program.steps import MOST_REPEATS, AnyStep, EndStep, RepeatStep

PROGRAM_FILES = DocumentKind(ProgramError, most_bytes=1024 * 1024, entries={"steps": "step"})
MOST_STEPS = 20_000
"""no program has more"""


class Program(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A program, as written in its file."""

    format: Literal[1] = 1
    robot: str
    name: str = "untitled"
    steps: tuple[AnyStep, ...] = ()


# Which ``repeat`` belongs to which ``end``.


@dataclass(frozen=True, slots=True)
class Blocks:
    """The repeat blocks of some steps, whether their markers match or not."""

    partners: Mapping[int, int]
    """index of a marker to that of the one it belongs to, both ways"""
    depths: Sequence[int]
    """for each step how many blocks are around it; a block's markers are as deep as what is around it"""
    findings: Sequence[tuple[int, UnmatchedBlock]]
    """markers without the other one: (index of the step, what is wrong), in the order of the steps"""

    @classmethod
    def of(cls, steps: Sequence[Step]) -> Self:
        """Match the markers of some steps."""
        partners: dict[int, int] = {}
        depths: list[int] = []
        findings: list[tuple[int, UnmatchedBlock]] = []
        begun: list[int] = []
        for index, step in enumerate(steps):
            if isinstance(step, EndStep):
                if begun:
                    begin = begun.pop()
                    partners[begin], partners[index] = index, begin
                else:
                    findings.append((index, UnmatchedBlock("end")))
            depths.append(len(begun))
            if isinstance(step, RepeatStep):
                begun.append(index)
        findings += [(index, UnmatchedBlock("repeat")) for index in begun]
        return cls(partners, depths, sorted(findings, key=lambda finding: finding[0]))

    @classmethod
    def matched(cls, steps: Sequence[Step]) -> Self:
        """The same; a ProgramError names the first ``repeat`` without an ``end``, or the reverse."""
        found = cls.of(steps)
        for index, why in found.findings:
            raise ProgramError(why).about(f"step {index + 1}")
        return found

    def whole(self, index: int) -> tuple[int, int]:
        """First and last step of the block that a marker begins or ends; of another step, the step itself."""
        first, last = sorted((index, self.partners.get(index, index)))
        return first, last


# Editing a program: each function gives a new program and the index of the row to select in it.

PLACES: tuple[str, ...] = (
    "at the end",
    "before the selected row",
    "after the selected row",
    "in place of the selected row",
)
Change = tuple[Program, int]
_RANGE = re.compile(r"\s*(\d{1,6})\s*(?:(?:-|–|…|to)\s*(\d{1,6})\s*)?")


def add(program: Program, step: Step, where: str, selected: int) -> Change:
    """A step goes to one of the ``PLACES``; several put before or after the selected row keep their order."""
    count = len(program.steps)
    spans = ((count, 0), (selected, 0), (selected + 1, 0), (selected, 1))
    at, removed = dict(zip(PLACES, spans, strict=True))[where] if count else (0, 0)
    row = selected + 1 if where == PLACES[1] and count else at
    return _spliced(program, at, removed, (step,)), row


def replace(program: Program, row: int, step: Step) -> Change:
    """``step`` instead of the one in a row."""
    return _spliced(program, row, 1, (step,)), row


def delete(program: Program, row: int) -> Change:
    """Without a row; a marker of a block takes its partner with it. The next row is selected, or the last."""
    _require_row(program, row)
    first, last = Blocks.of(program.steps).whole(row)
    steps = tuple(step for i, step in enumerate(program.steps) if i not in (first, last))
    selected = row - 1 if first < row else row
    return _with(program, steps), max(min(selected, len(steps) - 1), 0)


def move(program: Program, row: int, by: int) -> Change:
    """A row up (-1) or down (+1); a ProgramError where it is the first or the last already."""
    _require_row(program, row)
    if not 0 <= row + by < len(program.steps):
        raise ProgramError(f"row {row + 1} is the {'first' if by < 0 else 'last'} one already")
    steps = list(program.steps)
    steps.insert(row + by, steps.pop(row))
    return _with(program, tuple(steps)), row + by


def duplicate(program: Program, row: int) -> Change:
    """A copy of a row behind it, or of the whole block that it begins or ends; the copy is selected.

    Its steps are objects of their own, so that they can be told from those that were copied.
    """
    _require_row(program, row)
    first, last = Blocks.of(program.steps).whole(row)
    copied = tuple(msgspec.structs.replace(step) for step in program.steps[first : last + 1])
    return _spliced(program, last + 1, 0, copied), row + len(copied)


def repeat(program: Program, rows: str, selected: int, times: int) -> Change:
    """The rows of a range, e.g. ``2-5``, in a block that runs ``times`` times; empty: the selected row."""
    first = last = selected
    if rows.strip():
        match = _RANGE.fullmatch(rows)
        if match is None:
            raise InputError(f"rows to repeat: {rows.strip()[:40]!r} is no range of rows; write e.g. 2-5")
        first, last = int(match[1]) - 1, int(match[2] or match[1]) - 1
    for row in (selected, first, last):
        _require_row(program, row)
    if last < first:
        raise ProgramError(f"a block cannot go from step {first + 1} back to step {last + 1}")
    if not 1 <= times <= MOST_REPEATS:
        raise ProgramError(f"a block repeats 1 … {MOST_REPEATS} times, not {times}")
    blocks = Blocks.matched(program.steps)
    for row in range(first, last + 1):
        begin, end = blocks.whole(row)
        if begin < first or last < end:
            raise ProgramError(
                f"steps {first + 1} … {last + 1} cut the block of steps {begin + 1} … {end + 1}; "
                "take all of it, or none"
            )
    inside = program.steps[first : last + 1]
    return _spliced(program, first, len(inside), (RepeatStep(times=times), *inside, EndStep())), first


def _require_row(program: Program, row: int) -> None:
    if not program.steps:
        raise ProgramError("the list is empty; record a pose first")
    if not 0 <= row < len(program.steps):
        raise ProgramError(f"there is no row {row + 1}; the program has {len(program.steps)}")


def _spliced(program: Program, at: int, removed: int, steps: tuple[Step, ...]) -> Program:
    return _with(program, (*program.steps[:at], *steps, *program.steps[at + removed :]))


def _with(program: Program, steps: tuple[Step, ...]) -> Program:
    return msgspec.structs.replace(program, steps=steps)


# The steps of a program in the order in which they are executed.


class Cursor:
    """Where one pass of a program is; repeats are counted, blocks that do nothing are passed over whole."""

    def __init__(self, program: Program, first: int = 0) -> None:
        """Stand before the step ``first``: in a block in its first pass, which its ``end`` ends at once."""
        steps = program.steps
        if not 0 <= first < max(len(steps), 1):
            raise InputError(f"{program.name} has no step {first + 1}; it has {len(steps)}")
        self._steps = steps
        self._partners = Blocks.matched(steps).partners
        self._goals = _goals(steps, self._partners)
        self._next = self._goals[first]
        self._left: list[int] = []
        """passes still to be begun or under way, for each open block, the outermost first"""
        for index in range(first):
            step = steps[index]
            if self._goals[index] == index:
                if isinstance(step, RepeatStep):
                    self._left.append(step.times)
                elif isinstance(step, EndStep):
                    self._left.pop()

    def copy(self) -> Self:
        """Another cursor at the same place."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin._left = self._left.copy()
        return twin

    def next(self) -> tuple[int, Step] | None:
        """Index and step of what is executed next; None at the end of the pass, and from then on."""
        while (index := self.advance()) is not None:
            step = self._steps[index]
            if step.acts:
                return index, step
        return None

    def advance(self) -> int | None:
        """Index of the next step or marker of a block, which is passed; None at the end of the pass."""
        index = self._next
        if index >= len(self._steps):
            return None
        step, following = self._steps[index], index + 1
        if isinstance(step, RepeatStep):
            self._left.append(step.times)
        elif isinstance(step, EndStep):
            self._left[-1] -= 1
            if self._left[-1] > 0:
                following = self._partners[index] + 1
            else:
                self._left.pop()
        self._next = self._goals[following]
        return index

    def leave(self, begin: int) -> None:
        """Go on behind a block whose ``repeat`` or ``end`` was passed last; no pass of it follows."""
        end = self._partners[begin]
        if begin < self._next <= end:
            self._left.pop()
            self._next = self._goals[end + 1]


def _goals(steps: Sequence[Step], partners: Mapping[int, int]) -> list[int]:
    """(steps + 1) From each place, the next step that does something or belongs to a block that does."""
    acting = [0, *accumulate(step.acts for step in steps)]
    goals = [len(steps)] * (len(steps) + 1)
    for index in range(len(steps) - 1, -1, -1):
        first, last = sorted((index, partners.get(index, index)))
        goals[index] = index if acting[last + 1] > acting[first] else goals[index + 1]
    return goals

"""Serial motion: a named list of steps that the arm runs once, N times or for ever."""

from __future__ import annotations

import sys
from collections.abc import Container, Mapping, Sequence
from itertools import accumulate
from typing import Annotated, Literal, Self

import msgspec
from msgspec import Meta

from armctl.documents import DocumentKind
from armctl.errors import InputError, ProgramError
from armctl.facts import UnmatchedBlock
from armctl.facts.commands import NoSuchStep
from armctl.lazy_dataclass import dataclass
from armctl.program.base_steps import BlockStep, MotionStep, Step
from armctl.program.frames import (
    MOST_FRAMES,
    FrameName,
    Placing,
    UserFrame,
    markers_of,
)
from armctl.program.logic_steps import IfStep
from armctl.program.steps import AnyStep

PROGRAM_FILES = DocumentKind(ProgramError, most_bytes=1024 * 1024, entries={"steps": "step"})
MOST_STEPS = 20_000
"""no program has more"""
MOST_CALLED = 200
"""files that one program may call, over others or not"""
PROGRAM_SUFFIXES = (".toml", ".csv")


class CalledProgram(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A program that another one calls, as it was read once."""

    file: str
    """as seen from the folder of the program that was started"""
    robot: str = ""
    frames: dict[str, UserFrame] = {}
    """its own; those of what calls it do not count in it"""
    steps: tuple[AnyStep, ...] = ()
    missing: Literal["", "beside", "saved"] = ""
    """where it was looked for and is not; empty: it was there"""
    unread: str = ""
    """why it cannot be read; empty: it could"""


class Program(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A program, as written in its file; and what it calls, which are files of their own."""

    format: Literal[1] = 1
    robot: str
    name: str = "untitled"
    frames: Annotated[dict[FrameName, UserFrame], Meta(max_length=MOST_FRAMES)] = {}
    """by name; which of them a step is in is what ``frame`` steps say"""
    steps: tuple[AnyStep, ...] = ()
    called: tuple[CalledProgram, ...] = ()
    """the programs that it calls, and those call, as they were read (``link``); no file holds them"""

    def __hash__(self) -> int:
        return hash((self.robot, self.name, self.steps, frozenset(self.frames.items())))

    @property
    def content(self) -> tuple[object, ...]:
        """What the arm would do: two programs with the same differ in their names only."""
        return self.steps, self.frames


# Which markers belong to each other.


@dataclass(frozen=True, slots=True)
class Blocks:
    """The blocks of some steps, whether their markers match or not."""

    partners: Mapping[int, int]
    """index of the begin of a block to that of its end, both ways"""
    elses: Mapping[int, int]
    """index of an ``if`` to that of its ``else``, both ways"""
    depths: Sequence[int]
    """for each step how many blocks are around it; a block's markers are as deep as what is around it"""
    findings: Sequence[tuple[int, UnmatchedBlock]]
    """markers without the other one: (index of the step, what is wrong), in the order of the steps"""

    @classmethod
    def of(cls, steps: Sequence[Step]) -> Self:
        """Match the markers of some steps."""
        partners: dict[int, int] = {}
        elses: dict[int, int] = {}
        depths: list[int] = []
        findings: list[tuple[int, UnmatchedBlock]] = []
        begun: list[int] = []
        markers = markers_of(steps)
        for index, step in enumerate(steps):
            if type(step) not in markers:
                depths.append(len(begun))
                continue
            if step.divides:
                if begun and isinstance(steps[begun[-1]], IfStep) and begun[-1] not in elses:
                    elses[begun[-1]], elses[index] = index, begun[-1]
                else:
                    findings.append((index, UnmatchedBlock(step.kind)))
            if step.closes:
                if begun:
                    begin = begun.pop()
                    partners[begin], partners[index] = index, begin
                else:
                    findings.append((index, UnmatchedBlock(step.kind)))
            depths.append(len(begun) - (index in elses))
            if isinstance(step, BlockStep):
                begun.append(index)
        findings += [(index, UnmatchedBlock(steps[index].kind)) for index in begun]
        return cls(partners, elses, depths, sorted(findings, key=lambda finding: finding[0]))

    @classmethod
    def matched(cls, steps: Sequence[Step]) -> Self:
        """The same, all of them ``required`` to match."""
        return cls.of(steps).required()

    def required(self) -> Self:
        """These; a ProgramError names the first marker without its other one."""
        for index, why in self.findings:
            raise ProgramError(why).about(f"step {index + 1}")
        return self

    def whole(self, index: int) -> tuple[int, int]:
        """First and last step of the block that a marker is of; of another step, the step itself."""
        if index not in self.partners:
            index = self.elses.get(index, index)
        first, last = sorted((index, self.partners.get(index, index)))
        return first, last


def in_first_cells(program: Program) -> list[Step]:
    """The steps with their points in the base frame, those in a grid as its first pass runs them."""
    placing = Placing(program.steps, program.frames)
    cells: list[tuple[float, float, float] | None] = [None]
    placed: list[Step] = []
    for index, step in enumerate(program.steps):
        if isinstance(step, BlockStep):
            cells.append(step.cell(0) or cells[-1])
        elif step.closes and len(cells) > 1:
            cells.pop()
        placed.append(placing.placed(index, step, cells[-1]))
    return placed


# The steps of a program in the order in which they are executed.


class Cursor:
    """Where one pass of a program is; passes of blocks are counted, blocks that do nothing are passed over.

    Behind a step that asks (``Effect.asks``) the answer is needed: ``decide``.
    """

    def __init__(
        self,
        program: Program,
        first: int = 0,
        begins: Container[int] = (),
        known: tuple[Placing, Blocks] | None = None,
    ) -> None:
        """Stand before the step ``first``: in a block in its first pass, which its ``end`` ends at once.

        An ``if`` around it counts as answered. ``begins``: indices of the steps that ``begun`` counts.
        ``known``: frames and blocks of the steps, where they were found before.
        """
        steps = program.steps
        if not 0 <= first < max(len(steps), 1):
            raise InputError(NoSuchStep(program.name, first + 1, len(steps)))
        self._steps = steps
        self._placing, self._blocks = known or (Placing(steps, program.frames), Blocks.matched(steps))
        self._goals = _goals(steps, self._blocks)
        self._next = self._goals[first]
        self._open: list[tuple[int, int]] = []
        """open blocks, the outermost first: where each begins, and its passes to be begun or under way"""
        self._begins = begins
        self.begun = 0
        """how many steps have begun that are counted"""
        self.percent = 100.0
        """what the last speed step asks for"""
        self._percents: list[float] = []
        """what it was ahead of each open block that keeps its speed to itself"""
        self.asked: int | None = None
        """the step that asks and has no answer yet"""
        for index in range(first):
            step = steps[index]
            if self._goals[index] == index:
                if isinstance(step, BlockStep):
                    self._enter(index, step)
                elif step.closes:
                    self._leave()

    def copy(self) -> Self:
        """Another cursor at the same place."""
        twin = object.__new__(type(self))
        twin.__dict__.update(self.__dict__)
        twin._open, twin._percents = self._open.copy(), self._percents.copy()
        return twin

    def next(self) -> tuple[int, Step] | None:
        """Index and step of what is executed next; None at the end of the pass, and from then on."""
        while self._next < len(self._steps):
            if self.asked is not None:
                raise ProgramError("which step comes next is not decided").about(f"step {self.asked + 1}")
            index = self._next
            step = self._steps[index]
            self._pass(index, step)
            if step.acts:
                return index, self._placed(index, step)
        return None

    def decide(self, holds: bool) -> None:
        """Go on behind the step that was passed last and asks."""
        begin, self.asked = self.asked, None
        if begin is None:
            raise ProgramError("no step asks anything")
        if holds:
            self._next = self._goals[begin + 1]
            return
        otherwise = self._blocks.elses.get(begin)
        if otherwise is None:
            self._open.pop()
            otherwise = self._blocks.partners[begin]
        self._next = self._goals[otherwise + 1]

    def _placed(self, index: int, step: Step) -> Step:
        """A step with its points in the base frame."""
        for begin, left in reversed(self._open) if step.in_cell else ():
            block = self._steps[begin]
            cell = block.cell((block.passes or left) - left) if isinstance(block, BlockStep) else None
            if cell is not None:
                return self._placing.placed(index, step, cell)
        return self._placing.placed(index, step, None)

    def _pass(self, index: int, step: Step) -> None:
        following = index + 1
        if index in self._begins:
            self.begun += step.acts or (isinstance(step, BlockStep) and step.scoped)
        percent = None if isinstance(step, MotionStep) else step.effect.percent
        if percent is not None:
            self.percent = percent
        if isinstance(step, BlockStep):
            if not self._open or self._open[-1][0] != index:
                self._enter(index, step)
            if step.effect.asks is not None:
                self.asked, following = index, index
        elif step.divides and self._open:
            following = self._blocks.partners[self._open.pop()[0]] + 1
        elif step.closes:
            begin, left = self._leave()
            if left > 1:
                self._open.append((begin, left - 1))
                following = begin if self._steps[begin].effect.asks is not None else begin + 1
        self._next = self._goals[following]

    def _leave(self) -> tuple[int, int]:
        begin, left = self._open.pop()
        block = self._steps[begin]
        if isinstance(block, BlockStep) and block.scoped:
            self.percent = self._percents.pop()
        return begin, left

    def _enter(self, index: int, step: BlockStep) -> None:
        if step.scoped:
            self._percents.append(self.percent)
        self._open.append((index, sys.maxsize if step.passes is None else step.passes))


def _goals(steps: Sequence[Step], blocks: Blocks) -> list[int]:
    """(steps + 1) From each place, the next step that does something or belongs to a block that does."""
    acting = [0, *accumulate(step.acts for step in steps)]
    goals = [len(steps)] * (len(steps) + 1)
    for index in range(len(steps) - 1, -1, -1):
        first = last = index
        if index in blocks.partners or index in blocks.elses:
            first, last = blocks.whole(index)
        goals[index] = index if acting[last + 1] > acting[first] else goals[index + 1]
    return goals

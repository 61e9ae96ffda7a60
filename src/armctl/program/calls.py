"""Programs that call others: found and read once, and then run as one list of steps."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import ClassVar, Self

import msgspec

from armctl.facts import (
    About,
    CallCircle,
    CalledStep,
    CallMissing,
    CallTooDeep,
    CallTooLong,
    CallUnread,
    InStep,
    OtherRobot,
    Part,
    PathTurn,
    Reason,
    Said,
    say,
)
from armctl.lazy_dataclass import dataclass
from armctl.motion.preflight import Finding
from armctl.program.base_steps import BlockStep, Step
from armctl.program.frames import BASE, FrameStep, Placing, UserFrame
from armctl.program.logic_steps import EndStep
from armctl.program.program import MOST_CALLED, PROGRAM_SUFFIXES, Blocks, CalledProgram, Program

DEEPEST = 8
"""so many programs may call one another"""
MOST_STEPS_IN_ALL = 50_000
"""of a program and those that it calls, each as often as it is called"""


# Which programs there are.


def called_file(caller: str, name: str) -> str:
    """The file that the program in file ``caller`` means by a name, both as seen from the same folder."""
    file = name if name.lower().endswith(PROGRAM_SUFFIXES) else f"{name}.toml"
    return posixpath.normpath(posixpath.join(posixpath.dirname(caller), file))


def called_name(file: str) -> str:
    """What people call the program in a file."""
    return file.removesuffix(".toml")


def link(
    program: Program, read: Callable[[str], CalledProgram], known: Iterable[CalledProgram] = ()
) -> Program:
    """A program with those that it calls, each read once; ``known``: those that were read before."""
    before = {one.file: one for one in known}
    found: dict[str, CalledProgram] = {}
    waiting = [("", step.calls) for step in program.steps if step.calls]
    while waiting and len(found) < MOST_CALLED:
        caller, name = waiting.pop()
        file = called_file(caller, name)
        if file not in found:
            found[file] = before[file] if file in before else read(file)
            waiting += [(file, step.calls) for step in found[file].steps if step.calls]
    called = tuple(found.values())
    return program if called == program.called else msgspec.structs.replace(program, called=called)


# All that runs, as one list.


@dataclass(frozen=True, slots=True)
class StepPlace:
    """Where a step that runs is written."""

    index: int
    """of the step of the program that was started"""
    calls: tuple[CalledStep, ...] = ()
    """the steps of called programs, the outermost first"""
    part: Part = ""
    """what of a step that is made of others"""

    def within(self, reason: Reason) -> Reason:
        """What is wrong there, as it is said of the step of the program that was started."""
        return InStep(self.calls, self.part, reason) if self.calls or self.part else reason

    @property
    def words(self) -> str:
        """Where inside the step, ahead of what is said of it; empty: it is all of it."""
        return say(self.within(Said("")))


ALL_OF_IT = StepPlace(0)
"""a step that is run as it is written"""


class CallBlock(BlockStep, frozen=True, kw_only=True, tag="called"):
    """Around the steps of a called program, among those that run; no file holds it."""

    acts: ClassVar[bool] = False
    scoped: ClassVar[bool] = True

    @property
    def passes(self) -> int:
        """Once."""
        return 1


@dataclass(frozen=True, eq=False)
class WholeProgram:
    """A program with all that it calls, its steps taken apart into those that run.

    Blocks and frames are found once, for the check and every pass: with 10,000 steps, half of the time from
    Go to the first setpoint went into finding them twice.
    """

    written: Program
    flat: Program
    """its steps are run as they are"""
    begins: Sequence[int]
    """(steps + 1) for each step as written, the first of ``flat`` that is made of it"""
    findings: Sequence[tuple[int, Reason]] = ()
    """calls that cannot be: (index of the step as written, why)"""
    files: Sequence[CalledProgram] = ()
    """the called programs that run"""
    marks: frozenset[int] = frozenset()
    """indices in ``flat`` at which steps as written begin"""
    _places: Sequence[StepPlace] | None = None
    """None: each step is run as it is written"""

    @classmethod
    def of(cls, program: Program) -> Self:
        """Take a program apart; what cannot be called stays as it is, and is a finding."""
        steps = program.steps
        neither = Step.calls, Step.parts  # as most kinds have it
        made = {kind for kind in {type(step) for step in steps} if (kind.calls, kind.parts) != neither}
        if not any(step.calls or step.parts for step in steps if type(step) in made):
            return cls(program, program, range(len(steps) + 1), marks=frozenset(range(len(steps))))
        taken = _Taking(program)
        begins: list[int] = []
        for index, step in enumerate(steps):
            begins.append(len(taken.steps))
            taken.take(step, StepPlace(index), "", (program.name,))
        begins.append(len(taken.steps))
        frames = {**program.frames, **taken.frames}
        flat = msgspec.structs.replace(program, frames=frames, steps=tuple(taken.steps), called=())
        return cls(
            program,
            flat,
            begins,
            taken.findings,
            tuple(taken.files.values()),
            frozenset(begins[:-1]),
            taken.places,
        )

    @cached_property
    def blocks(self) -> Blocks:
        """Of ``flat``."""
        return Blocks.of(self.flat.steps)

    @cached_property
    def placing(self) -> Placing:
        """In which frame each step of ``flat`` is."""
        return Placing(self.flat.steps, self.flat.frames)

    def place(self, index: int) -> StepPlace:
        """Where a step of ``flat`` is written."""
        return StepPlace(index) if self._places is None else self._places[index]

    def span(self, index: int) -> range:
        """The steps of ``flat`` that one as written is made of."""
        return range(self.begins[index], self.begins[index + 1])

    def share(self, index: int) -> tuple[float, float]:
        """Of a step of ``flat``: how much of the one as written is ahead of it, and how much it is itself."""
        span = self.span(self.place(index).index)
        return (index - span.start) / len(span), 1 / len(span)

    def told(self, finding: Finding) -> Finding:
        """What was found at a step of ``flat``, as it is said of the step as written."""
        if finding.step is None:
            return finding
        place = self.place(finding.step)
        return replace(finding, step=place.index, reason=place.within(finding.reason))

    def called(self, index: int, why: Reason) -> Finding:
        """What is wrong with a step of a called program, all of it, that a step of ``flat`` is made of."""
        return self.told(Finding(why, step=index))

    def turn(self, turn: PathTurn) -> PathTurn:
        """The way at a step of ``flat``, likewise."""
        place = self.place(turn.step)
        if not place.calls:
            return replace(turn, step=place.index)
        return replace(turn, step=place.calls[-1].step, program=place.calls[-1].program)

    def where(self, file: str, index: int) -> Iterator[int]:
        """The steps of ``flat`` that are made of a step of a called program."""
        written = CalledStep(called_name(file), index)
        for k, place in enumerate(self._places or ()):
            if place.calls and place.calls[-1] == written:
                yield k


def _frame_of(file: str, name: str) -> str:
    """What a frame of a called program is called among those of all."""
    return f"{called_name(file)}: {name}"


def _with_own_frames(file: str, steps: Sequence[Step]) -> Iterator[Step]:
    for step in steps:
        if isinstance(step, FrameStep) and step.frame != BASE:
            yield msgspec.structs.replace(step, frame=_frame_of(file, step.frame))
        else:
            yield step


@dataclass
class _Taking:
    """Takes steps apart, each called program where it is called."""

    program: Program
    steps: list[Step] = field(default_factory=list[Step])
    places: list[StepPlace] = field(default_factory=list[StepPlace])
    findings: list[tuple[int, Reason]] = field(default_factory=list[tuple[int, Reason]])
    files: dict[str, CalledProgram] = field(default_factory=dict[str, CalledProgram])
    frames: dict[str, UserFrame] = field(default_factory=dict[str, UserFrame])
    """of the called programs, each by its file and its name"""

    def __post_init__(self) -> None:
        self._called = {one.file: one for one in self.program.called}
        self._full = False

    def take(self, step: Step, place: StepPlace, caller: str, chain: tuple[str, ...]) -> None:
        """Add what a step is made of; ``chain``: the programs that call each other, down to this one."""
        if len(self.steps) >= MOST_STEPS_IN_ALL and place.calls:
            if not self._full:
                self.findings.append((place.index, CallTooLong(MOST_STEPS_IN_ALL)))
            self._full = True
            return
        if step.calls:
            file = called_file(caller, step.calls)
            found = self._callable(file, chain)
            if isinstance(found, Reason):
                self.findings.append((place.index, place.within(found)))
                self._add(step, place)
                return
            self.files[file] = found
            self.frames |= {_frame_of(file, name): one for name, one in found.frames.items()}
            self._add(CallBlock(note=step.note), place)
            for index, inner in enumerate(_with_own_frames(file, found.steps)):
                called = (*place.calls, CalledStep(called_name(file), index))
                self.take(inner, StepPlace(place.index, called), file, (*chain, called_name(file)))
            self._add(EndStep(), place)
            return
        parts = step.parts
        for part, inner in parts:
            self._add(inner, replace(place, part=part))
        if not parts:
            self._add(step, place)

    def _callable(self, file: str, chain: tuple[str, ...]) -> CalledProgram | Reason:
        """The program in a file, or why it cannot be called."""
        name, found, robot = called_name(file), self._called.get(file), self.program.robot
        if name in chain[1:]:
            return CallCircle((*chain, name))
        if len(chain) > DEEPEST:
            return CallTooDeep((*chain, name), DEEPEST)
        if found is None or found.missing:
            return CallMissing(name, "sent" if found is None or not found.missing else found.missing)
        if found.unread:
            return CallUnread(name, found.unread)
        if found.robot != robot:
            return About(name, OtherRobot(found.robot, robot))
        return next(
            (InStep((CalledStep(name, index),), "", why) for index, why in Blocks.of(found.steps).findings),
            found,
        )

    def _add(self, step: Step, place: StepPlace) -> None:
        self.steps.append(step)
        self.places.append(place)

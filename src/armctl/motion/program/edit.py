"""Editing a program: pure functions, each gives a new program."""

from __future__ import annotations

import msgspec

from armctl.errors import ProgramError
from armctl.motion.program.blocks import Blocks, partner_of
from armctl.motion.program.program import MOST_REPEATS, EndStep, Program, RepeatStep, Step


def insert(program: Program, index: int, step: Step) -> Program:
    """``step`` before the step that is now at ``index``; at ``len(steps)`` it is appended.

    Raises:
        ProgramError: no such place.
    """
    if not 0 <= index <= len(program.steps):
        raise ProgramError(f"a step cannot be inserted at {index + 1}; the program has {_size(program)}")
    return _with(program, (*program.steps[:index], step, *program.steps[index:]))


def replace(program: Program, index: int, step: Step) -> Program:
    """``step`` instead of the one at ``index``.

    Raises:
        ProgramError: no such step.
    """
    _check(program, index)
    return _with(program, (*program.steps[:index], step, *program.steps[index + 1 :]))


def delete(program: Program, index: int) -> Program:
    """Without the step at ``index``; one marker of a block takes the other with it, what it repeated stays.

    Raises:
        ProgramError: no such step.
    """
    _check(program, index)
    gone = {index, partner_of(program.steps, index)}
    return _with(program, tuple(step for i, step in enumerate(program.steps) if i not in gone))


def duplicate(program: Program, index: int) -> Program:
    """With a copy of the step at ``index`` behind it; of a block's marker, the whole block behind its end.

    Raises:
        ProgramError: no such step.
    """
    _check(program, index)
    partner = partner_of(program.steps, index)
    first, last = sorted((index, index if partner is None else partner))
    copied = program.steps[first : last + 1]
    return _with(program, (*program.steps[: last + 1], *copied, *program.steps[last + 1 :]))


def repeat(program: Program, first: int, last: int, times: int) -> Program:
    """With the steps ``first`` ... ``last`` in a block that runs ``times`` times.

    Raises:
        ProgramError: no such steps, a number of times that cannot be, or a range that cuts another block.
    """
    _check(program, first)
    _check(program, last)
    if last < first:
        raise ProgramError(f"a block cannot go from step {first + 1} back to step {last + 1}")
    if not 1 <= times <= MOST_REPEATS:
        raise ProgramError(f"a block repeats 1 … {MOST_REPEATS} times, not {times}")
    blocks = Blocks.of(program)
    for index in range(first, last + 1):
        partner = blocks.partner(index)
        if partner is not None and not first <= partner <= last:
            begin, end = sorted((index, partner))
            raise ProgramError(
                f"steps {first + 1} … {last + 1} cut the block of steps {begin + 1} … {end + 1}; "
                "take all of it, or none"
            )
    steps = program.steps
    inside = steps[first : last + 1]
    return _with(program, (*steps[:first], RepeatStep(times=times), *inside, EndStep(), *steps[last + 1 :]))


def move(program: Program, index: int, to: int) -> Program:
    """The step at ``index`` taken out and put back so that it ends up at ``to``.

    Raises:
        ProgramError: no such step or no such place.
    """
    _check(program, index)
    _check(program, to)
    steps = list(program.steps)
    steps.insert(to, steps.pop(index))
    return _with(program, tuple(steps))


def _check(program: Program, index: int) -> None:
    if not 0 <= index < len(program.steps):
        raise ProgramError(f"there is no step {index + 1}; the program has {_size(program)}")


def _size(program: Program) -> str:
    count = len(program.steps)
    return "1 step" if count == 1 else f"{count} steps"


def _with(program: Program, steps: tuple[Step, ...]) -> Program:
    return msgspec.structs.replace(program, steps=steps)

"""Editing a program: pure functions, each gives a new program."""

from __future__ import annotations

import msgspec

from armctl.errors import ProgramError
from armctl.motion.program.program import Program, Step


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
    """Without the step at ``index``.

    Raises:
        ProgramError: no such step.
    """
    _check(program, index)
    return _with(program, (*program.steps[:index], *program.steps[index + 1 :]))


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

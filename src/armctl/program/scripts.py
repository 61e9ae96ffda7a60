"""A program as a plain Python script for the ``Arm`` class; those that it calls are its functions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import count

import msgspec

from armctl.errors import ProgramError
from armctl.program.base_steps import BlockStep, Step, literal
from armctl.program.calls import WholeProgram, called_file, called_name
from armctl.program.conditions import COUNTER
from armctl.program.frames import BASE, FrameStep, Placing, UserFrame
from armctl.program.program import Blocks, CalledProgram, Program
from armctl.program.signal_steps import ConditionStep
from armctl.program.steps import CommentStep

_DEEPEST = 19
"""Python takes 20 blocks inside each other; the ``with`` is one."""
_INDENT = "    "
_HEAD = """\
# Written by armctl; run it with Python.
# Each call moves and waits until the arm stands, so nothing is blended here. Name a board with
# Arm.open(..., port="auto"); without, the simulated one is used. An arm of your own is opened by its file,
# Arm.open("my_arm.toml"). set_speed slows down what follows it, and the
# points of what follows set_frame are in that frame."""


def write_script(program: Program) -> str:
    """The program as Python, whose texts never become code. ProgramError: a step or depth it has not."""
    Blocks.matched(program.steps)
    whole = WholeProgram.of(program)
    for index, why in whole.findings:
        raise ProgramError(why).about(f"step {index + 1}")
    names = _function_names(whole.files)
    lines = [literal(program.name), "", _HEAD, "", "import armctl", ""]
    framed = any(one.frames for one in (program, *whole.files))
    if program.frames:
        lines += [*_frames_lines(program.frames, ""), ""]
    for called in reversed(whole.files):  # what calls stands behind what it calls, where it can
        lines += ["", *_function(called, names, framed), ""]
    lines += [f"with armctl.Arm.open({literal(program.robot)}) as arm:", f"{_INDENT}arm.enable()"]
    every = (program.steps, *(called.steps for called in whole.files))
    counters = {name for steps in every for name in _counted(steps)}
    lines += [f"{_INDENT}{name}_count = 0" for name in sorted(counters)]
    return "\n".join([*lines, *_body(program, "", names), ""])


def _function_names(called: Iterable[CalledProgram]) -> dict[str, str]:
    """The name of a function for each called program, by file."""
    names: dict[str, str] = {}
    for one in called:
        plain = "run_" + re.sub(r"\W+", "_", called_name(one.file), flags=re.ASCII).strip("_").lower()
        free = (plain if number == 1 else f"{plain}_{number}" for number in count(1))
        names[one.file] = next(name for name in free if name not in names.values())
    return names


def _function(called: CalledProgram, names: Mapping[str, str], framed: bool) -> list[str]:
    """``framed``: user frames are used somewhere; it begins in the base frame, and has its own."""
    lines = [f"def {names[called.file]}(arm):", f"{_INDENT}{literal(called_name(called.file))}"]
    counters = sorted({*_counted(called.steps), *_asked(called.steps)})
    if counters:
        lines.append(f"{_INDENT}global {', '.join(f'{name}_count' for name in counters)}")
    keeps = any(step.effect.percent is not None for step in called.steps)
    if keeps:  # the speed that it sets ends with it
        lines.append(f"{_INDENT}speed_percent = 100 * arm.snapshot.speed")
    if called.frames:
        lines += _frames_lines(called.frames, _INDENT)
    if framed:
        lines.append(f"{_INDENT}arm.{_set_frame(BASE)}")
    try:
        lines += _body(called, called.file, names)
    except ProgramError as cause:
        raise ProgramError(f"in {called_name(called.file)!r}, {cause}") from cause
    return [*lines, f"{_INDENT}arm.set_speed(speed_percent)"] if keeps else lines


def _counted(steps: Sequence[Step]) -> set[str]:
    return {counts.counter for step in steps if (counts := step.effect.counts) is not None}


def _asked(steps: Sequence[Step]) -> set[str]:
    return {step.counter for step in steps if isinstance(step, ConditionStep) and step.watch == COUNTER}


def _body(program: Program | CalledProgram, file: str, names: Mapping[str, str]) -> list[str]:
    """The steps of the program in a file, as statements of a block; ``names``: of functions, by file."""
    steps = program.steps
    blocks, placing = Blocks.of(steps), Placing(steps, program.frames)
    lines: list[str] = []
    for index, step in enumerate(steps):
        depth, note = blocks.depths[index], _remark(step.note)
        indent = _INDENT * (1 + depth)
        if isinstance(step, CommentStep):
            lines.append(f"{indent}{note.strip() or '#'}")
        elif isinstance(step, BlockStep) and depth >= _DEEPEST:
            raise ProgramError(
                f"step {index + 1}: a Python script takes at most {_DEEPEST} blocks inside each other"
            )
        elif step.closes or step.divides:
            begin = blocks.whole(index)[0]
            after = blocks.elses.get(begin, begin) if step.closes else begin
            inside = steps[after + 1 : index]
            if inside and placing.names[index - 1] != placing.names[index]:  # the block goes back to it
                lines.append(f"{_INDENT}{indent}arm.{_set_frame(placing.names[index])}")
            # A block needs a statement, and its end's note one to stand behind.
            if all(isinstance(other, CommentStep) for other in inside) or (step.closes and step.note):
                lines.append(f"{_INDENT}{indent}pass{note if step.closes else ''}")
            if step.divides:
                lines.append(f"{indent}else:{note}")
        elif step.calls:
            lines.append(f"{indent}{names[called_file(file, step.calls)]}(arm){note}")
            if placing.names[index] != BASE:
                lines.append(f"{indent}arm.{_set_frame(placing.names[index])}")
        else:
            of_arm = "" if isinstance(step, BlockStep) or step.effect.counts is not None else "arm."
            try:
                script = _set_frame(step.frame) if isinstance(step, FrameStep) else step.script()
                first, *others = script.split("\n")
            except ProgramError as cause:
                raise ProgramError(f"step {index + 1}: {cause}") from cause
            lines += [f"{indent}{of_arm}{first}{note}", *(indent + line for line in others)]
    return lines


def _frames_lines(frames: Mapping[str, UserFrame], indent: str) -> list[str]:
    lines = [f"{indent}frames = {{"]
    for name, frame in frames.items():
        given = ", ".join(f"{key}={literal(value)}" for key, value in msgspec.structs.asdict(frame).items())
        lines.append(f"{indent}{_INDENT}{literal(name)}: armctl.program.UserFrame({given}),")
    return [*lines, f"{indent}}}"]


def _set_frame(name: str) -> str:
    return "set_frame()" if name == BASE else f"set_frame(frames[{literal(name)}])"


def _remark(note: str) -> str:
    """A note behind ``#``; as a string literal where it would not stay one line of plain text."""
    if not note:
        return ""
    plain = note.isprintable() and note == note.strip() and note[:1] not in ("'", '"')
    return f"  # {note if plain else literal(note)}"

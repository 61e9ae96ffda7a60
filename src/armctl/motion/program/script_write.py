"""Programs as plain Python scripts for the ``Arm`` class."""

from __future__ import annotations

from typing import cast

from armctl.errors import ProgramError
from armctl.motion.program.blocks import Blocks
from armctl.motion.program.program import (
    CommentStep,
    EndStep,
    Program,
    RepeatStep,
    Step,
    defaults_of,
    kind_of,
)
from armctl.motion.program.script_calls import CALLS

DEEPEST = 19
"""Python takes 20 blocks inside each other; the ``with`` is one."""
_INDENT = "    "
_HEAD = """\
# Written by armctl; it can read this file again as long as it holds only calls like these.
# Each call moves and waits until the arm stands, so nothing is blended here. Name a board with
# Arm.open(..., port="auto"); without, the simulated one is used. An arm of your own is opened by its file,
# Arm.open("my_arm.toml"). set_speed slows down what follows it."""


def write_script(program: Program) -> str:
    """The program as a Python script; ``read_script`` gives the same program again.

    Texts stand in it as string literals or behind ``#``, never as code.

    Raises:
        ProgramError: blocks that do not match, or more than 19 inside each other; names the step.
    """
    blocks = Blocks.of(program)
    lines = [_literal(program.name), "", _HEAD, "", "import armctl", ""]
    lines += [f"with armctl.Arm.open({_literal(program.robot)}) as arm:", f"{_INDENT}arm.enable()"]
    for index, step in enumerate(program.steps):
        depth = blocks.depth(index)
        if isinstance(step, RepeatStep) and depth >= DEEPEST:
            raise ProgramError(
                f"step {index + 1}: a Python script takes at most {DEEPEST} repeats inside each other"
            )
        if isinstance(step, EndStep):
            inside = program.steps[(blocks.partner(index) or 0) + 1 : index]
            needed = step.note or all(isinstance(other, CommentStep) for other in inside)
            # A loop needs a statement, and its end's note one to stand behind.
            if needed:
                lines.append(f"{_INDENT * (2 + depth)}pass{_remark(step.note)}")
        else:
            lines.append(f"{_INDENT * (1 + depth)}{_line(step)}")
    return "\n".join([*lines, ""])


def is_plain(note: str) -> bool:
    """Whether a note can stand behind ``#`` as it is; others stand there as a string literal."""
    return note.isprintable() and note == note.strip() and note[:1] not in ("'", '"')


def _line(step: Step) -> str:
    if isinstance(step, CommentStep):
        return _remark(step.note).strip() or "#"
    if isinstance(step, RepeatStep):
        return f"for _ in range({step.times}):{_remark(step.note)}"
    return f"arm.{_call(step)}{_remark(step.note)}"


def _call(step: Step) -> str:
    call = CALLS[kind_of(step)]
    arguments: list[str] = []
    defaults = defaults_of(step)
    for argument in call.arguments:
        values = [getattr(step, key) for key in argument.keys]
        if argument.optional and values == [defaults[key] for key in argument.keys]:
            continue
        value = values[0] if len(values) == 1 else tuple(values)
        text = _literal([*value] if argument.keys == ("joints_deg",) else value)
        arguments.append(text if argument.positional else f"{argument.name}={text}")
    return f"{call.name}({', '.join(arguments)})"


def _literal(value: object) -> str:
    # Of the plain types only: a subclass may show itself as anything.
    match value:
        case bool() | int() | None:
            return repr(value)
        case float():
            return repr(float(value))
        case list():
            return f"[{', '.join(map(_literal, cast('list[object]', value)))}]"
        case tuple():
            return f"({', '.join(map(_literal, cast('tuple[object, ...]', value)))})"
        case _:
            return repr(str(value))


def _remark(note: str) -> str:
    if not note:
        return ""
    return f"  # {note if is_plain(note) else _literal(note)}"

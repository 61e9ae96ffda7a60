"""Programs as plain Python scripts for the ``Arm`` class."""

from __future__ import annotations

from armctl.errors import ProgramError
from armctl.program.keys import literal
from armctl.program.program import Blocks, Program
from armctl.program.steps import CommentStep, EndStep, RepeatStep

DEEPEST = 19
"""Python takes 20 blocks inside each other; the ``with`` is one."""
_INDENT = "    "
_HEAD = """\
# Written by armctl; run it with Python.
# Each call moves and waits until the arm stands, so nothing is blended here. Name a board with
# Arm.open(..., port="auto"); without, the simulated one is used. An arm of your own is opened by its file,
# Arm.open("my_arm.toml"). set_speed slows down what follows it."""


def write_script(program: Program) -> str:
    """The program as a Python script.

    Texts stand in it as string literals or behind ``#``, never as code.

    Raises:
        ProgramError: blocks that do not match, more than 19 inside each other, or a step that no call of
            ``Arm`` does; names the step.
    """
    blocks = Blocks.matched(program.steps)
    lines = [literal(program.name), "", _HEAD, "", "import armctl", ""]
    lines += [f"with armctl.Arm.open({literal(program.robot)}) as arm:", f"{_INDENT}arm.enable()"]
    for index, step in enumerate(program.steps):
        depth, note = blocks.depths[index], _remark(step.note)
        indent = _INDENT * (1 + depth)
        if isinstance(step, CommentStep):
            lines.append(f"{indent}{note.strip() or '#'}")
        elif isinstance(step, RepeatStep):
            if depth >= DEEPEST:
                raise ProgramError(
                    f"step {index + 1}: a Python script takes at most {DEEPEST} repeats inside each other"
                )
            lines.append(f"{indent}for _ in range({step.times}):{note}")
        elif isinstance(step, EndStep):
            inside = program.steps[blocks.partners[index] + 1 : index]
            # A loop needs a statement, and its end's note one to stand behind.
            if step.note or all(isinstance(other, CommentStep) for other in inside):
                lines.append(f"{_INDENT}{indent}pass{note}")
        else:
            try:
                lines.append(f"{indent}arm.{step.script()}{note}")
            except ProgramError as cause:
                raise ProgramError(f"step {index + 1}: {cause}") from cause
    return "\n".join([*lines, ""])


def _remark(note: str) -> str:
    """A note behind ``#``; as a string literal where it would not stay one line of plain text."""
    if not note:
        return ""
    plain = note.isprintable() and note == note.strip() and note[:1] not in ("'", '"')
    return f"  # {note if plain else literal(note)}"

"""Programs as plain Python scripts for the ``Arm`` class."""

from __future__ import annotations

import ast
import io
import math
import tokenize
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, cast

import msgspec

from armctl.errors import ProgramError
from armctl.program.files.document import plain_text, refusal_of
from armctl.program.program import (
    Blocks,
    CommentStep,
    EndStep,
    Program,
    RepeatStep,
    Step,
    defaults_of,
    kind_of,
)

# Which call of ``Arm`` stands for which kind of step.


class Argument(NamedTuple):
    """One argument of a call."""

    name: str
    keys: tuple[str, ...]
    """of the step; more than one: a tuple of them"""
    positional: bool = False
    optional: bool = False


class Call(NamedTuple):
    """A method of ``Arm``."""

    name: str
    do: str
    arguments: tuple[Argument, ...]


def _required(*names: str, positional: bool = False) -> tuple[Argument, ...]:
    return tuple(Argument(name, (name,), positional) for name in names)


def _optional(*names: str) -> tuple[Argument, ...]:
    return tuple(Argument(name, (name,), optional=True) for name in names)


_POINT = ("x_mm", "y_mm", "z_mm")
_VIA = ("via_x_mm", "via_y_mm", "via_z_mm")
_LED = _optional("pitch", "pitch_deg", "speed_mm_s", "duration_s", "blend_mm")
_ALL = (
    Call(
        "go_joints",
        "move",
        (*_required("joints_deg", positional=True), *_optional("duration_s", "profile", "blend_mm")),
    ),
    Call(
        "go",
        "point",
        (
            *_required(*_POINT),
            *_optional("pitch_deg", "roll_deg", "choose", "duration_s", "profile", "blend_mm"),
        ),
    ),
    Call("line", "line", (*_required(*_POINT), *_LED)),
    Call("arc", "arc", (Argument("via_mm", _VIA), Argument("to_mm", _POINT), *_LED)),
    Call("wait", "wait", (Argument("seconds", ("seconds",), positional=True),)),
    Call("gripper", "gripper", (Argument("open_percent", ("open_percent",), positional=True),)),
    Call("set_speed", "speed", (Argument("percent", ("percent",), positional=True),)),
)
CALLS = {call.do: call for call in _ALL}
"""by the kind of step"""
BY_NAME = {call.name: call for call in _ALL}
"""by the name of the method"""


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


# Programs from the Python scripts that ``write_script`` writes: read, never run.

_ALLOWED = "allowed are calls of arm with plain numbers and texts, 'for _ in range(N):', 'pass' and comments"
_LARGEST = 1e300


def read_script(text: bytes | str) -> Program:
    """A program from a script; nothing of it is executed.

    Raises:
        ProgramError: not Python, or anything that ``write_script`` does not write; names the line and what.
    """
    plain = plain_text(text).replace("\r\n", "\n")
    try:
        tree = ast.parse(plain)
        comments = _comments(plain)
    except SyntaxError as cause:  # an IndentationError and a TabError are ones, too
        raise ProgramError(f"line {cause.lineno or 1}: not Python: {cause.msg}") from cause
    except tokenize.TokenError as cause:
        raise ProgramError(f"not Python: {cause.args[0]}") from cause
    except (ValueError, MemoryError, RecursionError) as cause:
        raise ProgramError("not Python: it holds a null character, or is nested too deep") from cause
    name, block = _frame(tree)
    robot = _opened(block)
    reader = _Body(comments)
    body = block.body
    _require_enable(body[0])
    reader.skip_until(block.lineno)
    steps = tuple(reader.steps(body[1:], body[0].col_offset, math.inf))
    return Program(robot=robot, name=name, steps=steps)


@dataclass(frozen=True)
class _Comment:
    line: int
    column: int
    note: str
    alone: bool


class _Body:
    """Walks statements and comments in the order of their lines."""

    def __init__(self, comments: Sequence[_Comment]) -> None:
        self._own_lines = deque(comment for comment in comments if comment.alone)
        self._notes = {comment.line: comment.note for comment in comments if not comment.alone}

    def skip_until(self, line: int) -> None:
        """Forget the comments above a line."""
        while self._own_lines and self._own_lines[0].line < line:
            self._own_lines.popleft()

    def steps(self, body: Sequence[ast.stmt], column: int, until: float) -> Iterator[Step]:
        """The steps of a block whose statements begin at a column, and that ends before a line."""
        for number, statement in enumerate(body, 1):
            yield from self._comments(column, statement.lineno)
            following = body[number].lineno if number < len(body) else until
            match statement:
                case ast.Expr(value=ast.Call() as call):
                    yield _script_read_call(call, self._note(statement))
                case ast.For():
                    yield from self._loop(statement, following)
                case _:
                    raise _refused(statement, f"{_shown(statement)} is not a step; {_ALLOWED}")
        yield from self._comments(column, until)

    def _loop(self, loop: ast.For, until: float) -> Iterator[Step]:
        yield RepeatStep(times=_times(loop), note=self._notes.get(loop.lineno, ""))
        body, last = loop.body, loop.body[-1]
        column = body[0].col_offset
        if isinstance(last, ast.Pass):
            yield from self.steps(body[:-1], column, last.lineno)
            yield EndStep(note=self._note(last))
        else:
            yield from self.steps(body, column, until)
            yield EndStep()

    def _note(self, statement: ast.stmt) -> str:
        lines = range(statement.lineno, (statement.end_lineno or statement.lineno) + 1)
        return " ".join(self._notes[line] for line in lines if line in self._notes)

    def _comments(self, column: int, until: float) -> Iterator[Step]:
        """Comments of this block that stand on lines of their own, as far as a line."""
        own = self._own_lines
        while own and own[0].line < until and own[0].column >= column:
            yield CommentStep(note=own.popleft().note)


def _frame(tree: ast.Module) -> tuple[str, ast.With]:
    """The program's name and the ``with`` statement."""
    body = tree.body
    match body:
        case [
            ast.Expr(value=ast.Constant(value=str(name))),
            ast.Import(names=[ast.alias(name="armctl", asname=None)]),
            ast.With() as block,
        ]:
            return name, block
        case _:
            raise ProgramError(
                f"line {body[0].lineno if body else 1}: a script is the program's name as a text, "
                "'import armctl' and one 'with armctl.Arm.open(...) as arm:', nothing else"
            )


def _opened(block: ast.With) -> str:
    match block.items:
        case [
            ast.withitem(
                context_expr=ast.Call(
                    func=ast.Attribute(
                        value=ast.Attribute(value=ast.Name(id="armctl"), attr="Arm"), attr="open"
                    ),
                    args=[ast.Constant(value=str(robot))],
                    keywords=keywords,
                ),
                optional_vars=ast.Name(id="arm"),
            )
        ] if all(keyword.arg == "port" and isinstance(keyword.value, ast.Constant) for keyword in keywords):
            return robot
        case _:
            raise _refused(block, 'write \'with armctl.Arm.open("ROBOT") as arm:\' (port="..." may be given)')


def _require_enable(statement: ast.stmt) -> None:
    match statement:
        case ast.Expr(
            value=ast.Call(func=ast.Attribute(value=ast.Name(id="arm"), attr="enable"), args=[], keywords=[])
        ):
            return
        case _:
            raise _refused(statement, "the first call is 'arm.enable()'")


def _times(loop: ast.For) -> int:
    match loop:
        case ast.For(
            target=ast.Name(id="_"),
            iter=ast.Call(func=ast.Name(id="range"), args=[ast.Constant(value=int() as times)], keywords=[]),
            orelse=[],
        ):
            record = {"do": "repeat", "times": times}
            try:
                return msgspec.convert(record, RepeatStep).times
            except msgspec.ValidationError as cause:
                raise _refused(loop, f"repeats: {refusal_of(cause, record).what}") from cause
        case _:
            raise _refused(loop, "a loop is 'for _ in range(N):' with a whole number N")


def _script_read_call(node: ast.Call, note: str) -> Step:
    match node.func:
        case ast.Attribute(value=ast.Name(id="arm"), attr=name) if name in BY_NAME:
            call = BY_NAME[name]
        case _:
            known = ", ".join(f"arm.{name}" for name in BY_NAME)
            raise _refused(node, f"{_shown(node.func)}(...) is not a step; known are {known}")
    record: dict[str, object] = {"do": call.do, "note": note}
    for argument, value in _given(node, call):
        if argument.keys[0] in record:
            raise _refused(node, f"arm.{call.name}: {argument.name} is given twice")
        record |= _values(node, call, argument, value)
    try:
        return msgspec.convert(record, Step)
    except msgspec.ValidationError as cause:
        refusal = refusal_of(cause, record)
        where = f"{refusal.where}: " if refusal.where else ""
        raise _refused(node, f"arm.{call.name}: {where}{refusal.what}") from cause


def _given(node: ast.Call, call: Call) -> Iterator[tuple[Argument, ast.expr]]:
    by_name = {argument.name: argument for argument in call.arguments}
    positional = [argument for argument in call.arguments if argument.positional]
    if len(node.args) > len(positional):
        most = f"{len(positional)} values without a name"
        raise _refused(node, f"arm.{call.name} takes {most}, not {len(node.args)}")
    yield from zip(positional, node.args, strict=False)
    for keyword in node.keywords:
        if keyword.arg not in by_name:
            raise _refused(node, f"arm.{call.name}: there is no argument {keyword.arg or '**'!r}")
        yield by_name[keyword.arg], keyword.value


def _values(node: ast.Call, call: Call, argument: Argument, value: ast.expr) -> dict[str, object]:
    literal = _script_read_literal(value, f"arm.{call.name}: {argument.name}")
    if len(argument.keys) == 1:
        return {argument.keys[0]: literal}
    numbers = cast("list[object]", literal) if isinstance(literal, list) else []
    if len(numbers) != len(argument.keys):
        needed = f"{len(argument.keys)} numbers in brackets"
        raise _refused(node, f"arm.{call.name}: {argument.name} needs {needed}")
    return dict(zip(argument.keys, numbers, strict=True))


def _script_read_literal(node: ast.expr, what: str) -> object:
    match node:
        case ast.Constant(value=bool() | str() | None as value):
            return value
        case ast.Constant(value=int() | float() as value):
            return _checked(node, value, what)
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float() as value)):
            return -_checked(node, value, what)
        case ast.List(elts=elements) | ast.Tuple(elts=elements):
            return [_script_read_literal(element, what) for element in elements]
        case _:
            raise _refused(node, f"{what}: {_shown(node)} is not a plain number or text")


def _checked(node: ast.expr, value: float, what: str) -> float:
    if abs(value) > _LARGEST:
        raise _refused(node, f"{what}: {_shown(node)} is too large")
    return value


def _comments(text: str) -> list[_Comment]:
    found: list[_Comment] = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            line, column = token.start
            found.append(_Comment(line, column, _note(token.string), not token.line[:column].strip()))
    return found


def _note(comment: str) -> str:
    """What a comment says; a text in quotes stands for what is between them."""
    note = comment.removeprefix("#").strip()
    if note[:1] in ("'", '"'):
        try:
            value = ast.literal_eval(note)
        except (ValueError, SyntaxError):
            return note
        if isinstance(value, str):
            return value
    return note


def _shown(node: ast.AST) -> str:
    text = ast.unparse(node).splitlines()[0]
    return repr(text if len(text) <= 60 else f"{text[:57]}...")


def _refused(node: ast.expr | ast.stmt, what: str) -> ProgramError:
    return ProgramError(f"line {node.lineno}: {what}")

"""What would take the page server seconds, done apart: long programs read and checked, arms with meshes.

An arm crosses as in ``records``, a program as its struct, a drawing as arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import msgspec
import numpy as np

from armctl.apart import Tell, apart
from armctl.arrays import FloatArray
from armctl.errors import InputError, LimitError, ProgramError, RobotFileError
from armctl.facts import Said
from armctl.facts.words import fact_of, fact_record
from armctl.motion.preflight import Finding
from armctl.program import Program, RepeatStep, may_be_program, read_program
from armctl.program.base_steps import BlockStep
from armctl.program.calls import WholeProgram
from armctl.program.check import check_program
from armctl.robot import Robot
from armctl.robot.body.meshes import Drawn, coarse_solids, keep, kept
from armctl.robot.record import robot_of, robot_record
from armctl.robot.solids import Solid

_CHECK_S, _ARM_S, _READ_S = 600.0, 120.0, 60.0
"""processor time of a check, of an arm, and of reading a program"""
_AT_ONCE, _AT_ONCE_MESHED, _AT_ONCE_BYTES = 100, 8, 100 << 10
"""A program of so many steps is checked, and read, here: that takes less than the start of a process."""
_TOLD = 200
"""how often it is told how far a check is"""

Progress = Callable[[int, int], None]


def _apart(work: str, request: bytes, seconds: float, parts: int, progress: Progress | None) -> bytes:
    """Have one of this module's ``work`` done apart; it tells how many of how many ``parts`` are done."""
    done = (0, parts)

    def told(content: bytes) -> None:
        nonlocal done
        done = msgspec.msgpack.decode(content, type=tuple[int, int])
        look()

    def look() -> None:
        if progress is not None:
            progress(*done)

    return apart(f"{__name__}:{work}", request, seconds=seconds, told=told, look=look)


def read_program_apart(
    filename: str, content: bytes, robot: Robot, progress: Progress | None = None
) -> Program:
    """As ``read_program``; blocks, but keeps no other thread waiting. ``progress``: see ``worked_out``."""
    if len(content) <= _AT_ONCE_BYTES or not may_be_program(filename, content):
        return read_program(filename, content, robot)
    request = msgspec.msgpack.encode((filename, content, robot_record(robot)))
    try:
        return msgspec.msgpack.decode(_apart("do_read", request, _READ_S, 1, progress), type=Program)
    except LimitError as cause:
        raise ProgramError(f"{filename}: {cause}") from cause


def do_read(request: bytes, _: Tell) -> bytes:
    """The ``Work`` of ``read_program_apart``."""
    filename, content, robot = msgspec.msgpack.decode(request, type=tuple[str, bytes, dict[str, Any]])
    return msgspec.msgpack.encode(read_program(filename, content, robot_of(robot)))


class _CheckRequest(msgspec.Struct):
    robot: dict[str, Any]
    program: Program
    start: list[float] | None


def check_program_apart(
    program: Program,
    robot: Robot,
    *,
    start: FloatArray | None = None,
    progress: Progress | None = None,
) -> list[Finding]:
    """As ``check_program``; blocks, but keeps no other thread waiting.

    ``progress`` is called ten times a second at least, so that what it raises ends the check at once.
    """
    few = _AT_ONCE_MESHED if robot.shapes else _AT_ONCE

    def here() -> list[Finding]:
        return check_program(program, robot, start=start, progress=progress)

    # Steps of a long loop are walked many times.
    steps = WholeProgram.of(program).flat.steps
    often = any(
        isinstance(step, BlockStep) and not (isinstance(step, RepeatStep) or step.scoped) for step in steps
    )
    if len(steps) <= few and not often:
        return here()
    begin = None if start is None else np.asarray(start, dtype=np.float64).tolist()
    request = msgspec.msgpack.encode(_CheckRequest(robot_record(robot), program, begin))
    try:
        found = _apart("do_check", request, _CHECK_S, len(steps), progress)
    except InputError:  # made in Python, with values that no file holds
        return here()
    return [_finding(*one) for one in msgspec.msgpack.decode(found)]


def _finding(record: dict[str, Any], text: str, *others: Any) -> Finding:
    return Finding(fact_of(record) or Said(text), *others)


def do_check(request: bytes, tell: Tell) -> bytes:
    """The ``Work`` of ``check_program_apart``."""
    try:
        asked = msgspec.msgpack.decode(request, type=_CheckRequest)
    except msgspec.MsgspecError as cause:
        raise InputError(str(cause)) from cause
    often = max(1, len(asked.program.steps) // _TOLD)
    last = 0

    def progress(done: int, steps: int) -> None:
        nonlocal last
        if done - last >= often:
            last = done
            tell(msgspec.msgpack.encode((done, steps)))

    found = check_program(asked.program, robot_of(asked.robot), start=asked.start, progress=progress)
    return msgspec.msgpack.encode([
        (fact_record(one.reason), one.what, one.time, one.part, one.kind, one.severity, one.step, one.digits)
        for one in found
    ])  # fmt: skip


class _DrawnPiece(msgspec.Struct, array_like=True):
    """Of a ``Drawn``."""

    link: int
    color: tuple[int, int, int] | None
    vertices: bytes
    faces: bytes


class _Worked(msgspec.Struct):
    capsules: list[dict[str, Any]]
    assumed: tuple[str, ...]
    drawn: list[list[_DrawnPiece]]


def worked_out(
    robot: Robot, sizes: Sequence[int] = (), progress: Progress | None = None
) -> tuple[Robot, Mapping[int, Drawn]]:
    """The arm with its body, and its drawings of so many triangles each; blocks.

    ``progress`` is called ten times a second, with how many of how many parts of the work are done; what it
    raises ends the work. What was worked out before takes no time, and it is not called.
    ``RobotFileError``: its meshes take too long, or too much memory.
    """
    if all(shape.kind != "mesh" for shape in robot.shapes):
        robot = robot.with_body()
        return robot, {most: coarse_solids(robot.shapes, most) for most in sizes}
    if (known := robot.with_known_body()) is not None:
        drawings = {most: kept(Drawn, known.shapes, most) for most in sizes}
        if None not in drawings.values():
            return known, {most: drawing for most, drawing in drawings.items() if drawing is not None}
    request = msgspec.msgpack.encode((robot_record(robot), list(sizes)))
    try:
        content = _apart("do_work_out", request, _ARM_S, robot.n + 1 + len(sizes), progress)
    except LimitError as cause:
        raise RobotFileError(
            f"the meshes of {robot.title}: {cause}; make them coarser, or leave out those that are too large"
        ) from cause
    worked = msgspec.msgpack.decode(content, type=_Worked)
    body = robot_of({**robot_record(robot), "capsules": worked.capsules})
    drawn = {most: tuple(map(_solid, pieces)) for most, pieces in zip(sizes, worked.drawn, strict=True)}
    return replace(robot, capsules=body.capsules, assumed=worked.assumed), drawn


def do_work_out(request: bytes, tell: Tell) -> bytes:
    """The ``Work`` of ``worked_out``."""
    record, sizes = msgspec.msgpack.decode(request, type=tuple[dict[str, Any], list[int]])
    arm = robot_of(record)
    parts = arm.n + 1 + len(sizes)

    def progress(done: int, _: int) -> None:
        tell(msgspec.msgpack.encode((done, parts)))

    robot = arm.with_body(progress)
    drawn: list[list[_DrawnPiece]] = []
    for done, most in enumerate(sizes, arm.n + 1):
        progress(done, parts)
        solids = keep(Drawn, robot.shapes, most, make=partial(coarse_solids, robot.shapes, most))
        drawn.append([
            _DrawnPiece(link, color, solid.vertices.tobytes(), solid.faces.astype(np.int64).tobytes())
            for link, color, solid in solids
        ])  # fmt: skip
    return msgspec.msgpack.encode(_Worked(robot_record(robot)["capsules"], robot.assumed, drawn))


def _solid(piece: _DrawnPiece) -> tuple[int, tuple[int, int, int] | None, Solid]:
    vertices = np.frombuffer(piece.vertices, np.float64).reshape(-1, 3)
    faces = np.frombuffer(piece.faces, np.int64).reshape(-1, 3)
    return piece.link, piece.color, Solid(vertices.copy(), faces.copy())

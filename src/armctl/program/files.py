"""Program files: TOML as armctl saves it, a CSV table, and Python scripts for the ``Arm`` class."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations, islice
from pathlib import Path, PurePath
from typing import Annotated, Any, Literal, cast

import msgspec
import numpy as np
import tomli_w
from msgspec import Meta

from armctl.arrays import FloatArray
from armctl.documents import Document, as_path, not_written, write_atomically
from armctl.errors import ArmctlError, Errors, ProgramError
from armctl.facts import say
from armctl.program.base_steps import Step
from armctl.program.calls import called_name, link
from armctl.program.check import check_program
from armctl.program.csv import read_csv
from armctl.program.frames import MOST_FRAMES, FrameName, UserFrame
from armctl.program.motion_steps import LineStep, MoveStep, PointStep
from armctl.program.program import MOST_STEPS, PROGRAM_FILES, PROGRAM_SUFFIXES, Blocks, CalledProgram, Program
from armctl.program.standing_steps import GripperStep, WaitStep
from armctl.program.steps import CommentStep, any_step
from armctl.robot import Robot

_WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
"""how packed files and those of older office programs begin"""
_WRITABLE = (int, float, str, list, tuple, np.generic, np.ndarray)


def open_program(path: str | Path, robot: Robot | None = None) -> Program:
    """Read a program file of any form; only a CSV, which names none, needs the robot that it is for."""
    file = as_path(path, "a program is a Program or the path of its file")
    program = PROGRAM_FILES.load(file, lambda content: _read(file, content, robot))
    return _linked(_found_from(file.parent, program), file.parent, robot)


def read_program(filename: str, content: bytes, robot: Robot | None) -> Program:
    """A program from the content of a file of any form; a ProgramError names the file and the line."""
    try:
        return _read(PurePath(filename), content, robot)
    except ProgramError as cause:
        raise ProgramError(f"{filename}: {cause}") from cause


def may_be_program(filename: str, content: bytes) -> bool:
    """Whether ``read_program`` has to read the content to say what it is."""
    return PurePath(filename).suffix.lower() in PROGRAM_SUFFIXES and not content.startswith(_WORKBOOKS)


def _read(name: PurePath, content: bytes, robot: Robot | None) -> Program:
    if content.startswith(_WORKBOOKS) and name.suffix.lower() not in (".toml", ".py"):
        raise ProgramError(
            "is a workbook (.xlsx, .xls or .ods, by its content) and no text; save it in the spreadsheet "
            "program as CSV (UTF-8)"
        )
    match name.suffix.lower():
        case ".toml":
            return decode_program(content)
        case ".csv" if robot is not None:
            return read_csv(content, robot, name.stem)
        case ".csv":
            raise ProgramError("a CSV names no robot; say which one it is for, e.g. --robot uzuner")
        case ".py":
            raise ProgramError(f"is a Python script; run it with Python: python {name.name}")
        case _:
            raise ProgramError(f"is none of {', '.join(PROGRAM_SUFFIXES)}")


def load_program(path: str | Path) -> Program:
    """Read a program file (TOML); a ProgramError names the file, the line, the step and the key."""
    file = as_path(path, "a program file is given by its path")
    program = _found_from(file.parent, PROGRAM_FILES.load(file, decode_program))
    return _linked(program, file.parent, None)


def _found_from(folder: Path, program: Program) -> Program:
    """The files that its steps name are looked for in a folder."""
    folder = folder.absolute()
    return msgspec.structs.replace(program, steps=tuple(step.found_from(folder) for step in program.steps))


def _linked(program: Program, folder: Path, robot: Robot | None) -> Program:
    """With the programs that it calls, found from a folder; a CSV among them is for ``robot``."""
    return link(program, lambda file: read_called(folder, file, robot), program.called)


def read_called(folder: Path, file: str, robot: Robot | None = None) -> CalledProgram:
    """A called program; one that cannot be had says why."""
    path = folder / file
    try:
        program = PROGRAM_FILES.load(path, lambda content: _read(path, content, robot))
    except ProgramError as cause:
        if not path.is_file():
            return CalledProgram(file=file, missing="beside")
        return CalledProgram(file=file, unread=str(cause))
    steps = _found_from(path.parent, program).steps
    return CalledProgram(file=file, robot=program.robot, frames=program.frames, steps=steps)


def decode_program(text: bytes | str) -> Program:
    """A program from the text of its file; refused as by ``load_program``, without the file's name."""
    return _decoded(PROGRAM_FILES.parse(text))


def checked_program(program: Program) -> Program:
    """A program built in Python as it would be read from its file; numpy's numbers become plain ones."""
    try:
        plain = _decoded(Document(PROGRAM_FILES, _record(program)))
    except ProgramError as cause:
        raise ProgramError(f"{program.name}: {cause}") from cause
    plain = msgspec.structs.replace(_found_from(Path(), plain), called=program.called)
    return _linked(plain, Path(), None)


def encode_program(program: Program) -> str:
    """The text of the program's file (TOML; what is not set is left out)."""
    record = _record(program)
    steps = [
        {key: value for key, value in step.items() if value is not None and (key, value) != ("note", "")}
        for step in record.pop("steps")
    ]
    if not record["frames"]:
        del record["frames"]
    text = tomli_w.dumps({**record, "steps": steps} if steps else record, indent=0)
    # A list stays on its line: half as long a file. No text holds a line's end, they are written as \\n.
    return text.replace("[\n", "[").replace(",\n]", "]").replace(",\n", ", ")


def save_program(program: Program, path: str | Path) -> None:
    """Write a program file, or what its link leads to; the version before is kept as ``NAME.toml~``."""
    path = Path(path)
    try:
        steps = _decoded(Document(PROGRAM_FILES, _record(program))).steps
        steps = tuple(step.seen_from(path.absolute().parent) for step in steps)
        content = encode_program(msgspec.structs.replace(program, steps=steps)).encode()
        PROGRAM_FILES.text(content)
    except (ProgramError, UnicodeError) as cause:
        raise ProgramError(f"{path}: not saved, it could not be read again: {cause}") from cause
    try:
        write_atomically(path.resolve(), content, keep=True)
    except OSError as cause:
        raise ProgramError(not_written(path, cause)) from cause
    except RuntimeError as cause:  # links in a circle
        raise ProgramError(f"{path}: cannot be written: {cause}") from cause


class _Head(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All but the steps, whose kinds are known only when the file is read."""

    format: Literal[1] = 1
    robot: str
    name: str = "untitled"
    frames: Annotated[dict[FrameName, UserFrame], Meta(max_length=MOST_FRAMES)] = {}
    steps: tuple[()] = ()


def _decoded(document: Document) -> Program:
    errors = Errors()
    head = replace(document, record={**document.record, "steps": []}).decoded(_Head, errors)
    written: Any = document.record.get("steps", [])
    if isinstance(written, list) and (count := len(cast("list[object]", written))) > MOST_STEPS:
        raise ProgramError(f"it has {count} steps; a program has {MOST_STEPS} at most")
    steps: tuple[Step, ...] = ()
    if written != []:
        steps = document.decoded(tuple[any_step(), ...], errors, ("steps",))
    errors.raise_all()
    for index, why in Blocks.of(steps).findings:
        errors.found.append(document.refusal(say(why), ("steps", index)))
    errors.raise_all()
    return Program(robot=head.robot, name=head.name, frames=head.frames, steps=steps)


def _record(program: Program) -> dict[str, Any]:
    """What a file says of a program, numpy's numbers as plain ones; refuses, say, a set: it has no order."""
    steps = cast("object", program.steps)
    if not isinstance(steps, list | tuple):
        raise ProgramError(f"steps must be a list, not {steps!r}")
    for index, step in enumerate(cast("Sequence[object]", steps)):
        for key in step.__struct_fields__ if isinstance(step, msgspec.Struct) else ():
            value: object = getattr(step, key)
            if value is not None and not isinstance(value, _WRITABLE):
                raise ProgramError(
                    f"step {index + 1}, key {key}: {value!r} is neither a number, nor text, nor a list"
                )
    record = cast("dict[str, Any]", msgspec.to_builtins(program, enc_hook=_plain))
    del record["called"]
    return record


def _plain(value: object) -> object:
    if isinstance(value, np.generic | np.ndarray):
        return cast("object", value.tolist())
    return repr(value)  # somewhere in a list of numbers: refused as the text that it is now


# Programs that are saved in one folder, and call each other by their names.


_NAME = re.compile(r"\w[\w .+-]{0,60}")


class SavedPrograms:
    """A folder of them. Its calls block: they read files."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def names(self) -> list[str]:
        """Sorted."""
        return sorted(path.stem for path in self.folder.glob("*.toml"))

    def path(self, name: str) -> Path:
        """The file of a name; ``ProgramError``: it is none."""
        if not _NAME.fullmatch(name):
            raise ProgramError(
                f"{name!r} is no program name: up to 61 letters, digits, spaces, '.', '+', '-' and '_', "
                "beginning with a letter or a digit"
            )
        return self.folder / f"{name}.toml"

    def link(self, program: Program, known: Iterable[CalledProgram] = ()) -> Program:
        """A program with those that it calls, each read once; those of ``known`` are not read again."""
        return link(program, self._read, known)

    def _read(self, file: str) -> CalledProgram:
        """No file of another folder: whoever may edit the program may not read all that the computer has."""
        if not _NAME.fullmatch(called_name(file)):
            return CalledProgram(file=file, missing="saved")
        found = read_called(self.folder, file)
        return msgspec.structs.replace(found, missing="saved") if found.missing else found


# Sample programs for any arm: they are fitted to its reach, and checked before they are offered.


_SIZES_MM = (80.0, 60.0, 40.0, 25.0, 15.0)
"""of a square, and of a way down; the first that passes the check is taken"""
_AROUND = (0.5, 0.35, 0.2, 0.0)
"""between the home pose (0) and the rest pose (1): where the middle of a sample lies"""
_TURN_RAD = 0.3
_MOST_WAYS = 20
"""of so many poses: each is checked, and an arm may have many poses"""


def sample_program(name: str, robot: Robot) -> Program:
    """The sample for this arm, a key of ``SAMPLES``; a ProgramError where none passes the check."""
    for steps in SAMPLES[name](robot):
        program = Program(robot=robot.name, name=name, steps=tuple(steps))
        try:
            findings = check_program(program, robot, start=robot.pose("home"))
        except ArmctlError:
            continue
        if not any(finding.severity == "error" for finding in findings):
            return program
    raise ProgramError(f"{name}: no size of it fits {robot.title}; record a program of your own")


def _poses(robot: Robot) -> Iterator[list[Step]]:
    """Home, as many of the other named poses as can be reached one after the other, and home again."""
    others = [name for name in robot.poses if name != "home"]
    for count in range(len(others), 0, -1):
        for names in islice(combinations(others, count), _MOST_WAYS):
            yield [_move(robot, robot.pose(name), note=name) for name in ("home", *names, "home")]
    home, turned = robot.pose("home"), robot.pose("home")
    low, high = robot.limits[0]
    turned[0] += _TURN_RAD if high - home[0] > home[0] - low else -_TURN_RAD
    yield [_move(robot, home), _move(robot, turned, note=robot.joints[0].title), _move(robot, home)]


def _square(robot: Robot) -> Iterator[list[Step]]:
    for start, middle in _middles(robot):
        across = np.array([-middle[1], middle[0], 0.0])
        length = float(np.linalg.norm(across))
        across = across / length if length > 1.0 else np.array([0.0, 1.0, 0.0])
        up = np.array([0.0, 0.0, 1.0])
        for size in _SIZES_MM:
            sides = (across, across + up, up, 0 * up)
            corners = [middle + size * side for side in sides]
            yield [_move(robot, start, note="the first corner"), *(_line(corner) for corner in corners)]


def _pick_and_place(robot: Robot) -> Iterator[list[Step]]:
    for start, middle in _middles(robot):
        for size in _SIZES_MM:
            down = np.array([0.0, 0.0, size])
            there = np.array([-size * middle[1], size * middle[0], 0.0]) / max(np.hypot(*middle[:2]), 1.0)
            pick, place = middle - there, middle + there
            yield [
                _move(robot, start),
                *_grip(robot, 80.0),
                *(_point(pick, note="above the part"), _point(pick - down)),
                *_grip(robot, 20.0),
                *(_point(pick), _point(place, note="above its place"), _point(place - down)),
                *_grip(robot, 80.0),
                _point(place),
                _move(robot, start),
            ]


SAMPLES: dict[str, Callable[[Robot], Iterator[list[Step]]]] = {
    "sample - named poses": _poses,
    "sample - square": _square,
    "sample - pick and place": _pick_and_place,
}


def _middles(robot: Robot) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Configurations (n,) [rad] between home and rest, with their tool points (3,) [mm]."""
    home, rest = robot.pose("home"), robot.pose("rest")
    for share in _AROUND:
        q = home + share * (rest - home)
        yield q, 1000 * robot.forward(q)[:3, 3]


def _move(robot: Robot, q: FloatArray, note: str = "") -> MoveStep:
    return MoveStep(joints_deg=tuple(np.round(robot.shown(q), 9).tolist()), note=note)


def _line(point: FloatArray) -> LineStep:
    x, y, z = np.round(point, 1).tolist()
    return LineStep(x_mm=x, y_mm=y, z_mm=z, pitch="free")


def _point(point: FloatArray, note: str = "") -> PointStep:
    x, y, z = np.round(point, 1).tolist()
    return PointStep(x_mm=x, y_mm=y, z_mm=z, choose="least-travel", note=note)


def _grip(robot: Robot, percent: float) -> list[Step]:
    if robot.gripper is None:
        return [CommentStep(note=f"gripper to {percent:g} %, if it had one")]
    return [GripperStep(open_percent=percent), WaitStep(seconds=0.3)]

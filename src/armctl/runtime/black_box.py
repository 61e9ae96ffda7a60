"""The black box: the last minute of an arm, kept in memory and saved at every fault.

A saved one is a zip file of two members, which a report has, too:

``black_box.json``: robot, joints, why it was made, and when: ``wall_s`` (seconds since the epoch),
``clock_s`` and ``utc_offset_s`` of one moment. All other times are of that one clock, which never jumps.
``commands`` (who, what, when, answered how), ``lines`` of the log, ``warnings`` as they changed, ``states``
and ``columns``.

``ticks.npy``: float64, a row a tick, oldest first, with ``columns``: ``time_s``; ``late_s``, how much later
than its period it came; ``took_s``; ``state``, an index into ``states``; ``speed`` override; ``gripper``
0..1; ``step`` of the program that runs; ``setpoint NAME`` and ``readback NAME`` of each joint [rad]; then
``load NAME`` (a share of the largest), ``temperature_c NAME``, ``voltage_v NAME``, ``current_a NAME``, where
the board measures them. NaN: there is none, or it is not known.
"""

from __future__ import annotations

import io
import logging
import math
import os
import re
import reprlib
import threading
import zipfile
import zlib
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import platformdirs

from armctl.arrays import FloatArray
from armctl.documents import DocumentKind, write_atomically
from armctl.errors import InputError
from armctl.facts import State
from armctl.facts.quantities import NAMES
from armctl.kinematics import Target
from armctl.program import Program
from armctl.robot import Robot
from armctl.runtime.clock import wall_time
from armctl.runtime.snapshot import Event, Snapshot
from armctl.system import private_folder

LENGTH_S = 60.0
_ROWS_A_PERIOD = 2
"""a command brings a tick forward: rows nearer than half a period are one"""
_MOST_COMMANDS, _MOST_LINES = 5000, 1000
_LONGEST_WORDS, _LONGEST_LINE = 400, 2000
"""letters of a command, of a line of the log"""
_MOST_NUMBERS = 16
_SECRET = ("pin",)
_KEPT = 20
"""so many saved ones are kept"""
_APART_S = 5.0
"""a fault that comes sooner after the last save is saved then, with what was before it"""
_CLOSING_S = 2.0
_STATES = tuple(State)
_PLAIN = ("time_s", "late_s", "took_s", "state", "speed", "gripper", "step")
_SETPOINT, _READBACK = "setpoint ", "readback "
_FOLDER = "black_box"
_TEXT, _TICKS = "black_box.json", "ticks.npy"
_UNSAFE = re.compile(r"[^A-Za-z0-9_-]+")
_LOG = logging.getLogger("armctl.runtime")
_FILES = DocumentKind(InputError, most_bytes=16 << 20)
_MOST_UNPACKED = 16 << 20
"""bytes of a member"""


class CommandLine(msgspec.Struct):
    """A command, and its answer."""

    time_s: float
    who: str
    what: str
    answered_s: float | None = None
    answer: str = ""
    """"done", or what refused, stopped or broke it; empty: none yet"""

    def end(self, answer: str, now: float) -> None:
        """It is answered at ``now`` (controller clock) [s]."""
        self.answer, self.answered_s = answer, now


class LogLine(msgspec.Struct, frozen=True):
    """A line of the log; its level is info, warning or error."""

    time_s: float
    level: str
    text: str


class WarningsLine(msgspec.Struct, frozen=True):
    """What was shown as a warning from ``time_s`` on."""

    time_s: float
    texts: tuple[str, ...]


class Story(msgspec.Struct, frozen=True, kw_only=True):
    """What happened, without the ticks: ``black_box.json``."""

    format: int = 1
    robot: str
    joints: tuple[str, ...]
    titles: tuple[str, ...]
    """of the joints"""
    board: str
    """what was connected last, in words"""
    period_s: Annotated[float, msgspec.Meta(gt=0)]
    why: str
    """why it was made: a fault, or asked for"""
    wall_s: Annotated[float, msgspec.Meta(ge=0, le=1e11)]
    clock_s: float
    utc_offset_s: Annotated[float, msgspec.Meta(gt=-86400, lt=86400)]
    commands: tuple[CommandLine, ...]
    lines: tuple[LogLine, ...]
    warnings: tuple[WarningsLine, ...]
    states: tuple[str, ...]
    columns: tuple[str, ...]


class Recording(Story, frozen=True, kw_only=True, eq=False):
    """A minute of an arm; the module tells units and columns."""

    ticks: FloatArray
    """(k, columns)"""

    def column(self, name: str) -> FloatArray:
        """(k,) one column."""
        return self.ticks[:, self.columns.index(name)]

    @property
    def time_s(self) -> FloatArray:
        """(k,) when each tick began."""
        return self.column("time_s")

    @property
    def setpoint(self) -> FloatArray:
        """(k, n) [rad]."""
        return self._joints(_SETPOINT)

    @property
    def readback(self) -> FloatArray:
        """(k, n) [rad]."""
        return self._joints(_READBACK)

    def _joints(self, head: str) -> FloatArray:
        return self.ticks[:, [self.columns.index(f"{head}{name}") for name in self.joints]]

    def wall(self, time_s: float) -> datetime:
        """Local time, where the arm is, of a time of the recording."""
        zone = timezone(timedelta(seconds=self.utc_offset_s))
        return datetime.fromtimestamp(self.wall_s + time_s - self.clock_s, zone)


class BlackBox:
    """Records an arm. The controller thread writes; any thread may ask for a recording."""

    def __init__(self, robot: Robot, period_s: float, now: Callable[[], float], folder: Path | None) -> None:
        """Keep nothing yet; ``folder`` of saved ones, None: none is saved."""
        self._robot, self._period_s, self._now, self._folder = robot, period_s, now, folder
        self._columns = (
            *_PLAIN,
            *(f"{_SETPOINT}{name}" for name in robot.joint_names),
            *(f"{_READBACK}{name}" for name in robot.joint_names),
            *(f"{quantity} {name}" for quantity in NAMES for name in robot.joint_names),
        )
        self._rows = np.full((math.ceil(_ROWS_A_PERIOD * LENGTH_S / period_s), len(self._columns)), np.nan)
        self._count = 0
        """rows ever begun"""
        self._began_s = self._ticked_s = -math.inf
        """of the last row, of the last tick"""
        self._commands: deque[CommandLine] = deque(maxlen=_MOST_COMMANDS)
        self._lines: deque[LogLine] = deque(maxlen=_MOST_LINES)
        self._warnings: deque[WarningsLine] = deque(maxlen=_MOST_LINES)
        self._last: Snapshot | None = None
        self._board = "nothing was connected"
        self._lock = threading.Lock()
        self._due: Recording | None = None
        self._writer: threading.Thread | None = None
        self._closing = threading.Event()
        self._results: deque[tuple[str, str]] = deque()

    def order(self, command: object, who: str, note: str, finished: Future[None], now: float) -> None:
        """A command (None: STOP) is about to be carried out; ``finished`` will tell what became of it."""
        line = CommandLine(now, who[:_LONGEST_WORDS], _words(command, note))

        def answered(future: Future[None]) -> None:
            error = future.exception()
            line.end("done" if error is None else str(error)[:_LONGEST_WORDS], self._now())

        with self._lock:
            self._commands.append(line)
        finished.add_done_callback(answered)

    def tick(self, snapshot: Snapshot, pace_s: float | None = None) -> None:
        """A tick is over, and this is what came of it; ``pace_s`` after the one before, if not the period."""
        before, now = self._last, snapshot.stamp
        pace_s = self._period_s if pace_s is None else pace_s
        late = max(0.0, now - self._ticked_s - pace_s) if before is not None else 0.0
        took, self._ticked_s = self._now() - now, now
        with self._lock:
            same = now - self._began_s < self._period_s / _ROWS_A_PERIOD
            if not same:
                self._count += 1
                self._began_s = now
            row = self._rows[(self._count - 1) % len(self._rows)]
            if same:
                late, took = max(late, float(row[1])), max(took, float(row[2]))
            n, plain = self._robot.n, len(_PLAIN)
            program = snapshot.program
            row[:plain] = (
                self._began_s,
                late,
                took,
                _STATES.index(snapshot.state),
                snapshot.speed,
                np.nan if snapshot.gripper is None else snapshot.gripper,
                np.nan if program is None else program.step,
            )
            row[plain : plain + n] = snapshot.q_command if snapshot.commanded else np.nan
            row[plain + n : plain + 2 * n] = snapshot.q
            row[plain + 2 * n :] = np.nan
            for j, joint in enumerate(self._robot.joints):
                if (measured := snapshot.quantities.get(joint.title)) is not None:
                    row[plain + 2 * n + j :: n] = [getattr(measured, name) for name in NAMES]
            if before is None or snapshot.events is not before.events:
                old = None if before is None or not before.events else before.events[-1]
                self._lines += [
                    LogLine(now, one.level, one.text[:_LONGEST_LINE]) for one in _since(old, snapshot.events)
                ]
            if snapshot.warnings != (() if before is None else before.warnings):
                self._warnings.append(WarningsLine(now, snapshot.warnings))
        if snapshot.board is not None:
            self._board = f"{snapshot.board.title} at {snapshot.board.port}"
        self._last = snapshot
        if snapshot.state is State.FAULT and before is not None and before.state is not State.FAULT:
            self._save(f"fault: {snapshot.cause}")

    def results(self) -> list[tuple[str, str]]:
        """What became of saves since it was last asked, for the log: texts and levels."""
        return [self._results.popleft() for _ in range(len(self._results))]

    def recording(self, why: str) -> Recording:
        """The last minute, as it is now."""
        with self._lock:
            clock, wall = self._now(), wall_time()
            order = np.arange(max(0, self._count - len(self._rows)), self._count) % len(self._rows)
            ticks = self._rows[order]
            commands, lines, warnings = list(self._commands), list(self._lines), list(self._warnings)
        first = max(clock, self._began_s) - LENGTH_S
        offset = datetime.fromtimestamp(wall).astimezone().utcoffset()
        return Recording(
            robot=self._robot.name,
            joints=self._robot.joint_names,
            titles=tuple(joint.title for joint in self._robot.joints),
            board=self._board,
            period_s=self._period_s,
            why=why,
            wall_s=wall,
            clock_s=clock,
            utc_offset_s=0.0 if offset is None else offset.total_seconds(),
            commands=tuple(msgspec.structs.replace(one) for one in commands if one.time_s >= first),
            lines=tuple(one for one in lines if one.time_s >= first),
            warnings=(
                *[one for one in warnings if one.time_s < first][-1:],  # shown already when it begins
                *(one for one in warnings if one.time_s >= first),
            ),
            states=tuple(state.value for state in _STATES),
            columns=self._columns,
            ticks=ticks[ticks[:, 0] >= first],
        )

    def close(self) -> None:
        """Wait until what is being saved is on the disk, but not for a disk that hangs."""
        self._closing.set()
        if self._writer is not None:
            self._writer.join(_CLOSING_S)

    def _save(self, why: str) -> None:
        if self._folder is None:
            return
        recording = self.recording(why)
        with self._lock:
            self._due = recording
            if self._writer is None or not self._writer.is_alive():
                self._writer = threading.Thread(
                    target=self._write, args=(self._folder,), name="armctl-black-box", daemon=True
                )
                self._writer.start()

    def _write(self, folder: Path) -> None:
        """Save what is due, and whatever becomes due meanwhile, but not one right after the other."""
        while True:
            with self._lock:
                recording, self._due = self._due, None
                if recording is None:
                    self._writer = None
                    return
            try:
                path = save_recording(recording, folder)
            except OSError as cause:
                text = f"the last minute before the fault cannot be saved: {folder}: {cause.strerror}"
                self._results.append((text, "warning"))
            except Exception:  # must not end in silence; the arm does not depend on it
                _LOG.exception("the last minute before the fault could not be saved")
            else:
                self._results.append(
                    (f"the last minute before the fault is in {path} (armctl replay)", "info")
                )
            self._closing.wait(_APART_S)


def _words(command: object, note: str) -> str:
    """A command in one short line; joint angles in degrees."""
    match command:
        case None:
            words = f"STOP: {note}" if note else "STOP"
        case _:
            names: tuple[str, ...] = getattr(command, "__struct_fields__", ())  # what is no command has none
            fields = ((name, getattr(command, name)) for name in names)
            told = ", ".join(
                f"{name} {_value(name, value)}"
                for name, value in fields
                if not (value is None or value is False or (isinstance(value, str) and not value))
            )
            words = f"{type(command).__name__} {told}".strip()
    return words[:_LONGEST_WORDS]


def _value(name: str, value: object) -> str:
    match value:
        case np.ndarray() if value.size <= _MOST_NUMBERS and value.dtype.kind in "fi":
            angles = name == "q"
            with np.errstate(over="ignore"):  # refused or not: what was asked for is recorded
                unit, numbers = ("°", np.degrees(value)) if angles else ("", value)
            return "(" + ", ".join(f"{number:.4g}{unit}" for number in numbers.ravel().tolist()) + ")"
        case np.ndarray():
            return f"array of {value.shape}"
        case Program():
            steps = "1 step" if len(value.steps) == 1 else f"{len(value.steps)} steps"
            return f"{value.name!r} with {steps}"
        case Target():
            place = ", ".join(f"{1000 * number:.1f}" for number in value.point)
            return f"({place}) mm{'' if value.pitch is None else f' pitch {math.degrees(value.pitch):.1f}°'}"
        case float():
            return f"{value:.4g}"
        case str() if name in _SECRET:
            return "(not recorded)"
        case str() | int() | tuple() | list():
            return reprlib.repr(value)  # pyright: ignore[reportUnknownArgumentType]
        case _:
            return type(value).__name__


def _since(old: Event | None, events: Sequence[Event]) -> list[Event]:
    """The lines after the one that was the newest."""
    new: list[Event] = []
    for event in reversed(events):
        if event is old:
            break
        new.append(event)
    return new[::-1]


# The file.


def black_boxes() -> Path:
    """Where the black boxes of this user's arms are saved."""
    return platformdirs.user_state_path("armctl") / _FOLDER


def saved_recordings(folder: Path | None = None) -> list[Path]:
    """The saved ones, the newest first."""
    return sorted((black_boxes() if folder is None else folder).glob("fault-*.zip"), reverse=True)


def save_recording(recording: Recording, folder: Path) -> Path:
    """Save it in a file of its own, whole or not at all; of many the oldest go."""
    private_folder(folder)
    robot = _UNSAFE.sub("_", recording.robot)[:40]
    path = folder / f"fault-{recording.wall(recording.clock_s):%Y%m%d-%H%M%S}-{robot}-{os.getpid()}.zip"
    write_atomically(path, packed(recording), private=True)
    for old in [one for one in saved_recordings(folder) if one != path][_KEPT - 1 :]:
        old.unlink(missing_ok=True)
    return path


def packed(recording: Recording) -> bytes:
    """The content of its file."""
    return zipped(members(recording))


def zipped(content: Mapping[str, bytes]) -> bytes:
    """A zip file of members by name."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, one in content.items():
            archive.writestr(name, one)
    return stream.getvalue()


def members(recording: Recording) -> dict[str, bytes]:
    """What a zip file holds of it: content by name."""
    story = Story(**{name: getattr(recording, name) for name in Story.__struct_fields__})
    ticks = io.BytesIO()
    np.save(ticks, recording.ticks)
    return {_TEXT: msgspec.json.format(msgspec.json.encode(story), indent=1), _TICKS: ticks.getvalue()}


def read_recording(path: Path) -> Recording:
    """What a saved black box, or a report, holds; ``InputError`` says what is wrong with the file."""
    return _FILES.load(path, unpacked)


def unpacked(content: bytes) -> Recording:
    """What ``packed`` made, or a report's content; errors as ``read_recording``."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            text, ticks = _member(archive, _TEXT), _member(archive, _TICKS)
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError) as cause:  # RuntimeError: encrypted
        raise InputError(f"is no black box and no report: {cause}") from cause
    try:
        story = msgspec.json.decode(text, type=Story)
    except msgspec.DecodeError as cause:  # also a ValidationError
        raise InputError(f"{_TEXT}: {cause}") from cause
    n = len(story.joints)
    wanted = {*_PLAIN, *(f"{head}{name}" for head in (_SETPOINT, _READBACK) for name in story.joints)}
    if story.format != 1 or n == 0 or len(story.titles) != n or not wanted <= set(story.columns):
        raise InputError(f"{_TEXT}: is of another version of armctl, or was changed")
    try:
        array = _array(ticks, len(story.columns))
    except ValueError as cause:
        raise InputError(f"{_TICKS}: {cause}") from cause
    recording = Recording(**{name: getattr(story, name) for name in Story.__struct_fields__}, ticks=array)
    time, state = recording.time_s, recording.column("state")
    if not (
        np.isfinite(time).all()
        and (np.diff(time) > 0).all()
        and np.isin(state, range(len(story.states))).all()
    ):
        raise InputError(f"{_TICKS}: its times do not ascend, or a state is none")
    return recording


def _member(archive: zipfile.ZipFile, name: str) -> bytes:
    try:
        info = archive.getinfo(name)
    except KeyError:
        raise InputError(f"is no black box and no report: there is no {name} in it") from None
    if info.file_size > _MOST_UNPACKED:
        raise InputError(f"{name} is larger than {_MOST_UNPACKED >> 20} MiB; no black box is")
    return archive.read(info)


def _array(content: bytes, columns: int) -> FloatArray:
    """The rows (k, columns) of a .npy file, at least one; nothing is made of a size that it merely claims."""
    stream = io.BytesIO(content)
    if np.lib.format.read_magic(stream) != (1, 0):
        raise ValueError("is no .npy file of version 1.0")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
    body = content[stream.tell() :]
    rows = len(body) // (8 * columns)
    if dtype != np.dtype("<f8") or fortran or shape != (rows, columns) or len(body) != 8 * columns * rows:
        raise ValueError(f"must be float64, rows of {columns} columns")
    if not rows:
        raise ValueError("holds no tick")
    return np.frombuffer(body, dtype=np.float64).reshape(rows, columns).copy()

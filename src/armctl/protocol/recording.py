"""The last minute of an arm, as its black box keeps it and saves it at every fault.

A saved one is a zip file of two members, which a report has, too:

``black_box.json``: robot, joints, why it was made, and when: ``wall_s`` (seconds since the epoch),
``clock_s`` and ``utc_offset_s`` of one moment. All other times are of that one clock, which never jumps.
``commands`` (who, what, when, answered how), ``lines`` of the log, ``warnings`` as they changed, ``states``
and ``columns``.

``ticks.npy``: float64, a row a tick, oldest first, with ``columns``: ``time_s``; ``late_s``, how much later
than its period it came; ``took_s``; ``state``, an index into ``states``; ``speed`` override; ``gripper``
0..1; ``step`` of the program that runs; ``setpoint NAME`` and ``readback NAME`` of each joint [rad]; then
``load NAME`` (a share of the largest), ``temperature_c NAME``, ``voltage_v NAME``, ``current_a NAME`` of each
joint, and of the gripper as ``gripper``, where the board measures them; ``input NAME`` and ``output NAME`` of
the robot file; of an arm with several tools ``tool``, an index into ``tools``. NaN: there is none, or it is
not known.
"""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Mapping
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Annotated

import msgspec
import numpy as np
import platformdirs

from armctl.arrays import FloatArray
from armctl.documents import DocumentKind
from armctl.errors import InputError

PLAIN = ("time_s", "late_s", "took_s", "state", "speed", "gripper", "step")
SETPOINT, READBACK = "setpoint ", "readback "
INPUT, OUTPUT = "input ", "output "
TOOL = "tool"
_FOLDER = "black_box"
_TEXT, _TICKS = "black_box.json", "ticks.npy"
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
    command: str = ""
    """its name; empty: an older version wrote the file"""

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
    tools: tuple[str, ...] = ()
    """of the robot file; empty: it names none, or an older version wrote the file"""


class Recording(Story, frozen=True, kw_only=True, eq=False):
    """A minute of an arm; the module tells units and columns."""

    ticks: FloatArray
    """(k, columns)"""

    def column(self, name: str) -> FloatArray:
        """(k,) one column."""
        return self.ticks[:, self.columns.index(name)]

    def tool_at(self, k: int) -> str:
        """Name of the tool that was on at tick ``k``; empty: the arm had none, or the file is older."""
        return self.tools[int(self.column(TOOL)[k])] if self.tools else ""

    @property
    def tools_on(self) -> tuple[str, ...]:
        """Names of the tools that were on, in the order of ``tools``; empty: as of ``tool_at``."""
        return tuple(self.tools[int(one)] for one in np.unique(self.column(TOOL))) if self.tools else ()

    @property
    def time_s(self) -> FloatArray:
        """(k,) when each tick began."""
        return self.column("time_s")

    @property
    def setpoint(self) -> FloatArray:
        """(k, n) [rad]."""
        return self._joints(SETPOINT)

    @property
    def readback(self) -> FloatArray:
        """(k, n) [rad]."""
        return self._joints(READBACK)

    def _joints(self, head: str) -> FloatArray:
        return self.ticks[:, [self.columns.index(f"{head}{name}") for name in self.joints]]

    def wall(self, time_s: float) -> datetime:
        """Local time, where the arm is, of a time of the recording."""
        zone = timezone(timedelta(seconds=self.utc_offset_s))
        return datetime.fromtimestamp(self.wall_s + time_s - self.clock_s, zone)


# The file.


def black_boxes() -> Path:
    """Where the black boxes of this user's arms are saved."""
    return platformdirs.user_state_path("armctl") / _FOLDER


def saved_recordings(folder: Path | None = None) -> list[Path]:
    """The saved ones, the newest first."""
    return sorted((black_boxes() if folder is None else folder).glob("fault-*.zip"), reverse=True)


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


def ticks_csv(recording: Recording) -> str:
    """Every tick as a line, its columns as the module tells them; what is not known is left open."""
    heads = [f'"{name}"' if "," in name else name for name in recording.columns]
    rows = [
        ",".join("" if math.isnan(one) else f"{one:.9g}" for one in row) for row in recording.ticks.tolist()
    ]
    return "\n".join([",".join(heads), *rows]) + "\n"


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
    wanted = {*PLAIN, *(f"{head}{name}" for head in (SETPOINT, READBACK) for name in story.joints)}
    wanted |= {TOOL} if story.tools else set()
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
        and (not story.tools or np.isin(recording.column(TOOL), range(len(story.tools))).all())
    ):
        raise InputError(f"{_TICKS}: its times do not ascend, or a state is none, or a tool")
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

"""The black box: the last minute of an arm, kept in memory and saved at every fault."""

from __future__ import annotations

import logging
import math
import os
import re
import reprlib
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from datetime import datetime
from pathlib import Path

import msgspec
import numpy as np

from armctl.documents import write_atomically
from armctl.facts import State
from armctl.facts.angles import in_degrees, to_degrees
from armctl.facts.quantities import NAMES
from armctl.hardware import BoardIdentity
from armctl.kinematics import Target
from armctl.program import Program
from armctl.protocol import Event, Recording, Snapshot, wall_time
from armctl.protocol.recording import (
    INPUT,
    OUTPUT,
    PLAIN,
    READBACK,
    SETPOINT,
    TOOL,
    CommandLine,
    LogLine,
    WarningsLine,
    packed,
    saved_recordings,
)
from armctl.robot import Robot
from armctl.robot.tools import own_gripper
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
_UNSAFE = re.compile(r"[^A-Za-z0-9_-]+")
_LOG = logging.getLogger("armctl.runtime")


class BlackBox:
    """Records an arm. The controller thread writes; any thread may ask for a recording."""

    def __init__(self, robot: Robot, period_s: float, now: Callable[[], float], folder: Path | None) -> None:
        """Keep nothing yet; ``folder`` of saved ones, None: none is saved."""
        self._robot, self._period_s, self._now, self._folder = robot, period_s, now, folder
        self._tools = tuple(tool.name for tool in robot.tools)
        self._measured = {joint.name: joint.title for joint in robot.joints}
        """titles by name of what may be measured besides its position"""
        if (gripper := own_gripper(robot)) is not None:
            self._measured.setdefault("gripper", gripper.title)
        self._columns = (
            *PLAIN,
            *(f"{SETPOINT}{name}" for name in robot.joint_names),
            *(f"{READBACK}{name}" for name in robot.joint_names),
            *(f"{quantity} {name}" for quantity in NAMES for name in self._measured),
            *(f"{INPUT}{one.name}" for one in robot.signals.inputs),
            *(f"{OUTPUT}{one.name}" for one in robot.signals.outputs),
            *((TOOL,) if robot.tools else ()),
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
        self._board: BoardIdentity | None = None
        """the one that was connected last"""
        self._lock = threading.Lock()
        self._due: Recording | None = None
        self._writer: threading.Thread | None = None
        self._closing = threading.Event()
        self._results: deque[tuple[str, str]] = deque()

    def order(self, command: object, who: str, note: str, finished: Future[None], now: float) -> None:
        """A command (None: STOP) is about to be carried out; ``finished`` will tell what became of it."""
        name = "STOP" if command is None else type(command).__name__
        line = CommandLine(now, who[:_LONGEST_WORDS], _words(command, name, note), command=name)

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
            row[:] = [self._began_s, late, took, *self._numbers(snapshot)]  # None becomes NaN
            if before is None or snapshot.events is not before.events:
                old = None if before is None or not before.events else before.events[-1]
                self._lines += [
                    LogLine(now, one.level, one.text[:_LONGEST_LINE]) for one in _since(old, snapshot.events)
                ]
            if snapshot.warnings != (() if before is None else before.warnings):
                self._warnings.append(WarningsLine(now, snapshot.warnings))
        if snapshot.board is not None:
            self._board = snapshot.board
        self._last = snapshot
        if snapshot.state is State.FAULT and before is not None and before.state is not State.FAULT:
            self._save(f"fault: {snapshot.cause}")

    def _numbers(self, snapshot: Snapshot) -> list[float | None]:
        """What stands in a row behind its times; None: not known."""
        program, signals = snapshot.program, self._robot.signals
        row: list[float | None] = [
            _STATES.index(snapshot.state),
            snapshot.speed,
            snapshot.gripper,
            None if program is None else program.step,
        ]
        row += snapshot.q_command.tolist() if snapshot.commanded else [None] * self._robot.n
        row += snapshot.q.tolist()
        measured = [snapshot.quantities.get(title) for title in self._measured.values()]
        row += [None if one is None else one.load for one in measured]
        row += [None if one is None else one.temperature_c for one in measured]
        row += [None if one is None else one.voltage_v for one in measured]
        row += [None if one is None else one.current_a for one in measured]
        row += [snapshot.inputs.get(one.name) for one in signals.inputs]
        row += [snapshot.outputs.get(one.name) for one in signals.outputs]
        return [*row, self._tools.index(snapshot.tool)] if self._tools else row

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
            board = self._board
        first = max(clock, self._began_s) - LENGTH_S
        offset = datetime.fromtimestamp(wall).astimezone().utcoffset()
        return Recording(
            robot=self._robot.name,
            joints=self._robot.joint_names,
            titles=tuple(joint.title for joint in self._robot.joints),
            board="nothing was connected" if board is None else f"{board.title} at {board.port}",
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
            tools=self._tools,
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


def _words(command: object, name: str, note: str) -> str:
    """A command in one short line; joint angles in degrees."""
    match command:
        case None:
            words = f"{name}: {note}" if note else name
        case _:
            keys: tuple[str, ...] = getattr(command, "__struct_fields__", ())  # what is no command has none
            fields = ((key, getattr(command, key)) for key in keys)
            told = ", ".join(
                f"{key} {_value(key, value)}"
                for key, value in fields
                if not (value is None or value is False or (isinstance(value, str) and not value))
            )
            words = f"{name} {told}".strip()
    return words[:_LONGEST_WORDS]


def _value(name: str, value: object) -> str:
    match value:
        case np.ndarray() if value.size <= _MOST_NUMBERS and value.dtype.kind in "fi":
            angles = name == "q"
            with np.errstate(over="ignore"):  # refused or not: what was asked for is recorded
                unit, numbers = ("°", to_degrees(value)) if angles else ("", value)
            return "(" + ", ".join(f"{number:.4g}{unit}" for number in numbers.ravel().tolist()) + ")"
        case np.ndarray():
            return f"array of {value.shape}"
        case Program():
            steps = "1 step" if len(value.steps) == 1 else f"{len(value.steps)} steps"
            return f"{value.name!r} with {steps}"
        case Target():
            place = ", ".join(f"{1000 * number:.1f}" for number in value.point)
            pitch = "" if value.pitch is None else f" pitch {in_degrees(value.pitch, '.1f')}"
            return f"({place}) mm{pitch}"
        case float():
            return f"{value:.4g}"
        case str() if name in _SECRET:
            return "(not recorded)"
        case str() | int() | tuple() | list():
            return reprlib.repr(value)  # pyright: ignore[reportUnknownArgumentType]
        case _:
            return type(value).__name__


def _since(old: Event | None, events: Sequence[Event]) -> list[Event]:
    new: list[Event] = []
    for event in reversed(events):
        if event is old:
            break
        new.append(event)
    return new[::-1]


def save_recording(recording: Recording, folder: Path) -> Path:
    """Save it in a file of its own, whole or not at all; of many the oldest go."""
    private_folder(folder)
    robot = _UNSAFE.sub("_", recording.robot)[:40]
    path = folder / f"fault-{recording.wall(recording.clock_s):%Y%m%d-%H%M%S}-{robot}-{os.getpid()}.zip"
    write_atomically(path, packed(recording), private=True)
    for old in [one for one in saved_recordings(folder) if one != path][_KEPT - 1 :]:
        old.unlink(missing_ok=True)
    return path

"""What the inputs of a simulated board see over time: a short script, or a table.

A script is statements, one a line or between semicolons; ``#`` begins a comment::

    at 2 s part = on
    every 5 s part on for 200 ms
    every 1 s from 10 s knob = 40 % for 0.5 s

A table (CSV) has ``time_s`` in its first column and an input in each other one; an empty cell changes
nothing. Times count from when the script is played, on the board's clock.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, MutableMapping
from pathlib import Path

from armctl.documents import DocumentKind
from armctl.errors import InputError
from armctl.hardware.board_type import ByteModel
from armctl.lazy_dataclass import dataclass
from armctl.robot.signals import Input, Signals

LONGEST_SCRIPT = 20_000
"""characters"""
SCRIPT_FILES = DocumentKind(InputError, most_bytes=4 * LONGEST_SCRIPT)
SHORTEST_S = 0.001
"""of a pulse, and from one to the next"""
LONGEST_S = 1e6
_MOST_STATEMENTS = 300
_MOST_AT_ONCE = 300
"""changes that are played one by one when much time passes at once; of more only the last state counts"""
_UNITS = {"ms": 0.001, "s": 1.0, "min": 60.0}
_TIME = r"(\d+(?:\.\d*)?|\.\d+)\s*(ms|s|min)"
_FORM = re.compile(
    rf"(?P<word>at|every)\s+(?P<time>{_TIME})(?:\s+from\s+(?P<begin>{_TIME}))?\s+(?P<name>[a-z][a-z0-9_]*)"
    rf"\s*(?:=|\s)\s*(?P<value>on|off|\d+(?:\.\d*)?\s*%|\d+(?:\.\d*)?|\.\d+)(?:\s+for\s+(?P<length>{_TIME}))?"
)
_EXAMPLE = "at 2 s part = on; every 5 s part on for 200 ms"


@dataclass(frozen=True, slots=True)
class InputChange:
    """One statement: an input has a value from some time on, or for a while; perhaps again and again."""

    name: str
    value: float
    at_s: float
    """the first time, from the begin of the script"""
    every_s: float = math.inf
    for_s: float = math.inf
    """then it is as before again; inf: it stays"""

    def begun(self, time_s: float) -> float | None:
        """When it began last, at or before a time; None: not yet."""
        if time_s < self.at_s:
            return None
        return self.at_s if math.isinf(self.every_s) else self._turn(self._turns(time_s))

    def _turns(self, time_s: float) -> int:
        turn = math.floor((time_s - self.at_s) / self.every_s)
        if self._turn(turn + 1) <= time_s:  # the quotient is rounded
            return turn + 1
        return turn if self._turn(turn) <= time_s else turn - 1

    def _turn(self, turn: int) -> float:
        return self.at_s + self.every_s * turn

    def next(self, time_s: float) -> float:
        """When it begins or ends next, after a time; inf: never."""
        began = self.begun(time_s)
        if began is None:
            return self.at_s
        end = began + self.for_s
        if end > time_s or math.isinf(self.every_s):
            return end if end > time_s else math.inf
        return self._turn(self._turns(time_s) + 1)


@dataclass(frozen=True, slots=True)
class InputScript:
    """All changes of the inputs of a simulated board, in the order in which they are written."""

    changes: tuple[InputChange, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """The inputs that it changes."""
        return tuple(dict.fromkeys(change.name for change in self.changes))

    def value(self, name: str, time_s: float) -> float | None:
        """What an input is at; None: nothing was said of it yet. What began last counts, pulses first."""
        found: tuple[bool, float, float] | None = None
        for change in self.changes:
            began = change.begun(time_s) if change.name == name else None
            if began is None or time_s >= began + change.for_s:
                continue
            now = math.isfinite(change.for_s), began, change.value
            if found is None or now[:2] >= found[:2]:
                found = now
        if found is not None:
            return found[2]
        began_before = any(one.name == name and one.begun(time_s) is not None for one in self.changes)
        return 0.0 if began_before else None

    def next(self, time_s: float) -> float:
        """When something changes next, after a time; inf: never."""
        return min((change.next(time_s) for change in self.changes), default=math.inf)


def read_script(text: str, signals: Signals) -> InputScript:
    """A script or a table, for the inputs of an arm. InputError: the line, and what is wrong there."""
    if len(text) > LONGEST_SCRIPT:
        raise InputError(f"a script has at most {LONGEST_SCRIPT} characters, not {len(text)}")
    table = text.lstrip().lower().startswith("time_s")
    changes = [*(_table(text, signals) if table else _statements(text, signals))]
    if not changes:
        raise InputError(f"the script is empty; for example: {_EXAMPLE}")
    if len(changes) > _MOST_STATEMENTS:
        raise InputError(f"a script has at most {_MOST_STATEMENTS} changes, not {len(changes)}")
    return InputScript(tuple(changes))


def load_script(path: Path, signals: Signals) -> str:
    """The text of a file, which ``read_script`` reads. InputError: the file, and what is wrong there."""

    def checked(content: bytes) -> str:
        text = SCRIPT_FILES.text(content)
        read_script(text, signals)
        return text

    return SCRIPT_FILES.load(path, checked)


def _statements(text: str, signals: Signals) -> Iterator[InputChange]:
    for number, line in enumerate(text.splitlines(), 1):
        for part in line.partition("#")[0].split(";"):
            if part.strip():
                yield _statement(" ".join(part.split()), f"line {number}", signals)


def _statement(text: str, where: str, signals: Signals) -> InputChange:
    found = _FORM.fullmatch(text)
    if found is None:
        raise InputError(f"{where}: {text[:60]!r} cannot be read; write as in: {_EXAMPLE}")
    time_s = _seconds(found["time"])
    value = _value(_input(found["name"], where, signals), found["value"], where)
    for_s = math.inf if found["length"] is None else _seconds(found["length"])
    begin_s, every_s = time_s, math.inf
    if found["word"] == "every":
        begin_s, every_s = time_s if found["begin"] is None else _seconds(found["begin"]), time_s
        if math.isinf(for_s):
            raise InputError(f"{where}: say for how long, as in: every 5 s {found['name']} on for 200 ms")
        if for_s >= every_s:
            raise InputError(f"{where}: {for_s:g} s is not shorter than the {every_s:g} s between two begins")
    elif found["begin"] is not None:
        raise InputError(f"{where}: from goes with every; write only: at {found['begin']} …")
    if min(for_s, every_s) < SHORTEST_S or max(begin_s, time_s) > LONGEST_S:
        raise InputError(f"{where}: times are {1000 * SHORTEST_S:g} ms … {LONGEST_S:g} s")
    return InputChange(found["name"], value, begin_s, every_s, for_s)


def _table(text: str, signals: Signals) -> Iterator[InputChange]:
    rows = list(csv.reader(io.StringIO(text.strip())))
    names = [name.strip() for name in rows[0]][1:]
    if not names:
        raise InputError("line 1: a table has time_s and at least one input")
    for number, row in enumerate(rows[1:], 2):
        where = f"line {number}"
        if len(row) > len(names) + 1:
            raise InputError(f"{where}: {len(row)} cells, but the first line names {len(names) + 1}")
        if not any(cell.strip() for cell in row):
            continue
        try:
            time_s = float(row[0])
        except ValueError:
            raise InputError(f"{where}: time_s: {row[0][:20]!r} is not a number") from None
        if not 0 <= time_s <= LONGEST_S:
            raise InputError(f"{where}: time_s: {row[0].strip()} is outside 0 … {LONGEST_S:g}")
        for name, cell in zip(names, row[1:], strict=False):
            if cell.strip():
                yield InputChange(name, _value(_input(name, where, signals), cell.strip(), where), time_s)


def _input(name: str, where: str, signals: Signals) -> Input:
    found = signals.input(name)
    if found is None:
        every = ", ".join(one.name for one in signals.inputs) or "none"
        raise InputError(f"{where}: there is no input {name!r}; the robot file has {every}")
    return found


def _value(signal: Input, text: str, where: str) -> float:
    if text in ("on", "off"):
        return float(text == "on")
    number, percent, _ = text.partition("%")
    try:
        value = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        raise InputError(f"{where}: input {signal.name}: {text[:20]!r} is not on, off or a number") from None
    if not 0 <= value <= 1:
        raise InputError(f"{where}: input {signal.name}: {text} is outside 0 … 1")
    if signal.kind != "analog" and value not in (0, 1):
        raise InputError(f"{where}: input {signal.name} is digital: on or off, not {text}")
    return value


def _seconds(text: str) -> float:
    number = text.rstrip("mins ")
    return float(number) * _UNITS[text.removeprefix(number).strip()]


class InputPlayer:
    """Plays a script on the pins of a simulated board, from its first moment on."""

    def __init__(self, script: InputScript, signals: Signals, levels: MutableMapping[int, float]) -> None:
        """``levels``: of the board's pins by channel, as in ``SimulatedPins``."""
        self._script, self._levels = script, levels
        self._inputs = {
            name: (signals.input(name), InputScript(tuple(one for one in script.changes if one.name == name)))
            for name in script.names
        }
        self._last: dict[str, float | None] = dict.fromkeys(script.names)
        self._began: float | None = None
        self._at = 0.0

    def advance(self, model: ByteModel, now: float) -> bytes:
        """Let the board's time pass up to ``now`` [s], its inputs changing on the way; what it sends."""
        if self._began is None:
            self._began = now
            self._put(0.0)
        sent, until = b"", now - self._began
        for _ in range(_MOST_AT_ONCE):
            following = self._script.next(self._at)
            if following > until:
                break
            sent += model.advance(self._began + following)
            self._put(following)
        self._put(until)
        return sent + model.advance(now)

    def _put(self, time_s: float) -> None:
        """Only what changes is put there: what is pressed by hand stays until then."""
        self._at = time_s
        for name, (signal, own) in self._inputs.items():
            value = own.value(name, time_s)
            if value is not None and signal is not None and value != self._last[name]:
                self._last[name] = value
                self._levels[signal.channel] = signal.value(value)

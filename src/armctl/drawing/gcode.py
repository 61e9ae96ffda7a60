"""G-code read to strokes, strictly: G0 to G3 in the plane, millimetres or inches, absolute or relative.

The pen is down below Z = 0, or after M3 in a file that has M3; a file with neither draws with G1 to G3.
"""

from __future__ import annotations

import math
import re
from collections.abc import Set
from dataclasses import field

import numpy as np

from armctl.arrays import FloatArray
from armctl.drawing.strokes import LARGEST_MM, MOST_POINTS, PenDrawing
from armctl.drawing.svg_path import arc, flattened
from armctl.errors import DrawingError
from armctl.lazy_dataclass import dataclass

_COMMENT = re.compile(r"\([^()]*\)|[;%].*|\*[0-9]+\s*(?=$|[;(])")
"""and the sum at the end of a line by which a machine checks it"""
_WORD = re.compile(r"\s*([A-Za-z])\s*(?:([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))|(?=[A-Za-z]|$))")
"""a letter and its number, or a bare letter"""
_MOTIONS = {0.0: 0, 1.0: 1, 2.0: 2, 3.0: 3}
_PASSED_OVER_G = (17.0, 40.0, 49.0, 54.0, 61.0, 64.0, 80.0, 94.0)
_WAITS_G, _SETS_ORIGIN_G, _GOES_HOME_G = 4.0, 92.0, (28.0, 30.0)
_HOMES = re.compile(rf"[Gg]\s*({'|'.join(f'{code:g}' for code in _GOES_HOME_G)})(?![0-9.])")
_PASSED_OVER_M = (0.0, 1.0, 2.0, 6.0, 7.0, 8.0, 9.0, 30.0)
_ENDS = (2.0, 30.0)
_LETTERS = "GMXYZIJRFSTNOPK"
_MOST_LINES = 200_000
_SAME_RADIUS, _SAME_RADIUS_MM = 0.01, 0.05
"""by how much the two ends of an arc may differ in their distance from its middle"""
_PLAIN = np.eye(2, 3)
_PEN_BY_M, _PEN_BY_Z = re.compile(r"[Mm]\s*0*[34](?![0-9.])"), re.compile(r"[Zz]")
_LIFTED_MM = 1.0
"""until the first Z of a file that has one"""


@dataclass(eq=False)
class _Machine:
    """What is in force from line to line."""

    by_spindle: bool
    scale: float = 1.0
    relative: bool = False
    motion: int | None = None
    place: FloatArray = field(default_factory=lambda: np.zeros(2))
    """[mm]"""
    origin: FloatArray = field(default_factory=lambda: np.zeros(2))
    """where the file's X and Y are 0 [mm]"""
    height: float | None = None
    """None: the file has no Z"""
    spindle: bool = False
    current: list[FloatArray] = field(default_factory=list[FloatArray])
    begun: int = 0
    """line of the file where the present stroke begins"""
    lines: list[tuple[FloatArray, int]] = field(default_factory=list[tuple[FloatArray, int]])
    points: int = 0

    @property
    def down(self) -> bool:
        """Whether the pen is."""
        lifted = self.height is not None and self.height > 0.0
        return not lifted and (self.spindle if self.by_spindle else True)

    def lift(self) -> None:
        """The stroke is over."""
        if self.current:
            self.lines.append((np.concatenate(self.current), self.begun))
        self.current = []

    def go(self, points: FloatArray, line: int, *, draws: bool) -> None:
        """To points (k, 2) [mm], the first is where it stands."""
        if not np.abs(points).max() < LARGEST_MM:
            raise DrawingError(f"it lies more than {LARGEST_MM / 1000:g} m away")
        self.points += len(points)
        if self.points > MOST_POINTS:
            raise DrawingError(f"more than {MOST_POINTS} points up to here; simplify the drawing")
        if draws:
            if not self.current:
                self.current, self.begun = [points[:1]], line
            self.current.append(points[1:])
        else:
            self.lift()
        self.place = points[-1]


def read_gcode(text: str) -> PenDrawing:
    """The strokes of a G-code file [mm]. DrawingError: says the line and the word."""
    lines = text.splitlines()
    if len(lines) > _MOST_LINES:
        raise DrawingError(f"it has {len(lines)} lines; a drawing has {_MOST_LINES} at most")
    plain = [_COMMENT.sub("", line) for line in lines]
    machine = _Machine(any(map(_PEN_BY_M.search, plain)))
    if any(map(_PEN_BY_Z.search, plain)):
        machine.height = _LIFTED_MM
    for number, line in enumerate(plain, 1):
        try:
            if _obeyed(machine, _words(line), number):
                break
        except DrawingError as cause:
            raise cause.about(f"line {number}") from cause
    machine.lift()
    return PenDrawing.of(machine.lines)


def _words(line: str) -> list[tuple[str, float]]:
    words: list[tuple[str, float]] = []
    bare = "XYZ" if _HOMES.search(line) else ""
    at = 1 if line.startswith("/") else 0
    while match := _WORD.match(line, at):
        letter, number = match[1].upper(), match[2] or "0"
        if match[2] is None and letter not in bare:
            break
        if letter not in _LETTERS:
            raise DrawingError(f"the word {match[0].strip()[:20]!r} is not known here")
        if len(number) > 20:
            raise DrawingError(f"the number of {letter} is too long")
        words.append((letter, float(number)))
        at = match.end()
    if line[at:].strip():
        raise DrawingError(f"{line[at:].strip()[:20]!r} is no word of G-code")
    return words


def _obeyed(machine: _Machine, words: list[tuple[str, float]], line: int) -> bool:
    """Do what one line says; whether it ends the program."""
    values: dict[str, float] = {}
    codes = [value for letter, value in words if letter == "G"]
    ends = False
    for letter, value in words:
        if letter == "G":
            _set(machine, value)
        elif letter == "M":
            ends |= value in _ENDS
            if value in (3.0, 4.0, 5.0):
                machine.spindle = value != 5.0
            elif value not in _PASSED_OVER_M:
                raise DrawingError(f"M{value:g} is not known here")
        elif letter in values:
            raise DrawingError(f"{letter} stands twice")
        else:
            values[letter] = value
    if values.get("S") == 0.0 and machine.by_spindle:
        machine.spindle = False  # a laser, or a pen's servo, that is off
    if _SETS_ORIGIN_G in codes:
        _set_origin(machine, values)
    elif any(code in _GOES_HOME_G for code in codes):
        _go_home(machine, values.keys() & {"X", "Y", "Z"} or {"X", "Y", "Z"})
    elif _WAITS_G not in codes:
        _move(machine, values, line)
    if not machine.down:
        machine.lift()
    return ends


def _set(machine: _Machine, value: float) -> None:
    if value in _MOTIONS:
        machine.motion = _MOTIONS[value]
    elif value in (20.0, 21.0):
        machine.scale = 25.4 if value == 20.0 else 1.0
    elif value in (90.0, 91.0):
        machine.relative = value == 91.0
    elif value not in (_WAITS_G, _SETS_ORIGIN_G, *_GOES_HOME_G, *_PASSED_OVER_G):
        known = "G0 to G3, G20, G21, G28, G90, G91 and G92"
        raise DrawingError(f"G{value:g} is not known here; known are {known}")


def _set_origin(machine: _Machine, values: dict[str, float]) -> None:
    """G92: what the file calls the present place from now on; Z 0 is on the paper after it, too."""
    for axis, letter in enumerate("XY"):
        if letter in values:
            machine.origin[axis] = machine.place[axis] - values[letter] * machine.scale
    if "Z" in values:
        machine.height = values["Z"] * machine.scale


def _go_home(machine: _Machine, axes: Set[str]) -> None:
    """G28: to where these ``axes`` of the machine itself are 0, whatever the file calls that place.

    Nothing is drawn on the way. Where Z is one of them, the pen is up then.
    """
    machine.lift()
    machine.place = np.where([axis in axes for axis in "XY"], 0.0, machine.place)
    if "Z" in axes and machine.height is not None:
        machine.height = _LIFTED_MM


def _move(machine: _Machine, values: dict[str, float], line: int) -> None:
    if not values.keys() & {"X", "Y", "Z", "I", "J", "R"}:
        return
    if machine.motion is None:
        raise DrawingError("a place without G0, G1, G2 or G3 before it")
    was_down = machine.down
    if "Z" in values:
        below = (machine.height or 0.0) if machine.relative else 0.0
        machine.height = below + values["Z"] * machine.scale
    end = machine.place.copy()
    for axis, letter in enumerate("XY"):
        if letter in values:
            value = values[letter] * machine.scale
            end[axis] = value + (end if machine.relative else machine.origin)[axis]
    draws = machine.motion > 0 and was_down and machine.down
    turns = machine.motion in (2, 3)
    if not turns and values.keys() & {"I", "J"}:
        raise DrawingError("I and J go with G2 and G3 only")
    if turns and values.keys() & {"X", "Y", "I", "J", "R"}:
        machine.go(_arc(machine, values, end), line, draws=draws)
    elif (end != machine.place).any():
        machine.go(np.stack([machine.place, end]), line, draws=draws)


def _arc(machine: _Machine, values: dict[str, float], end: FloatArray) -> FloatArray:
    """(k, 2) points of G2 (clockwise) or G3 [mm]."""
    start, clockwise = machine.place, machine.motion == 2
    offset = np.array([values.get("I", 0.0), values.get("J", 0.0)]) * machine.scale
    if "R" in values:
        if values.keys() & {"I", "J"}:
            raise DrawingError("an arc has either R or I and J, not both")
        offset = _from_radius(start, end, values["R"] * machine.scale, clockwise=clockwise)
    middle = start + offset
    radius, other = math.hypot(*offset), math.hypot(*(end - middle))
    if radius < 1e-6:
        raise DrawingError("an arc needs its middle by I and J, or its radius by R")
    if abs(radius - other) > _SAME_RADIUS_MM + _SAME_RADIUS * radius:
        raise DrawingError(
            f"the arc begins {radius:.3f} mm and ends {other:.3f} mm from its middle; these must be the same"
        )
    begin, to = (math.atan2(*(point - middle)[::-1]) for point in (start, end))
    sweep = (to - begin) % (2.0 * math.pi)
    if clockwise:
        sweep -= 2.0 * math.pi
    if abs(sweep) < 1e-9:  # begin and end are one place, but for rounding
        sweep = -2.0 * math.pi if clockwise else 2.0 * math.pi
    round_arc = arc(middle, np.array([radius, 0.0]), np.array([0.0, radius]), begin, sweep)

    def at(t: FloatArray) -> FloatArray:
        # what the two radii differ by is spread over the arc
        return middle + (round_arc(t) - middle) * (1.0 + (other / radius - 1.0) * t[:, None])

    return flattened(at, _PLAIN)


def _from_radius(start: FloatArray, end: FloatArray, radius: float, *, clockwise: bool) -> FloatArray:
    """From the start to the middle of the arc; of a negative radius it is the longer one."""
    half = 0.5 * (end - start)
    far = math.hypot(*half)
    if far < 1e-6:
        raise DrawingError("an arc by R needs another end than its start; a whole circle needs I and J")
    if abs(radius) < far * (1.0 - _SAME_RADIUS):
        raise DrawingError(f"an arc of R = {radius:g} mm cannot span {2.0 * far:.3f} mm")
    rise = math.sqrt(max(radius**2 - far**2, 0.0)) / far
    left = clockwise == (radius < 0.0)
    return half + (rise if left else -rise) * np.array([-half[1], half[0]])

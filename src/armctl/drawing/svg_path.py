"""What an SVG path and the basic shapes draw, as points: the grammar of SVG 1.1, read strictly.

Curves are kept as functions of a parameter until their transform is known: how fine they are cut depends on
how large they are drawn.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator

import numpy as np

from armctl.arrays import FloatArray
from armctl.drawing.strokes import MOST_POINTS, MOST_TURN, TOLERANCE_MM
from armctl.errors import DrawingError
from armctl.lazy_dataclass import dataclass

NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]{1,4})?"
_PATH_TOKEN = re.compile(rf"[\s,]*(?:([MmZzLlHhVvCcSsQqTtAa])|({NUMBER}))")
_NUMBERS = re.compile(rf"[\s,]*({NUMBER})")
_FLAG = re.compile(r"[\s,]*([01])")
_REST = re.compile(r"[\s,]*")
_TRANSFORM = re.compile(r"[\s,]*(matrix|translate|scale|rotate|skewX|skewY)\s*\(([^()]*)\)")
_LENGTH = re.compile(rf"\s*({NUMBER})\s*(px|pt|pc|mm|cm|in|q|Q|%)?\s*")
MM_PER_PX = 25.4 / 96
UNITS_PX = {
    **{"px": 1.0, "pt": 4 / 3, "pc": 16.0, "in": 96.0},
    **{"mm": 96 / 25.4, "cm": 960 / 25.4, "q": 24 / 25.4, "Q": 24 / 25.4},
}
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_FIRST_CUTS, _MOST_CUTS = 8, 4096
MOST_SEGMENTS = 50_000
"""of one path"""

Segment = Callable[[FloatArray], FloatArray]
"""points (k, 2) at parameters (k,), 0 … 1"""


@dataclass(frozen=True, eq=False)
class OutlinePiece:
    """One piece of a line: straight, or the image of 0 … 1."""

    end: FloatArray
    """(2,)"""
    at: Segment | None = None
    """None: straight to the end"""


@dataclass(eq=False)
class Outline:
    """One line of an outline, in the user units of its element."""

    start: FloatArray
    """(2,)"""
    curves: list[OutlinePiece]

    def points(self, matrix: FloatArray) -> FloatArray:
        """(k, 2) of the line as the affine map ``matrix`` (2, 3) places it [mm]."""
        found = [_mapped(matrix, self.start[None])]
        for curve in self.curves:
            if curve.at is None:
                found.append(_mapped(matrix, curve.end[None]))
            else:
                found.append(flattened(curve.at, matrix)[1:])
        return np.concatenate(found)


def _mapped(matrix: FloatArray, points: FloatArray) -> FloatArray:
    return points @ matrix[:, :2].T + matrix[:, 2]


def flattened(at: Segment, matrix: FloatArray) -> FloatArray:
    """(k, 2) points [mm] of a curve, so near to each other that it stays within the tolerance of them.

    From one to the next it also turns by little, so that what turns by more is known to be a corner.
    """
    count = _FIRST_CUTS
    while True:
        points = _mapped(matrix, at(np.linspace(0.0, 1.0, count + 1)))
        steps = np.diff(points, axis=0)
        far = np.hypot(steps[:, 0], steps[:, 1])
        cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
        turn = np.abs(np.arctan2(cross, (steps[:-1] * steps[1:]).sum(axis=1)))
        longer = np.maximum(far[:-1], far[1:])
        coarse = (longer * turn / 8.0 > TOLERANCE_MM) | ((turn > MOST_TURN) & (longer > TOLERANCE_MM))
        if not coarse.any() or count >= _MOST_CUTS:
            return points
        count *= 2


def arc(center: FloatArray, x_axis: FloatArray, y_axis: FloatArray, begin: float, sweep: float) -> Segment:
    """An arc of an ellipse with two half axes (2,), from an angle over a ``sweep`` [rad]."""

    def at(t: FloatArray) -> FloatArray:
        angle = begin + sweep * t
        return center + np.cos(angle)[:, None] * x_axis + np.sin(angle)[:, None] * y_axis

    return at


def bezier(*controls: FloatArray) -> Segment:
    """A quadratic or a cubic one."""
    points, degree = np.array(controls), len(controls) - 1
    weights = np.array([math.comb(degree, k) for k in range(degree + 1)])

    def at(t: FloatArray) -> FloatArray:
        powers = np.arange(degree + 1)
        return (weights * t[:, None] ** powers * (1.0 - t[:, None]) ** powers[::-1]) @ points

    return at


def _elliptic(start: FloatArray, numbers: list[float], end: FloatArray) -> OutlinePiece:
    """The arc of a path: from its ends to its middle, as the specification has it (SVG 1.1, F.6)."""
    rx, ry, turned, large, sweeps = numbers[:5]
    rx, ry = abs(rx), abs(ry)
    if rx == 0.0 or ry == 0.0 or bool((start == end).all()):
        return OutlinePiece(end)
    cos, sin = math.cos(math.radians(turned)), math.sin(math.radians(turned))
    to_axes = np.array([[cos, sin], [-sin, cos]])
    x, y = (to_axes @ (start - end) / 2.0).tolist()
    grow = math.sqrt(max((x / rx) ** 2 + (y / ry) ** 2, 1.0))
    rx, ry = rx * grow, ry * grow
    over = (rx * ry) ** 2 - (rx * y) ** 2 - (ry * x) ** 2
    far = math.sqrt(max(over, 0.0) / ((rx * y) ** 2 + (ry * x) ** 2))
    far = -far if bool(large) == bool(sweeps) else far
    middle = np.array([far * rx * y / ry, -far * ry * x / rx])
    begin = math.atan2((y - middle[1]) / ry, (x - middle[0]) / rx)
    sweep = math.atan2((-y - middle[1]) / ry, (-x - middle[0]) / rx) - begin
    if sweeps and sweep < 0.0:
        sweep += 2.0 * math.pi
    elif not sweeps and sweep > 0.0:
        sweep -= 2.0 * math.pi
    center = to_axes.T @ middle + (start + end) / 2.0
    return OutlinePiece(end, arc(center, rx * to_axes[0], ry * to_axes[1], begin, sweep))


class _Reader:
    """The commands of a path, one after the other, with their numbers."""

    def __init__(self, text: str) -> None:
        self._text, self._at = text, 0

    def commands(self) -> Iterator[tuple[str, list[float]]]:
        """Each command with its numbers; numbers that follow on repeat it. DrawingError: what is none."""
        letter = ""
        while not self._ended():
            match = _PATH_TOKEN.match(self._text, self._at)
            if match is None:
                raise DrawingError(f"path data: {self._seen()} is no command and no number")
            if match[1]:
                letter, self._at = match[1], match.end()
            elif letter in ("", "Z", "z"):
                raise DrawingError(f"path data: the number {match[2][:20]} belongs to no command")
            yield letter, [self._number(letter, k) for k in range(_COUNTS[letter.upper()])]
            letter = {"M": "L", "m": "l"}.get(letter, letter)

    def _number(self, letter: str, place: int) -> float:
        flag = letter in "Aa" and place in (3, 4)
        match = (_FLAG if flag else _NUMBERS).match(self._text, self._at)
        if match is None:
            what = "a flag, 0 or 1," if flag else "a number"
            raise DrawingError(f"path data: {letter} needs {what} where it says {self._seen()}")
        self._at = match.end()
        return finite(match[1])

    def _ended(self) -> bool:
        rest = _REST.match(self._text, self._at)
        return rest is not None and rest.end() == len(self._text)

    def _seen(self) -> str:
        rest = self._text[self._at :].strip()[:20]
        return repr(rest) if rest else "nothing more"


def finite(text: str) -> float:
    """A number that is not too large."""
    value = float(text)
    if not abs(value) < 1e12:
        raise DrawingError(f"the number {text[:20]} is too large")
    return value


def path_outlines(text: str) -> list[Outline]:
    """The lines of path data. DrawingError: what is no path, or one of too many pieces."""
    outlines: list[Outline] = []
    here, begun, control, before = np.zeros(2), np.zeros(2), np.zeros(2), ""
    pieces = 0
    for letter, numbers in _Reader(text).commands():
        kind, relative = letter.upper(), letter.islower()
        pieces += 1
        if pieces > MOST_SEGMENTS:
            raise DrawingError(f"path data: more than {MOST_SEGMENTS} pieces")
        if not before and kind != "M":
            raise DrawingError(f"path data: it begins with {letter}; a path begins with M or m")
        origin = here if relative else np.zeros(2)
        if kind == "M":
            here = begun = origin + numbers
            outlines.append(Outline(here, []))
        elif kind == "Z":
            outlines[-1].curves.append(OutlinePiece(begun))
            here = begun
        else:
            if before == "Z":  # what follows begins where the closed one began
                outlines.append(Outline(begun, []))
            curve, control = _piece(kind, numbers, origin, here, control, before)
            outlines[-1].curves.append(curve)
            here = curve.end
        before = kind
    return [outline for outline in outlines if outline.curves]


def _piece(
    kind: str, numbers: list[float], origin: FloatArray, here: FloatArray, control: FloatArray, before: str
) -> tuple[OutlinePiece, FloatArray]:
    """One piece of a path, and its last control point, of which a smooth one after it makes its first."""
    if kind in "HV":
        end = here.copy()
        end["HV".index(kind)] = origin["HV".index(kind)] + numbers[0]
        return OutlinePiece(end), end
    if kind == "A":
        end = origin + numbers[5:]
        return _elliptic(here, numbers, end), end
    points = [origin + numbers[k : k + 2] for k in range(0, len(numbers), 2)]
    end = points[-1]
    if kind == "L":
        return OutlinePiece(end), end
    if kind in "ST":
        same = before in ("CS" if kind == "S" else "QT")
        points = [2.0 * here - control if same else here, *points]
    return OutlinePiece(end, bezier(here, *points)), points[-2]


# Basic shapes, as the outlines that SVG says they have.


def polygon(text: str, *, closed: bool) -> list[Outline]:
    """Of the ``points`` of a polyline or a polygon."""
    values = numbers_of(text)
    if len(values) % 2:
        raise DrawingError(f"points: {len(values)} numbers are no pairs")
    points = np.array(values).reshape(-1, 2)
    if len(points) > MOST_POINTS:
        raise DrawingError(f"points: {len(points)}; a drawing has {MOST_POINTS} at most")
    if len(points) < 2:
        return []
    return [Outline(points[0], [OutlinePiece(point) for point in (*points[1:], *points[: 1 * closed])])]


def ellipse(cx: float, cy: float, rx: float, ry: float) -> list[Outline]:
    """A whole one; none where a radius is 0."""
    if rx == 0.0 or ry == 0.0:
        return []
    middle, x, y = np.array([cx, cy]), np.array([rx, 0.0]), np.array([0.0, ry])
    return [Outline(middle + x, [OutlinePiece(middle + x, arc(middle, x, y, 0.0, 2.0 * math.pi))])]


def rectangle(x: float, y: float, width: float, height: float, rx: float, ry: float) -> list[Outline]:
    """With round corners where both radii are positive; none where a side is 0."""
    if width == 0.0 or height == 0.0:
        return []
    rx, ry = min(rx, width / 2), min(ry, height / 2)
    if rx == 0.0 or ry == 0.0:
        corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
        return [Outline(corners[0], [OutlinePiece(corner) for corner in (*corners[1:], corners[0])])]
    across, down = np.array([rx, 0.0]), np.array([0.0, ry])
    curves: list[OutlinePiece] = []
    for k, (dx, dy) in enumerate(((1, 0), (1, 1), (0, 1), (0, 0))):
        inset = np.array([rx if dx == 0 else width - rx, ry if dy == 0 else height - ry])
        middle, begin = np.array([x, y]) + inset, math.pi * (k - 1) / 2
        corner = arc(middle, across, down, begin, math.pi / 2)
        first, last = corner(np.array([0.0, 1.0]))
        curves += [OutlinePiece(first), OutlinePiece(last, corner)]
    start = np.array([x + rx, y])
    return [Outline(start, [*curves, OutlinePiece(start)])]


# Numbers, lengths and transforms.


def numbers_of(text: str) -> list[float]:
    """Numbers between blanks and commas. DrawingError: something else among them."""
    values: list[float] = []
    at = 0
    while match := _NUMBERS.match(text, at):
        values.append(finite(match[1]))
        at = match.end()
        if len(values) > 2 * MOST_POINTS:
            raise DrawingError(f"more than {2 * MOST_POINTS} numbers")
    if text[at:].strip(" \t\r\n\f,"):
        raise DrawingError(f"{text[at:].strip()[:20]!r} is not a number")
    return values


def length_px(text: str, whole: float) -> float:
    """A length with or without a unit, in user units; a percentage is of ``whole``."""
    match = _LENGTH.fullmatch(text)
    if match is None:
        raise DrawingError(f"{text[:20]!r} is no length; write a number, or one with px, mm, cm, in, pt or %")
    value, unit = finite(match[1]), match[2] or "px"
    return value * whole / 100.0 if unit == "%" else value * UNITS_PX[unit]


def transform_of(text: str) -> FloatArray:
    """(2, 3) of a ``transform``: the last of its parts is done first. DrawingError: what is none."""
    found, at = np.eye(3), 0
    while match := _TRANSFORM.match(text, at):
        found = found @ _transform(match[1], numbers_of(match[2]))
        at = match.end()
    if text[at:].strip(" \t\r\n\f,") or not np.abs(found).max() < 1e9:
        raise DrawingError(f"transform: {text[at:].strip()[:40]!r} is none, or too large")
    return found[:2]


def _transform(name: str, values: list[float]) -> FloatArray:
    allowed = {"matrix": (6,), "translate": (1, 2), "scale": (1, 2), "rotate": (1, 3)}.get(name, (1,))
    if len(values) not in allowed:
        counts = " or ".join(map(str, allowed))
        raise DrawingError(f"transform: {name} takes {counts} numbers, not {len(values)}")
    found, first = np.eye(3), values[0]
    if name == "matrix":
        found[:2] = np.array(values).reshape(3, 2).T
    elif name == "translate":
        found[:2, 2] = first, values[1] if len(values) == 2 else 0.0
    elif name == "scale":
        found[0, 0], found[1, 1] = first, values[-1]
    elif name == "rotate":
        cos, sin = math.cos(math.radians(first)), math.sin(math.radians(first))
        found[:2, :2] = [[cos, -sin], [sin, cos]]
        if len(values) == 3:
            middle = np.array(values[1:])
            found[:2, 2] = middle - found[:2, :2] @ middle
    else:
        found["XY".index(name[-1]), 1 - "XY".index(name[-1])] = math.tan(math.radians(first))
    return found

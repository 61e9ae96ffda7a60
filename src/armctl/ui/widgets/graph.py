"""The page's graph: lines, limits, marks, legend, cursor, zoom and pan. There is no other one.

It is a piece of HTML in a part of the page (``guard/parts.py``); what is done there comes back by the graph's
name. ``plot_html`` alone is one that only shows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from html import escape
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.lazy_dataclass import dataclass
from armctl.ui.widgets.html import button, fixed
from armctl.ui.widgets.number_field import parse_number, parse_numbers

SAMPLES = 241
"""of each line"""
_WIDE, _HIGH = 1000, 100
"""of the drawing, in its own units"""
_NEAREST_ZOOM, _ZOOM = 0.002, 1.5
"""the least share of the duration that is shown; by how much a press or a notch of the wheel changes it"""
_NOTCHES = 5.0
"""of a wheel at once, at most"""
_TOOLS = (
    ("in", "+", "Zoom in (wheel)"), ("out", "−", "Zoom out (wheel)"), ("all", "All", "Show all of it"),
)  # fmt: skip
_X_TICKS, TALL_TICKS = 5, 5
_LIMIT_DASH = "6 4"


@dataclass(frozen=True, slots=True, eq=False)
class PlotLine:
    """One line: ``y`` (k,), NaN where it has no value."""

    name: str
    y: FloatArray
    color: str
    dash: tuple[float, float] | None = None
    """lengths of dash and gap [px]; None: drawn through"""
    width: float = 1.6
    """[px]"""


class Bound(NamedTuple):
    """A limit, drawn as a dashed line with a band beyond it."""

    name: str
    value: float
    color: str
    is_upper: bool


class PlotMark(NamedTuple):
    """A point, drawn as a dot."""

    name: str
    x: float
    y: float
    color: str


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """One quantity, mostly over time."""

    x: FloatArray
    """(k,) ascending; a time [s], or in ``unit``"""
    lines: tuple[PlotLine, ...]
    bounds: tuple[Bound, ...] = ()
    marks: tuple[PlotMark, ...] = ()
    unit: str = " s"
    """behind the numbers below"""

    def at(self, x: FloatArray) -> Curves:
        """The same at other places (j,), on straight lines between its own."""
        lines = (replace(one, y=np.interp(x, self.x, one.y, right=np.nan)) for one in self.lines)
        return replace(self, x=x, lines=tuple(lines))


class PartsOfPage(Protocol):
    """What tells of what is done on a page's parts: its session."""

    def on_part(self, do: str, action: Callable[[str], None]) -> None:
        """Run ``action(key)`` where this is done."""
        ...

    def on_part_value(self, do: str, action: Callable[[str, str], None]) -> None:
        """Run ``action(key, value)`` where something is given a value."""
        ...


class Graph:
    """What of the time is in view, and where the cursor stands, both as shares of the duration."""

    def __init__(
        self,
        session: PartsOfPage,
        name: str,
        on_cursor: Callable[[float], None],
        draw: Callable[[], None],
        *,
        scrolls: bool = False,
        cursor: str = "Time of the motion",
    ) -> None:
        """``on_cursor``: the cursor was led to a share of the duration; ``draw``: something else changed.

        ``scrolls``: it is in a panel that scrolls, so the wheel zooms only once somebody has clicked in it.
        ``cursor``: what it chooses, for those who have it read aloud.
        """
        self._name, self._on_cursor, self._draw, self._cursor = name, on_cursor, draw, cursor
        self._held = " data-held" if scrolls else ""
        self.share = 1.0
        """where the cursor stands"""
        self.window = 0.0, 1.0
        """what is in view"""
        self.runs = False
        """the cursor goes with what runs now"""
        session.on_part(f"{name}-zoom", self._on_zoom)
        session.on_part_value(f"{name}-wheel", self._on_wheel)
        session.on_part_value(f"{name}-at", self._on_at)

    def reset(self) -> None:
        """Another motion: all of it is in view, the cursor stands at its end."""
        self.share, self.window, self.runs = 1.0, (0.0, 1.0), False

    def times(self, duration: float) -> FloatArray:
        """(k,) of what is in view of a motion of ``duration`` [s]."""
        low, high = self.window
        return np.linspace(low * duration, high * duration, SAMPLES)

    # What is done here.

    def _on_zoom(self, key: str) -> None:
        """About the cursor, where it is in view."""
        low, high = self.window
        middle = self.share if low <= self.share <= high else 0.5 * (low + high)
        if key in ("in", "out"):
            self._zoom(middle, 1 / _ZOOM if key == "in" else _ZOOM)
        else:
            self.window = 0.0, 1.0
        self._draw()

    def _on_wheel(self, _: str, value: str) -> None:
        """``value``: where the wheel was turned, of the width, and its notches down and to the right."""
        try:
            at, down, right = parse_numbers(value, "the wheel", ("at", "down", "right"))
        except ArmctlError:  # no page of armctl's
            return
        low, high = self.window
        if right:
            self._pan(min(max(right, -_NOTCHES), _NOTCHES) * 0.1 * (high - low))
        if down:
            notches = min(max(down, -_NOTCHES), _NOTCHES)
            self._zoom(low + min(max(at, 0.0), 1.0) * (high - low), _ZOOM**notches)
        self._draw()

    def _zoom(self, about: float, factor: float) -> None:
        low, high = self.window
        size = min(max(factor * (high - low), _NEAREST_ZOOM), 1.0)
        low = about - size * (about - low) / (high - low)
        low = min(max(low, 0.0), 1.0 - size)
        self.window = low, low + size

    def _pan(self, by: float) -> None:
        low, high = self.window
        by = min(max(by, -low), 1.0 - high)
        self.window = low + by, high + by

    def _on_at(self, _: str, value: str) -> None:
        try:
            share = parse_number(value, "the cursor") / _WIDE
        except ArmctlError:  # no page of armctl's
            return
        low, high = self.window
        self._on_cursor(low + min(max(share, 0.0), 1.0) * (high - low))

    # What is shown.

    def tools(self) -> str:
        """The buttons that zoom."""
        why = "all of it is in view" if self.window == (0.0, 1.0) else None
        return "".join(
            button(
                f"{self._name}-zoom",
                label,
                key=key,
                title=title,
                kind="tool",
                icon=key,
                why=None if key == "in" else why,
            )
            for key, label, title in _TOOLS
        )

    def plot(self, curves: Curves, of: str, ticks: int, speed: float = 1.0, under: str = "") -> str:
        """What is in view, with about so many numbers at its side. ``of``: what it is the graph of.

        ``speed`` and ``under`` as in ``plot_html``.
        """
        begin, end = self.window
        here = (self.share - begin) / (end - begin)
        at = round(_WIDE * min(max(here, 0.0), 1.0))
        over = (
            f"<input type='range' min='0' max='{_WIDE}' value='{at}' data-set='{self._name}-at' "
            f"aria-label='{escape(self._cursor)}: {escape(of)}'>"
        )
        wheel = f" data-wheel='{self._name}-wheel'{self._held}"
        return plot_html(
            curves, ticks, here, speed=speed, wheel=wheel, over=over, under=under, runs=self.runs
        )


def graph_html(graph: Graph, curves: Curves, heading: str, play: str = "") -> str:
    """A graph with its heading, zoom and legend. ``curves`` are all that there is.

    ``play``: a button that stands with those that zoom.
    """
    begin, end = float(curves.x[0]), float(curves.x[-1])
    if end <= begin:
        return f"<p class='plot'>{escape(heading)}: the motion ends where it begins.</p>"
    here = curves.at(np.array([begin + graph.share * (end - begin)]))
    values = [float(line.y[0]) for line in here.lines]
    low, high = graph.window
    view = curves.at(begin + np.linspace(low, high, SAMPLES) * (end - begin))
    return (
        f"<header><b>{escape(heading)}</b>{play}{graph.tools()}</header>"
        f"<div class='legend'>{legend(curves.lines, values, curves.bounds, curves.marks)}</div>"
        f"{graph.plot(view, heading, TALL_TICKS)}"
    )


def plot_html(
    curves: Curves,
    ticks: int,
    cursor: float | None = None,
    *,
    speed: float = 1.0,
    wheel: str = "",
    over: str = "",
    under: str = "",
    runs: bool = False,
) -> str:
    """The drawing, with about so many numbers at its side; the ends of x have to be apart.

    ``cursor``: where it stands, as a share of the width. ``speed``: the present override; the times that are
    written are those with it. ``wheel``: attributes of what the wheel turns. ``over``, ``under``: HTML over
    the drawing, and between drawing and numbers. ``runs``: the cursor is where something is now.
    """
    low, high = _range(curves)
    levels = _ticks(low, high, ticks)
    line = ""
    if cursor is not None and 0.0 <= cursor <= 1.0:
        line = f"<i class='cursor{' runs' * runs}' style='left:{100 * cursor:.1f}%'></i>"
    sides = "".join(
        f"<small style='top:{100 * (high - level) / (high - low):.1f}%'>{text}</small>"
        for level, text in levels
    )
    first, last = float(curves.x[0]), float(curves.x[-1])
    below = "".join(
        f"<small style='left:{100 * (x * speed - first) / (last - first):.1f}%'>{text}{curves.unit}</small>"
        for x, text in _ticks(first / speed, last / speed, _X_TICKS)
    )
    return (
        f"<div class='plot'{wheel}>{sides}"
        f"<svg viewBox='0 0 {_WIDE} {_HIGH}' preserveAspectRatio='none' aria-hidden='true'>"
        f"{_drawn(curves, low, high, [level for level, _ in levels])}</svg>"
        f"{line}{over}</div>{under}<div class='times'>{below}</div>"
    )


def legend(
    lines: Sequence[PlotLine],
    here: Sequence[float],
    bounds: Sequence[Bound] = (),
    marks: Sequence[PlotMark] = (),
    unit: str = "",
) -> str:
    """What each line is, its value at the cursor, and what limits and marks are."""
    names = "".join(
        f"<span>{_swatch(line.color, '' if line.dash is None else 'dashed')}{escape(line.name)} "
        f"<b>{fixed(value, 1)}</b>{escape(unit)}</span>"
        for line, value in zip(lines, here, strict=True)
    )
    limits = (f"<span>{_swatch(one.color, 'dashed')}{escape(one.name)}</span>" for one in bounds)
    dots = (f"<span>{_swatch(one.color, 'dot')}{escape(one.name)}</span>" for one in marks)
    return names + "".join([*limits, *dots])


def _swatch(color: str, kind: str = "") -> str:
    return f"<i{f' class={kind}' if kind else ''} style='--of:{color}'></i>"


def thinned(count: int, most: int) -> NDArray[np.int64]:
    """At most ``most`` indices of ``count`` points: evenly spread, with both ends."""
    return np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)


def _range(curves: Curves) -> tuple[float, float]:
    """Bottom and top of a drawing, with a margin."""
    first, last = float(curves.x[0]), float(curves.x[-1])
    values = [bound.value for bound in curves.bounds]
    values += [mark.y for mark in curves.marks if first <= mark.x <= last]
    known = np.concatenate([values, *(line.y for line in curves.lines)])
    known = known[np.isfinite(known)]
    if len(known) == 0:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    margin = 0.06 * (high - low) or max(0.05 * abs(high), 1e-3)
    return low - margin, high + margin


def _drawn(curves: Curves, low: float, high: float, levels: Sequence[float]) -> str:
    """Grid, bands beyond the limits, and lines."""

    def up(value: FloatArray) -> FloatArray:
        return _HIGH * (high - value) / (high - low)

    grid = "".join(f"<path class='grid' d='M0,{y:.1f}H{_WIDE}'/>" for y in up(np.array(levels)).tolist())
    bands = ""
    for bound in curves.bounds:
        y = float(up(np.array(bound.value)))
        top, height = (0.0, y) if bound.is_upper else (y, _HIGH - y)
        bands += (
            f"<rect y='{top:.1f}' width='{_WIDE}' height='{height:.1f}' fill='{bound.color}'/>"
            f"<path stroke='{bound.color}' stroke-width='1.2' stroke-dasharray='{_LIMIT_DASH}' "
            f"d='M0,{y:.1f}H{_WIDE}'/>"
        )
    first, last = float(curves.x[0]), float(curves.x[-1])
    x = _WIDE * (curves.x - first) / (last - first)
    paths = ""
    for line in curves.lines:
        dash = "" if line.dash is None else f" stroke-dasharray='{line.dash[0]:g} {line.dash[1]:g}'"
        known = np.flatnonzero(np.isfinite(line.y))
        runs = np.split(known, np.flatnonzero(np.diff(known) > 1) + 1) if len(known) else []
        points = "M".join(
            " ".join(f"{a:.0f},{b:.1f}" for a, b in zip(x[run], up(line.y[run]), strict=True)) for run in runs
        )
        if points:
            paths += f"<path stroke='{line.color}' stroke-width='{line.width:g}'{dash} d='M{points}'/>"
    for mark in curves.marks:
        at, y = _WIDE * (mark.x - first) / (last - first), float(up(np.array(mark.y)))
        paths += f"<path class='mark' stroke='{mark.color}' d='M{at:.1f},{y:.1f}h.01'/>"
    return grid + bands + paths


def _ticks(low: float, high: float, count: int) -> list[tuple[float, str]]:
    """About ``count`` round values between two, and how they are written."""
    step = round_step((high - low) / count)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [(step * k, fixed(step * k, digits)) for k in range(first, last + 1)]


def round_step(rough: float) -> float:
    """The least of 1, 2, 5, 10, 20 … that is no less than ``rough``."""
    power = 10.0 ** math.floor(math.log10(rough))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough)

"""Line plots with readable axes: title and unit above, one colour a line, legend below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

FloatArray = NDArray[np.float64]
COLORS = ("#1971c2", "#e8590c", "#2f9e44", "#9c36b5", "#f08c00", "#0c8599", "#5c940d", "#495057")
_HEIGHT = 250
_LABEL_FONT = "12px sans-serif"


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """One line: ``y`` (k,), NaN where it has no value. A mark is drawn as dots only."""

    name: str
    y: FloatArray
    color: str
    mark: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What a plot shows."""

    title: str
    x_label: str
    x: FloatArray
    """(k,) ascending"""
    lines: tuple[Line, ...]


class LinePlot:
    """One plot; made when there is something to show, and made anew when its lines are others."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self._gui = gui
        self._place = gui.add_folder(None)
        self._handle: viser.GuiUplotHandle | None = None
        self._heads: tuple[object, ...] = ()

    def show(self, picture: Picture) -> None:
        """Draw a picture."""
        data = (picture.x, *(line.y for line in picture.lines))
        heads = (
            picture.title,
            picture.x_label,
            span(picture.lines),
            *((line.name, line.color) for line in picture.lines),
        )
        if self._handle is not None and heads == self._heads:
            self._handle.data = data
            return
        self.clear()
        self._heads = heads
        with self._place:
            self._handle = self._gui.add_uplot(
                data,
                ({"label": picture.x_label}, *(_series(line) for line in picture.lines)),
                title=picture.title,
                scales={"x": {"time": False}, "y": {"auto": False, "range": span(picture.lines)}},
                axes=(
                    {"label": picture.x_label, "labelSize": 22, "labelFont": _LABEL_FONT, "size": 32},
                    {"size": 54},
                ),
                cursor={"points": {"show": False}},  # they would be drawn astray where a value is NaN
                height=_HEIGHT,
            )

    def clear(self) -> None:
        """Show nothing."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None
            self._heads = ()


def span(lines: Sequence[Line]) -> tuple[float, float]:
    """Bottom and top of a plot, with a margin; given, because uPlot finds none where a value is NaN."""
    low = min((float(np.fmin.reduce(line.y)) for line in lines), default=0.0)
    high = max((float(np.fmax.reduce(line.y)) for line in lines), default=1.0)
    if not (np.isfinite(low) and np.isfinite(high)):
        return 0.0, 1.0
    margin = 0.06 * (high - low) or max(0.05 * abs(high), 1e-3)
    return low - margin, high + margin


def thinned(count: int, most: int, keep: Sequence[int] = ()) -> NDArray[np.int64]:
    """About ``most`` indices of ``count`` points: evenly spread, both ends, and those to ``keep``."""
    even = np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)
    return np.unique(np.concatenate([even, np.array(keep, dtype=np.int64)]))


def _series(line: Line) -> uplot.Series:
    if line.mark:
        return {
            "label": line.name,
            "stroke": line.color,
            "width": 0,
            "points": {"show": True, "size": 9, "fill": line.color, "stroke": line.color},
        }
    return {"label": line.name, "stroke": line.color, "width": 1.6, "pxAlign": 0.0, "points": {"show": False}}

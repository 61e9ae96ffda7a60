"""Line plots with readable axes: title and unit above, one colour a line, legend below."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from armctl.arrays import FloatArray

_HEIGHT, _LIVE_HEIGHT = 250, 200
_PADDING = (10, 12, 0, 0)
"""top, right, bottom, left [px]: room for half of the outermost numbers"""
_FONT, _LABEL_FONT = "11px sans-serif", "12px sans-serif"
"""as those of the graph (``graph.py``)"""


@dataclass(frozen=True, slots=True, eq=False)
class PlotLine:
    """One line: ``y`` (k,), NaN where it has no value. A mark is drawn as dots only."""

    name: str
    y: FloatArray
    color: str
    dash: tuple[float, float] | None = None
    """lengths of dash and gap [px]; None: drawn through"""
    width: float = 1.6
    """[px]"""
    mark: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """What a plot shows."""

    title: str
    x_label: str
    x: FloatArray
    """(k,) ascending"""
    lines: tuple[PlotLine, ...]


class LinePlot:
    """One plot; made when there is something to show, and made anew when its lines are others."""

    def __init__(self, gui: viser.GuiApi, y_label: str | None = None) -> None:
        """With ``y_label`` it is live: small, fitted by the page, with neither title nor legend."""
        self._gui, self._live = gui, y_label is not None
        self._y_axis: uplot.Axis = {"size": 54, "font": _FONT}
        if y_label is not None:
            self._y_axis |= {
                "label": y_label, "size": 42, "labelSize": 18, "labelGap": 0, "labelFont": _LABEL_FONT,
            }  # fmt: skip
        self._place = gui.add_folder(None)
        self._handle: viser.GuiUplotHandle | None = None
        self._heads: tuple[object, ...] = ()

    def show(self, picture: Picture) -> None:
        """Draw a picture."""
        data = (picture.x, *(line.y for line in picture.lines))
        heads: tuple[uplot.Series, ...] = (
            {"label": picture.x_label},
            *(_series(line) for line in picture.lines),
        )
        # No fixed range where it is live: the page fits it anew only when the ends of x move with the data.
        y_scale: uplot.Scale = {"auto": True} if self._live else {"auto": False, "range": span(picture.lines)}
        key = (picture.title, y_scale, heads)
        if self._handle is not None and key == self._heads:
            self._handle.data = data
            return
        self.clear()
        self._heads = key
        x_axis: uplot.Axis = {
            "label": picture.x_label, "labelSize": 22, "labelFont": _LABEL_FONT, "size": 32, "font": _FONT,
        }  # fmt: skip
        with self._place:
            self._handle = self._gui.add_uplot(
                data,
                heads,
                title=picture.title or None,
                scales={"x": {"time": False}, "y": y_scale},
                axes=(x_axis, self._y_axis),
                cursor={"points": {"show": self._live}},  # they would be drawn astray where a value is NaN
                legend={"show": not self._live},
                height=_LIVE_HEIGHT if self._live else _HEIGHT,
                padding=_PADDING,
            )

    def clear(self) -> None:
        """Show nothing."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None


def span(lines: Sequence[PlotLine]) -> tuple[float, float]:
    """Bottom and top of a plot, with a margin; given, because uPlot finds none where a value is NaN."""
    low = min((float(np.fmin.reduce(line.y)) for line in lines), default=0.0)
    high = max((float(np.fmax.reduce(line.y)) for line in lines), default=1.0)
    if not (np.isfinite(low) and np.isfinite(high)):
        return 0.0, 1.0
    margin = 0.06 * (high - low) or max(0.05 * abs(high), 1e-3)
    return low - margin, high + margin


def upright(x: FloatArray, at: float, bottom: float, top: float) -> FloatArray:
    """A line's values (k,) that draw an upright line at ``at``: from one point of ``x`` (k,) to the next."""
    y = np.full(len(x), np.nan)
    k = min(int(np.searchsorted(x, at)), len(x) - 2)
    y[k : k + 2] = bottom, top
    return y


def thinned(count: int, most: int, keep: Sequence[int] = ()) -> NDArray[np.int64]:
    """About ``most`` indices of ``count`` points: evenly spread, both ends, and those to ``keep``."""
    even = np.linspace(0, count - 1, min(count, most)).round().astype(np.int64)
    return np.unique(np.concatenate([even, np.array(keep, dtype=np.int64)]))


def _series(line: PlotLine) -> uplot.Series:
    series: uplot.Series = {"label": line.name, "stroke": line.color, "width": 0 if line.mark else line.width}
    if line.mark:
        series["points"] = {"show": True, "size": 9, "fill": line.color, "stroke": line.color}
        return series
    series |= {"pxAlign": 0.0, "points": {"show": False}}
    if line.dash is not None:
        series["dash"] = line.dash
    return series

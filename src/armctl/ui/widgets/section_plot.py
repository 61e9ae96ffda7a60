"""The section of the workspace as a drawing to scale: height over the distance from the base axis, in mm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
_WIDTH, _TALLEST = 400.0, 330.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 10.0, 8.0, 36.0
_TICKS = 8
_GRID = "stroke='currentColor' stroke-opacity='.15'"
_AXIS_TEXT = "font-size='11' fill='currentColor' fill-opacity='.75'"


@dataclass(frozen=True, slots=True, eq=False)
class SectionPicture:
    """What is drawn, in mm: across (from the base axis) and up."""

    outline: tuple[FloatArray, ...]
    """closed lines (k, 2)"""
    tip: tuple[float, float]
    arm: FloatArray
    """(k, 2) joints and tip of the arm as it stands"""
    floor: float | None
    """height of the floor; None where the plane is not upright"""


class _Scale:
    """From mm to the drawing's own units, the same across and up."""

    def __init__(self, picture: SectionPicture) -> None:
        corners = np.concatenate([*picture.outline, picture.arm, [picture.tip]])
        if picture.floor is not None:
            corners = np.concatenate([corners, [[corners[0, 0], picture.floor]]])
        low, high = corners.min(axis=0), corners.max(axis=0)
        margin = 0.05 * float((high - low).max())
        self.low, self.high = low - margin, high + margin
        across, up = (self.high - self.low).tolist()
        self.unit = min((_WIDTH - _LEFT - _RIGHT) / across, (_TALLEST - _TOP - _BOTTOM) / up)
        # a narrow section gets more room to its sides, so that the drawing fills its width
        spare = (_WIDTH - _LEFT - _RIGHT) / self.unit - across
        self.low[0] -= 0.5 * spare
        self.high[0] += 0.5 * spare
        self.height = _TOP + _BOTTOM + self.unit * up

    def x(self, value: float) -> float:
        return round(_LEFT + self.unit * (value - float(self.low[0])), 1)

    def y(self, value: float) -> float:
        return round(_TOP + self.unit * (float(self.high[1]) - value), 1)

    def points(self, line: FloatArray) -> str:
        return " ".join(f"{self.x(x):g},{self.y(y):g}" for x, y in line.tolist())


def section_svg(picture: SectionPicture) -> str:
    """The drawing as SVG: what is reached, the floor, the base axis, the arm and its tip."""
    scale = _Scale(picture)
    left, right = _LEFT, _WIDTH - _RIGHT
    top, bottom = _TOP, scale.height - _BOTTOM
    reached = " ".join(f"M{scale.points(line)}Z" for line in picture.outline)
    parts = [
        f"<svg class='section-plot' viewBox='0 0 {_WIDTH:g} {scale.height:.0f}' "
        "style='width:100%;display:block' role='img' aria-label='Section of the workspace'>",
        *_grid(scale, left, right, top, bottom),
        f"<path d='{reached}' fill='#1971c2' fill-opacity='.16' fill-rule='evenodd' "
        "stroke='#e03131' stroke-width='1.6' stroke-linejoin='round'/>",
    ]
    if picture.floor is not None:
        level = scale.y(picture.floor)
        parts += [
            f"<rect x='{left:g}' y='{level:g}' width='{right - left:g}' "
            f"height='{max(bottom - level, 0):.1f}' fill='#868e96' fill-opacity='.30'/>",
            f"<line x1='{left:g}' x2='{right:g}' y1='{level:g}' y2='{level:g}' stroke='#868e96' "
            "stroke-width='2'/>",
            f"<text x='{right - 3:g}' y='{level - 4:g}' text-anchor='end' {_AXIS_TEXT}>floor</text>",
        ]
    x, y = scale.x(picture.tip[0]), scale.y(picture.tip[1])
    parts += [
        f"<polyline points='{scale.points(picture.arm)}' fill='none' stroke='currentColor' "
        "stroke-opacity='.55' stroke-width='3' stroke-linejoin='round' stroke-linecap='round'/>",
        f"<circle cx='{x:g}' cy='{y:g}' r='5' fill='#e8590c' stroke='white' stroke-width='1.5'/>",
        "</svg>",
    ]
    return "".join(parts)


def _grid(scale: _Scale, left: float, right: float, top: float, bottom: float) -> list[str]:
    step = _nice(float((scale.high - scale.low).max()) / _TICKS)
    parts: list[str] = []
    for value in _ticks(float(scale.low[0]), float(scale.high[0]), step):
        x = scale.x(value)
        parts.append(f"<line x1='{x:g}' x2='{x:g}' y1='{top:g}' y2='{bottom:.1f}' {_GRID}/>")
        parts.append(
            f"<text x='{x:g}' y='{bottom + 14:.1f}' text-anchor='middle' {_AXIS_TEXT}>{_label(value)}</text>"
        )
    for value in _ticks(float(scale.low[1]), float(scale.high[1]), step):
        y = scale.y(value)
        parts.append(f"<line x1='{left:g}' x2='{right:g}' y1='{y:g}' y2='{y:g}' {_GRID}/>")
        parts.append(
            f"<text x='{left - 5:g}' y='{y + 4:g}' text-anchor='end' {_AXIS_TEXT}>{_label(value)}</text>"
        )
    axis = scale.x(0.0)
    parts.append(
        f"<line x1='{axis:g}' x2='{axis:g}' y1='{top:g}' y2='{bottom:.1f}' stroke='currentColor' "
        "stroke-opacity='.5' stroke-dasharray='2 4'/>"
    )
    middle, across = 0.5 * (top + bottom), 0.5 * (left + right)
    parts += [
        f"<text x='{across:g}' y='{bottom + 30:.1f}' text-anchor='middle' {_AXIS_TEXT}>r mm</text>",
        f"<text x='12' y='{middle:.1f}' text-anchor='middle' {_AXIS_TEXT} "
        f"transform='rotate(-90 12 {middle:.1f})'>z mm</text>",
    ]
    return parts


def _ticks(low: float, high: float, step: float) -> list[float]:
    return [step * k for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _nice(step: float) -> float:
    """The next larger of 1, 2, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= step)


def _label(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def to_mm(lines: Sequence[FloatArray], rise_m: float) -> tuple[FloatArray, ...]:
    """Lines (k, 2) [m] in mm, lifted by the height of the plane's origin [m]."""
    return tuple(1000 * (line + np.array([0.0, rise_m])) for line in lines)

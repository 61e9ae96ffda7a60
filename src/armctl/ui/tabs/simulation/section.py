"""The section of the workspace, drawn to scale: height over the distance from the base axis, in mm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armctl.arrays import FloatArray
from armctl.robot import Robot

_WIDTH, _TALLEST = 400.0, 330.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 10.0, 8.0, 36.0
_TICKS = 8
_GRID = "stroke='currentColor' stroke-opacity='.15'"
_AXIS_TEXT = "font-size='11' fill='currentColor' fill-opacity='.75'"
_UPRIGHT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class SectionPicture:
    """All lines and points in mm: across (from the base axis) and up."""

    outline: tuple[FloatArray, ...]
    """closed lines (k, 2)"""
    tip: tuple[float, float]
    arm: FloatArray
    """(k, 2) joints and tip of the arm as it stands"""
    floor: float | None
    """height of the floor; None where the plane is not upright"""


def picture_of(
    robot: Robot, T_base_plane: FloatArray, outline: tuple[FloatArray, ...], q: FloatArray
) -> SectionPicture:
    """The section with the arm at ``q`` (n,) [rad] in it.

    Args:
        robot: the arm.
        T_base_plane: (4, 4) the plane of the section, metres.
        outline: closed lines (k, 2) in x and z of the plane [m].
        q: (n,) joint angles [rad].
    """
    rise = np.array([0.0, T_base_plane[2, 3]])
    points = (robot.frames(q)[:, :3, 3] - T_base_plane[:3, 3]) @ T_base_plane[:3, :3]
    arm = 1000 * (points[:, [0, 2]] + rise)
    upright = float(T_base_plane[2, 2]) > 1 - _UPRIGHT
    return SectionPicture(
        outline=tuple(1000 * (line + rise) for line in outline),
        tip=(float(arm[-1, 0]), float(arm[-1, 1])),
        arm=arm,
        floor=1000 * robot.floor_z if upright else None,
    )


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
    """The drawing as SVG: the boundary of the reach, the floor, the base axis, the arm and its tip."""
    scale = _Scale(picture)
    right, bottom = _WIDTH - _RIGHT, scale.height - _BOTTOM
    reached = " ".join(f"M{scale.points(line)}Z" for line in picture.outline)
    parts = [
        f"<svg class='section-plot' viewBox='0 0 {_WIDTH:g} {scale.height:.0f}' "
        "style='width:100%;display:block' role='img' aria-label='Section of the workspace'>",
        *_grid(scale, right, bottom),
        f"<path d='{reached}' fill='#1971c2' fill-opacity='.16' fill-rule='evenodd' "
        "stroke='#e03131' stroke-width='1.6' stroke-linejoin='round'/>",
    ]
    if picture.floor is not None:
        level = scale.y(picture.floor)
        parts += [
            f"<rect x='{_LEFT:g}' y='{level:g}' width='{right - _LEFT:g}' "
            f"height='{max(bottom - level, 0):.1f}' fill='#868e96' fill-opacity='.30'/>",
            f"<line x1='{_LEFT:g}' x2='{right:g}' y1='{level:g}' y2='{level:g}' stroke='#868e96' "
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


def _grid(scale: _Scale, right: float, bottom: float) -> list[str]:
    """Grid lines with their numbers, the base axis, and the names of the axes."""
    rough = float((scale.high - scale.low).max()) / _TICKS
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= rough)

    def ticks(axis: int) -> list[float]:
        low, high = float(scale.low[axis]), float(scale.high[axis])
        return [step * k for k in range(math.ceil(low / step), math.floor(high / step) + 1)]

    parts: list[str] = []
    for value in ticks(0):
        x, text = scale.x(value), f"{value:g}".replace("-", "−")
        parts.append(f"<line x1='{x:g}' x2='{x:g}' y1='{_TOP:g}' y2='{bottom:.1f}' {_GRID}/>")
        parts.append(f"<text x='{x:g}' y='{bottom + 14:.1f}' text-anchor='middle' {_AXIS_TEXT}>{text}</text>")
    for value in ticks(1):
        y, text = scale.y(value), f"{value:g}".replace("-", "−")
        parts.append(f"<line x1='{_LEFT:g}' x2='{right:g}' y1='{y:g}' y2='{y:g}' {_GRID}/>")
        parts.append(f"<text x='{_LEFT - 5:g}' y='{y + 4:g}' text-anchor='end' {_AXIS_TEXT}>{text}</text>")
    axis, middle, across = scale.x(0.0), 0.5 * (_TOP + bottom), 0.5 * (_LEFT + right)
    return [
        *parts,
        f"<line x1='{axis:g}' x2='{axis:g}' y1='{_TOP:g}' y2='{bottom:.1f}' stroke='currentColor' "
        "stroke-opacity='.5' stroke-dasharray='2 4'/>",
        f"<text x='{across:g}' y='{bottom + 30:.1f}' text-anchor='middle' {_AXIS_TEXT}>r mm</text>",
        f"<text x='12' y='{middle:.1f}' text-anchor='middle' {_AXIS_TEXT} "
        f"transform='rotate(-90 12 {middle:.1f})'>z mm</text>",
    ]

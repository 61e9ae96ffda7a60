"""The workspace on the Simulation screen: cloud and section in the 3D view, and the section to scale."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from armctl.runtime import Snapshot
from armctl.ui.console import Console
from armctl.ui.scene.workspace import (
    COLOURINGS,
    CloudFigure,
    Colouring,
    SectionLines,
    WorkspaceCloud,
    workspace_cloud,
)
from armctl.ui.widgets.html import LiveHtml, fixed, muted

if TYPE_CHECKING:
    from armctl.robot import Robot
    from armctl.ui.session import Session


# The section of the workspace as a drawing to scale: height over the distance from the base axis, in mm.

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


_CLOUD_HINT = "Where the tool point can be: a cloud of reachable points."
_SECTION_HINT = "The workspace cut open in the plane of the base axis and the tool point."
_COMPUTING = "Computing …"
_KEYS = {
    "height": "Dark is low, yellow is high.",
    "manipulability": "Yellow: the tool moves freely. Dark: near a singularity.",
}
_TURNED_RAD = 0.01
"""how far the arm turns before a sampled section is made anew"""
_UPRIGHT = 1e-9


class CloudStore:
    """Computes the cloud off the event loop, once, for whoever asks first."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._cloud: asyncio.Task[WorkspaceCloud] | None = None

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """That of the console's arm."""
        del before
        return cls(console.robot)

    async def get(self) -> WorkspaceCloud:
        """The cloud of the arm."""
        if self._cloud is None:
            self._cloud = asyncio.create_task(asyncio.to_thread(workspace_cloud, self._robot))
        return await asyncio.shield(self._cloud)


class WorkspaceView:
    """Two checkboxes, what they draw, and the figures. Made for one page; computed once for all."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._model: WorkspaceCloud | None = None
        self._outline: tuple[FloatArray, ...] = ()
        self._outlined_at: FloatArray | None = None
        self._outlining = False
        gui, scene = session.gui, session.client.scene
        self._cloud = gui.add_checkbox("Workspace cloud", initial_value=False, hint=_CLOUD_HINT)
        self._colour = gui.add_dropdown("Coloured by", COLOURINGS, initial_value=COLOURINGS[0], visible=False)
        self._cloud_text = LiveHtml(gui)
        self._cloud_text.visible = False
        self._section = gui.add_checkbox("Section", initial_value=False, hint=_SECTION_HINT)
        self._plot, self._section_text = LiveHtml(gui), LiveHtml(gui)
        self._plot.visible = self._section_text.visible = False
        self._cloud_figure, self._lines = CloudFigure(scene), SectionLines(scene)
        session.on(self._cloud.on_update, self._on_cloud)
        session.on(self._colour.on_update, self._on_cloud)
        session.on(self._section.on_update, self._on_section)

    def refresh(self, snapshot: Snapshot) -> None:
        """Let the section follow the arm."""
        model = self._model
        if model is None or not self._section.value:
            return
        q = self._session.console.last_known.drawn(snapshot)
        if self._outlined_at is None or (
            not model.section.exact and np.abs(q - self._outlined_at).max() > _TURNED_RAD
        ):
            if not self._outlining:
                self._outlining = True
                self._session.spawn(self._make_outline(model, q.copy()))
            return
        self._lines.place(model.section.plane(q if model.section.exact else self._outlined_at))
        self._plot.show(section_svg(picture_of(self._robot, model.section.plane(q), self._outline, q)))

    async def _make_outline(self, model: WorkspaceCloud, q: FloatArray) -> None:
        try:
            outline = await asyncio.to_thread(model.section.outline, q)
        finally:
            self._outlining = False
        if self._section.value:
            self._outline, self._outlined_at = outline, q
            self._lines.place(model.section.plane(q))
            self._lines.show(outline)

    async def _on_cloud(self) -> None:
        shown = self._cloud.value
        self._colour.visible = self._cloud_text.visible = shown
        if not shown:
            self._cloud_figure.hide()
            return
        self._cloud_text.show(_COMPUTING)
        model = await self._computed()
        if self._cloud.value:  # not switched off meanwhile
            colouring: Colouring = self._colour.value
            self._cloud_figure.show(model, colouring)
            self._cloud_text.show(cloud_html(self._robot, model, colouring))

    async def _on_section(self) -> None:
        shown = self._section.value
        self._plot.visible = self._section_text.visible = shown
        if not shown:
            self._lines.hide()
            self._outlined_at = None
            return
        self._section_text.show(_COMPUTING)
        model = await self._computed()
        self._section_text.show(muted(section_words(model)))

    async def _computed(self) -> WorkspaceCloud:
        self._model = await self._session.shared(CloudStore).get()
        return self._model


def picture_of(
    robot: Robot, T_base_plane: FloatArray, outline: tuple[FloatArray, ...], q: FloatArray
) -> SectionPicture:
    """The section with the arm at ``q`` (n,) [rad] in it, in mm."""
    rise = float(T_base_plane[2, 3])
    points = (robot.frames(q)[:, :3, 3] - T_base_plane[:3, 3]) @ T_base_plane[:3, :3]
    (arm,) = to_mm([points[:, [0, 2]]], rise)
    upright = float(T_base_plane[2, 2]) > 1 - _UPRIGHT
    return SectionPicture(
        outline=to_mm(outline, rise),
        tip=(float(arm[-1, 0]), float(arm[-1, 1])),
        arm=arm,
        floor=1000 * robot.floor_z if upright else None,
    )


def cloud_html(robot: Robot, model: WorkspaceCloud, colouring: Colouring) -> str:
    """What the cloud is, and how far the tool comes."""
    extent = model.extent
    reach, low, high = (fixed(1000 * value, 0) for value in (extent.reach, extent.lowest, extent.highest))
    text = (
        f"<div>The tool comes <b>{reach} mm</b> from the base axis, and from "
        f"<b>{low}</b> to <b>{high} mm</b> in height.</div>"
    )
    if extent.lowest < robot.floor_z:
        floor = fixed(1000 * robot.floor_z, 0)
        text += muted(f"What is below the floor ({floor} mm) is left out of the cloud.")
    return text + muted(
        f"{len(model.points)} tool points inside the joint limits, denser at the boundary. {_KEYS[colouring]}"
    )


def section_words(model: WorkspaceCloud) -> str:
    """What the drawing shows."""
    kind = (
        "The red line is the exact boundary of what the pitch joints reach with the base standing still."
        if model.section.exact
        else "Sampled: the red line goes around cells that hold a reachable point; the base turns each point "
        "into this plane."
    )
    axes = "z is the height, r the distance from the axis."
    return f"{kind} Dot: the tool point now. Dotted: the base axis. {axes}"

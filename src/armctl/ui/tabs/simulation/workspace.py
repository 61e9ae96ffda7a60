"""The workspace of the arm: a cloud of reachable points and a section in the 3D view, and figures."""

from __future__ import annotations

import asyncio
import math
from typing import Literal, Self

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.workspace import (
    CutShell,
    Extent,
    Section,
    WorkspaceShell,
    sample_workspace,
    workspace_extent,
)
from armctl.lazy_dataclass import dataclass
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.robot.solids import Solid
from armctl.ui.console import Console
from armctl.ui.scene.arm_model import add_solid
from armctl.ui.scene.ghost import Lines, segments
from armctl.ui.session import Session
from armctl.ui.widgets.graph import round_step
from armctl.ui.widgets.html import LiveHtml, fixed, muted

_COLOURINGS = {
    "height": "Dark is low, yellow is high.",
    "manipulability": "Yellow: the tool moves freely. Dark: near a singularity.",
}
_POINTS = 14_000
_POINT_SIZE = 0.0015
"""of the reach: small enough to see the arm through the cloud"""
_RGB = (68, 33, 253), (1, 145, 231), (84, 140, 37)
"""each of low, middle, high"""
_CLOUD_HINT = "Where the tool point can be: a cloud of reachable points."
_SECTION_HINT = "The workspace cut open in the plane of the base axis and the tool point."
_TURNED_RAD = 0.01
"""how far the arm turns before a sampled section is made anew"""
_SECTION_COLOR = (92, 118, 143)
_SHELL_HINT = "All that the tool point can reach, cut open in the arm's plane on your side of it."
_SHELL_COLOR, _SHELL_OPACITY = (25, 113, 194), 0.22
_SHELL_TURNED_RAD = 0.02
"""how far the tool turns about the base axis before the shell is cut anew"""
_BESIDE = 0.1
"""of its distance: so far a camera stands beside the arm's plane before the shell is cut from its side"""


class CloudStore:
    """Computes cloud and shell off the event loop, once, for whoever asks first."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._cloud: asyncio.Task[WorkspaceCloud] | None = None
        self._shell: asyncio.Task[WorkspaceShell] | None = None

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

    async def shell(self) -> WorkspaceShell:
        """The shell of the arm, above the floor."""
        if self._shell is None:
            one = self._robot
            self._shell = asyncio.create_task(
                asyncio.to_thread(WorkspaceShell, one.chain, one.limits, one.floor_z)
            )
        return await asyncio.shield(self._shell)


class ShellView:
    """A checkbox, and the workspace as a translucent shell; it is cut open where the arm comes to rest."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._box = session.gui.add_checkbox("Workspace", initial_value=False, hint=_SHELL_HINT)
        self._edge = Lines(session.client.scene, "/shell_edge", _SHELL_COLOR, 2.0)
        self._mesh: viser.MeshHandle | None = None
        self._shell: WorkspaceShell | None = None
        self._cut: tuple[FloatArray, Literal[-1, 1]] | None = None
        """the plane (4, 4) in which it is cut, and which half is drawn"""
        self._cutting = False
        session.on(self._box.on_update, self._on_box)

    def _on_box(self) -> None:
        if not self._box.value and self._mesh is not None:
            self._mesh.remove()
            self._edge.hide()
            self._mesh = self._cut = None

    def refresh(self, snapshot: Snapshot) -> None:
        """Cut it anew where the arm has come to rest elsewhere, or is looked at from its other side."""
        if not self._box.value or self._cutting or (self._cut is not None and snapshot.busy):
            return
        q = self._session.console.last_known.drawn(snapshot)
        if self._shell is None or self._is_elsewhere(self._shell.plane(q)):
            self._cutting = True
            self._session.spawn(self._cut_at(q.copy()))

    def _is_elsewhere(self, plane: FloatArray) -> bool:
        if self._cut is None:
            return True
        before, side = self._cut
        turned = math.acos(min(max(float(before[:3, 0] @ plane[:3, 0]), -1.0), 1.0))
        return turned > _SHELL_TURNED_RAD or self._side(plane) != side

    async def _cut_at(self, q: FloatArray) -> None:
        try:
            self._shell = await self._session.console.shared(CloudStore).shell()
            plane = self._shell.plane(q)
            side = self._side(plane)
            cut = await asyncio.to_thread(self._shell.cut, q, side)
            if self._box.value:  # not switched off meanwhile
                self._cut = plane, side
                self._show(cut)
        finally:
            self._cutting = False

    def _side(self, plane: FloatArray) -> Literal[-1, 1]:
        """Which half is drawn: the one behind the arm's plane (4, 4), as the page sees it."""
        away = np.asarray(self._session.client.camera.position) - plane[:3, 3]
        beside = float(away @ plane[:3, 1])
        if self._cut is not None and abs(beside) < _BESIDE * float(np.linalg.norm(away)):
            return self._cut[1]
        return -1 if beside > 0 else 1

    def _show(self, cut: CutShell) -> None:
        scene = self._session.client.scene
        with self._session.client.atomic():
            if self._mesh is not None:
                self._mesh.remove()
            solid = Solid(cut.vertices, cut.faces)
            self._mesh = add_solid(scene, "/shell", solid, _SHELL_COLOR, _SHELL_OPACITY, two_sided=True)
            self._edge.show(cut.edge)


class WorkspaceView:
    """Checkboxes, what they draw, and the figures; computed once for all pages."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._model: WorkspaceCloud | None = None
        self._outline: tuple[FloatArray, ...] = ()
        self._outlined_at: FloatArray | None = None
        self._outlining = False
        gui = session.gui
        self._shell = ShellView(session)
        self._cloud = gui.add_checkbox("Workspace cloud", initial_value=False, hint=_CLOUD_HINT)
        self._section = gui.add_checkbox("Section", initial_value=False, hint=_SECTION_HINT)
        self._colour = gui.add_dropdown("Coloured by", tuple(_COLOURINGS), visible=False)
        self._cloud_text = LiveHtml(gui, visible=False)
        self._plot, self._section_text = LiveHtml(gui, visible=False), LiveHtml(gui, visible=False)
        self._points: viser.PointCloudHandle | None = None
        self._lines = Lines(session.client.scene, "/section", _SECTION_COLOR, 2.5)
        session.on(self._cloud.on_update, self._on_cloud)
        session.on(self._colour.on_update, self._on_cloud)
        session.on(self._section.on_update, self._on_section)

    def refresh(self, snapshot: Snapshot) -> None:
        """Let shell and section follow the arm."""
        self._shell.refresh(snapshot)
        self._lines.set_visible(self._session.sees("Simulation"))
        model = self._model
        if model is None or not self._section.value:
            return
        q, at = self._session.console.last_known.drawn(snapshot), self._outlined_at
        if at is None or (not model.section.exact and np.abs(q - at).max() > _TURNED_RAD):
            if not self._outlining:
                self._outlining = True
                self._session.spawn(self._make_outline(model, q.copy()))
            return
        self._lines.place(model.section.plane(q if model.section.exact else at))
        self._plot.show(section_svg(*in_plane(self._robot, model.section.plane(q), self._outline, q)))

    async def _make_outline(self, model: WorkspaceCloud, q: FloatArray) -> None:
        try:
            outline = await asyncio.to_thread(model.section.outline, q)
        finally:
            self._outlining = False
        if self._section.value:
            self._outline, self._outlined_at = outline, q
            self._lines.place(model.section.plane(q))
            lines = np.concatenate([np.empty((0, 2, 2)), *(segments(line) for line in outline)])
            self._lines.show(np.insert(lines, 1, 0.0, axis=2))  # x and z of the plane

    async def _on_cloud(self) -> None:
        self._colour.visible = self._cloud_text.visible = self._cloud.value
        if self._cloud.value:
            self._cloud_text.show("Computing …")
            await self._compute()
        if self._points is not None:
            self._points.remove()
            self._points = None
        model = self._model
        if self._cloud.value and model is not None:  # not switched off meanwhile
            self._points = self._session.client.scene.add_point_cloud(
                "/workspace", model.points, model.colors(self._colour.value),
                point_size=_POINT_SIZE * model.extent.reach, point_shape="circle", point_shading="flat",
                precision="float32",
            )  # fmt: skip
            self._cloud_text.show(cloud_html(self._robot, model, self._colour.value))

    async def _on_section(self) -> None:
        self._plot.visible = self._section_text.visible = self._section.value
        if self._section.value:
            self._section_text.show("Computing …")
            self._section_text.show(muted(section_words(await self._compute())))
        else:
            self._lines.hide()
            self._outlined_at = None

    async def _compute(self) -> WorkspaceCloud:
        self._model = await self._session.console.shared(CloudStore).get()
        return self._model


@dataclass(frozen=True, slots=True)
class WorkspaceCloud:
    """Tool points inside the joint limits and above the floor, and the workspace cut open."""

    points: FloatArray
    """(k, 3) [m]"""
    manipulability: FloatArray
    """(k,) √det(J Jᵀ) of the tool point's velocity [m³]; 0 at a singularity"""
    extent: Extent
    """of all tool points, also those below the floor"""
    section: Section

    def colors(self, colouring: str) -> NDArray[np.uint8]:
        """(k, 3) RGB: dark where the value is low, yellow where it is high."""
        values = self.points[:, 2] if colouring == "height" else self.manipulability
        low, high = np.percentile(values, (1, 99)) if len(values) else (0.0, 1.0)
        u = (values - low) / max(high - low, 1e-12)
        rgb = [np.interp(u, (0.0, 0.5, 1.0), channel) for channel in _RGB]
        return np.stack(rgb, axis=-1).round().astype(np.uint8)


def workspace_cloud(robot: Robot, count: int = _POINTS) -> WorkspaceCloud:
    """Sample about ``count`` points; the same every time, without those below the floor."""
    samples = sample_workspace(robot.chain, robot.limits, count)
    above = samples.points[:, 2] >= robot.floor_z
    extent = workspace_extent(robot.chain, robot.limits)
    section = robot.inverse_kinematics.section()
    return WorkspaceCloud(samples.points[above], samples.manipulability[above], extent, section)


def cloud_html(robot: Robot, model: WorkspaceCloud, colouring: str) -> str:
    """What the cloud is, and how far the tool comes."""
    extent = model.extent
    reach, low, high = (fixed(1000 * value, 0) for value in (extent.reach, extent.lowest, extent.highest))
    text = f"<div>The tool reaches <b>{reach} mm</b> from the base axis, and heights from "
    text += f"<b>{low}</b> to <b>{high} mm</b>.</div>"
    if extent.lowest < robot.floor_z:
        floor = fixed(1000 * robot.floor_z, 0)
        text += muted(f"What is below the floor ({floor} mm) is left out of the cloud.")
    count = f"{len(model.points)} tool points inside the joint limits, denser at the boundary."
    return text + muted(f"{count} {_COLOURINGS[colouring]}")


def section_words(model: WorkspaceCloud) -> str:
    """What the drawing shows."""
    kind = "The blue line is the exact boundary of what the pitch joints reach with the base standing still."
    if not model.section.exact:
        kind = (
            "Sampled: the blue line goes around cells that hold a reachable point; the base turns each point "
        )
        kind += "into this plane."
    return (
        f"{kind} Dot: the tool point now. Dotted: the base axis. "
        "z is the height, r the distance from the axis."
    )


# The section as a drawing to scale: height over the distance from the base axis, in mm.

_WIDTH, _TALLEST = 400.0, 330.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 10.0, 8.0, 36.0
_GRID = "stroke='currentColor' stroke-opacity='.15'"
_AXIS_TEXT = "font-size='11' fill='currentColor' fill-opacity='.75'"


def in_plane(
    robot: Robot, T_base_plane: FloatArray, outline: tuple[FloatArray, ...], q: FloatArray
) -> tuple[tuple[FloatArray, ...], FloatArray, float | None]:
    """Outline, arm (k, 2) at ``q`` (n,) [rad] and floor (None: not upright) in a plane (4, 4), all in mm."""
    rise = np.array([0.0, T_base_plane[2, 3]])
    points = (robot.frames(q)[:, :3, 3] - T_base_plane[:3, 3]) @ T_base_plane[:3, :3]
    upright = float(T_base_plane[2, 2]) > 1 - 1e-9
    arm = 1000 * (points[:, [0, 2]] + rise)
    return tuple(1000 * (line + rise) for line in outline), arm, 1000 * robot.floor_z if upright else None


def section_svg(outline: tuple[FloatArray, ...], arm: FloatArray, floor: float | None) -> str:
    """The drawing as SVG: the boundary of the reach, the floor, the base axis, the arm and its tip [mm]."""
    ground = [] if floor is None else [np.array([[arm[0, 0], floor]])]
    corners = np.concatenate([*outline, arm, *ground])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.05 * float((high - low).max())
    low, high = low - margin, high + margin
    across, up = (high - low).tolist()
    unit = min((_WIDTH - _LEFT - _RIGHT) / across, (_TALLEST - _TOP - _BOTTOM) / up)
    # a narrow section gets more room to its sides, so that the drawing fills its width
    spare = (_WIDTH - _LEFT - _RIGHT) / unit - across
    low[0] -= 0.5 * spare
    high[0] += 0.5 * spare
    height = _TOP + _BOTTOM + unit * up
    right, bottom = _WIDTH - _RIGHT, height - _BOTTOM

    def drawn(x: float, y: float) -> tuple[float, float]:
        """A point [mm] in the drawing's own units, y downwards."""
        return round(_LEFT + unit * (x - low[0]), 1), round(_TOP + unit * (high[1] - y), 1)

    def path(line: FloatArray) -> str:
        return " ".join("{:g},{:g}".format(*drawn(x, y)) for x, y in line.tolist())

    parts = [
        f"<svg class='section-plot' viewBox='0 0 {_WIDTH:g} {height:.0f}' "
        "style='width:100%;display:block' role='img' aria-label='Section of the workspace'>"
    ]
    for value in _ticks(low, high, axis=0):
        x, _ = drawn(value, 0.0)
        parts += [_line(x, _TOP, x, bottom, _GRID), _text(x, bottom + 14, "middle", fixed(value, 0))]
    for value in _ticks(low, high, axis=1):
        _, y = drawn(0.0, value)
        parts += [_line(_LEFT, y, right, y, _GRID), _text(_LEFT - 5, y + 4, "end", fixed(value, 0))]
    base, middle = drawn(0.0, 0.0)[0], 0.5 * (_TOP + bottom)
    parts += [
        _line(base, _TOP, base, bottom, "stroke='currentColor' stroke-opacity='.5' stroke-dasharray='2 4'"),
        _text(0.5 * (_LEFT + right), bottom + 30, "middle", "r mm"),
        _text(12, middle, "middle", "z mm", f"transform='rotate(-90 12 {middle:.1f})'"),
        f"<path d='{' '.join(f'M{path(line)}Z' for line in outline)}' fill='#1971c2' fill-opacity='.16' "
        "fill-rule='evenodd' stroke='#5c768f' stroke-width='2' stroke-linejoin='round'/>",
    ]
    if floor is not None:
        _, level = drawn(0.0, floor)
        parts += [
            f"<rect x='{_LEFT:g}' y='{level:g}' width='{right - _LEFT:g}' "
            f"height='{max(bottom - level, 0):.1f}' fill='#868e96' fill-opacity='.30'/>",
            _line(_LEFT, level, right, level, "stroke='#868e96' stroke-width='2'"),
            _text(right - 3, level - 4, "end", "floor"),
        ]
    x, y = drawn(*arm[-1].tolist())
    return "".join(parts) + (
        f"<polyline points='{path(arm)}' fill='none' stroke='currentColor' "
        "stroke-opacity='.55' stroke-width='3' stroke-linejoin='round' stroke-linecap='round'/>"
        f"<circle cx='{x:g}' cy='{y:g}' r='5' fill='#e8590c' stroke='white' stroke-width='1.5'/></svg>"
    )


def _ticks(low: FloatArray, high: FloatArray, axis: int) -> list[float]:
    """Round values along an axis [mm], the same distance apart on both axes."""
    step = round_step(float((high - low).max()) / 8)
    return [step * k for k in range(math.ceil(low[axis] / step), math.floor(high[axis] / step) + 1)]


def _line(x1: float, y1: float, x2: float, y2: float, style: str) -> str:
    return f"<line x1='{x1:g}' y1='{y1:.1f}' x2='{x2:g}' y2='{y2:.1f}' {style}/>"


def _text(x: float, y: float, anchor: str, text: str, more: str = "") -> str:
    return f"<text x='{x:g}' y='{y:.1f}' text-anchor='{anchor}' {_AXIS_TEXT} {more}>{text}</text>"

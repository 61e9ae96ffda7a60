"""The workspace of the arm: a cloud of reachable points and a section in the 3D view, and figures."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.workspace import Extent, Section, sample_workspace, workspace_extent
from armctl.robot import Robot
from armctl.runtime import Snapshot
from armctl.ui.console import Console
from armctl.ui.scene.ghost import Lines, segments
from armctl.ui.session import Session
from armctl.ui.tabs.simulation.section import picture_of, section_svg
from armctl.ui.widgets.html import LiveHtml, fixed, muted

Colouring = Literal["height", "manipulability"]
COLOURINGS: tuple[Colouring, ...] = ("height", "manipulability")
_POINTS = 14_000
_POINT_SIZE = 0.004
"""of the reach: small enough to see the arm through the cloud"""
_LOW, _MIDDLE, _HIGH = (
    np.array([68.0, 1.0, 84.0]),
    np.array([33.0, 145.0, 140.0]),
    np.array([253.0, 231.0, 37.0]),
)
_CLOUD_HINT = "Where the tool point can be: a cloud of reachable points."
_SECTION_HINT = "The workspace cut open in the plane of the base axis and the tool point."
_COMPUTING = "Computing …"
_KEYS = {
    "height": "Dark is low, yellow is high.",
    "manipulability": "Yellow: the tool moves freely. Dark: near a singularity.",
}
_TURNED_RAD = 0.01
"""how far the arm turns before a sampled section is made anew"""
_SECTION_COLOR = (224, 49, 49)


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
        self._cloud_text = LiveHtml(gui, visible=False)
        self._section = gui.add_checkbox("Section", initial_value=False, hint=_SECTION_HINT)
        self._plot, self._section_text = LiveHtml(gui, visible=False), LiveHtml(gui, visible=False)
        self._points: viser.PointCloudHandle | None = None
        self._lines = Lines(scene, "/section", _SECTION_COLOR, 2.5)
        session.on(self._cloud.on_update, self._on_cloud)
        session.on(self._colour.on_update, self._on_cloud)
        session.on(self._section.on_update, self._on_section)

    def refresh(self, snapshot: Snapshot) -> None:
        """Let the section follow the arm."""
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
        self._plot.show(section_svg(picture_of(self._robot, model.section.plane(q), self._outline, q)))

    async def _make_outline(self, model: WorkspaceCloud, q: FloatArray) -> None:
        """Cut the workspace open in the plane of the arm at ``q`` (n,) [rad], and draw the outline."""
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
        shown = self._cloud.value
        self._colour.visible = self._cloud_text.visible = shown
        if not shown:
            self._draw_points(None)
            return
        self._cloud_text.show(_COMPUTING)
        model = await self._computed()
        if self._cloud.value:  # not switched off meanwhile
            self._draw_points(model)
            self._cloud_text.show(cloud_html(self._robot, model, self._colour.value))

    def _draw_points(self, model: WorkspaceCloud | None) -> None:
        if self._points is not None:
            self._points.remove()
            self._points = None
        if model is not None:
            self._points = self._session.client.scene.add_point_cloud(
                "/workspace", model.points, model.colors(self._colour.value),
                point_size=_POINT_SIZE * model.extent.reach, point_shape="circle", point_shading="flat",
                precision="float32",
            )  # fmt: skip

    async def _on_section(self) -> None:
        shown = self._section.value
        self._plot.visible = self._section_text.visible = shown
        if not shown:
            self._lines.hide()
            self._outlined_at = None
            return
        self._section_text.show(_COMPUTING)
        self._section_text.show(muted(section_words(await self._computed())))

    async def _computed(self) -> WorkspaceCloud:
        self._model = await self._session.shared(CloudStore).get()
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

    def colors(self, colouring: Colouring) -> NDArray[np.uint8]:
        """(k, 3) RGB: dark where the value is low, yellow where it is high."""
        values = self.points[:, 2] if colouring == "height" else self.manipulability
        low, high = np.percentile(values, (1, 99)) if len(values) else (0.0, 1.0)
        u = np.clip((values - low) / max(high - low, 1e-12), 0.0, 1.0)[:, None]
        below = _LOW + 2 * u * (_MIDDLE - _LOW)
        above = _MIDDLE + (2 * u - 1) * (_HIGH - _MIDDLE)
        return np.where(u < 0.5, below, above).round().astype(np.uint8)


def workspace_cloud(robot: Robot, count: int = _POINTS) -> WorkspaceCloud:
    """Sample the workspace; the same points every time.

    Args:
        robot: the arm.
        count: about how many points; those with the tool point below the floor are left out.
    """
    samples = sample_workspace(robot.chain, robot.limits, count)
    above = samples.points[:, 2] >= robot.floor_z
    return WorkspaceCloud(
        samples.points[above],
        samples.manipulability[above],
        workspace_extent(robot.chain, robot.limits),
        robot.inverse_kinematics.section(),
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

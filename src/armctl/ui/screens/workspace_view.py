"""The workspace on the Simulation screen: cloud and section in the 3D view, and the section to scale."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.runtime import Snapshot
from armctl.ui.scene.cloud import COLOURINGS, CloudFigure, Colouring, WorkspaceCloud
from armctl.ui.scene.section_lines import SectionLines
from armctl.ui.widgets.html_bits import fixed, muted
from armctl.ui.widgets.section_plot import SectionPicture, section_svg, to_mm
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.robot import Robot
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]
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
        self._model = await self._session.console.clouds.get(self._robot)
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

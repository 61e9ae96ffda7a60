"""Known points that the tool is brought to: how large its error is, and what is to blame."""

from __future__ import annotations

import numpy as np
import viser

from armctl.calibration import ToolError
from armctl.errors import InputError
from armctl.runtime import Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration
from armctl.ui.tabs.manual.jog import ToolJog
from armctl.ui.widgets.calibration_text import numbered, points_html, told_html
from armctl.ui.widgets.html import LiveHtml, muted, numbers
from armctl.ui.widgets.number_field import EditWatch, NumberField
from armctl.ui.widgets.standing import standing_outputs

_TYPED = "as typed below"
_SLOW_MM_S = 5.0
_HOW = (
    "Bring the tip to a point whose place you know, type the place and press Add point. Six points or more, "
    "in different poses, tell how far the tool is off and which number of the robot file is to blame."
)


class CalibrationPoints:
    """Choose or type a point, touch it, add it; the verdict comes with the sixth."""

    def __init__(self, session: Session) -> None:
        """Add the controls to the present container."""
        self._session, self._points = session, session.shared(SharedCalibration).points
        self._robot = session.console.robot
        self._drawn = -1
        gui = session.gui
        LiveHtml(gui, muted(_HOW))
        self._known = gui.add_dropdown("Known point", (_TYPED, *self._robot.points))
        self._xyz = [NumberField(gui, f"{axis} mm", None) for axis in "XYZ"]
        self._tip = LiveHtml(gui)
        with gui.add_folder("Jog the tool", expand_by_default=False):
            ToolJog(session, _SLOW_MM_S)
        add = gui.add_button("Add point", icon=viser.Icon.PLUS)
        self._table = LiveHtml(gui)
        self._which = gui.add_dropdown("Point", numbered(0))
        self._delete = gui.add_button("Delete point", color="gray")
        self._told = LiveHtml(gui)
        self._download = gui.add_button("Download the suggestion", color="gray", visible=False)
        self._watch = EditWatch(self._xyz)
        session.spawn(self._points.think())  # touches that were made before the arm was opened anew
        session.on(self._known.on_update, self._on_known)
        session.on(add.on_click, self._on_add)
        session.on(self._delete.on_click, self._on_delete)
        session.on(self._download.on_click, self._on_download)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show where the tip is, and the points if they have changed."""
        q = np.where(np.isnan(snapshot.q), snapshot.q_command, snapshot.q)
        tip = numbers(1000 * self._robot.forward(q)[:3, 3], 1)
        self._tip.show(f"<div>The tip, by the calibration in force: <b>{tip} mm</b></div>")
        if self._drawn != self._points.version:
            self._drawn = self._points.version
            self._draw()

    def _draw(self) -> None:
        points = self._points
        self._table.show(points_html(points))
        self._told.show(told_html(points))
        options = numbered(len(points.touches))
        if self._which.options != options:
            self._which.options = options
            self._which.value = options[-1]
        self._which.visible = self._delete.visible = bool(points.touches)
        self._download.visible = isinstance(points.told, ToolError) and bool(points.told.changes)

    async def _on_known(self) -> None:
        if self._known.value != _TYPED:
            point = 1000 * self._robot.point(self._known.value)
            for field, value in zip(self._xyz, point.tolist(), strict=True):
                field.fill(value)

    async def _on_add(self) -> None:
        self._session.require_operator()
        self._watch.require_settled()
        point = np.array([field.value for field in self._xyz]) / 1000
        self._points.add(standing_outputs(self._robot, self._session.snapshot), point)
        await self._points.think()

    async def _on_delete(self) -> None:
        self._session.require_operator()
        self._points.delete(int(self._which.value) - 1)
        await self._points.think()

    async def _on_download(self) -> None:
        told = self._points.told
        if not isinstance(told, ToolError):
            raise InputError("there is no suggestion yet: touch more points")
        name = f"{self._robot.name}-suggestion.toml"
        self._session.client.send_file_download(name, told.toml().encode(), save_immediately=True)

"""The Known points tab: points that the tool is brought to, how far it is off, and what is to blame."""

from __future__ import annotations

from html import escape

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.calibration import LEAST_POINTS, ToolError
from armctl.errors import InputError
from armctl.protocol import Snapshot
from armctl.ui.session import Session, refused_by
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration, TouchedPoints, standing_outputs
from armctl.ui.tabs.manual.jog import ToolJog
from armctl.ui.widgets.html import LiveHtml, fixed, heading, muted, numbers, refused, sentence, strong, table
from armctl.ui.widgets.number_field import EditWatch, NumberField

_TYPED = "as typed below"
_SLOW_MM_S = 5.0
_HOW = (
    "Bring the tip to a point whose place you know, type the place and press Add point. Six points or more, "
    "in different poses, tell how far the tool is off and which number of the robot file is probably wrong."
)


class CalibrationPoints:
    """Choose or type a point, touch it, add it; the result comes with the sixth."""

    def __init__(self, session: Session) -> None:
        self._session, self._points = session, session.console.shared(SharedCalibration).points
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
        self._result = LiveHtml(gui)
        self._download = gui.add_button("Download the suggestion", color="gray", visible=False)
        self._watch = EditWatch(self._xyz)
        session.spawn(self._points.compute())  # touches that were made before the arm was opened anew
        session.on(self._known.on_update, self._on_known)
        session.needs(None, add, also=refused_by(self._touch))
        session.needs(None, self._delete, told=False)
        session.on(add.on_click, self._on_add)
        session.on(self._delete.on_click, self._on_delete)
        session.on(self._download.on_click, self._on_download)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show where the tip is, and the points if they have changed."""
        q = np.where(np.isnan(snapshot.q), snapshot.q_command, snapshot.q)
        tip = numbers(1000 * self._robot.forward(q)[:3, 3], 1)
        self._tip.show(f"<div>The tip, by the calibration in force: <b>{tip} mm</b></div>")
        points = self._points
        if self._drawn == points.version:
            return
        self._drawn = points.version
        self._table.show(points_html(points))
        self._result.show(result_html(points))
        show_numbers(self._which, len(points.touches))
        self._delete.visible = bool(points.touches)
        self._download.visible = isinstance(points.result, ToolError) and bool(points.result.changes)

    async def _on_known(self) -> None:
        if self._known.value != _TYPED:
            point = 1000 * self._robot.point(self._known.value)
            for field, value in zip(self._xyz, point.tolist(), strict=True):
                field.fill(value)

    async def _on_add(self) -> None:
        self._session.require_operator()
        self._watch.require_settled()
        self._points.add(*self._touch(self._session.snapshot))
        await self._points.compute()

    def _touch(self, snapshot: Snapshot) -> tuple[dict[int, float], FloatArray]:
        """Outputs and point (3,) [m]; ``ArmctlError`` where one of them is not known."""
        point = np.array([field.value for field in self._xyz]) / 1000
        return standing_outputs(self._robot, snapshot), point

    async def _on_delete(self) -> None:
        self._session.require_operator()
        self._points.delete(int(self._which.value) - 1)
        await self._points.compute()

    async def _on_download(self) -> None:
        result = self._points.result
        if not isinstance(result, ToolError):
            raise InputError("there is no suggestion yet: touch more points")
        self._session.download("suggestion.toml", result.toml())


def numbered(count: int) -> tuple[str, ...]:
    """Entries of a list of marks or points; the page hides the list while there are none."""
    return tuple(str(number) for number in range(1, max(count, 1) + 1))


def show_numbers(which: viser.GuiDropdownHandle[str], count: int) -> None:
    """Offer the numbers up to ``count``, the last one chosen; with none the list is hidden."""
    options = numbered(count)
    if which.options != options:
        which.options = options
        which.value = options[-1]
    which.visible = count > 0


def points_html(points: TouchedPoints) -> str:
    """The touched points, and how far from each the arm believes its tool to be."""
    rows = [
        [str(number), *(fixed(1000 * value, 1) for value in touch.point_m), fixed(1000 * distance, 2)]
        for number, (touch, distance) in enumerate(
            zip(points.touches, points.distances_m.tolist(), strict=True), 1
        )
    ]
    head = ("point", "X mm", "Y mm", "Z mm", "off by mm")
    return table(head, rows, words=()) if rows else ""


def result_html(points: TouchedPoints) -> str:
    """The tool error by the touched points, and the suggested values."""
    result, count = points.result, len(points.touches)
    if count < LEAST_POINTS:
        left = LEAST_POINTS - count
        return muted(f"{left} more point{'' if left == 1 else 's'} needed.") if count else ""
    if result is None:
        return muted("Comparing …")
    if isinstance(result, str):
        return refused(sentence(result))
    first, *rest = result.words
    text = strong(sentence(first)) + "".join(f"<div>{escape(sentence(words))}</div>" for words in rest)
    if result.changes:
        text += heading("Suggested values")
        text += f"<pre style='margin:0;font-size:11.5px;user-select:text'>{escape(result.toml())}</pre>"
    return text

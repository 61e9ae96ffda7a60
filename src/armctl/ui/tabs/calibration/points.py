"""The Known points tab: points that the tool touches, how far it is off, what is to blame, and what to do."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from html import escape
from typing import Final

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.calibration import LEAST_POINTS, Paper, TouchFit
from armctl.errors import ArmctlError, InputError
from armctl.facts import say, say_with_advice
from armctl.facts.causes import FitFigures, MistakenPoint
from armctl.motion.choices import first_possible, may_go_to
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.dragged_tool import dragged_to
from armctl.ui.events import GivenUpError
from armctl.ui.next_pose import PoseWriter
from armctl.ui.offers import refused_by
from armctl.ui.robot_switch import release_first
from armctl.ui.session import Session
from armctl.ui.tabs.calibration.joint import numbered, show_numbers
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration, standing_touch
from armctl.ui.tabs.calibration.touched_points import TouchedPoint, TouchedPoints
from armctl.ui.tabs.manual.jog import ToolJog
from armctl.ui.widgets.html import (
    LiveHtml,
    fixed,
    folded,
    heading,
    muted,
    numbers,
    refused,
    sentence,
    strong,
    table,
)
from armctl.ui.widgets.number_field import EditWatch, NumberField

_TYPED = "as typed below"
_SLOW_MM_S = 5.0
_ABOVE_M = (0.03, 0.06, 0.1)
_ON: Final[dict[str, Paper | None]] = {
    "known places": None,
    "a printed sheet, A4": "a4",
    "a printed sheet, Letter": "letter",
}
_HOW = (
    "Bring the tip to a point and press Here: six points at least, ten are better, in poses that differ. "
    "armctl then tells how far the tool is off, what is to blame, and corrects it."
)
_HOW_SHEET = (
    "Print the sheet at 100 %, check its scale bar, and tape it down about where it says. Touch some "
    "crosshairs again coming from the other side, as that tells play, and some on a block of known height."
)
_ON_HINT = "Known places in the base frame, or crosshairs of a sheet that lies anywhere."
_HEIGHT_HINT = "0 on the paper; else the height of a block that stands on the crosshair."
_BLOCK_HINT = "How high a block is that you have to put on crosshairs; then some are proposed on it. 0: none."
_HIGHEST_MM = 500.0
_CHECK_POINTS = 3


class CalibrationPoints:
    """Choose or type a point, touch it, press Here; the result comes with the sixth."""

    def __init__(self, session: Session) -> None:
        self._session, self._shared = session, session.console.shared(SharedCalibration)
        self._points, self._robot = self._shared.points, session.console.robot
        self._writer = PoseWriter(session, "Known points")
        self._drawn = -1
        self._no_correction: str | None = None
        """why there is nothing to apply"""
        gui = session.gui
        LiveHtml(gui, muted(_HOW))
        self._on = gui.add_dropdown("Points", tuple(_ON), hint=_ON_HINT)
        self._how = LiveHtml(gui, muted(_HOW_SHEET), visible=False)
        self._sheet = gui.add_button("Download the sheet", icon=viser.Icon.DOWNLOAD, visible=False)
        self._known = gui.add_dropdown("Known point", (_TYPED, *self._robot.points))
        self._xyz = [NumberField(gui, f"{axis} mm", None) for axis in "XYZ"]
        self._next = LiveHtml(gui, visible=False)
        self._crosshair = gui.add_dropdown("Crosshair", numbered(0), visible=False)
        self._height = NumberField(gui, "Height mm", 0.0, hint=_HEIGHT_HINT, visible=False)
        self._block = NumberField(gui, "Block mm", 0.0, hint=_BLOCK_HINT, visible=False)
        self._skip = gui.add_button("Propose another one", color="gray", visible=False)
        above = gui.add_button("Next pose above it", color="gray")
        self._tip = LiveHtml(gui)
        with gui.add_folder("Jog the tool", expand_by_default=False):
            ToolJog(session, _SLOW_MM_S)
        here = gui.add_button("Here", icon=viser.Icon.TARGET)
        session.needs(None, here, also=refused_by(self._touch))
        self._table = LiveHtml(gui)
        self._which = gui.add_dropdown("Point", numbered(0))
        self._delete = gui.add_button("Delete point", color="gray")
        self._undo = gui.add_button("Undo the last", color="gray")
        self._clear = gui.add_button("Start anew", color="gray")
        self._result = LiveHtml(gui)
        self._apply = gui.add_button("Apply the correction", icon=viser.Icon.DEVICE_FLOPPY, visible=False)
        free = partial(release_first, reopen=True)
        session.needs(None, self._apply, also=lambda snapshot: free(snapshot) or self._no_correction)
        self._download = gui.add_button("Download the suggestion", color="gray", visible=False)
        self._keep = gui.add_button("Download the points", color="gray", visible=False)
        self._watch = EditWatch([*self._xyz, self._height, self._block])
        session.spawn(self._points.compute())  # touches that were made before the arm was opened anew
        self._listen(above, here)

    def _listen(self, above: viser.GuiButtonHandle, here: viser.GuiButtonHandle) -> None:
        session, points = self._session, self._points
        session.needs(None, self._delete, self._undo, self._clear, self._skip, self._on, above, told=False)
        session.on(self._on.on_update, self._on_kind)
        session.on(self._sheet.on_click, self._on_sheet)
        session.on(self._known.on_update, self._on_known)
        session.on(self._skip.on_click, self._on_skip)
        session.on(above.on_click, self._show_above)
        session.on(here.on_click, self._on_here)
        session.on(self._delete.on_click, lambda: self._on_change(self._delete_chosen))
        session.on(
            self._undo.on_click, lambda: self._on_change(lambda: points.delete(len(points.touches) - 1))
        )
        session.on(self._clear.on_click, lambda: self._on_change(points.clear))
        session.on(self._apply.on_click, self._on_apply)
        session.on(self._download.on_click, self._on_download)
        session.on(self._keep.on_click, lambda: session.download("points.csv", points.csv))

    def refresh(self, snapshot: Snapshot) -> None:
        """Show where the tip is, and the points if they have changed."""
        q = np.where(np.isnan(snapshot.q), snapshot.q_command, snapshot.q)
        tip = numbers(1000 * self._robot.forward(q)[:3, 3], 1)
        self._tip.show(f"<div>The tip, by the calibration in force: <b>{tip} mm</b></div>")
        points = self._points
        if self._drawn == points.version:
            return
        self._drawn = points.version
        self._show_kind()
        self._table.show(points_html(points))
        self._result.show(result_html(points))
        show_numbers(self._which, len(points.touches))
        for control in (self._delete, self._undo, self._clear, self._keep):
            control.visible = bool(points.touches)
        self._download.visible = bool(points.suggestion)
        self._apply.visible = isinstance(points.result, TouchFit) and points.result.correct
        self._no_correction = (
            refused_by(lambda _: self._shared.correction())(snapshot) if self._apply.visible else None
        )

    def _show_kind(self) -> None:
        """The fields for the points that are chosen."""
        points, sheet = self._points, self._points.sheet
        kind = next(label for label, paper in _ON.items() if paper == (sheet and sheet.paper))
        if self._on.value != kind:
            self._on.value = kind
        of_sheet = (
            self._how,
            self._sheet,
            self._next,
            self._crosshair,
            self._height,
            self._block,
            self._skip,
        )
        for one in of_sheet:
            one.visible = sheet is not None
        for one in (self._known, *self._xyz):
            one.visible = sheet is None
        if sheet is None:
            return
        options = numbered(len(sheet.points_m))
        if self._crosshair.options != options:
            self._crosshair.options = options
        if points.next is not None:
            self._crosshair.value = str(points.next.number)
        self._next.show(next_html(points))

    # What is pressed.

    async def _on_kind(self) -> None:
        paper = _ON[self._on.value]
        if paper == (self._points.sheet and self._points.sheet.paper):
            return
        try:
            self._session.require_operator()
            await self._points.use_sheet(paper, self._session.work_out)
        except (ArmctlError, GivenUpError):
            self._drawn = -1  # this page shows again what holds
            raise
        await self._points.compute(self._session.work_out)
        await self._show_next()

    async def _on_sheet(self) -> None:
        if self._points.sheet is not None:
            self._session.download("sheet.pdf", self._points.sheet.pdf())

    async def _on_known(self) -> None:
        if self._known.value != _TYPED:
            point = 1000 * self._robot.point(self._known.value)
            for field, value in zip(self._xyz, point.tolist(), strict=True):
                field.fill(value)

    async def _on_here(self) -> None:
        self._session.require_operator()
        self._watch.require_settled()
        touch = self._touch(self._session.snapshot)
        await self._change(lambda: self._points.add(touch))
        await self._show_next()

    async def _on_skip(self) -> None:
        self._session.require_operator()
        await self._change(self._points.skip)
        await self._show_next()

    async def _on_change(self, change: Callable[[], None]) -> None:
        self._session.require_operator()
        await self._change(change)

    def _delete_chosen(self) -> None:
        self._points.delete(int(self._which.value) - 1)

    async def _change(self, change: Callable[[], None]) -> None:
        """Change the points, and compare them; where that is cancelled they are as before."""
        points, before = self._points, self._points.touches
        block_m = self._block.within(0.0, _HIGHEST_MM) / 1000
        change()
        points.use_block(block_m)
        changed = points.touches
        try:
            await points.compute(self._session.work_out)
        except GivenUpError as given_up:
            as_before = points.go_back(before, changed)
            self._session.spawn(points.compute())  # if nobody else compares those that are left
            kept = "the points are as before" if as_before else "the points stay: others have changed since"
            raise GivenUpError(kept) from given_up

    def _touch(self, snapshot: Snapshot) -> TouchedPoint:
        """What is touched now; ``ArmctlError`` where something of it is not known."""
        number, point = None, np.zeros(3)
        if self._points.sheet is None:
            point = np.array([field.value for field in self._xyz]) / 1000
        else:
            number = int(self._crosshair.value)
            point = self._points.crosshair(number) + np.array((0.0, 0.0, self._height.value / 1000))
        return standing_touch(self._robot, snapshot, point, number, self._points.sense)

    # The ghost above the point.

    async def _show_next(self) -> None:
        if (proposed := self._points.next) is not None:
            self._crosshair.value = str(proposed.number)
            self._height.fill(1000 * proposed.height_m)
            await self._show_above()

    async def _show_above(self) -> None:
        self._session.require_operator()
        if self._points.sheet is None:
            near = self._session.next.shown_in(self._session.snapshot)
            point = np.array([field.value for field in self._xyz]) / 1000
        else:
            near, more = self._points.pose(int(self._crosshair.value), self._height.value / 1000)
            point = self._robot.forward(near)[:3, 3] + more
        start = self._session.next.standing(self._session.snapshot)
        above = await self._session.work_out(pose_above, self._session.held, point, near, start)
        self._writer.show(above)

    # The correction.

    async def _on_apply(self) -> None:
        self._session.require_operator()
        self._session.robots.require_reopenable()
        saved = await self._shared.correct()
        self._writer.hide()
        await take_effect(self._session, "Correction applied", str(saved.path))

    async def _on_download(self) -> None:
        if not (text := self._points.suggestion):
            raise InputError("there is no suggestion yet: touch more points")
        self._session.download("suggestion.toml", text)


def pose_above(robot: Robot, point: FloatArray, near: FloatArray, start: FloatArray) -> FloatArray:
    """A configuration (n,) [rad] to which the arm may go from ``start`` with the tool above a point (3,) [m].

    The one nearest to ``near`` (n,), where that may be, else any. ``InputError``: there is none.
    """
    for lift in _ABOVE_M:
        target = point + np.array((0.0, 0.0, lift))
        q = dragged_to(robot, target, near)
        if q is not None and may_go_to(robot, start, q):
            return q
        others = robot.inverse(target, start=start).q
        found = first_possible(robot, start, others, partial(may_go_to, robot, start))
        if found is not None:
            return others[found]
    raise InputError("the arm finds no free way above this point: jog it there, or choose another one")


async def take_effect(session: Session, title: str, text: str) -> None:
    """Have the arm opened anew by the calibration that was saved."""
    session.notify(title, f"{text}. The arm is opened anew with it: press Enable.")
    await session.reopen_arm()


# The texts.


def next_html(points: TouchedPoints) -> str:
    """Which crosshair to touch next."""
    if points.next is None:
        return muted("Looking for the next one …" if points.unknown else "Choose a crosshair to touch.")
    on = f", on the block ({fixed(1000 * points.next.height_m, 1)} mm)" if points.next.height_m else ""
    told = strong(f"Touch crosshair {points.next.number} next{on}")
    if len(points.touches) >= _CHECK_POINTS:
        told += muted("It tells most of what is still uncertain, also where it was touched before.")
    return told


def points_html(points: TouchedPoints) -> str:
    """The touched points, and how far the tool misses each as it is calibrated now; ✗: it does not fit."""
    errors: list[float | None] = [None] * len(points.touches)
    if points.errors_m is not None:
        errors = list(points.errors_m.tolist())
    result = points.result
    wrong = {one.number for one in result.mistaken if isinstance(one, MistakenPoint)} if isinstance(
        result, TouchFit
    ) else set[int]()  # fmt: skip
    rows = [
        [
            str(number),
            *([] if points.sheet is None else [str(touch.number or "")]),
            *(fixed(1000 * value, 1) for value in touch.point_m),
            ("" if error is None else fixed(1000 * error, 2)) + (" ✗" if number in wrong else ""),
        ]
        for number, (touch, error) in enumerate(zip(points.touches, errors, strict=True), 1)
    ]
    cross = [] if points.sheet is None else ["cross-hair"]
    head = ("point", *cross, "X mm", "Y mm", "Z mm", "off by mm")
    return table(head, rows, words=()) if rows else ""


def result_html(points: TouchedPoints) -> str:
    """What was corrected, the tool error, what is to blame, and the suggested values."""
    result, count = points.result, len(points.touches)
    text = "" if points.corrected is None else _corrected_html(points, points.corrected)
    if count < LEAST_POINTS:
        left = LEAST_POINTS - count
        so_far = _sizes_html("Tool error at these points", points.errors_m) if count >= _CHECK_POINTS else ""
        more = muted(f"{left} more point{'' if left == 1 else 's'} needed for a correction.") if count else ""
        return text + so_far + more
    if result is None:
        return text + muted("Comparing …")
    if isinstance(result, str):
        return text + refused(sentence(result))
    text += strong(f"Tool error {_millimetres(result.before.rms)}")
    if result.correct:
        text += strong(f"with the correction {_millimetres(result.after.rms)}")
        text += muted(
            f"RMS at points that were left out of the fit; largest {_millimetres(result.before.largest)}, "
            f"with the correction {_millimetres(result.after.largest)}; to be expected nearby "
            f"{_millimetres(result.expected.rms)}."
        )
    told = [*result.mistaken, *result.causes, *(() if result.verdict is None else (result.verdict,))]
    text += "".join(f"<div>{escape(sentence(say_with_advice(one)))}</div>" for one in told)
    if result.held:
        text += folded("What these points do not tell", [sentence(say(one)) for one in result.held])
    if suggested := points.suggestion:
        text += heading("Suggested values")
        text += f"<pre style='margin:0;font-size:11.5px;user-select:text'>{escape(suggested)}</pre>"
    return text


def _corrected_html(points: TouchedPoints, figures: FitFigures) -> str:
    before, after = _millimetres(figures.before), _millimetres(figures.after)
    text = strong(f"Corrected: {before} before, {after} after")
    since = None if points.errors_m is None else points.errors_m[points.used :]
    left = _CHECK_POINTS - (len(points.touches) - points.used)
    if left > 0:
        return text + muted(f"Touch {left} more point{'' if left == 1 else 's'} to check it.")
    return text + _sizes_html("Checked by points touched since", since)


def _sizes_html(what: str, errors_m: FloatArray | None) -> str:
    if errors_m is None:
        return ""
    rms = float(np.sqrt(np.mean(errors_m**2)))
    sizes = f"{_millimetres(rms)} RMS, largest {_millimetres(float(errors_m.max()))}"
    return f"<div>{what} ({len(errors_m)}): <b>{sizes}</b></div>"


def _millimetres(length_m: float) -> str:
    return f"{fixed(1000 * length_m, 2 if length_m < 0.001 else 1)} mm"

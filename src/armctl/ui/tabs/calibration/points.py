"""The Known points tab: which point is touched next, Here, and the correction."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
import viser

from armctl.calibration import Paper, TouchedPoint, TouchFit
from armctl.errors import ArmctlError, InputError, MotionRefusedError
from armctl.motion import Profile
from armctl.protocol import Snapshot
from armctl.ui.console import known
from armctl.ui.events import GivenUpError
from armctl.ui.next_pose import PoseWriter
from armctl.ui.offers import refused_by
from armctl.ui.robot_switch import release_first
from armctl.ui.session import Session
from armctl.ui.tabs.calibration.joint import numbered, show_numbers
from armctl.ui.tabs.calibration.points_html import (
    again_label,
    next_html,
    offered_html,
    points_html,
    result_html,
    sheet_html,
    tip_html,
)
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration, standing_touch
from armctl.ui.tabs.calibration.touch_question import NextTouch
from armctl.ui.tabs.calibration.touch_scene import (
    ABOVE_M,
    FAR_ABOVE_M,
    SheetInScene,
    lifts_for,
    pose_above,
)
from armctl.ui.tabs.calibration.touched_points import FORGET, GO_ON
from armctl.ui.tabs.manual.by_hand import ByHand
from armctl.ui.tabs.manual.jog import SLOW_MM_S, ToolJog
from armctl.ui.tabs.manual.tool_steps import Pause, ToolSteps
from armctl.ui.widgets.html import (
    LiveHtml,
    step_heading,
)
from armctl.ui.widgets.number_field import EditWatch, NumberField, button_pairs, field_grid

_TYPED = "as typed below"
_ON: Final[dict[str, Paper | None]] = {
    "known places": None,
    "a printed sheet, A4": "a4",
    "a printed sheet, Letter": "letter",
}
_ON_HINT = (
    "Known places in the base frame, or crosshairs of a printed sheet that lies anywhere. Ten points are "
    "better than six, in poses that differ: armctl tells how far the tool is off, what is to blame, and "
    "corrects it."
)
_HEIGHT_HINT = "0 on the paper; else the height of a block that stands on the crosshair."
_BLOCK_HINT = "How high a block is that you can put on crosshairs; then some are proposed on it. 0: none."
_LIES_HINT = (
    "How high over the floor the sheet lies, such as on books. Where the arm stops above the paper because "
    "of the floor, its zeros are off: lay the sheet higher, 40 mm or so. 0: on the floor."
)
_LOAD_HINT = (
    "What the tool carries in all touches, such as a pen or a weight in the gripper. 0: nothing. It bends "
    "the arm. The correction holds for it; 'Save & test' sets another one."
)
_LEAD_HINT = (
    "Joints that you tick go limp. <b>Support the arm</b>, lead the tip onto the point, and take the joints "
    "back. Let go slowly: the arm sinks by what its servos give way. Step the tip onto the point again, and "
    "press <b>Here</b>: so the arm hangs as it does at work."
)
_HIGHEST_MM = 500.0
_LIFTS_M = (0.03, 0.02, 0.01, 0.005)
HEAVIEST_KG = 100.0


class CalibrationPoints:
    """Choose or type a point, touch it, press Here; the result comes with the sixth."""

    def __init__(self, session: Session, pause: Pause = asyncio.sleep) -> None:
        """``pause``: waits for so many seconds."""
        self._session, self._shared = session, session.console.shared(SharedCalibration)
        self._points, self._robot = self._shared.points, session.console.robot
        self._profile: Profile = "cubic"
        self._writer = PoseWriter(session, "Known points", lambda: (self._profile, None))
        self._in_scene = SheetInScene(session)
        self._drawn = -1
        self._shown: NextTouch | None = None
        """the proposal that the fields were filled with"""
        self._no_correction: str | None = None
        """why there is nothing to apply"""
        gui = session.gui
        self._offered = LiveHtml(gui, visible=False)
        self._offer = gui.add_button_group("Kept points", (GO_ON, FORGET), visible=False)
        self._add_choice(gui)
        LiveHtml(gui, step_heading(2, "Go above it"))
        above = gui.add_button("Next pose above it", color="gray")
        LiveHtml(gui, step_heading(3, "Touch it with the tip"))
        self._steps = ToolSteps(session, lambda: self._points.sense, lambda: self._points.heading, pause)
        self._by_hand = ByHand(session, ticked=True, hint=_LEAD_HINT)
        with gui.add_folder("Jog the tool", expand_by_default=False):
            ToolJog(session, SLOW_MM_S)
        LiveHtml(gui, step_heading(4, "Take it, and lift: six points at least"))
        with button_pairs(gui):
            here = gui.add_button("Here", icon=viser.Icon.TARGET)
            self._lift = gui.add_button("Lift the tip", color="gray", icon=viser.Icon.ARROW_UP)
        session.needs(None, here, also=self._not_here)
        session.needs(self._steps.need, self._lift, told=False)
        self._tip = LiveHtml(gui)
        self._add_result(gui)
        self._watch = EditWatch([*self._xyz, self._height, self._block, self._load, self._lies])
        session.spawn(self._points.compute())  # touches that were made before the arm was opened anew
        self._listen(above, here)

    def _add_choice(self, gui: viser.GuiApi) -> None:
        LiveHtml(gui, step_heading(1, "Choose the point"))
        self._on = gui.add_dropdown("Points", tuple(_ON), hint=_ON_HINT)
        self._how = LiveHtml(gui, visible=False)
        self._sheet = gui.add_button("Download the sheet", icon=viser.Icon.DOWNLOAD, visible=False)
        self._known = gui.add_dropdown("Known point", (_TYPED, *self._robot.points))
        with field_grid(gui):
            self._xyz = [NumberField(gui, f"{axis} mm", None) for axis in "XYZ"]
        with gui.add_folder("Heights and load", expand_by_default=False):
            self._lies = NumberField(gui, "Sheet high mm", 0.0, hint=_LIES_HINT, visible=False)
            self._block = NumberField(gui, "Block mm", 0.0, hint=_BLOCK_HINT, visible=False)
            self._height = NumberField(gui, "Height mm", 0.0, hint=_HEIGHT_HINT, visible=False)
            self._load = NumberField(gui, "Load kg", 0.0, hint=_LOAD_HINT)
        self._next = LiveHtml(gui, visible=False)
        self._crosshair = gui.add_dropdown("Crosshair", numbered(0), visible=False)
        self._skip = gui.add_button("Propose another one", color="gray", visible=False)

    def _add_result(self, gui: viser.GuiApi) -> None:
        session = self._session
        self._result = LiveHtml(gui)
        self._again = gui.add_button(again_label(0), icon=viser.Icon.REPEAT, visible=False)
        self._apply = gui.add_button("Apply the correction", icon=viser.Icon.DEVICE_FLOPPY, visible=False)
        free = partial(release_first, reopen=True)
        session.needs(None, self._apply, also=lambda snapshot: free(snapshot) or self._no_correction)
        self._table = LiveHtml(gui)
        self._which = gui.add_dropdown("Point", numbered(0))
        self._delete = gui.add_button("Delete point", color="gray")
        self._undo = gui.add_button("Undo the last", color="gray")
        self._clear = gui.add_button("Start anew", color="gray")
        self._download = gui.add_button("Download the suggestion", color="gray", visible=False)
        self._keep = gui.add_button("Download the points", color="gray", visible=False)

    def _listen(self, above: viser.GuiButtonHandle, here: viser.GuiButtonHandle) -> None:
        session, points = self._session, self._points
        edits = (
            self._delete, self._undo, self._clear, self._skip, self._on, self._offer, above, self._again
        )  # fmt: skip
        session.needs(None, *edits, told=False)
        session.on(self._offer.on_click, self._on_offer)
        session.on(self._on.on_update, self._on_kind)
        session.on(self._sheet.on_click, self._on_sheet)
        session.on(self._known.on_update, self._on_known)
        for field in (self._block, self._load, self._lies):
            session.on(field.handle.on_update, self._on_given)
        session.on(self._skip.on_click, self._on_skip)
        session.on(above.on_click, self._show_above)
        session.on(here.on_click, self._on_here)
        session.on(self._lift.on_click, self._on_lift)
        session.on(self._again.on_click, self._on_again)
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
        self._tip.show(tip_html(self._robot, known(snapshot)))
        self._by_hand.refresh(snapshot)
        self._steps.refresh()
        points = self._points
        chosen = None if points.sheet is None else int(self._crosshair.value)
        self._in_scene.refresh(points.sheet, chosen)
        if self._drawn == points.version:
            return
        self._drawn = points.version
        self._show_kind()
        lies = 0.0 if points.sheet is None else 1000 * points.sheet.height_m
        shared = ((self._block, 1000 * points.block_m), (self._load, points.load_kg), (self._lies, lies))
        for field, value in shared:
            if not field.edited and field.value != value:  # another page, or touches that were kept
                field.fill(value)
        self._offered.show(offered_html(points))
        self._offered.visible = points.offered is not None or points.not_kept is not None
        self._offer.visible = points.offered is not None
        self._table.show(points_html(points))
        self._result.show(result_html(points))
        show_numbers(self._which, len(points.touches))
        for control in (self._delete, self._undo, self._clear, self._keep):
            control.visible = bool(points.touches)
        self._again.visible = points.doubtful is not None
        if points.doubtful is not None:
            self._again.label = again_label(points.doubtful)
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
            self._lies,
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
        self._how.show(sheet_html(sheet))
        self._fill_next()
        self._next.show(next_html(points))

    def _fill_next(self) -> None:
        """Fill in what is proposed, once: the crosshair and the height, which go together."""
        proposed = self._points.next
        if proposed is not None and proposed is not self._shown:
            self._shown, self._crosshair.value = proposed, str(proposed.number)
            self._height.fill(1000 * proposed.height_m)

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

    async def _on_offer(self) -> None:
        self._session.require_operator()
        points = self._points
        await self._change(points.go_on if self._offer.value == GO_ON else points.forget)
        if points.touches:
            await self._show_next()

    async def _on_sheet(self) -> None:
        if self._points.sheet is not None:
            self._session.download("sheet.pdf", self._points.sheet.pdf())

    async def _on_known(self) -> None:
        if self._known.value != _TYPED:
            point = 1000 * self._robot.point(self._known.value)
            for field, value in zip(self._xyz, point.tolist(), strict=True):
                field.fill(value)

    async def _on_given(self) -> None:
        """A block or a load is typed: what is proposed and told counts it at once."""
        if not self._session.operates or self._points.offered is not None:
            return
        try:
            given = self._given()
        except InputError:  # half typed; whatever is pressed next says so
            return
        if self._points.use(*given):
            await self._change(lambda: None)

    def _given(self) -> tuple[float, float, float]:
        """What is typed: how high a block is, and the sheet lies [m], and the load [kg]."""
        block_m, lies_m = (round(one.within(0.0, _HIGHEST_MM) / 1000, 6) for one in (self._block, self._lies))
        return block_m, lies_m, self._load.within(0.0, HEAVIEST_KG)

    async def _on_here(self) -> None:
        self._session.require_operator()
        self._watch.require_settled()
        await self._steps.settled()  # the arm may seem to stand while what is missing is still sent
        self._session.require_operator()  # still
        touch = self._touch(self._session.snapshot)
        await self._change(lambda: self._points.add(touch))
        await self._show_next()

    async def _on_skip(self) -> None:
        self._session.require_operator()
        await self._change(self._points.skip)
        await self._show_next()

    async def _on_lift(self) -> None:
        """As high as the arm can from there, before it goes to the next point."""
        for height in _LIFTS_M:
            try:
                await self._steps.step(np.array((0.0, 0.0, height)))
            except MotionRefusedError:
                if height == _LIFTS_M[-1]:
                    raise
            else:
                return

    async def _on_again(self) -> None:
        """The point that does not fit is next, and its touch takes the place of the one that was made."""
        self._session.require_operator()
        index = self._points.doubtful
        if index is None:
            raise InputError("every point fits: there is none to touch again")
        self._points.retake(index)
        if self._points.sheet is None:
            for field, value in zip(self._xyz, self._points.touches[index].point_m, strict=True):
                field.fill(1000 * value)
            await self._show_above()
        else:
            await self._show_next()

    async def _on_change(self, change: Callable[[], None]) -> None:
        self._session.require_operator()
        await self._change(change)

    def _delete_chosen(self) -> None:
        self._points.delete(int(self._which.value) - 1)

    async def _change(self, change: Callable[[], None]) -> None:
        """Change the points, and compare them; where that is cancelled they are as before."""
        points, before = self._points, self._points.touches
        given = self._given()
        change()
        if points.offered is None and change != points.go_on:  # else it has its own
            points.use(*given)
        changed = points.touches
        await points.keep()
        try:
            await points.compute(self._session.work_out)
        except GivenUpError as given_up:
            as_before = points.go_back(before, changed)
            self._session.spawn(points.compute())  # if nobody else compares those that are left
            await points.keep()
            kept = "the points are as before" if as_before else "the points stay: others have changed since"
            raise GivenUpError(kept) from given_up

    def _not_here(self, snapshot: Snapshot) -> str | None:
        return None if self._steps.stepping else refused_by(self._touch)(snapshot)

    def _touch(self, snapshot: Snapshot) -> TouchedPoint:
        """What is touched now; ``ArmctlError`` where something of it is not known."""
        number, point = None, np.zeros(3)
        if self._points.sheet is None:
            if not any(field.text.strip() for field in self._xyz):
                raise InputError("no point is chosen yet")
            point = np.array([field.value for field in self._xyz]) / 1000
        else:
            number = int(self._crosshair.value)
            height = self._height.within(0.0, _HIGHEST_MM) / 1000
            point = self._points.crosshair(number) + np.array((0.0, 0.0, height))
        return standing_touch(self._robot, snapshot, point, number, self._points.sense)

    # The ghost above the point.

    async def _show_next(self) -> None:
        if self._points.next is not None:
            self._fill_next()
            await self._show_above()

    async def _show_above(self) -> None:
        self._session.require_operator()
        side: Profile = "cubic"
        aim = self._points.aim
        if self._points.sheet is None:
            near = self._session.next.shown_in(self._session.snapshot)
            own = point = np.array([field.value for field in self._xyz]) / 1000
        else:
            number, height = int(self._crosshair.value), self._height.value / 1000
            near, more = self._points.pose(number, height)
            if (proposed := self._points.next) is not None and proposed.number == number:
                side = proposed.side
            point = self._robot.forward(near)[:3, 3] + more
            own = self._points.crosshair(number) + np.array((0.0, 0.0, height))
        start, ahead = self._session.next.standing(self._session.snapshot), None
        lifts = ABOVE_M if self._points.sheet is None else FAR_ABOVE_M
        if aim is not None:
            point, ahead, lifts = aim.in_base(own), aim.ahead, lifts_for(aim.height_sd(near, own))
        is_newest = self._writer.begin()
        q, profile = await self._session.work_out(
            pose_above, self._session.held, point, near, start, side, lifts, ahead
        )
        if is_newest():
            self._profile = profile
            self._writer.show(q)

    # The correction.

    async def _on_apply(self) -> None:
        self._session.require_operator()
        self._session.robots.require_reopenable()
        if self._points.use(*self._given()):
            await self._change(lambda: None)
            raise InputError("what is typed has changed: look at what comes of it, then press again")
        saved = await self._shared.correct()
        self._writer.hide()
        await take_effect(self._session, "Correction applied", str(saved.path))

    async def _on_download(self) -> None:
        if not (text := self._points.suggestion):
            raise InputError("there is no suggestion yet: touch more points")
        self._session.download("suggestion.toml", text)


async def take_effect(session: Session, title: str, text: str) -> None:
    """Have the arm opened anew by the calibration that was saved."""
    session.notify(title, f"{text}. The arm is opened anew with it: press Enable.")
    await session.reopen_arm()

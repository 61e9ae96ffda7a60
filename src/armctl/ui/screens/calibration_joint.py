"""The marks and the safe limits of one joint."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import viser

from armctl.errors import ArmctlError
from armctl.runtime import Snapshot
from armctl.ui.calibration_work import End
from armctl.ui.screens.calibration_jog import CalibrationJog
from armctl.ui.widgets.calibration_text import fit_html, limits_html, marks_html, numbered
from armctl.ui.widgets.html_bits import fixed, muted, sentence
from armctl.ui.widgets.number_field import EditWatch, NumberField
from armctl.ui.widgets.standing import calibrated_map, present_outputs, standing_outputs
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

_ENDS: dict[str, End] = {"Set lower limit here": "low", "Set upper limit here": "high"}
_ANGLE_HINT = (
    "What the protractor shows, in the joint's own sense: 0° and + as in the robot file and the 3D view."
)
_LIMIT_HINT = "Farther than this the board is never told to go. Outputs, not angles: a sign may be reversed."


class CalibrationJoint:
    """Choose a joint, bring it to a mark, type the angle; again, and the line through the marks shows."""

    def __init__(self, session: Session) -> None:
        """Add the controls to the present container."""
        self._session, self._work = session, session.console.calibrating.work
        self._robot = session.console.robot
        self._titles = {joint.title: joint.name for joint in self._robot.joints if joint.lower < joint.upper}
        self._drawn = -1
        gui = session.gui
        self._joint = gui.add_dropdown("Joint", tuple(self._titles))
        self._jog = CalibrationJog(session, self._index)
        self._now = LiveHtml(gui)
        self._angle = NumberField(gui, "Angle read °", None, hint=_ANGLE_HINT)
        self._add = gui.add_button("Add mark", icon=viser.Icon.PLUS)
        self._marks = LiveHtml(gui)
        self._fit = LiveHtml(gui)
        self._which = gui.add_dropdown("Mark", numbered(0))
        self._delete = gui.add_button("Delete mark", color="gray")
        self._limits = LiveHtml(gui)
        self._ends = gui.add_button_group("Safe limits", tuple(_ENDS), hint=_LIMIT_HINT)
        default = gui.add_button("Limits of the robot file", color="gray")
        self._watch = EditWatch([self._angle])
        session.on(self._joint.on_update, self._on_joint)
        session.on(self._add.on_click, self._on_add)
        session.on(self._delete.on_click, self._on_delete)
        session.on(self._ends.on_click, self._on_limit)
        session.on(default.on_click, self._on_default_limits)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show where the joint stands, and the marks if they have changed."""
        self._now.show(self._now_html(snapshot))
        if self._drawn != self._work.version:
            self._drawn = self._work.version
            self._draw()

    def _draw(self) -> None:
        work, joint = self._work, self._work.chosen
        title = next((title for title, name in self._titles.items() if name == joint), None)
        if title is not None and self._joint.value != title:
            self._joint.value = title
        marks = work.joint(joint).marks
        try:
            fit = work.fit(joint)
        except ArmctlError:
            fit = None
        self._marks.show(marks_html(marks, fit, work.map.unit))
        self._fit.show(fit_html(work, joint) if marks else "")
        self._limits.show(limits_html(work, joint))
        options = numbered(len(marks))
        if self._which.options != options:
            self._which.options = options
            self._which.value = options[-1]
        self._which.visible = self._delete.visible = bool(marks)

    def _now_html(self, snapshot: Snapshot) -> str:
        """Output and angle of the joint as it stands."""
        try:
            output = present_outputs(self._robot, snapshot)[self._channel()]
        except ArmctlError as error:
            return muted(sentence(str(error)))
        i = self._index()
        angle = math.degrees(float(calibrated_map(self._robot).angles({self._channel(): output})[i]))
        said = f"<b>{fixed(output, 1)} {self._work.map.unit}</b>"
        return f"<div>Stands at {said}, by the calibration in force {fixed(angle, 2)}°</div>"

    def _output(self, snapshot: Snapshot) -> float:
        return standing_outputs(self._robot, snapshot)[self._channel()]

    def _channel(self) -> int:
        return self._work.map.channels[self._index()]

    def _index(self) -> int:
        return self._robot.joint_names.index(self._work.chosen)

    async def _on_joint(self) -> None:
        try:
            self._session.require_operator()
        except ArmctlError:
            self._drawn = -1  # this page still shows the operator's joint
            raise
        self._work.choose(self._titles[self._joint.value])

    async def _on_add(self) -> None:
        self._session.require_operator()
        self._watch.require_settled()
        self._work.add_mark(
            self._work.chosen, self._output(self._session.snapshot), math.radians(self._angle.value)
        )

    async def _on_delete(self) -> None:
        self._session.require_operator()
        self._work.delete_mark(self._work.chosen, int(self._which.value) - 1)

    async def _on_limit(self) -> None:
        end = _ENDS[self._ends.value]
        self._session.require_operator()
        self._work.set_limit(self._work.chosen, end, self._output(self._session.snapshot))

    async def _on_default_limits(self) -> None:
        self._session.require_operator()
        self._work.limits_by_default(self._work.chosen)

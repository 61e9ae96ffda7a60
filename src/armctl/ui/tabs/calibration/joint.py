"""The Joints and Gripper tabs: bring a joint to marks, and the gripper to its ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import viser

from armctl.calibration import (
    LEAST_MARKS,
    JointFit,
    Mark,
    differences,
    own_calibration,
    own_map,
)
from armctl.errors import ArmctlError, InputError
from armctl.facts import Need
from armctl.facts.angles import DEGREE, to_degrees
from armctl.protocol import Jog, MoveGripper, Snapshot
from armctl.ui.offers import refused_by
from armctl.ui.session import Session
from armctl.ui.tabs.calibration.shared_calibration import (
    CalibrationWork,
    End,
    Jaw,
    SharedCalibration,
    present_outputs,
    standing_gripper,
    standing_outputs,
)
from armctl.ui.tabs.manual.jog import HeldJog, joint_jog
from armctl.ui.tabs.manual.joints import GripperSlider, JointStepper, slow_duration, slow_speeds
from armctl.ui.widgets.html import LiveHtml, fixed, muted, refused, sentence, table
from armctl.ui.widgets.number_field import EditWatch, NumberField, button_pairs, in_row

STEPS = {"−10": -10.0, "−1": -1.0, "−0.1": -0.1, "+0.1": 0.1, "+1": 1.0, "+10": 10.0}
_STEP_HINT = "Turns the joint at once, at no more than 10°/s. Degrees by the calibration in force."


def on_edit(
    session: Session,
    button: viser.GuiButtonHandle | viser.GuiButtonGroupHandle,
    edit: Callable[[], None],
    also: Callable[[Snapshot], str | None] | None = None,
    *,
    told: bool = False,
) -> None:
    """Run ``edit`` on a click of the operator's; ``also`` and ``told`` as in ``Session.needs``."""

    async def run() -> None:
        session.require_operator()
        edit()

    session.needs(None, button, also=also, told=told)
    session.on(button.on_click, run)


_ENDS: dict[str, End] = {"Set lower limit here": "low", "Set upper limit here": "high"}
_ANGLE_HINT = (
    "What the protractor shows, in the joint's own sense: 0° and + as in the robot file and the 3D view."
)
_LIMITS_ARE = "these are the limits of the robot file"
_LIMIT_HINT = "The joint is never sent beyond these. They are outputs: the lower one may be the larger angle."


class CalibrationJoint:
    """Choose a joint, bring it to a mark, type the angle; again, and the line through the marks shows."""

    def __init__(self, session: Session) -> None:
        self._session, self._work = session, session.console.shared(SharedCalibration).work
        self._robot = session.console.robot
        self._stepper = JointStepper(session, partial(slow_duration, self._robot))
        self._titles = {joint.title: joint.name for joint in self._robot.joints if joint.lower < joint.upper}
        self._drawn = -1
        gui, work = session.gui, self._work
        self._joint = gui.add_dropdown("Joint", tuple(self._titles))
        self._steps = gui.add_button_group("Step °", tuple(STEPS), hint=_STEP_HINT)
        session.needs(self._stepper.need, self._steps, told=False)  # Jog below tells the same
        jog = HeldJog(session)
        with button_pairs(gui):
            for label, sign in (("Jog −", -1.0), ("Jog +", 1.0)):
                button = gui.add_button(label, color="gray")
                jog.attach(button, partial(self._jog, sign))
                session.needs(Need.JOG, button, told=False)
        session.needs(Need.JOG, hint="Jog turns the joint slowly for as long as its button is held.")
        self._now = LiveHtml(gui)
        self._angle = NumberField(gui, "Angle read °", None, hint=_ANGLE_HINT)
        with in_row(gui, " "):
            add = gui.add_button("Add mark", icon=viser.Icon.PLUS)
        on_edit(session, add, self._add, refused_by(self._mark), told=True)
        self._marks = LiveHtml(gui)
        self._fit = LiveHtml(gui)
        self._which = gui.add_dropdown("Mark", numbered(0))
        self._delete = gui.add_button("Delete mark", color="gray")
        self._ends = gui.add_button_group("Safe limits", tuple(_ENDS), hint=_LIMIT_HINT)
        self._limits = LiveHtml(gui)
        with in_row(gui, " "):
            default = gui.add_button("Limits of the robot file", color="gray")
        self._watch = EditWatch([self._angle])
        session.on(self._joint.on_update, self._on_joint)
        session.on(self._steps.on_click, self._on_step)
        on_edit(session, self._delete, lambda: work.delete_mark(work.chosen, int(self._which.value) - 1))
        on_edit(
            session,
            self._ends,
            lambda: work.set_limit(work.chosen, _ENDS[self._ends.value], self._output(session.snapshot)),
            refused_by(self._output),
        )
        on_edit(
            session,
            default,
            lambda: work.limits_by_default(work.chosen),
            lambda _: None if work.limited(work.chosen) else _LIMITS_ARE,
        )

    def refresh(self, snapshot: Snapshot) -> None:
        """Show where the joint stands, and the marks if they have changed."""
        self._now.show(self._now_html(snapshot))
        work, joint = self._work, self._work.chosen
        if self._drawn == work.version:
            return
        self._drawn = work.version
        title = next((title for title, name in self._titles.items() if name == joint), None)
        if title is not None:
            self._joint.value = title
        marks = work.joint(joint).marks
        try:
            fit = work.fit(joint)
        except ArmctlError:
            fit = None
        self._marks.show(marks_html(marks, fit, work.map.unit))
        self._fit.show(fit_html(work, joint) if marks else "")
        self._limits.show(limits_html(work, joint))
        show_numbers(self._which, len(marks))
        self._delete.visible = bool(marks)

    def _now_html(self, snapshot: Snapshot) -> str:
        channel = self._channel()
        try:
            output = present_outputs(self._robot, snapshot)[channel]
        except ArmctlError:  # told below Add mark
            return ""
        degrees = self._robot.shown(own_map(self._robot).angles({channel: output}))[self._index()]
        return (
            f"<div>Stands at <b>{fixed(output, 1)} {self._work.map.unit}</b>, now calibrated as "
            f"{fixed(degrees, 1)}°</div>"
        )

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

    async def _on_step(self) -> None:
        self._session.require_operator()
        await self._stepper.step(self._index(), STEPS[self._steps.value])

    def _jog(self, sign: float) -> Jog:
        joint, robot = self._index(), self._robot
        return joint_jog(robot, joint, sign * slow_speeds(robot)[joint] / robot.speed_limits[joint])

    def _add(self) -> None:
        self._watch.require_settled()
        self._work.add_mark(self._work.chosen, *self._mark(self._session.snapshot))

    def _mark(self, snapshot: Snapshot) -> tuple[float, float]:
        """Output and angle [rad]; ``ArmctlError`` where one of them is not known."""
        if not self._angle.text.strip():
            raise InputError("no angle is typed yet")
        return self._output(snapshot), self._robot.joints[self._index()].read(self._angle.value)


def marks_html(marks: Sequence[Mark], fit: JointFit | None, unit: str) -> str:
    """The marks with their residuals; one that does not fit is marked."""
    if not marks:
        return muted(
            "No marks yet: jog the joint to a mark of the protractor, type the angle, press Add mark."
        )
    rows = [
        [str(number), fixed(mark.output, 1), fixed(to_degrees(mark.angle), 2), ""]
        for number, mark in enumerate(marks, 1)
    ]
    for row, residual in zip(rows, fit.residuals_rad if fit else (), strict=False):
        row[-1] = fixed(to_degrees(residual), 2)
    if fit and fit.suspect is not None:
        rows[fit.suspect][-1] += " ✗"
    return table(("mark", unit, "angle °", "residual °"), rows, marked=fit and fit.suspect, words=())


def fit_html(work: CalibrationWork, joint: str) -> str:
    """What the marks of a joint come to, beside what its robot file says."""
    marks, unit = work.joint(joint).marks, work.map.unit
    try:
        fit = work.fit(joint)
    except ArmctlError as error:
        return refused(sentence(error.reason))
    if fit is None:
        left = LEAST_MARKS - len(marks)
        return muted(f"{left} more mark{'' if left == 1 else 's'} needed, as far apart as the joint allows.")
    own = own_calibration(work.robot, joint)
    rows = [
        ["sign", *("+" if one.per_rad > 0 else "−" for one in (fit, own))],
        ["offset (at 0°)", *(f"{fixed(one.zero, 1)} {unit}" for one in (fit, own))],
        ["scale", *(f"{fixed(abs(one.per_rad * DEGREE), 3)} {unit}/°" for one in (fit, own))],
        ["residual, RMS", f"{fixed(to_degrees(fit.rms_rad), 2)}°", ""],
    ]
    if work.map.homed:
        homes = (fit.angle(0.0), -own.zero / own.per_rad)
        rows.insert(1, ["home (0 counts) is at", *(f"{fixed(to_degrees(home), 2)}°" for home in homes)])
    text = table(("", "by the marks", "robot file"), rows)
    text += "".join(muted(sentence(words)) for words in differences(work.robot, joint, fit))
    return text if fit.advice is None else text + refused(sentence(fit.advice))


def limits_html(work: CalibrationWork, joint: str) -> str:
    """The safe limits of a joint, and where they come from."""
    try:
        low, high = work.limits(joint)
    except ArmctlError as error:
        return refused(sentence(error.reason))
    mine, now = work.joint(joint), work.in_force and work.in_force.joints.get(joint)
    if mine.low is not None or mine.high is not None:
        said = "set here"
    elif now is not None and not mine.by_default:
        said = "as in force" if (low, high) == (now.low, now.high) else "as in force, by the new marks"
    else:
        said = "as the robot file allows"
    return f"<div><b>{fixed(low, 1)} … {fixed(high, 1)} {work.map.unit}</b> ({said})</div>"


_HOW = (
    "Move the gripper until it just closes, without squeezing, and press 'Closed here'; open it as far as it "
    "should, and press 'Open here'."
)


class CalibrationGripper:
    """Move it, and say where it is closed and where it is open."""

    def __init__(self, session: Session) -> None:
        self._session, self._work = session, session.console.shared(SharedCalibration).work
        gui = session.gui
        LiveHtml(gui, muted(_HOW))
        self._slider = GripperSlider(session)
        with in_row(gui, " "):
            move = gui.add_button("Move gripper")
        session.needs(Need.GRIPPER, move, hint="0 % is closed, 100 % open, by the calibration in force.")
        self._now = LiveHtml(gui)
        jaws: tuple[Jaw, ...] = ("closed", "open")
        known = refused_by(partial(standing_gripper, session.console.robot))
        with button_pairs(gui):
            for jaw in jaws:
                button = gui.add_button(f"{jaw.capitalize()} here", color="gray")
                on_edit(session, button, partial(self._set_jaw, jaw), known)
        self._jaws = LiveHtml(gui)
        session.on(move.on_click, self._on_move)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show where the gripper is, and what was set."""
        work = self._work
        self._slider.follow(snapshot)
        self._now.show(self._now_html(snapshot))
        set_here = "set here, not saved yet" if work.jaws else "as in force"
        self._jaws.show(
            f"<div>Closed at <b>{fixed(work.jaw('closed'), 1)}</b>, open at "
            f"<b>{fixed(work.jaw('open'), 1)} {work.map.unit}</b> ({set_here})</div>"
        )

    def _now_html(self, snapshot: Snapshot) -> str:
        try:
            output = standing_gripper(self._session.console.robot, snapshot)
        except ArmctlError as error:
            return muted(sentence(error.reason))
        return f"<div>Stands at <b>{fixed(output, 1)} {self._work.map.unit}</b></div>"

    async def _on_move(self) -> None:
        await self._session.submit(MoveGripper(self._slider.opening))

    def _set_jaw(self, jaw: Jaw) -> None:
        self._work.set_jaw(jaw, standing_gripper(self._session.console.robot, self._session.snapshot))


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

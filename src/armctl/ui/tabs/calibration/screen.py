"""Calibration: which output is which angle, joint by joint; saving it, and how well known points are met."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from html import escape

import viser

from armctl.boards import SIMULATED_SERIAL, UNNUMBERED
from armctl.calibration import LEAST_MARKS, Calibration, CheckPose, Version, narrowed
from armctl.errors import ArmctlError, InputError
from armctl.facts import Need
from armctl.facts.angles import DEGREE, to_degrees
from armctl.protocol import MoveJoints, Snapshot
from armctl.ui.offers import refused_by
from armctl.ui.robot_switch import release_first
from armctl.ui.session import Session
from armctl.ui.tabs.calibration.joint import (
    CalibrationGripper,
    CalibrationJoint,
    on_edit,
)
from armctl.ui.tabs.calibration.points import HEAVIEST_KG, CalibrationPoints, take_effect
from armctl.ui.tabs.calibration.shared_calibration import CalibrationWork, SharedCalibration
from armctl.ui.tabs.calibration.tool_tip import CalibrationTip
from armctl.ui.tabs.manual.joints import slow_duration
from armctl.ui.widgets.html import (
    LiveHtml,
    date_and_time,
    fixed,
    heading,
    muted,
    refused,
    sentence,
    simulated_only_html,
    strong,
    table,
    with_minus,
)
from armctl.ui.widgets.number_field import NumberField, in_row

_NOTHING = "There is no output to calibrate."


class CalibrationScreen:
    """The joint to move on top; below it marks, gripper, saving and known points as inner tabs."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui, desk = session.gui, session.console.shared(SharedCalibration)
        self._shared = desk
        gap = "<div style='height:6px'></div>"
        self._parts: list[
            CalibrationJoint | CalibrationGripper | CalibrationSave | CalibrationPoints | CalibrationTip
        ] = []
        outputs = desk.work.robot.output_map
        if outputs is None:
            LiveHtml(gui, simulated_only_html(desk.work.robot) + muted(_NOTHING))
            return
        LiveHtml(gui, in_force_html(desk.in_force, desk.board) + gap)
        tabs = gui.add_tab_group()
        for title, part in (
            ("Joints", CalibrationJoint),
            *([] if outputs.gripper_channel is None else [("Gripper", CalibrationGripper)]),
            ("Save & test", CalibrationSave),
            ("Known points", CalibrationPoints),
            ("Tool point", CalibrationTip),
        ):
            with tabs.add_tab(title):
                self._parts.append(part(session))

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
        self._shared.points.follow(snapshot)
        for part in self._parts if self._session.sees("Calibration") else ():
            part.refresh(snapshot)


# Overview, saving, the test pose, and going back to an earlier calibration.

_LONGEST_NOTE = 120
_TEST_NOTE = (
    "Save first: the test pose uses the calibration in force. The arm moves slowly. If it does not look like "
    "this, press Revert."
)
_SAVE_NOTE = (
    "Saving closes the board and opens it again. A board that switches its outputs off meanwhile lets the "
    "arm drop: keep clear."
)
_LOAD_HINT = (
    "What the arm carries at the tool point while it works: the sag that it causes is corrected. Setting it "
    "opens the board anew, as saving does."
)
_REVERT_NOTE = "Revert uses this version again. The present one stays in the list."


class CalibrationSave:
    """What was measured becomes what the arm runs by."""

    def __init__(self, session: Session) -> None:
        self._session, self._desk = session, session.console.shared(SharedCalibration)
        self._drawn = -1
        self._no_draft: str | None = None
        """why there is nothing that could be saved"""
        gui = session.gui
        self._overview = LiveHtml(gui)
        self._note = gui.add_text("Note", "", hint="What a later reader should know of this calibration.")
        with in_row(gui):
            save = gui.add_button("Save calibration", icon=viser.Icon.DEVICE_FLOPPY)
            clear = gui.add_button("Forget what is not saved", color="gray")
        free = partial(release_first, reopen=True)
        session.needs(None, save, also=lambda snapshot: free(snapshot) or self._no_draft)
        LiveHtml(gui, muted(_SAVE_NOTE))
        with gui.add_folder("Test pose"):
            self._pose = self._desk.check_pose
            LiveHtml(gui, check_pose_html(self._pose))
            with in_row(gui):
                go = gui.add_button("Go to test pose", color="gray")
            session.needs(Need.HOLDING, go, hint="The arm goes there slowly, by the calibration in force.")
            LiveHtml(gui, muted(_TEST_NOTE))
        if self._desk.in_force is not None and self._desk.in_force.deflection:
            self._add_load(self._desk.in_force)
        with gui.add_folder("Earlier calibrations"):
            versions = self._desk.versions()
            self._versions = earlier_versions(versions)
            self._version = gui.add_dropdown("Version", tuple(self._versions))
            with in_row(gui):
                revert = gui.add_button("Revert", color="orange")
            kept = refused_by(lambda _: self._desk.require_revertable(self._versions[self._version.value]))
            session.needs(None, revert, also=lambda snapshot: free(snapshot) or kept(snapshot))
            LiveHtml(gui, muted(_REVERT_NOTE))
            LiveHtml(gui, kept_html(versions))
        session.on(save.on_click, self._on_save)
        work = self._desk.work
        on_edit(session, clear, work.clear, lambda _: self._no_draft if work.is_empty else None)
        session.on(go.on_click, self._on_go)
        session.on(revert.on_click, self._on_revert)

    def _add_load(self, now: Calibration) -> None:
        """Where joints give way: what the arm carries at work."""
        session, gui = self._session, self._session.gui
        with gui.add_folder("Load"):
            LiveHtml(gui, load_html(now))
            self._load = NumberField(gui, "Load kg", now.load_kg, hint=_LOAD_HINT)
            with in_row(gui):
                carry = gui.add_button("Set the load", color="gray")
            other = refused_by(lambda _: self._desk.with_load(self._load.within(0.0, HEAVIEST_KG)))
            free = partial(release_first, reopen=True)
            session.needs(None, carry, also=lambda snapshot: free(snapshot) or other(snapshot))
            session.on(carry.on_click, self._on_load)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what was measured, if that has changed."""
        if self._drawn != self._desk.work.version:
            self._drawn = self._desk.work.version
            self._no_draft, found = None, ""
            try:
                found = draft_html(self._desk)
            except ArmctlError as refusal:
                self._no_draft = str(refusal)
            self._overview.show(overview_html(self._desk.work) + found)

    async def _on_save(self) -> None:
        note = self._note.value.strip()
        if len(note) > _LONGEST_NOTE:
            raise InputError(f"the note has {len(note)} characters, {_LONGEST_NOTE} are allowed; shorten it")
        self._session.require_operator()
        self._session.robots.require_reopenable()
        saved = await self._desk.save(note)
        await take_effect(self._session, "Calibration saved", str(saved.path))

    async def _on_go(self) -> None:
        session = self._session
        way = self._pose.q - session.snapshot.q_command
        await session.submit(MoveJoints(self._pose.q, slow_duration(session.console.robot, way)))

    async def _on_load(self) -> None:
        self._session.require_operator()
        self._session.robots.require_reopenable()
        saved = await self._desk.set_load(self._load.within(0.0, HEAVIEST_KG))
        await take_effect(self._session, "Load set", str(saved.path))

    async def _on_revert(self) -> None:
        self._session.require_operator()
        self._session.robots.require_reopenable()
        label = self._version.value
        await self._desk.revert(self._versions[label])
        await take_effect(self._session, "Calibration reverted", label)


def load_html(calibration: Calibration) -> str:
    """What load the correction of sag counts."""
    return f"<div>Sag is corrected for a load of <b>{calibration.load_kg:g} kg</b> at the tool point.</div>"


def earlier_versions(versions: Sequence[Version]) -> dict[str, int | None]:
    """Numbers by label of what can be gone back to, the latest first; last the robot file itself, None."""
    earlier = {version_label(one): one.number for one in versions[1:] if one.problem is None}
    return {**earlier, "robot file, no calibration": None}


# The texts.

_BOARDS = {
    None: "its board (not connected yet)",
    SIMULATED_SERIAL: "the simulated board",
    UNNUMBERED: "a board without a serial number (one calibration for all such boards)",
}


def in_force_html(calibration: Calibration | None, board: str | None) -> str:
    """Which calibration the arm runs by."""
    on = _BOARDS.get(board, f"board {board}")
    if calibration is None:
        return strong("In force: the robot file") + muted(f"This arm is not calibrated on {on}.")
    note = f" “{calibration.note}”" if calibration.note else ""
    return strong(f"In force: calibration of {date_and_time(calibration.made)}{note}") + muted(
        f"{joints_words(calibration)} of this arm on {on}; the rest is as in the robot file."
    )


def overview_html(work: CalibrationWork) -> str:
    """What was measured so far, a row a joint."""
    unit = work.map.unit
    rows = [[one.title, *_measured(work, one.name)] for one in work.robot.joints]
    text = heading(f"What was measured (outputs in {unit})")
    text += table(("", "marks", "RMS", "at 0°", "per degree", "safe"), rows)
    if work.map.gripper_channel is not None:
        said = "" if work.jaws else " (as before)"
        text += (
            f"<div style='margin:6px 4px 0'>Gripper: closed at {fixed(work.jaw('closed'), 1)}, open at "
            f"{fixed(work.jaw('open'), 1)} {unit}{said}</div>"
        )
    if work.unfinished:
        text += refused(f"{', '.join(work.unfinished)}: fewer than {LEAST_MARKS} marks are not used.")
    return text


def draft_html(desk: SharedCalibration) -> str:
    """What saving would do; ``ArmctlError`` where nothing can be saved."""
    return "".join(muted(sentence(words)) for words in narrowed(desk.work.robot, desk.draft()))


def check_pose_html(pose: CheckPose) -> str:
    """What one should see in the test pose."""
    *joints, tool = (with_minus(words) for words in pose.words)
    said = f"<b>{escape(', '.join(joints))}</b>; {escape(tool)}."
    return f"<div>You should see ({escape(pose.title)}): {said}</div>"


def kept_html(versions: Sequence[Version]) -> str:
    """Where they are kept."""
    if not versions:
        return muted("Nothing is saved for this arm on this board yet.")
    return f"<div style='overflow-wrap:anywhere'>{muted(f'Kept in {versions[0].path.parent}.')}</div>"


def version_label(version: Version) -> str:
    """An earlier calibration, as one line of a list."""
    if version.problem is not None:
        return f"{version.number}: cannot be read"
    what = "robot file" if version.calibration is None else joints_words(version.calibration)
    back = "" if version.again is None else f", back to {version.again}"
    note = f" “{version.note}”" if version.note and version.calibration is not None else ""
    return f"{version.number}: {date_and_time(version.made)}, {what}{back}{note}"


def joints_words(calibration: Calibration) -> str:
    """What a calibration covers."""
    count = len(calibration.joints)
    joints = f"{count} joint{'' if count == 1 else 's'}"
    return joints if calibration.gripper is None else f"{joints} and the gripper"


def _measured(work: CalibrationWork, joint: str) -> list[str]:
    count = str(len(work.joint(joint).marks) or "–")
    try:
        fit = work.fit(joint)
        low, high = work.limits(joint)
    except ArmctlError:
        return [count, "no line", "–", "–", "–"]
    safe = f"{fixed(low, 0)} … {fixed(high, 0)}"
    if fit is None:
        return [count, "–", "–", "–", safe]
    doubt = " ✗" if fit.suspect is not None else " ?" if fit.advice else ""
    rms = f"{fixed(to_degrees(fit.rms_rad), 2)}°{doubt}"
    return [count, rms, fixed(fit.zero, 1), fixed(fit.per_rad * DEGREE, 3), safe]

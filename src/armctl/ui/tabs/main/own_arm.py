"""Your own arm: lengths of a usual build or DH rows become a robot file, drawn and checked as it is typed."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import field
from html import escape
from typing import Any, cast

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, InputError
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot, robot_path
from armctl.robot.draft import BUILDS, Draft
from armctl.robot.load import across_the_link
from armctl.robot.look.rows import MAKES, MakeName
from armctl.robot.parts import Hand
from armctl.ui.own_copy import taken_along
from armctl.ui.robot_switch import RobotChoice
from armctl.ui.scene.arm_model import HALF_OPEN, ArmFigure
from armctl.ui.scene.camera import towards_camera
from armctl.ui.session import Session
from armctl.ui.tabs.main.arm_lengths import ROWS_HINT, LengthLabels, rows_of
from armctl.ui.tabs.main.beginning import OWN_ARM
from armctl.ui.widgets.html import LiveHtml, folded, muted, refused, sentence, warned
from armctl.ui.widgets.number_field import NumberField, field_grid, in_row, parse_number

_ROWS, _COPY = "DH rows", "A copy of the present robot"
_BEGINNINGS = {build.title: build for build in BUILDS}
_EXAMPLE = "0 90 80 0 base\n120 0 0 0 shoulder\n110 0 0 0 elbow\n0 90 0 90 wrist\n0 0 90 0 roll"
_JOINTS_HINT = (
    "Turn each joint to both ends of its range, and press lowest or highest there. Without servo channels "
    "the arm runs on the simulated board."
)
_END_HINT = "The angle at which the joint is drawn becomes its lowest or highest one."
_POSE_HINT = "The pose that is drawn becomes the arm's home pose, or the one in which it rests."
_GRIPPER_HINT = "Servo channel of the gripper; empty: no gripper."
_MOTORS: dict[str, MakeName | None] = {
    "not known": None,
    **{make.title: name for name, make in MAKES.items()},
}
_HANDS: dict[str, Hand | None] = {
    "as its gripper": None,
    "two jaws": "jaws",
    "suction cup": "cup",
    "pen": "pen",
    "tip": "tip",
}
_MOTORS_HINT = "What turns its joints: it is drawn, and taken for its body, as wide as these are."
_HAND_HINT = "What is drawn at the tool point: jaws where it has a gripper, else a tip."
_NO_JOINTS: tuple[str, ...] = ("base",)
"""until an arm is drawn"""
_ROOT = "/new-arm"
_ASIDE = 1.1
"""how far beside the present arm the new one is drawn, times the longer reach of both"""
_LOOK_AGAIN = 0.2
"""share by which that changes before the page looks anew"""
_Pose = tuple[tuple[str, ...], list[float]]
"""the joints that it is of, and their values as people count them"""


@dataclass
class _Edits:
    """What was changed of a beginning; kept while lengths and rows change."""

    joints: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    poses: dict[str, _Pose] = field(default_factory=dict[str, _Pose])
    floor_mm: float | None = None
    gripper: str | None = None
    """the text of its channel; empty: there is none"""
    motors: MakeName | None = None
    hand: Hand | None = None
    unread: dict[str, InputError] = field(default_factory=dict[str, InputError])
    """what cannot be read of the fields; it may be half typed"""

    def applied(self, draft: Draft) -> Draft:
        """The draft with these edits, as far as it has such joints. Raises what cannot be read."""
        for error in self.unread.values():
            raise error
        for joint, entries in self.joints.items():
            if joint in draft.joints:
                draft = draft.with_joint(joint, **entries)
        for name, (joints, angles) in self.poses.items():
            if joints == draft.joints:
                draft = draft.with_pose(name, angles)
        if self.gripper:
            draft = draft.with_gripper(parse_number(self.gripper, "Gripper channel"))
        elif self.gripper is not None:
            draft = draft.changed(gripper=None)
        draft = draft.with_guess(self.motors, self.hand)
        return draft if self.floor_mm is None else draft.changed(floor={"z_mm": self.floor_mm})


class OwnArm:
    """A tab in *Main*; nothing is drawn before it is begun, nothing is kept before it is saved."""

    def __init__(self, session: Session) -> None:
        self._session, self._edits = session, _Edits()
        self._robot: Robot | None = None
        self._figure: ArmFigure | None = None
        self._written = LengthLabels(session.client.scene, _ROOT)
        self._wrong: str | None = None
        """why what the fields say is no arm"""
        self._looked_aside = 0.0
        """how far beside the present arm the new one stood when the page was last shown both [m]"""
        self._q: dict[str, float] = {}
        """where each joint is drawn [degrees]"""
        self._servo_shown = ("", "", "")
        """the texts of the servo fields as they were filled in"""
        self._named = "my_arm"
        """the file name that follows from the title"""
        gui = session.gui
        self._intro = LiveHtml(gui, OWN_ARM)
        with in_row(gui):
            self._begin = gui.add_button("New arm", icon=viser.Icon.PLUS)
        self._box = gui.add_folder("New arm", visible=False)
        with self._box:
            self._status = LiveHtml(gui)
            steps = gui.add_tab_group()
            with steps.add_tab("1 Lengths"):
                self._kind = gui.add_dropdown("Begin with", (*_BEGINNINGS, _ROWS, _COPY))
                self._lengths_box = field_grid(gui)
                self._meanings = LiveHtml(gui)
                self._rows_box = gui.add_folder(None, visible=False)
                with self._rows_box:
                    self._convention = gui.add_dropdown("Convention", ("standard", "modified"))
                    self._rows = gui.add_text("Rows", _EXAMPLE, multiline=True, hint=ROWS_HINT)
                    LiveHtml(gui, muted(ROWS_HINT))
                self._motors = gui.add_dropdown("Motors", tuple(_MOTORS), hint=_MOTORS_HINT)
                self._hand = gui.add_dropdown("Hand", tuple(_HANDS), hint=_HAND_HINT)
            with steps.add_tab("2 Joints"):
                LiveHtml(gui, muted(_JOINTS_HINT))
                self._add_joint_fields(gui)
                self._poses = gui.add_button_group("Keep pose as", ("home", "rest"), hint=_POSE_HINT)
            with steps.add_tab("3 Save"):
                self._add_save_fields(gui)
            with in_row(gui):
                cancel = gui.add_button("Discard", color="gray")
        self._lengths: dict[str, NumberField] = {}
        self._fill_lengths()
        session.on(self._begin.on_click, self._on_begin)
        session.on(self._kind.on_update, self._on_kind)
        for handle in (self._convention, self._rows):
            session.on(handle.on_update, self._show)
        for choice in (self._motors, self._hand):
            session.on(choice.on_update, self._on_figure)
        session.on(self._poses.on_click, self._on_pose)
        session.on(cancel.on_click, self._end)
        session.on_theme(self._draw_anew)

    def _add_joint_fields(self, gui: viser.GuiApi) -> None:
        session = self._session
        self._joint: viser.GuiDropdownHandle[str] = gui.add_dropdown("Joint", _NO_JOINTS)
        self._angle = gui.add_slider("Turn it °", -180.0, 180.0, 0.5, 0.0)
        self._ends = gui.add_button_group("Limit here", ("lowest", "highest"), hint=_END_HINT)
        with field_grid(gui):
            self._low, self._high = NumberField(gui, "Lowest °", -90.0), NumberField(gui, "Highest °", 90.0)
            self._speed = NumberField(gui, "Speed °/s", 60.0)
            self._channel = gui.add_text("Servo channel", "", hint="Of the board; empty: no servo yet.")
            self._zero = NumberField(gui, "µs at 0°", 1500.0)
            self._scale = NumberField(gui, "µs per degree", 10.0, hint="Negative: it turns the other way.")
        session.on(self._joint.on_update, self._fill_joint)
        session.on(self._angle.on_update, self._on_angle)
        session.on(self._ends.on_click, self._on_end)
        for one in (self._low, self._high, self._speed, self._zero, self._scale):
            session.on(one.handle.on_update, self._on_joint_field)
        session.on(self._channel.on_update, self._on_joint_field)

    def _add_save_fields(self, gui: viser.GuiApi) -> None:
        session = self._session
        self._title = gui.add_text("Title", "My arm")
        self._name = gui.add_text("File name", self._named)
        self._floor = NumberField(gui, "Floor mm", 0.0, hint="Height of the floor in the base frame.")
        self._gripper = gui.add_text("Gripper channel", "", hint=_GRIPPER_HINT)
        with in_row(gui):
            save = gui.add_button("Save and open", icon=viser.Icon.DEVICE_FLOPPY)
            download = gui.add_button("Download robot file", icon=viser.Icon.DOWNLOAD, color="gray")
        session.needs(None, save, also=lambda _: self._wrong, hint="It is saved among your own arms.")
        session.needs(None, download, also=lambda _: self._wrong, told=False, anyone=True)
        session.on(self._title.on_update, self._on_title)
        session.on(self._name.on_update, self._show)
        session.on(self._floor.handle.on_update, self._on_floor)
        session.on(self._gripper.on_update, self._on_gripper)
        session.on(save.on_click, self._on_save)
        session.on(download.on_click, self._on_download)

    def _draft(self) -> Draft:
        name, title, kind = self._name.value.strip(), self._title.value.strip(), self._kind.value
        if kind == _COPY:
            present = robot_path(self._session.robots.present.name)
            if present.suffix.lower() != ".toml":
                raise InputError(f"{present} is no robot file (.toml) and cannot be copied")
            draft = Draft.of_file(present).changed(name=name, title=title)
        elif kind == _ROWS:
            draft = Draft.of_rows(name, title, self._convention.value, rows_of(self._rows.value), {})
        else:
            lengths = {key: one.value for key, one in self._lengths.items()}
            draft = Draft.of_build(name, title, _BEGINNINGS[kind], lengths)
        return self._edits.applied(draft)

    def _show(self) -> None:
        """Draw what the fields say; where that is no arm, say why and leave the last one standing."""
        if not self._box.visible:
            return
        try:
            draft = self._draft()
            robot = draft.robot()
            solver = robot.inverse_kinematics
        except ArmctlError as refusal:
            self._wrong = str(refusal)
            self._status.show("".join(refused(sentence(one.reason)) for one in refusal.each or (refusal,)))
            return
        self._wrong = None
        how = "every solution in closed form" if solver.complete else "solutions by search, maybe not all"
        note = across_the_link(robot.chain)
        x, y, z = np.round(1000 * robot.forward(self._pose_of(robot))[:3, 3], 1) + 0.0
        self._status.show(
            f"<div><b>{robot.n} joints: {escape(solver.family)}</b><br>{how}</div>"
            "<div style='opacity:.75;margin-bottom:6px'>"
            f"The tool is at x {x:z.1f}, y {y:z.1f}, z {z:z.1f} mm.</div>"
            + ("" if note is None else warned(sentence(f"the tool axis: {note.what}; {note.mend}")))
        )
        shown = self._robot
        drawn = (robot.chain, robot.gripper, robot.look, robot.floor_z)
        if shown is None or drawn != (shown.chain, shown.gripper, shown.look, shown.floor_z):
            self._draw(robot)
        self._robot = robot
        if tuple(self._joint.options) != robot.joint_names:
            self._joint.options = robot.joint_names
            self._fill_joint()
        if self._figure is not None:
            self._figure.pose(self._pose_of(robot), HALF_OPEN)
            self._write_lengths(robot)

    def _write_lengths(self, robot: Robot) -> None:
        build = _BEGINNINGS.get(self._kind.value)
        if build is None or self._wrong is not None:
            self._written.clear()
        else:
            lengths = {key: one.value for key, one in self._lengths.items()}
            self._written.show(build, lengths, robot, self._pose_of(robot))

    def _pose_of(self, robot: Robot) -> FloatArray:
        """(n,) the pose that is drawn [rad]; it may be outside the limits, which are being sought."""
        home = zip(robot.joint_names, robot.shown(robot.pose("home")).tolist(), strict=True)
        return robot.read(np.array([self._q.get(name, angle) for name, angle in home]))

    def _draw(self, robot: Robot) -> None:
        self._erase()
        self._figure = ArmFigure(self._session.client.scene, robot, _ROOT, theme=self._session.theme)
        present = self._session.console.robot
        aside = _ASIDE * max(robot.chain.length, present.chain.length)
        along_y = math.copysign(aside, towards_camera(present)[1])
        self._figure.root.position = (0.0, along_y, 0.0)
        if abs(aside - self._looked_aside) > _LOOK_AGAIN * aside:
            self._looked_aside = aside
            self._session.view.look(beside=(robot, along_y))
        if self._kind.value not in _BEGINNINGS:  # else its lengths say so
            self._figure.say("new arm")

    def _draw_anew(self) -> None:
        if self._figure is not None and self._robot is not None:
            self._draw(self._robot)
            self._figure.pose(self._pose_of(self._robot), HALF_OPEN)
            self._write_lengths(self._robot)

    def _erase(self) -> None:
        self._written.clear()
        if self._figure is not None:
            self._figure.root.remove()
            self._figure = None

    def _on_begin(self) -> None:
        self._form_shown(True)
        self._fill()

    def _end(self) -> None:
        if self._figure is not None:
            self._looked_aside = 0.0
            self._session.view.look()
        self._erase()
        self._robot, self._edits, self._q = None, _Edits(), {}
        self._form_shown(False)

    def _form_shown(self, shown: bool) -> None:
        self._box.visible = shown
        self._intro.visible = self._begin.visible = not shown

    def _on_kind(self) -> None:
        self._edits, self._q = _Edits(), {}
        self._motors.value, self._hand.value = next(iter(_MOTORS)), next(iter(_HANDS))
        kind = self._kind.value
        self._lengths_box.visible = self._meanings.visible = kind in _BEGINNINGS
        self._rows_box.visible = kind == _ROWS
        self._fill_lengths()
        self._fill()

    def _on_title(self) -> None:
        """The file name follows the title, until somebody types another one."""
        name = re.sub(r"[^a-z0-9]+", "_", self._title.value.lower()).lstrip("_0123456789").rstrip("_")
        if name and self._name.value == self._named:
            self._named = self._name.value = name
        self._show()

    def _fill(self) -> None:
        """Show what is begun with."""
        try:
            table = cast("dict[str, dict[str, Any]]", self._draft().table)
        except ArmctlError:  # told by ``_show``
            table = {}
        self._floor.fill(float(table.get("floor", {}).get("z_mm", 0.0)))
        self._gripper.value = str(table.get("gripper", {}).get("servo", {}).get("channel", ""))
        self._show()
        self._fill_joint()

    def _fill_lengths(self) -> None:
        for one in self._lengths.values():
            one.handle.remove()
        self._lengths = {}
        build = _BEGINNINGS.get(self._kind.value)
        words = [] if build is None else [f"{one.title}: {one.meaning}" for one in build.lengths]
        self._meanings.show(folded("What the lengths mean", words))
        with self._lengths_box:
            for length in () if build is None else build.lengths:
                hint = sentence(length.meaning)
                number = NumberField(self._session.gui, f"{length.title} mm", length.usual_mm, hint=hint)
                self._session.on(number.handle.on_update, self._show)
                self._lengths[length.key] = number

    def _fill_joint(self) -> None:
        self._edits.unread.pop("joint", None)
        robot = self._robot
        if robot is None or self._joint.value not in robot.joint_names:
            return
        k = robot.joint_names.index(self._joint.value)
        joint = robot.joints[k]
        self._low.fill(joint.shown(joint.lower))
        self._high.fill(joint.shown(joint.upper))
        self._speed.fill(joint.shown(joint.speed))
        outputs = robot.output_map
        servo = self._edits.joints.get(self._joint.value, {}).get("servo")
        if servo is not None:
            channel, zero, scale = servo["channel"], servo["zero_us"], servo["us_per_deg"]
        elif outputs is not None:
            channel, zero = outputs.channels[k], float(outputs.zero[k])
            scale = joint.read(float(outputs.per_rad[k]))  # a degree's share of a radian's
        else:
            channel, zero, scale = "", 1500.0, 10.0
        self._channel.value = str(channel)
        self._zero.fill(zero)
        self._scale.fill(scale)
        self._servo_shown = self._servo_texts()
        self._angle.value = min(max(joint.shown(float(self._pose_of(robot)[k])), -180.0), 180.0)

    def _servo_texts(self) -> tuple[str, str, str]:
        return self._channel.value, self._zero.text, self._scale.text

    def _on_angle(self) -> None:
        self._q[self._joint.value] = float(self._angle.value)
        self._show()

    def _on_end(self) -> None:
        (self._low if self._ends.value == "lowest" else self._high).fill(float(self._angle.value))
        self._on_joint_field()

    def _on_joint_field(self) -> None:
        with self._reading("joint"):
            self._edits.joints[self._joint.value] = self._joint_entries()
        self._show()

    @contextmanager
    def _reading(self, what: str) -> Generator[None]:
        """A field that cannot be read may be half typed: it is told below, and the rest stays as it was."""
        self._edits.unread.pop(what, None)
        try:
            yield
        except InputError as unread:
            self._edits.unread[what] = unread

    def _joint_entries(self) -> dict[str, Any]:
        joint, robot = self._joint.value, self._robot
        entries = dict(self._edits.joints.get(joint, {}))
        entries["limit_deg"] = [self._low.value, self._high.value]
        if self._speed.edited:
            speed, ratio = self._speed.value, 6.0
            if robot is not None and joint in robot.joint_names:
                present = robot.joints[robot.joint_names.index(joint)]
                ratio = present.acceleration / present.speed  # 1/s, in any unit of angle
            entries |= {"speed_deg_s": speed, "acceleration_deg_s2": ratio * speed}
        if "servo" not in entries and self._servo_texts() == self._servo_shown:
            pass  # as the beginning has it
        elif self._channel.value.strip():
            channel = parse_number(self._channel.value, "Servo channel")
            if channel != int(channel):
                raise InputError(f"Servo channel: {channel:g} is no whole number")
            zero, scale = self._zero.value, self._scale.value
            reached = sorted(zero + scale * angle for angle in entries["limit_deg"])
            pulse = [np.floor(reached[0]), np.ceil(reached[1])]
            servo = {"channel": int(channel), "zero_us": zero, "us_per_deg": scale, "pulse_us": pulse}
            entries["servo"] = servo
        else:
            entries["servo"] = None
        return entries

    def _on_figure(self) -> None:
        self._edits.motors, self._edits.hand = _MOTORS[self._motors.value], _HANDS[self._hand.value]
        self._show()

    def _on_floor(self) -> None:
        with self._reading("floor"):
            self._edits.floor_mm = self._floor.value
        self._show()

    def _on_gripper(self) -> None:
        self._edits.gripper = self._gripper.value.strip()
        self._show()

    def _on_pose(self) -> None:
        if self._robot is None:
            raise InputError("there is no arm yet whose pose could be taken")
        q = self._robot.check_limits(self._pose_of(self._robot))
        self._edits.poses[self._poses.value] = (self._robot.joint_names, self._robot.shown(q).tolist())
        self._show()
        self._session.notify("New arm", f"The pose drawn is its {self._poses.value} pose now.")

    def _on_download(self) -> None:
        self._session.download("robot.toml", self._checked().text())

    def _checked(self) -> Draft:
        draft = self._draft()
        draft.robot()
        return draft

    async def _on_save(self) -> None:
        session = self._session
        session.require_operator()
        draft = self._checked()
        path = await asyncio.to_thread(draft.save)
        along = await taken_along(session.console, draft.robot()) if self._kind.value == _COPY else ""
        session.robots.offer(choice := RobotChoice(draft.name, str(draft.table["title"])))
        session.notify("New arm", f"{choice.title} is saved: {path}. {along}".strip())
        self._end()  # before the page is built anew
        await session.change_robot(choice.name)

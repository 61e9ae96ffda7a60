"""The fields of the Trajectory tab: which motion, from where to where, how, and in which time."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics import CRITERIA, Target
from armctl.motion import PitchMode, usual_pitch
from armctl.motion.plan import Passing
from armctl.ui.session import Session
from armctl.ui.tabs.program.shared_program import SharedProgram
from armctl.ui.tabs.trajectory.plan import (
    ARC,
    JOINT_BY_JOINT,
    JOINTS,
    LINE,
    MOTIONS,
    PROGRAM,
    TEST_PATHS,
    TOOL_ARC,
    TOOL_LINE,
    TOOL_PATHS,
    MotionRequest,
    ToolWish,
    why_not,
)
from armctl.ui.tabs.trajectory.study import StudyForm
from armctl.ui.widgets.html import LiveHtml, muted, refused
from armctl.ui.widgets.number_field import EditWatch, NumberField, NumbersField
from armctl.ui.widgets.profile_choice import ALL_PROFILES, ProfileChoice

_CHOOSE_HINT = "What is least energy among the solutions of a point."
_ABOUT = {
    JOINTS: "All joints from one pose to another; the tool goes as it comes.",
    TOOL_LINE: "The tool in a straight line, on the branch the arm is on.",
    TOOL_ARC: "The tool along the circle through its start, via and end.",
    ARC: "The paper's test arc: radius 200 mm about the base axis, −87° to 87°, 85 mm high.",
    LINE: "The paper's test line: x = 220 mm, y from −196 to 196 mm by 14 mm, 85 mm high.",
    PROGRAM: "The program that is edited in Manual → Serial motion.",
    JOINT_BY_JOINT: "How fast each joint moves the tip at one constant joint speed. A study: nothing moves.",
}
_SHORTEST = "Duration 0 is the shortest that the speed and acceleration limits allow."
_TO_THE_LIMITS = "For 0 s is until every joint has come to its limit."
_PAPER_ARM, _PAPER_CRITERION = "uzuner", "published"
"""the criterion that the paper's tables were made with"""
_PASSING: dict[str, Passing | None] = {
    "tool on the curve itself": None,
    "stop at each": "stop",
    "spline through them": "spline",
    "blended": "blend",
}
_BLEND_MM = 2.0


class MotionForm:
    """Which motion, from where to where, by which criterion, along which profile, in which time."""

    def __init__(self, session: Session) -> None:
        """Add the fields to the present container."""
        self._session = session
        gui, robot = session.gui, session.console.robot
        self._motion = gui.add_dropdown("Which motion", MOTIONS, initial_value=JOINTS)
        self._about = LiveHtml(gui)
        self._from = EndChoice(session, "From", PRESENT, self._show_fields)
        self._to = EndChoice(session, "To", next(iter(robot.poses)), self._show_fields)
        self._tool = ToolPathForm(session)
        self._passing = gui.add_dropdown("Points", tuple(_PASSING), visible=False)
        self._blend = NumberField(gui, "Blend radius mm", _BLEND_MM, visible=False)
        self._choose = gui.add_dropdown(
            "Choose by", CRITERIA, initial_value=CRITERIA[0], visible=False, hint=_CHOOSE_HINT
        )
        self._profile = ProfileChoice(gui, session.on, ALL_PROFILES)
        self.study = StudyForm(session)
        self._zero = LiveHtml(gui)
        fields = (
            *self._from.fields, *self._to.fields, *self._tool.fields, self._blend, self._profile.duration,
            *self.study.fields,
        )  # fmt: skip
        self.watch = EditWatch(fields)
        session.on(self._motion.on_update, self._on_motion)
        session.on(self._passing.on_update, self._on_passing)
        self._show_fields()

    @property
    def is_study(self) -> bool:
        """Whether a study is chosen, not a motion."""
        return self._motion.value == JOINT_BY_JOINT

    @property
    def from_present(self) -> bool:
        """Whether the motion begins where the arm stands."""
        motion = self._motion.value
        return motion == PROGRAM or (motion not in TEST_PATHS and self._from.kind == PRESENT)

    @property
    def settings(self) -> tuple[object, ...]:
        """All settings of the motion; the same again means that nothing has changed."""
        motion = self._motion.value
        if self.is_study:
            return (motion, *self.study.settings)
        if motion == PROGRAM:
            return motion, self._session.shared(SharedProgram).version
        if motion in TEST_PATHS:
            ends: tuple[object, ...] = (self._passing.value, self._blend.text)
        else:
            end = self._tool if motion in TOOL_PATHS else self._to
            ends = (self._from.settings, end.settings)
        choose = self._choose.value if self._solves else ""
        return (motion, ends, choose, self._profile.settings)

    def request(self, present: FloatArray) -> MotionRequest:
        """The motion that the fields ask for, with the arm at ``present`` (n,) [rad].

        Raises:
            InputError: a field holds no number that can be used.
        """
        motion = self._motion.value
        start = present if motion in TEST_PATHS or motion == PROGRAM else self._from.asked(present)
        profile, duration = self._profile.checked()
        return MotionRequest(
            motion,
            self._title(),
            start,
            profile,
            duration,
            self._choose.value,
            end=self._to.asked(present) if motion == JOINTS else None,
            tool=self._tool.wish(with_via=motion == TOOL_ARC) if motion in TOOL_PATHS else None,
            passing=self._passed,
            blend_m=self._blend.value / 1000 if self._blend.visible else 0.0,
            program=self._session.shared(SharedProgram).program if motion == PROGRAM else None,
            present=present,
            opening=self._session.snapshot.gripper,
        )

    def refresh(self) -> None:
        """Say what a duration of 0 means for as long as it is 0."""
        duration = self.study.duration if self.is_study else self._profile.duration
        self._zero.visible = duration.visible and duration.text.strip() in ("", "0")
        self._zero.show(muted(_TO_THE_LIMITS if self.is_study else _SHORTEST))

    @property
    def _solves(self) -> bool:
        """Whether the inverse kinematics of a point has to choose."""
        return self._motion.value in TEST_PATHS or self._from.is_point or self._to.is_point

    @property
    def _passed(self) -> Passing | None:
        return _PASSING[self._passing.value]

    def _title(self) -> str:
        motion, profile = self._motion.value, self._profile.profile
        if motion == JOINTS:
            return f"{self._from.title} to {self._to.title}, {profile}"
        if motion in TEST_PATHS:
            shaped = "" if self._passed == "blend" else f", {profile}"
            return f"{motion}, {self._passing.value}{shaped}"
        return f"{motion} from {self._from.title}, pitch {self._tool.pitch}, {profile}"

    async def _on_motion(self) -> None:
        motion, robot = self._motion.value, self._session.console.robot
        if motion in TEST_PATHS and robot.name == _PAPER_ARM:
            self._choose.value = _PAPER_CRITERION
        if motion in TOOL_PATHS:
            self._profile.choose("trapezoid")
        self._show_fields()
        if motion in TEST_PATHS:
            reason = await asyncio.to_thread(why_not, robot, TEST_PATHS[motion]())
            if reason is not None and self._motion.value == motion:
                self._about.show(muted(_ABOUT[motion]) + refused(f"Not for this arm: {reason}."))

    async def _on_passing(self) -> None:
        self._show_fields()

    def _show_fields(self) -> None:
        motion = self._motion.value
        test = motion in TEST_PATHS
        blended = test and self._passed == "blend"
        planned = motion not in (PROGRAM, JOINT_BY_JOINT)
        each = motion == JOINTS or (test and self._passed == "stop")
        self._from.show(motion == JOINTS or motion in TOOL_PATHS)
        self._to.show(motion == JOINTS)
        self._tool.show(motion in TOOL_PATHS, via=motion == TOOL_ARC)
        self._passing.visible = test
        self._blend.visible = blended
        self._choose.visible = self._solves
        self._profile.show(profile=planned and not blended, duration=planned, normal=each)
        self.study.show(self.is_study)
        self._about.show(muted(_ABOUT[motion]))


# Where a motion begins or ends: a pose, angles, or a point of the tool.

PRESENT = "present pose"
ANGLES = "angles"
POINT = "X Y Z"
_XYZ_HINT = "Tool point in the base frame [mm], by inverse kinematics; e.g. 220, −196, 85."


class EndChoice:
    """A dropdown, and the field that the chosen kind of end needs."""

    def __init__(self, session: Session, label: str, initial: str, changed: Callable[[], None]) -> None:
        """Add both to the present container.

        Args:
            session: of the page.
            label: "From" or "To".
            initial: what is chosen first: ``PRESENT`` or a pose's name.
            changed: called when another kind is chosen.
        """
        gui, self._robot = session.gui, session.console.robot
        self._changed = changed
        self._visible = True
        poses = self._robot.poses
        self._kind = gui.add_dropdown(label, (PRESENT, *poses, ANGLES, POINT), initial_value=initial)
        titles = [joint.title for joint in self._robot.joints]
        hint = f"Joint angles [°]: {', '.join(titles)}."
        angles = np.degrees(self._robot.pose(next(iter(poses)))).tolist()
        self._angles = NumbersField(gui, f"{label} θ °", titles, angles, hint=hint, visible=False)
        self._point = _point_field(session, f"{label} X Y Z mm")
        self.fields = (self._angles, self._point)
        session.on(self._kind.on_update, self._on_kind)

    @property
    def kind(self) -> str:
        """The choice: ``PRESENT``, a pose's name, ``ANGLES`` or ``POINT``."""
        return self._kind.value

    @property
    def is_point(self) -> bool:
        """Whether inverse kinematics is needed."""
        return self._visible and self.kind == POINT

    @property
    def settings(self) -> tuple[str, ...]:
        """All settings of the end, but for where the arm stands."""
        typed = {ANGLES: self._angles.text, POINT: self._point.text}
        return self.kind, typed.get(self.kind, "")

    @property
    def title(self) -> str:
        """The end in a few words."""
        if self.kind == ANGLES:
            return f"({self._angles.text})°"
        return f"({self._point.text}) mm" if self.kind == POINT else self.kind

    def show(self, visible: bool) -> None:
        """Show or hide the choice and its field."""
        self._visible = self._kind.visible = visible
        self._angles.visible = visible and self.kind == ANGLES
        self._point.visible = visible and self.kind == POINT

    def asked(self, present: FloatArray) -> FloatArray | Target:
        """Joint angles (n,) [rad], or where the tool shall be.

        Raises:
            InputError: a field holds no numbers that can be used.
        """
        if self.kind == PRESENT:
            return present
        if self.kind == ANGLES:
            return np.radians(self._angles.values)
        if self.kind == POINT:
            return Target.of(_metres(self._point))
        return self._robot.pose(self.kind)

    async def _on_kind(self) -> None:
        self.show(self._visible)
        self._changed()


def _point_field(
    session: Session, label: str, offset_mm: tuple[float, float, float] = (0, 0, 0)
) -> NumbersField:
    """A hidden field for a tool point, filled with that of the first named pose, moved a little."""
    robot = session.console.robot
    point = 1000 * robot.forward(robot.pose(next(iter(robot.poses))))[:3, 3] + offset_mm
    return NumbersField(session.gui, label, "XYZ", point.round(1).tolist(), hint=_XYZ_HINT, visible=False)


def _metres(field: NumbersField) -> FloatArray:
    """The point (3,) in a field [m]."""
    return np.array(field.values) / 1000


# How a line or an arc of the tool shall be followed: end, via, pitch and speed.

_PITCH: dict[str, PitchMode] = {"kept": "kept", "evenly to another": "interpolated", "free": "free"}
_PITCH_HINT = (
    "Tool pitch on the way. Kept: as at the start. Evenly to another: it turns to the pitch below. "
    "Free: whatever takes the least motion."
)
_SPEED_HINT = "Largest speed of the tool. 0 or empty: as fast as the joints can."
_VIA_MM, _END_MM = (0.0, 40.0, 20.0), (0.0, 80.0, 0.0)
"""from the tool of the first named pose: an arc and a line that most arms can follow"""


class ToolPathForm:
    """The fields of a tool line or a tool arc; hidden while another motion is chosen."""

    def __init__(self, session: Session) -> None:
        """Add the fields to the present container."""
        gui = session.gui
        self._via = _point_field(session, "Via X Y Z mm", _VIA_MM)
        self._end = _point_field(session, "End X Y Z mm", _END_MM)
        usual = usual_pitch(session.console.robot)
        first = next(label for label, mode in _PITCH.items() if mode == usual)
        self._pitch = gui.add_dropdown(
            "Tool pitch", tuple(_PITCH), initial_value=first, hint=_PITCH_HINT, visible=False
        )
        self._end_pitch = NumberField(gui, "End pitch °", 0.0, visible=False)
        self._speed = NumberField(gui, "Tool speed mm/s", 0.0, hint=_SPEED_HINT, visible=False)
        self.fields = (self._via, self._end, self._end_pitch, self._speed)
        session.on(self._pitch.on_update, self._on_pitch)

    @property
    def settings(self) -> tuple[str, ...]:
        """All settings of the path."""
        return (self._pitch.value, *(field.text for field in self.fields if field.visible))

    @property
    def pitch(self) -> PitchMode:
        """What the tool pitch does on the way."""
        return _PITCH[self._pitch.value]

    def show(self, visible: bool, *, via: bool) -> None:
        """Show or hide the fields; ``via`` only for an arc."""
        self._via.visible = visible and via
        self._end.visible = self._speed.visible = self._pitch.visible = visible
        self._end_pitch.visible = visible and self.pitch == "interpolated"

    def wish(self, *, with_via: bool) -> ToolWish:
        """The path in the fields.

        Raises:
            InputError: a field holds no number that can be used, or the speed is negative.
        """
        speed = 0.0 if self._speed.is_empty else self._speed.value
        if speed < 0:
            raise InputError(f"Tool speed: {speed:g} mm/s is negative; 0 is as fast as the joints can")
        end_pitch = math.radians(self._end_pitch.value) if self.pitch == "interpolated" else None
        via = _metres(self._via) if with_via else None
        return ToolWish(_metres(self._end), via, self.pitch, end_pitch, speed / 1000 or None)

    async def _on_pitch(self) -> None:
        self._end_pitch.visible = self.pitch == "interpolated"

"""Which motion, from where to where, how, and in which time: the fields of the Trajectory tab."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Literal

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import InputError, out_of_range
from armctl.facts.angles import DEGREE, from_degrees
from armctl.kinematics import Target, roll_pitch_yaw, rotation_of
from armctl.motion import PitchMode, TurnMode, usual_pitch
from armctl.motion.analysis import Turning
from armctl.motion.plan import Passing
from armctl.robot import CarriedPart, Robot
from armctl.ui.session import Session
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.trajectory.plan import (
    ARC,
    JOINT_BY_JOINT,
    JOINTS,
    LINE,
    PROGRAM,
    TEST_PATHS,
    TOOL_ARC,
    TOOL_LINE,
    TOOL_PATHS,
    MotionRequest,
    why_not,
)
from armctl.ui.tabs.trajectory.study import PAPER_DEG_S, ShownStudy, make_study
from armctl.ui.widgets.html import LiveHtml, muted, refused
from armctl.ui.widgets.number_field import DEGREES, MILLIMETRES, EditWatch, NumberField, NumbersField
from armctl.ui.widgets.profile_choice import ALL_PROFILES, ProfileChoice

_ABOUT = {
    JOINTS: "All joints from one pose to another. The tool path is not controlled.",
    TOOL_LINE: "The tool moves along a straight line. The arm stays on its branch.",
    TOOL_ARC: "The tool moves along the circle through its start, via and end points.",
    ARC: "The paper's test arc: radius 200 mm about the base axis, −87° to 87°, 85 mm high.",
    LINE: "The paper's test line: x = 220 mm, y from −196 to 196 mm in steps of 14 mm, 85 mm high.",
    PROGRAM: "The program that is edited in Serial motion.",
    JOINT_BY_JOINT: "How fast each joint moves the tip at one constant joint speed. A study: nothing moves.",
}
"""the motions, in the order in which they are offered"""
_CHOOSE_HINT = "The criterion that chooses among the solutions of a point."
_PAPER_ARM, _PAPER_CRITERION = "uzuner", "published"
"""the criterion that the paper's tables were made with"""
TurnAsked = tuple[PitchMode | None, TurnMode | None]
"""of the tool on its way: its pitch, or its orientation"""
_PASSING: dict[str, Passing | None] = {
    "tool on the curve itself": None,
    "stop at each": "stop",
    "spline through them": "spline",
    "blended": "blend",
}
_BLEND_MM = 2.0
_XYZ_HINT = "Tool point in the base frame [mm], by inverse kinematics; e.g. 220, −196, 85."
_VIA_MM, _END_MM = (0.0, 40.0, 20.0), (0.0, 80.0, 0.0)
"""from the tool of the first named pose: an arc and a line that most arms can follow"""
_EVENLY = "evenly to another"
_PITCH_ONLY = "only its pitch kept"
_YIELDS = "kept if possible"
"""the usual choice: arms of four and five joints can keep their pitch on short lines only"""
_PITCH: dict[str, TurnAsked] = {
    _YIELDS: ("kept", None),
    "kept": ("kept", None),
    _EVENLY: ("interpolated", None),
    "free": ("free", None),
    "whole orientation kept": (None, "kept"),
}
_ORIENTATION: dict[str, TurnAsked] = {
    _YIELDS: (None, "kept"),
    "kept": (None, "kept"),
    _EVENLY: (None, "interpolated"),
    _PITCH_ONLY: ("kept", None),
    "free": (None, "free"),
}
_TURN_HINT = (
    "On the way. Kept: as at the start. If possible: kept, or free if that is impossible. "
    "Evenly to another: it turns to the one typed below. Free: what needs the least motion."
)
_RPY_HINT = "Roll, pitch and yaw of the tool at the end [°]: Rz(yaw)·Ry(pitch)·Rx(roll)."
_TOOL_SPEED_HINT = "Largest speed of the tool. Empty or 0: as fast as the joints can."
_TURNING: dict[str, Turning] = {"each joint alone": "in turn", "all joints at once": "all at once"}
_TURNING_HINT = (
    "Alone: each joint turns from the start pose while the others stand still. "
    "At once: they turn together, and the figures are what each contributes."
)
_SLOWEST_DEG_S, _FASTEST_DEG_S = 1.0, 360.0
_JOINT_SPEED_HINT = f"Of every joint, {_SLOWEST_DEG_S:g} … {_FASTEST_DEG_S:g} °/s. The paper takes 20."
_FOR_HINT = "Seconds. Empty or 0: until every joint has come to its limit."


class MotionForm:
    """The fields of all motions and of the study; each is shown where the chosen motion needs it."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui, robot = session.gui, session.console.robot
        first_pose = next(iter(robot.poses))
        self._motion = gui.add_dropdown("Which motion", tuple(_ABOUT), initial_value=JOINTS)
        self._about = LiveHtml(gui)
        self._from = EndChoice(session, "From", PRESENT, self._show_fields)
        self._to = EndChoice(session, "To", first_pose, self._show_fields)
        self._via = _point_field(session, "Via X Y Z mm", _VIA_MM)
        self._end = _point_field(session, "End X Y Z mm", _END_MM)
        self._turns = _ORIENTATION if robot.orients_tool else _PITCH
        what = "orientation" if robot.orients_tool else "pitch"
        offered = [label for label, (pitch, _) in self._turns.items() if pitch or _can_keep(robot)]
        usual = _YIELDS if robot.orients_tool or usual_pitch(robot) == "kept" else "free"
        self._turn = gui.add_dropdown(f"Tool {what}", offered, initial_value=usual, hint=_TURN_HINT)
        self._end_pitch = NumberField(gui, "End pitch °", 0.0)
        rpy = roll_pitch_yaw(robot.forward(robot.pose(first_pose))[:3, :3])
        self._end_rpy = NumbersField(gui, "End Rx Ry Rz °", ("Rx", "Ry", "Rz"), rpy, DEGREES, _RPY_HINT)
        self._tool_speed = NumberField(gui, "Tool speed mm/s", None, hint=_TOOL_SPEED_HINT)
        self._passing = gui.add_dropdown("Points", tuple(_PASSING))
        self._blend = NumberField(gui, "Blend radius mm", _BLEND_MM)
        self._choose = gui.add_dropdown("Choose by", robot.energy.criteria, hint=_CHOOSE_HINT)
        self._profile = ProfileChoice(gui, session.on, ALL_PROFILES)
        self._turning = gui.add_dropdown("Turn", tuple(_TURNING), hint=_TURNING_HINT)
        self._start = gui.add_dropdown("Start at", (*robot.poses, PRESENT), initial_value=first_pose)
        self._joint_speed = NumberField(gui, "Joint speed °/s", PAPER_DEG_S, hint=_JOINT_SPEED_HINT)
        self._for = NumberField(gui, "For s", None, hint=_FOR_HINT)
        typed = (
            *self._from.fields.values(), *self._to.fields.values(), self._via, self._end, self._end_pitch,
            self._end_rpy, self._tool_speed, self._blend, self._profile.duration, self._joint_speed,
            self._for,
        )  # fmt: skip
        self._inputs = (
            self._motion, self._from.choice, self._to.choice, self._turn, self._passing, self._choose,
            self._profile.choice, self._turning, self._start, *(field.handle for field in typed),
        )  # fmt: skip
        self.watch = EditWatch(typed)
        session.on(self._motion.on_update, self._on_motion)
        session.on(self._passing.on_update, self._show_fields)
        session.on(self._turn.on_update, self._show_fields)
        self._show_fields()

    @property
    def is_study(self) -> bool:
        """Whether a study is chosen, not a motion."""
        return self._motion.value == JOINT_BY_JOINT

    @property
    def from_present(self) -> bool:
        """Whether the motion begins where the arm stands."""
        motion = self._motion.value
        return motion == PROGRAM or (motion not in TEST_PATHS and self._from.choice.value == PRESENT)

    @property
    def settings(self) -> tuple[object, ...]:
        """All settings that are shown; the same again means that nothing has changed."""
        program = (
            self._session.console.shared(SharedProgram).version if self._motion.value == PROGRAM else None
        )
        return program, *((handle.label, handle.value) for handle in self._inputs if handle.visible)

    def request(self, present: FloatArray) -> MotionRequest:
        """The motion asked for, the arm at ``present`` (n,) [rad]; errors name the field, here and below."""
        motion = self._motion.value
        start = self._from.asked(present) if self._from.choice.visible else present
        profile, duration = self._profile.checked()
        speed = None
        if motion in TOOL_PATHS:
            speed = self._tool_speed.positive("Tool speed", "mm/s", "as fast as the joints can")
        shared = self._session.console.shared(SharedProgram)
        return MotionRequest(
            motion,
            self._subject(),
            start,
            profile,
            duration,
            self._choose.value,
            end=self._end_asked(present),
            via=self._via.array if self._via.visible else None,
            pitch=self._asked_turn[0],
            orientation=self._asked_turn[1],
            yields=self._turn.value == _YIELDS,
            speed=None if speed is None else speed / 1000,
            passing=_PASSING[self._passing.value],
            blend_m=self._blend.value / 1000 if self._blend.visible else 0.0,
            program=shared.program if motion == PROGRAM else None,
            library=shared.library if motion == PROGRAM else None,
            present=present,
            opening=self._session.snapshot.gripper,
            part=CarriedPart.of(self._session.snapshot.part_mm),
        )

    def study(self) -> Callable[[], ShownStudy]:
        """What computes the study that the fields ask for, in a worker thread."""
        speed = self._joint_speed.value
        if not _SLOWEST_DEG_S <= speed <= _FASTEST_DEG_S:
            raise InputError(f"Joint speed: {out_of_range(speed, _SLOWEST_DEG_S, _FASTEST_DEG_S, '°/s')}")
        seconds = self._for.positive("For", "s", "until every joint is at its limit")
        robot, name = self._session.console.robot, self._start.value
        start = self._session.snapshot.q_command if name == PRESENT else robot.pose(name)
        turning = _TURNING[self._turning.value]
        return partial(make_study, robot, name, start, turning, speed * DEGREE, seconds)

    def _end_asked(self, present: FloatArray) -> FloatArray | Target | None:
        if self._to.choice.visible:
            return self._to.asked(present)
        if not self._end.visible:
            return None
        pitch = from_degrees(self._end_pitch.value) if self._end_pitch.visible else None
        rotation = rotation_of(self._end_rpy.array) if self._end_rpy.visible else None
        return Target.of(self._end.array, rotation=rotation)._replace(pitch=pitch)

    @property
    def _asked_turn(self) -> TurnAsked:
        return self._turns[self._turn.value]

    def freer_words(self, pitch: Literal["kept", "free"]) -> str:
        """What is asked of the tool by ``ask_freer``."""
        if pitch == "kept":
            return "only the tool pitch kept"
        return f"the tool {'orientation' if self._turns is _ORIENTATION else 'pitch'} free"

    def ask_freer(self, pitch: Literal["kept", "free"]) -> None:
        """Ask less of the tool on its way."""
        kept = _PITCH_ONLY if self._turns is _ORIENTATION else "kept"
        self._turn.value = "free" if pitch == "free" else kept
        self._show_fields()

    def _subject(self) -> str:
        motion = self._motion.value
        if motion == JOINTS:
            return f"{self._from.title} to {self._to.title}"
        if motion in TEST_PATHS:
            return f"{motion}, {self._passing.value}"
        return f"{motion} from {self._from.title}"

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

    def _show_fields(self) -> None:
        motion, study = self._motion.value, self.is_study
        led, test = motion in TOOL_PATHS, motion in TEST_PATHS
        passing = _PASSING[self._passing.value] if test else None
        timed = not study and motion != PROGRAM
        self._from.show(motion == JOINTS or led)
        self._to.show(motion == JOINTS)
        self._via.visible = motion == TOOL_ARC
        self._end.visible = self._turn.visible = self._tool_speed.visible = led
        self._end_pitch.visible = led and self._asked_turn[0] == "interpolated"
        self._end_rpy.visible = led and self._asked_turn[1] == "interpolated"
        self._passing.visible = test
        self._blend.visible = passing == "blend"
        self._choose.visible = test or self._from.is_point or self._to.is_point
        normal = motion == JOINTS or passing == "stop"
        self._profile.show(profile=timed and passing != "blend", duration=timed, normal=normal)
        self._turning.visible = self._start.visible = study
        self._joint_speed.visible = self._for.visible = study
        self._about.show(muted(_ABOUT[motion]))


def _can_keep(robot: Robot) -> bool:
    """Whether an arm keeps its tool's orientation on some ways, if only in its own vertical plane."""
    return robot.orients_tool or robot.inverse_kinematics.roll_joint is not None


PRESENT = "present pose"
ANGLES = "angles"
POINT = "X Y Z"


class EndChoice:
    """Where a motion begins or ends: a pose, angles, or a point of the tool; with the field for it."""

    def __init__(self, session: Session, label: str, initial: str, changed: Callable[[], None]) -> None:
        gui, self._robot = session.gui, session.console.robot
        poses, titles = self._robot.poses, [joint.title for joint in self._robot.joints]
        self.choice = gui.add_dropdown(label, (PRESENT, *poses, ANGLES, POINT), initial_value=initial)
        hint = f"Joint angles [°]: {', '.join(titles)}."
        angles = self._robot.pose(next(iter(poses)))
        self.fields = {
            ANGLES: NumbersField(gui, f"{label} θ °", titles, angles, DEGREES, hint),
            POINT: _point_field(session, f"{label} X Y Z mm"),
        }
        session.on(self.choice.on_update, changed)

    @property
    def is_point(self) -> bool:
        """Whether inverse kinematics is needed."""
        return self.fields[POINT].visible

    @property
    def title(self) -> str:
        """The end in a few words."""
        kind = self.choice.value
        unit = "°" if kind == ANGLES else " mm"
        return f"({self.fields[kind].text}){unit}" if kind in self.fields else kind

    def show(self, visible: bool) -> None:
        """Show or hide the choice and its field."""
        self.choice.visible = visible
        for kind, field in self.fields.items():
            field.visible = visible and self.choice.value == kind

    def asked(self, present: FloatArray) -> FloatArray | Target:
        """Joint angles (n,) [rad], or where the tool has to be."""
        kind = self.choice.value
        if kind == ANGLES:
            return self.fields[ANGLES].array
        if kind == POINT:
            return Target.of(self.fields[POINT].array)
        return present if kind == PRESENT else self._robot.pose(kind)


def _point_field(
    session: Session, label: str, offset_mm: tuple[float, float, float] = (0, 0, 0)
) -> NumbersField:
    """A field for a tool point, filled with that of the first named pose, moved a little."""
    robot = session.console.robot
    point = robot.forward(robot.pose(next(iter(robot.poses))))[:3, 3] + np.array(offset_mm) / 1000
    return NumbersField(session.gui, label, "XYZ", point.round(4), MILLIMETRES, _XYZ_HINT)

"""The choice of a motion on the Trajectory screen."""

from __future__ import annotations

import asyncio

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import CRITERIA
from armctl.motion.plan import Passing
from armctl.ui.session import Session
from armctl.ui.tabs.program.shared_program import SharedProgram
from armctl.ui.tabs.trajectory.motions import (
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
    PointWish,
    ToolWish,
    why_not,
)
from armctl.ui.tabs.trajectory.study import StudyForm
from armctl.ui.tabs.trajectory.tool_path_form import PRESENT, EndChoice, ToolPathForm
from armctl.ui.widgets.html import LiveHtml, muted, refused
from armctl.ui.widgets.number_field import EditWatch, NumberField
from armctl.ui.widgets.profile_choice import ALL_PROFILES, ProfileChoice

FloatArray = NDArray[np.float64]
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
_OF_THE_PAPER = "published"
"""the criterion that the paper's tables were made with"""
_PAPER_ARM = "uzuner"
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
        self._session = session
        gui, robot = session.gui, session.console.robot
        self._motion = gui.add_dropdown("Which motion", MOTIONS, initial_value=JOINTS)
        self._about = LiveHtml(gui)
        self._from = EndChoice(session, "From", PRESENT, self._show_fields)
        self._to = EndChoice(session, "To", next(iter(robot.poses)), self._show_fields)
        self._tool = ToolPathForm(session, self._show_fields)
        self._passing = gui.add_dropdown("Points", tuple(_PASSING), visible=False)
        self._blend = NumberField(gui, "Blend radius mm", _BLEND_MM, visible=False)
        self._choose = gui.add_dropdown(
            "Choose by", CRITERIA, initial_value=CRITERIA[0], visible=False, hint=_CHOOSE_HINT
        )
        self._profile = ProfileChoice(session, ALL_PROFILES)
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
        """All that decides about the motion; the same again means that nothing has changed."""
        motion = self._motion.value
        if self.is_study:
            return (motion, *self.study.settings)
        if motion == PROGRAM:
            return motion, self._session.shared(SharedProgram).version
        ends: tuple[object, ...] = ()
        if motion in TEST_PATHS:
            ends = (self._passing.value, self._blend.text)
        elif motion in TOOL_PATHS:
            ends = (self._from.settings, self._tool.settings)
        else:
            ends = (self._from.settings, self._to.settings)
        choose = self._choose.value if self._solves else ""
        return (motion, ends, choose, self._profile.settings)

    def request(self, present: FloatArray) -> MotionRequest:
        """What the fields ask for, with the arm at ``present`` (n,) [rad].

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
            tool=self._tool_wish(motion),
            points=PointWish(self._passed, self._blend.value / 1000 if self._blend.visible else 0.0),
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
        motion = self._motion.value
        return (
            motion in TEST_PATHS
            or (motion in TOOL_PATHS and self._from.is_point)
            or (motion == JOINTS and (self._from.is_point or self._to.is_point))
        )

    @property
    def _passed(self) -> Passing | None:
        return _PASSING[self._passing.value]

    def _title(self) -> str:
        motion = self._motion.value
        law = self._profile.profile
        if motion == JOINTS:
            return f"{self._from.title} to {self._to.title}, {law}"
        if motion in TEST_PATHS:
            shaped = "" if self._passed == "blend" else f", {law}"
            return f"{motion}, {self._passing.value}{shaped}"
        return f"{motion} from {self._from.title}, pitch {self._tool.pitch}, {law}"

    def _tool_wish(self, motion: str) -> ToolWish | None:
        if motion not in TOOL_PATHS:
            return None
        tool = self._tool
        via = tool.via if motion == TOOL_ARC else None
        return ToolWish(tool.end, via, tool.pitch, tool.end_pitch, tool.speed)

    async def _on_motion(self) -> None:
        motion, robot = self._motion.value, self._session.console.robot
        if motion in TEST_PATHS and robot.name == _PAPER_ARM:
            self._choose.value = _OF_THE_PAPER
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
        self._from.show(motion == JOINTS or motion in TOOL_PATHS)
        self._to.show(motion == JOINTS)
        self._tool.show(motion in TOOL_PATHS, via=motion == TOOL_ARC)
        if self._passing.visible != test:
            self._passing.visible = test
        blended = test and self._passed == "blend"
        self._blend.visible = blended
        if self._choose.visible != self._solves:
            self._choose.visible = self._solves
        planned = motion not in (PROGRAM, JOINT_BY_JOINT)
        each = motion == JOINTS or (test and self._passed == "stop")
        self._profile.show(profile=planned and not blended, duration=planned, normal=each)
        self.study.show(self.is_study)
        self._about.show(muted(_ABOUT[motion]))

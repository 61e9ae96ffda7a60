"""The choice of a motion on the Trajectory screen."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import CRITERIA, Target
from armctl.ui.screens.study_form import StudyForm
from armctl.ui.screens.trajectory_motion import (
    ARC,
    JOINT_BY_JOINT,
    LINE,
    PROGRAM,
    TEST_PATHS,
    TO_POINT,
    MotionRequest,
    motion_labels,
    why_not,
)
from armctl.ui.widgets.html_bits import muted, refused
from armctl.ui.widgets.movement import MovementChoice
from armctl.ui.widgets.number_field import EditWatch, NumberField
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]
_CHOOSE_HINT = "What is least energy among the solutions of a point."
_ABOUT = {
    TO_POINT: "From where the arm stands to a point, by inverse kinematics.",
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


class MotionForm:
    """Which motion, by which criterion, along which profile, in which time."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui, robot = session.gui, session.console.robot
        labels = motion_labels(robot)
        self._motion = gui.add_dropdown("Which motion", labels, initial_value=labels[0])
        self._about = LiveHtml(gui)
        point = 1000 * robot.forward(robot.pose(next(iter(robot.poses))))[:3, 3]
        self._xyz = [
            NumberField(gui, f"{name} mm", value, visible=False)
            for name, value in zip("XYZ", point.round(1).tolist(), strict=True)
        ]
        self._choose = gui.add_dropdown(
            "Choose by", CRITERIA, initial_value=CRITERIA[0], visible=False, hint=_CHOOSE_HINT
        )
        self._movement = MovementChoice(session)
        self.study = StudyForm(session)
        self._zero = LiveHtml(gui)
        self.watch = EditWatch([*self._xyz, self._movement.duration, *self.study.fields])
        session.on(self._motion.on_update, self._on_motion)
        self._show_fields()

    @property
    def is_study(self) -> bool:
        """Whether a study is chosen, not a motion."""
        return self._motion.value == JOINT_BY_JOINT

    @property
    def settings(self) -> tuple[object, ...]:
        """All that decides about the motion; the same again means that nothing has changed."""
        motion = self._motion.value
        if self.is_study:
            return (motion, *self.study.settings)
        point = tuple(field.text for field in self._xyz) if motion == TO_POINT else ()
        version = self._session.console.programs.version if motion == PROGRAM else 0
        choose = self._choose.value if self._solves else ""
        return (motion, point, choose, version, self._movement.profile, self._movement.duration.text)

    def request(self, start: FloatArray) -> MotionRequest:
        """What the fields ask for, from ``start`` (n,) [rad].

        Raises:
            InputError: a field holds no number that can be used.
        """
        motion = self._motion.value
        profile, duration = self._movement.checked()
        target = None
        if motion == TO_POINT:
            target = Target.of(np.array([field.value for field in self._xyz]) / 1000)
        program = self._session.console.programs.program if motion == PROGRAM else None
        return MotionRequest(motion, start, profile, duration, self._choose.value, target, program)

    @property
    def _solves(self) -> bool:
        return self._motion.value in (TO_POINT, ARC, LINE)

    def refresh(self) -> None:
        """Say what a duration of 0 means for as long as it is 0."""
        duration = self.study.duration if self.is_study else self._movement.duration
        self._zero.visible = duration.visible and duration.text.strip() in ("", "0")
        self._zero.show(muted(_TO_THE_LIMITS if self.is_study else _SHORTEST))

    async def _on_motion(self) -> None:
        motion, robot = self._motion.value, self._session.console.robot
        if motion in TEST_PATHS and robot.name == _PAPER_ARM:
            self._choose.value = _OF_THE_PAPER
        self._show_fields()
        if motion in TEST_PATHS:
            reason = await asyncio.to_thread(why_not, robot, TEST_PATHS[motion]())
            if reason is not None and self._motion.value == motion:
                self._about.show(muted(_ABOUT[motion]) + refused(f"Not for this arm: {reason}."))

    def _show_fields(self) -> None:
        motion = self._motion.value
        for field in self._xyz:
            field.visible = motion == TO_POINT
        if self._choose.visible != self._solves:
            self._choose.visible = self._solves
        self._movement.visible = motion not in (PROGRAM, JOINT_BY_JOINT)
        self.study.show(self.is_study)
        self._about.show(muted(_ABOUT.get(motion, "From where the arm stands to a named pose.")))

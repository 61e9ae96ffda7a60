"""The choice of a motion on the Trajectory screen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import CRITERIA, Target
from armctl.ui.screens.trajectory_motion import (
    ARC,
    LINE,
    PROGRAM,
    TO_POINT,
    MotionRequest,
    motion_labels,
)
from armctl.ui.widgets.html_bits import muted
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
}


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
        self.watch = EditWatch([*self._xyz, self._movement.duration])
        session.on(self._motion.on_update, self._on_motion)
        self._show_fields()

    @property
    def settings(self) -> tuple[object, ...]:
        """All that decides about the motion; the same again means that nothing has changed."""
        motion = self._motion.value
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

    async def _on_motion(self) -> None:
        if self._motion.value in (ARC, LINE):
            self._choose.value = "published"  # what the paper's tables were made with
        self._show_fields()

    def _show_fields(self) -> None:
        motion = self._motion.value
        for field in self._xyz:
            field.visible = motion == TO_POINT
        if self._choose.visible != self._solves:
            self._choose.visible = self._solves
        self._movement.visible = motion != PROGRAM
        self._about.show(muted(_ABOUT.get(motion, "From where the arm stands to a named pose.")))

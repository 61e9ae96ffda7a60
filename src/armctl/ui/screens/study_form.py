"""What to study joint by joint: how the joints turn, how fast, from where, for how long."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.motion.joint_study import Turning
from armctl.ui.widgets.number_field import NumberField

if TYPE_CHECKING:
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]
_TURNING: dict[str, Turning] = {"each joint alone": "in turn", "all joints at once": "all at once"}
_PRESENT = "present pose"
_SLOWEST_DEG_S, _FASTEST_DEG_S = 1.0, 360.0
_PAPER_DEG_S = 20.0
_ALONE_HINT = (
    "Alone: each joint turns from the start pose while the others stand still. "
    "At once: they turn together, and the figures are what each contributes."
)
_SPEED_HINT = f"Of every joint, {_SLOWEST_DEG_S:g} … {_FASTEST_DEG_S:g} °/s. The paper takes 20."
_DURATION_HINT = "Seconds. 0 or empty: until every joint has come to its limit."


@dataclass(frozen=True, slots=True, eq=False)
class StudyRequest:
    """What the fields ask for."""

    turning: Turning
    start: FloatArray
    """(n,) [rad]"""
    start_name: str
    speed: float
    """[rad/s]"""
    duration_s: float | None
    """None: until every joint has come to its limit"""


class StudyForm:
    """The fields of a study; hidden while a motion is chosen."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui, poses = session.gui, session.console.robot.poses
        self._turning = gui.add_dropdown("Turn", tuple(_TURNING), hint=_ALONE_HINT, visible=False)
        starts = (*poses, _PRESENT)
        self._from = gui.add_dropdown("Start at", starts, initial_value=starts[0], visible=False)
        self._speed = NumberField(gui, "Joint speed °/s", _PAPER_DEG_S, hint=_SPEED_HINT, visible=False)
        self.duration = NumberField(gui, "For s", 0.0, hint=_DURATION_HINT, visible=False)

    @property
    def fields(self) -> tuple[NumberField, ...]:
        """Those that are typed into."""
        return self._speed, self.duration

    @property
    def settings(self) -> tuple[object, ...]:
        """All that decides about the study, but for where the arm stands."""
        return self._turning.value, self._from.value, self._speed.text, self.duration.text

    def show(self, visible: bool) -> None:
        """Show or hide the fields."""
        if self._turning.visible != visible:
            self._turning.visible = self._from.visible = visible
        for field in self.fields:
            field.visible = visible

    def request(self) -> StudyRequest:
        """What the fields ask for.

        Raises:
            InputError: a number that cannot be used.
        """
        speed = self._speed.value
        if not _SLOWEST_DEG_S <= speed <= _FASTEST_DEG_S:
            raise InputError(
                f"Joint speed: {speed:g} °/s is outside {_SLOWEST_DEG_S:g} … {_FASTEST_DEG_S:g} °/s"
            )
        seconds = 0.0 if self.duration.is_empty else self.duration.value
        if seconds < 0:
            raise InputError(f"For: {seconds:g} s is negative; 0 is until every joint is at its limit")
        name = self._from.value
        robot, here = self._session.console.robot, self._session.snapshot.q_command
        start = here if name == _PRESENT else robot.pose(name)
        return StudyRequest(_TURNING[self._turning.value], start, name, math.radians(speed), seconds or None)

"""The tool pose fields of the Forward screen: X, Y, Z, pitch and roll, coupled with the joint angles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.kinematics import Target
from armctl.kinematics.velocity import position_leaves_pitch
from armctl.robot import Robot
from armctl.ui.widgets.joint_step import held_at
from armctl.ui.widgets.number_field import NumberField

FloatArray = NDArray[np.float64]
_PITCH_HINT = "Angle of the tool's axis above the horizontal: 0 level, −90 straight down."
_DECIDED_HINT = "The position alone decides the pitch of this arm's tool."
_ROLL_HINT = "Angle of the tool about its own axis: the roll joint's own angle."
_HOLD_HINT = (
    "On: the pitch stays what it is while X, Y or Z change, so that the joint angles follow uniquely. "
    "Off: any pitch will do, and the field shows what it becomes."
)


class PoseFields:
    """Position [mm], pitch and roll [degrees] of the tool, as far as the arm has them."""

    def __init__(self, gui: viser.GuiApi, robot: Robot, q: FloatArray) -> None:
        """Add the fields to the present container, filled with the pose at ``q`` (n,) [rad]."""
        self._robot = robot
        solver = robot.inverse_kinematics
        pitch, roll = solver.pitch_and_roll(q)
        self.xyz = tuple(NumberField(gui, f"{name} mm", None) for name in "XYZ")
        self._asks_pitch = pitch is not None and position_leaves_pitch(robot.chain, robot.limits)
        self.pitch = NumberField(
            gui,
            "Pitch °",
            None,
            hint=_PITCH_HINT if self._asks_pitch else _DECIDED_HINT,
            visible=pitch is not None,
            disabled=not self._asks_pitch,
        )
        asks_roll = roll is not None and held_at(robot.joints[-1]) is None
        self.roll = NumberField(gui, "Roll °", None, hint=_ROLL_HINT, visible=asks_roll)
        self.hold = gui.add_checkbox(
            "Hold pitch", initial_value=bool(solver.pitch_joints), hint=_HOLD_HINT, visible=self._asks_pitch
        )
        self.fill(q)

    @property
    def fields(self) -> tuple[NumberField, ...]:
        """All that can be typed into."""
        turned = ((self.pitch, self._asks_pitch), (self.roll, self.roll.visible))
        return (*self.xyz, *(field for field, asked_for in turned if asked_for))

    def fill(self, q: FloatArray) -> None:
        """Show the tool's pose at ``q`` (n,) [rad]."""
        for field, value in zip(self.xyz, (1000 * self._robot.forward(q)[:3, 3]).tolist(), strict=True):
            field.fill(value)
        for field, angle in zip(
            (self.pitch, self.roll), self._robot.inverse_kinematics.pitch_and_roll(q), strict=True
        ):
            if angle is not None:
                field.fill(math.degrees(angle))

    def fill_pitch(self, q: FloatArray) -> None:
        """Show the pitch at ``q`` (n,) [rad], and nothing else."""
        pitch, _ = self._robot.inverse_kinematics.pitch_and_roll(q)
        if pitch is not None:
            self.pitch.fill(math.degrees(pitch))

    def holds_pitch(self, edited: NumberField) -> bool:
        """Whether the pitch is asked for when ``edited`` is the field that was typed into."""
        return self._asks_pitch and (self.hold.value or edited is self.pitch)

    def target(self, edited: NumberField) -> Target:
        """What the fields ask for.

        Raises:
            InputError: a field is empty, or holds no number that can be used.
        """
        position = np.array([field.value for field in self.xyz]) / 1000
        pitch = math.radians(self.pitch.value) if self.holds_pitch(edited) else None
        roll = math.radians(self.roll.value) if self.roll.visible else None
        return Target.of(position, pitch, roll)


@dataclass(frozen=True, eq=False)
class CoupledJoints:
    """The joint angles for a pose, or why there are none."""

    q: FloatArray | None
    """(n,) the solution nearest to the joint angles before [rad]"""
    why_not: str = ""
    """why there is none, and what is nearest; empty where there is one"""
    nearest_q: FloatArray | None = None
    """(n,) the configuration that comes nearest where there is none [rad]"""


def coupled_joints(robot: Robot, target: Target, before: FloatArray) -> CoupledJoints:
    """The solution of a pose that takes the least travel from joint angles ``before`` (n,) [rad]."""
    solutions = robot.inverse(target.position, target.pitch, target.roll)
    if not solutions.success:
        return CoupledJoints(None, solutions.explanation or "there is no solution", solutions.nearest_q)
    ways = [solutions]
    if solutions.free_joint is not None:
        # a sweep holds grid values only; the pitch before lies between them, and the same pose must come back
        pitch, _ = robot.inverse_kinematics.pitch_and_roll(before)
        held = robot.inverse(target.position, pitch, target.roll)
        ways += [held] if held.success else []
    nearest = min(ways, key=lambda way: float(way.energies("least-travel", before).min()))
    return CoupledJoints(nearest.best("least-travel", before))

"""Joint angles and tool pose of the Forward tab, coupled both ways while they are typed."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, UnreachableError
from armctl.kinematics import Target
from armctl.kinematics.velocity import position_leaves_pitch
from armctl.robot import Robot
from armctl.ui.newest import Newest, OneAtATime
from armctl.ui.session import Session
from armctl.ui.tabs.forward.figures import base_turns
from armctl.ui.widgets.html import LiveHtml, fixed, muted, refused
from armctl.ui.widgets.joint_angles import held_at
from armctl.ui.widgets.number_field import DEGREES, MILLIMETRES, FieldArray, NumberField

_PITCH_HINT = "Angle of the tool's axis above the horizontal: 0 level, −90 straight down."
_DECIDED_HINT = "The position alone decides the pitch of this arm's tool."
_ROLL_HINT = "Angle of the tool about its own axis: the roll joint's own angle."
_HOLD_HINT = (
    "On: the pitch stays what it is while X, Y or Z change, so that the joint angles follow uniquely. "
    "Off: any pitch will do, and the field shows what it becomes."
)
_HEAD = "Tool pose at these angles: type a pose, and the joint angles follow."
_SOLVING = "its joint angles are still being computed"


def angle_fields(gui: viser.GuiApi, robot: Robot, q: FloatArray) -> FieldArray:
    """A field a joint, in degrees, filled with ``q`` (n,) [rad]; one that is held cannot be typed into."""
    fields: list[NumberField] = []
    for i, joint in enumerate(robot.joints):
        held, hint = held_at(joint) is not None, limits_text(robot, i)
        fields.append(NumberField(gui, f"{joint.title} °", None, hint=hint, disabled=held))
    angles = FieldArray(fields, DEGREES)
    angles.fill(q)
    return angles


def limits_text(robot: Robot, joint: int) -> str:
    """A joint's limits, in words."""
    low, high = np.degrees(robot.limits[joint]).tolist()
    held = held_at(robot.joints[joint])
    return f"{robot.joints[joint].title}: {held or f'{fixed(low, 2)}° … {fixed(high, 2)}°'}"


class PoseFields:
    """Position [mm], pitch and roll [degrees] of the tool, as far as the arm has them."""

    def __init__(self, gui: viser.GuiApi, robot: Robot, q: FloatArray) -> None:
        """Add the fields to the present container, filled with the pose at ``q`` (n,) [rad]."""
        self._robot, solver = robot, robot.inverse_kinematics
        pitch, _ = solver.pitch_and_roll(q)
        self.xyz = FieldArray([NumberField(gui, f"{name} mm", None) for name in "XYZ"], MILLIMETRES)
        self._asks_pitch = pitch is not None and position_leaves_pitch(robot.chain, robot.limits)
        self.pitch = NumberField(
            gui, "Pitch °", None, hint=_PITCH_HINT if self._asks_pitch else _DECIDED_HINT,
            visible=pitch is not None, disabled=not self._asks_pitch,
        )  # fmt: skip
        asks_roll = solver.roll_joint is not None and held_at(robot.joints[solver.roll_joint]) is None
        self.roll = NumberField(gui, "Roll °", None, hint=_ROLL_HINT, visible=asks_roll)
        held = bool(solver.pitch_joints)
        self.hold = gui.add_checkbox("Hold pitch", held, hint=_HOLD_HINT, visible=self._asks_pitch)
        turns = ((self.pitch, self._asks_pitch), (self.roll, asks_roll))
        self.fields = (*self.xyz.fields, *(field for field, asked in turns if asked))
        """all that can be typed into"""
        self.fill(q)

    def fill(self, q: FloatArray, *, pitch_only: bool = False) -> None:
        """Show the tool's pose at ``q`` (n,) [rad], or its pitch and nothing else."""
        pitch, roll = self._robot.inverse_kinematics.pitch_and_roll(q)
        if pitch is not None:
            self.pitch.fill(math.degrees(pitch))
        if pitch_only:
            return
        self.xyz.fill(self._robot.forward(q)[:3, 3])
        if roll is not None:
            self.roll.fill(math.degrees(roll))

    def holds_pitch(self, edited: NumberField) -> bool:
        """Whether the pitch is asked for when ``edited`` is the field that was typed into."""
        return self._asks_pitch and (self.hold.value or edited is self.pitch)

    def target(self, edited: NumberField) -> Target:
        """The pose in the fields, when ``edited`` is the one that was typed into; errors name the field."""
        position = self.xyz.array
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


class PoseCoupling:
    """Keeps pose fields and angle fields the same pose, without rewriting what is being typed.

    A typed pose changes the angles to the solution nearest to what they were before that field was begun: on
    the way from 2 to 250 the arm may pass through other branches. A pose out of reach leaves them there, and
    a line says why; until it is mended, the two are different poses and nothing may move by them.
    """

    def __init__(self, session: Session, angles: FieldArray, changed: Callable[[], None]) -> None:
        """Add the pose fields to the present container; ``changed`` is called with new joint angles."""
        self._session, self._angles, self._changed = session, angles, changed
        self._robot = session.console.robot
        gui = session.gui
        LiveHtml(gui, muted(_HEAD))
        self._before: FloatArray = session.snapshot.q_command.copy()
        self.pose = PoseFields(gui, self._robot, self._before)
        self._line = LiveHtml(gui, self._pose_line(self._before))
        self._take = gui.add_button("Take nearest pose", color="orange", visible=False)
        self._unmet = ""
        self._nearest: FloatArray | None = None
        self._edited: NumberField | None = None
        self._newest = Newest()
        self._solver = OneAtATime(self._solve)
        for field in self.pose.fields:
            session.on(field.handle.on_update, partial(self._follow_pose, field))
        session.on(self.pose.hold.on_update, self._on_hold)
        session.on(self._take.on_click, self._on_take)

    def require_met(self) -> None:
        """Refuse while the pose fields show another pose than the angle fields, and say why they do."""
        if self._unmet:
            raise UnreachableError(
                f"the pose fields and the joint angles are not the same pose: {self._unmet}; mend the pose, "
                "take the nearest, or type a joint angle"
            )

    def follow_angles(self) -> None:
        """The joint angles are what counts: show their pose, if they are complete."""
        self._newest.drop()
        self._edited, self._unmet = None, ""
        try:
            q = self._angles.array
        except ArmctlError:  # half-typed, which the screen says and refuses to use
            return
        self.pose.fill(q)
        self._met(q)

    async def _follow_pose(self, field: NumberField) -> None:
        """Solve what the pose fields hold; ``field`` is the one that is typed into."""
        if field is not self._edited:
            self._edited = field
            try:
                self._before = self._angles.array  # those to stay near to
            except ArmctlError:  # half-typed: those before
                pass
        self._newest.drop()
        self._unmet = _SOLVING
        await self._solver.run()

    async def _on_hold(self) -> None:
        """Holding the pitch or not asks for no other pose, unless the present one cannot be had."""
        if self._unmet:
            await self._follow_pose(self._edited or self.pose.xyz.fields[0])

    def _on_take(self) -> None:
        if self._nearest is not None:
            self._angles.fill(self._nearest)
            self.follow_angles()
            self._changed()

    async def _solve(self) -> None:
        edited = self._edited
        if edited is None:  # a joint angle was typed since
            return
        is_newest = self._newest.begin()
        try:
            target = self.pose.target(edited)
        except ArmctlError as half_typed:
            found = CoupledJoints(None, str(half_typed))
        else:
            found = await asyncio.to_thread(coupled_joints, self._robot, target, self._before)
            if self._session.closed or not is_newest():
                return
        q = self._before if found.q is None else found.q
        self._angles.fill(q)
        if not self.pose.holds_pitch(edited):
            self.pose.fill(q, pitch_only=True)
        self._met(q, found)
        self._changed()

    def _met(self, q: FloatArray, found: CoupledJoints | None = None) -> None:
        """Tell whether the fields are one pose, that at ``q`` (n,) [rad], or why ``found`` is not."""
        self._unmet, self._nearest = (found.why_not, found.nearest_q) if found else ("", None)
        self._take.visible = self._nearest is not None
        why = refused(f"The joint angles stay as they are: {self._unmet}.")
        self._line.show(why if self._unmet else self._pose_line(q))

    def _pose_line(self, q: FloatArray) -> str:
        """The orientation as the fields do not show it."""
        turns = ", ".join(f"{name} {angle}" for name, angle in base_turns(self._robot.forward(q), 2))
        return muted(f"As turns about the base's axes: {turns}")

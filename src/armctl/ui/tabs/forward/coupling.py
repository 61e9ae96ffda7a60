"""Joint angles and tool pose of the Forward tab, coupled both ways while they are typed."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass

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
from armctl.ui.widgets.events import Action
from armctl.ui.widgets.html import LiveHtml, fixed, muted, refused
from armctl.ui.widgets.joint_angles import held_at
from armctl.ui.widgets.number_field import NumberField

_PITCH_HINT = "Angle of the tool's axis above the horizontal: 0 level, −90 straight down."
_DECIDED_HINT = "The position alone decides the pitch of this arm's tool."
_ROLL_HINT = "Angle of the tool about its own axis: the roll joint's own angle."
_HOLD_HINT = (
    "On: the pitch stays what it is while X, Y or Z change, so that the joint angles follow uniquely. "
    "Off: any pitch will do, and the field shows what it becomes."
)
_HEAD = "Tool pose at these angles: type a pose, and the joint angles follow."
_SOLVING = "its joint angles are still being computed"


class AngleFields:
    """One field a joint, in degrees."""

    def __init__(self, gui: viser.GuiApi, robot: Robot, q: FloatArray) -> None:
        """Add the fields to the present container, filled with ``q`` (n,) [rad]."""
        self.fields = [
            NumberField(
                gui,
                f"{joint.title} °",
                value,
                hint=limits_text(robot, i),
                disabled=held_at(joint) is not None,
            )
            for i, (joint, value) in enumerate(zip(robot.joints, np.degrees(q).tolist(), strict=True))
        ]

    def texts(self) -> tuple[str, ...]:
        """What the fields show."""
        return tuple(field.text for field in self.fields)

    def radians(self) -> FloatArray:
        """The angles (n,) [rad].

        Raises:
            InputError: a field is empty or holds no number; names it.
        """
        return np.radians([field.value for field in self.fields])

    def fill(self, q: FloatArray) -> None:
        """Put a configuration (n,) [rad] into the fields."""
        for field, value in zip(self.fields, np.degrees(q).tolist(), strict=True):
            field.fill(value)


def limits_text(robot: Robot, joint: int) -> str:
    """A joint's limits, in words."""
    if (held := held_at(robot.joints[joint])) is not None:
        return f"{robot.joints[joint].title}: {held}"
    low, high = np.degrees(robot.limits[joint]).tolist()
    return f"{robot.joints[joint].title}: {fixed(low, 2)}° … {fixed(high, 2)}°"


class PoseFields:
    """Position [mm], pitch and roll [degrees] of the tool, as far as the arm has them."""

    def __init__(self, gui: viser.GuiApi, robot: Robot, q: FloatArray) -> None:
        """Add the fields to the present container, filled with the pose at ``q`` (n,) [rad]."""
        self._robot = robot
        solver = robot.inverse_kinematics
        pitch, _ = solver.pitch_and_roll(q)
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
        asks_roll = solver.roll_joint is not None and held_at(robot.joints[solver.roll_joint]) is None
        self.roll = NumberField(gui, "Roll °", None, hint=_ROLL_HINT, visible=asks_roll)
        self.hold = gui.add_checkbox(
            "Hold pitch",
            initial_value=bool(solver.pitch_joints),
            hint=_HOLD_HINT,
            visible=self._asks_pitch,
        )
        self.fields = (
            *self.xyz,
            *((self.pitch,) if self._asks_pitch else ()),
            *((self.roll,) if asks_roll else ()),
        )
        """all that can be typed into"""
        self.fill(q)

    def fill(self, q: FloatArray) -> None:
        """Show the tool's pose at ``q`` (n,) [rad]."""
        for field, value in zip(self.xyz, (1000 * self._robot.forward(q)[:3, 3]).tolist(), strict=True):
            field.fill(value)
        _, roll = self._robot.inverse_kinematics.pitch_and_roll(q)
        if roll is not None:
            self.roll.fill(math.degrees(roll))
        self.fill_pitch(q)

    def fill_pitch(self, q: FloatArray) -> None:
        """Show the pitch at ``q`` (n,) [rad], and nothing else."""
        pitch, _ = self._robot.inverse_kinematics.pitch_and_roll(q)
        if pitch is not None:
            self.pitch.fill(math.degrees(pitch))

    def holds_pitch(self, edited: NumberField) -> bool:
        """Whether the pitch is asked for when ``edited`` is the field that was typed into."""
        return self._asks_pitch and (self.hold.value or edited is self.pitch)

    def target(self, edited: NumberField) -> Target:
        """The pose in the fields, when ``edited`` is the one that was typed into.

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


class PoseCoupling:
    """Keeps pose fields and angle fields the same pose, without ever rewriting what somebody types.

    A joint angle that is typed changes the pose fields. A pose that is typed changes the angle fields, to
    the solution nearest to what they held before that field was begun: on the way from 2 to 250 the arm may
    pass through other branches. A pose that cannot be reached leaves them at that, and a line says why; until
    it is mended, the two are different poses and nothing may move by them.
    """

    def __init__(self, session: Session, angles: AngleFields, changed: Callable[[], None]) -> None:
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
            session.on(field.handle.on_update, self._typing(field))
        session.on(self.pose.hold.on_update, self._on_hold)
        session.on(self._take.on_click, self._on_take)

    def require_met(self) -> None:
        """Refuse while the pose fields show another pose than the angle fields.

        Raises:
            UnreachableError: they do; says why.
        """
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
            q = self._angles.radians()
        except ArmctlError:  # half-typed, which the screen says and refuses to use
            return
        self.pose.fill(q)
        self._met(q)

    def _typing(self, field: NumberField) -> Action:
        async def on_typed() -> None:
            await self._follow_pose(field)

        return on_typed

    async def _follow_pose(self, field: NumberField) -> None:
        """Solve what the pose fields hold; ``field`` is the one that is typed into."""
        if field is not self._edited:
            self._edited = field
            try:
                self._before = self._angles.radians()  # those to stay near to
            except ArmctlError:  # half-typed: those before
                pass
        self._newest.drop()
        self._unmet = _SOLVING
        await self._solver.run()

    async def _on_hold(self) -> None:
        """Holding the pitch or not asks for no other pose, unless the present one cannot be had."""
        if self._unmet:
            await self._follow_pose(self._edited or self.pose.xyz[0])

    async def _on_take(self) -> None:
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
            self._refuse(str(half_typed), edited)
            return
        found = await asyncio.to_thread(coupled_joints, self._robot, target, self._before)
        if self._session.closed or not is_newest():
            return
        if found.q is None:
            self._refuse(found.why_not, edited, found.nearest_q)
            return
        self._angles.fill(found.q)
        if not self.pose.holds_pitch(edited):
            self.pose.fill_pitch(found.q)
        self._met(found.q)
        self._changed()

    def _met(self, q: FloatArray) -> None:
        self._unmet, self._nearest = "", None
        self._take.visible = False
        self._line.show(self._pose_line(q))

    def _refuse(self, why: str, edited: NumberField, nearest: FloatArray | None = None) -> None:
        self._unmet, self._nearest = why, nearest
        self._angles.fill(self._before)
        if not self.pose.holds_pitch(edited):
            self.pose.fill_pitch(self._before)
        self._changed()
        self._take.visible = nearest is not None
        self._line.show(refused(f"The joint angles stay as they are: {why}."))

    def _pose_line(self, q: FloatArray) -> str:
        """The orientation as the fields do not show it."""
        turns = ", ".join(f"{name} {angle}" for name, angle in base_turns(self._robot.forward(q), 2))
        return muted(f"As turns about the base's axes: {turns}")

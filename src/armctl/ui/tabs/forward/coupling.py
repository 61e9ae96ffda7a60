"""Joint angles and tool pose of the Forward screen, coupled both ways while they are typed."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.errors import ArmctlError, UnreachableError
from armctl.kinematics import Target
from armctl.kinematics.velocity import position_leaves_pitch
from armctl.robot import Robot
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, fixed, muted, refused, table
from armctl.ui.widgets.joint_angles import held_at
from armctl.ui.widgets.number_field import NumberField
from armctl.ui.widgets.pose_figures import base_turns

# The tool pose fields of the Forward screen: X, Y, Z, pitch and roll, coupled with the joint angles.

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


# The angle fields of the Forward screen, and what each of the two buttons would do with them.

REFERENCE = "Go with respect to reference"
LAST = "Go with respect to last position"
PRESENT = "present pose (live)"
SHOWN = ("angles as reference", "angles added to last position", PRESENT)


class AngleFields:
    """One field a joint, in degrees."""

    def __init__(self, gui: viser.GuiApi, robot: Robot, q: FloatArray) -> None:
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


def resulting_pose(how: str, asked: FloatArray, present: FloatArray) -> FloatArray:
    """Where the arm would go: ``asked`` itself, or added to where it is commanded to be (n,) [rad]."""
    return present + asked if how in (LAST, SHOWN[1]) else asked


def results_html(robot: Robot, angles: AngleFields, present: FloatArray) -> str:
    """A row for where the arm is, and one for where each button would send it."""
    rows = [_row("now", robot, present)]
    problems = ""
    try:
        asked = angles.radians()
    except ArmctlError as refusal:
        return _table(robot, rows) + refused(f"Nothing can be sent: {refusal}.")
    for name, how in (("reference", REFERENCE), ("last position", LAST)):
        q = resulting_pose(how, asked, present)
        rows.append(_row(f"→ {name}", robot, q))
        try:
            robot.check_limits(q)
        except ArmctlError as refusal:
            problems += muted(f"✗ With respect to {name}: {refusal}.")
    return _table(robot, rows) + (problems or muted("Both are inside the joint limits."))


def _row(name: str, robot: Robot, q: FloatArray) -> list[str]:
    point = 1000 * robot.forward(q)[:3, 3]
    return [name, *(fixed(v, 1) for v in np.degrees(q).tolist()), *(fixed(v, 1) for v in point.tolist())]


def _table(robot: Robot, rows: list[list[str]]) -> str:
    head = ["will go to", *(f"θ{i + 1}°" for i in range(robot.n)), "x mm", "y mm", "z mm"]
    return f"<div style='font-size:11px'>{table(head, rows)}</div>"


_HEAD = "Tool pose at these angles: type a pose, and the joint angles follow."
_SOLVING = "its joint angles are still being computed"


class PoseCoupling:
    """Keeps pose fields and angle fields the same pose, without ever rewriting what somebody types.

    A joint angle that is typed changes the pose fields; a pose that is typed changes the angle fields, to
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
        self._asked = 0
        self._solving = False
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
        self._asked += 1  # whatever is being solved is out of date
        self._edited, self._unmet = None, ""
        try:
            q = self._angles.radians()
        except ArmctlError:  # half-typed, which the screen says and refuses to use
            return
        self.pose.fill(q)
        self._met(q)

    def _typing(self, field: NumberField) -> Callable[[], Awaitable[None]]:
        async def on_typed() -> None:
            if field is not self._edited:
                self._begin(field)
            await self._solve()

        return on_typed

    async def _on_hold(self) -> None:
        """Holding the pitch or not asks for no other pose, unless the present one cannot be had."""
        if self._unmet:
            if self._edited is None:
                self._begin(self.pose.xyz[0])
            await self._solve()

    async def _on_take(self) -> None:
        if self._nearest is not None:
            nearest = self._nearest
            self._angles.fill(nearest)
            self.follow_angles()
            self._changed()

    async def _solve(self) -> None:
        """Solve what the fields hold: one at a time, and always the newest."""
        self._asked += 1
        self._unmet = _SOLVING
        if self._solving:
            return
        self._solving = True
        try:
            while await self._solve_once():
                pass
        finally:
            self._solving = False

    async def _solve_once(self) -> bool:
        """Solve the pose as it is now; True if it was changed meanwhile."""
        asked, edited = self._asked, self._edited
        if edited is None:  # a joint angle was typed since
            return False
        try:
            target = self.pose.target(edited)
        except ArmctlError as half_typed:
            self._refuse(str(half_typed))
            return False
        found = await asyncio.to_thread(coupled_joints, self._robot, target, self._before)
        if self._session.closed:
            return False
        if asked != self._asked:
            return True
        self._take_over(found, edited)
        return False

    def _begin(self, field: NumberField) -> None:
        """Somebody begins to type in a field: the joint angles as they are now are those to stay near to."""
        self._edited = field
        try:
            self._before = self._angles.radians()
        except ArmctlError:  # half-typed: those before
            return

    def _take_over(self, found: CoupledJoints, edited: NumberField) -> None:
        if found.q is None:
            self._refuse(found.why_not, found.nearest_q)
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

    def _refuse(self, why: str, nearest: FloatArray | None = None) -> None:
        self._unmet, self._nearest = why, nearest
        self._angles.fill(self._before)
        if self._edited is not None and not self.pose.holds_pitch(self._edited):
            self.pose.fill_pitch(self._before)
        self._changed()
        self._take.visible = nearest is not None
        self._line.show(refused(f"The joint angles stay as they are: {why}."))

    def _pose_line(self, q: FloatArray) -> str:
        """The orientation as the fields do not show it."""
        turns = ", ".join(f"{name} {angle}" for name, angle in base_turns(self._robot.forward(q), 2))
        return muted(f"As turns about the base's axes: {turns}")

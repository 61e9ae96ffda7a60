"""Forward: joint angles and tool pose, coupled; go there, absolutely or by so much from where the arm is."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from functools import partial

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, UnreachableError
from armctl.facts import Need, Reason, Several, ToDo, say
from armctl.facts.angles import from_degrees, to_degrees
from armctl.facts.targets import PoseUnmet
from armctl.kinematics import DEFAULT_STEP, Target
from armctl.kinematics.velocity import position_leaves_pitch
from armctl.lazy_dataclass import dataclass
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.events import Newest, On, OneAtATime
from armctl.ui.next_pose import End, Movement, PoseWriter
from armctl.ui.offers import NO_REASON
from armctl.ui.session import Session
from armctl.ui.tabs.forward.figures import (
    LAST,
    PRESENT,
    REFERENCE,
    SHOWN,
    Results,
    VelocityForm,
    abouts_html,
    goals_html,
    jacobian_html,
    offers_html,
    pose_html,
    resulting_pose,
    results,
)
from armctl.ui.widgets.angle_fields import OrientationFields, angle_fields, held_at
from armctl.ui.widgets.html import LiveHtml, muted, refused, sentence
from armctl.ui.widgets.number_field import (
    MILLIMETRES,
    MOST_IN_A_ROW,
    EditWatch,
    FieldArray,
    Following,
    NumberField,
    TextEntry,
    button_pairs,
    field_grid,
)
from armctl.ui.widgets.profile_choice import MOVEMENTS, ProfileChoice

_SHOWN_NOTE = "Which pose the ghost and these numbers show."
_SAME_RAD = 1e-6
_MOVING = "The fields take the pose of the arm once it stands."


class ForwardScreen:
    """Angle and pose fields, the two ways to go, and the figures of a configuration."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        self._last_known = session.console.last_known
        self._writer = PoseWriter(session, "angles in Forward", self._how, self._on_end, self._settled)
        self._drawn: tuple[object, ...] = ()
        self._sent_to: Mapping[str, FloatArray] = {}
        """(n,) where each button would send the arm [rad]; empty: nowhere"""
        self._written: tuple[object, ...] = ()
        gui = session.gui
        tabs = gui.add_tab_group()
        with tabs.add_tab("Angles and pose"):
            with field_grid(gui, min(self._robot.n, MOST_IN_A_ROW)):
                self._angles = angle_fields(gui, self._robot, session.snapshot.q_command)
            self._coupling = PoseCoupling(session, self._angles, self._on_coupled)
            self._fill_with = gui.add_button_group("Fill with", ("present pose", *self._robot.poses))
            self._movement = ProfileChoice(gui, session.on, MOVEMENTS)
            with button_pairs(gui, wide=True):  # above the numbers, which move neither
                absolute = gui.add_button(REFERENCE, color="gray")
                relative = gui.add_button(LAST, color="gray")
            LiveHtml(gui, abouts_html())
            self._goals = LiveHtml(gui)
            self._offers = {
                how: session.needs(Need.HOLDING, button, also=partial(self._outside, how), told=False)
                for how, button in ((REFERENCE, absolute), (LAST, relative))
            }
            self._why_not = LiveHtml(gui, NO_REASON)
            self._notes = LiveHtml(gui)
        with tabs.add_tab("Matrix and Jacobian"):
            self._shown = gui.add_dropdown("Show for", SHOWN, initial_value=SHOWN[0], hint=_SHOWN_NOTE)
            self._pose, self._jacobian = LiveHtml(gui), LiveHtml(gui)
        with tabs.add_tab("Velocities"):
            self._velocities = VelocityForm(session)
        pose_fields = self._coupling.pose.fields
        self._watch = EditWatch([*self._angles.fields, *pose_fields, self._movement.duration])
        self._following = Following(self._watch, self._fill, session.spawn, session.snapshot.q_command)
        for field in self._angles.fields:
            session.on(field.handle.on_update, self._on_angle)
        session.on(self._fill_with.on_click, self._on_fill)
        session.on(self._shown.on_update, self._draw_anew)
        session.on(absolute.on_click, lambda: self._go(REFERENCE))
        session.on(relative.on_click, lambda: self._go(LAST))
        self._draw(session.snapshot)  # as high as it will be, before somebody opens it

    def refresh(self, snapshot: Snapshot) -> None:
        """Keep what depends on where the arm is up to date."""
        if self._session.sees("Forward"):
            self._why_not.show(offers_html({how: offer.why for how, offer in self._offers.items()}))
            self._draw(snapshot)

    def _outside(self, how: str, snapshot: Snapshot) -> Reason | None:
        """Why the limits keep the arm from where a button would send it; half typed is told elsewhere."""
        if self._coupling.unmet is not None or self._coupling.computing:
            return None
        try:
            asked = self._angles.array
        except ArmctlError:
            return None
        try:
            self._robot.check_limits(resulting_pose(how, asked, self._last_known.standing(snapshot)))
        except ArmctlError as refusal:
            return refusal.reason
        return None

    def _how(self) -> Movement:
        return self._movement.checked()

    def _settled(self) -> None:
        self._watch.require_settled()

    def _on_end(self, why: End) -> None:
        """The fields hold nothing of their own any more, but for angles that are to be added once more."""
        if why != "arrived" or self._shown.value != SHOWN[1]:
            self._following.resume()
            self._drawn = ()

    def _fill(self, q: FloatArray) -> None:
        self._angles.fill(q)
        self._coupling.follow_angles()

    def _on_angle(self) -> None:
        self._coupling.follow_angles()
        self._edit()

    def _on_fill(self) -> None:
        asked = self._fill_with.value
        if asked == "present pose":
            self._session.next.clear()
            self._following.resume()
            self._draw_anew()
        else:
            self._fill(self._robot.pose(asked))
            self._edit()

    def _on_coupled(self) -> None:
        """A pose was typed and the joint angles have followed: a pose is absolute, so that is shown."""
        self._shown.value = SHOWN[0]
        self._edit()

    def _edit(self) -> None:
        self._following.edit()
        self._written = ()
        if self._writer.taken:  # from here on the next pose is this screen's, whoever wrote it
            self._session.next.clear("replaced")
        self._draw_anew()

    def _draw_anew(self) -> None:
        self._drawn = ()
        self._draw(self._session.snapshot)

    async def _go(self, how: str) -> None:
        self._watch.require_settled()
        present = self._session.snapshot.q_command
        self._following.follow(self._session.next.shown(present))
        self._coupling.require_met()
        self._movement.checked()
        q = self._robot.check_limits(resulting_pose(how, self._angles.array, present))
        self._shown.value = SHOWN[how == LAST]
        self._following.edit()
        self._written = self._angles.texts, self._shown.value, None
        await self._writer.go(q)
        if how == REFERENCE and not self._writer.shown:  # the arm is there already
            self._on_end("arrived")

    def _draw(self, snapshot: Snapshot) -> None:
        self._draw_figures(snapshot)
        self._goals.show(goals_html(self._robot, self._last_known.drawn(snapshot), self._sent_to))

    def _draw_figures(self, snapshot: Snapshot) -> None:
        present, shown, next_pose = self._last_known.standing(snapshot), self._shown.value, self._session.next
        # a field that changes all the time cannot be typed into, and what was typed and is being solved stays
        if not (snapshot.busy or self._coupling.computing):
            self._following.follow(next_pose.shown(present))
        edited, texts, unmet = self._following.edited, self._angles.texts, self._coupling.unmet
        key = (texts, shown, present.tobytes(), edited, snapshot.busy, next_pose.number, unmet)
        if key == self._drawn or self._coupling.computing:
            return
        q, refusal = present, None
        try:
            if shown != PRESENT:
                self._coupling.require_met()
                q = resulting_pose(shown, self._angles.array, present)
        except ArmctlError as why:
            refusal = why
        if edited and not snapshot.busy and self._written != (texts, shown, unmet):
            self._written = texts, shown, unmet  # once: where the arm is moved otherwise, it stays
            self._write(None if refusal is not None or shown == PRESENT else q)
        self._drawn = (*key[:5], next_pose.number, unmet)
        taken = self._writer.taken
        if snapshot.busy and not (edited or taken):  # the fields hold where it was
            told = Results({}, muted(_MOVING))
        else:
            said = self._said(q, shown)
            told = results(
                self._angles, present, edited=edited or taken, unmet=unmet, ghost=said, taken=taken
            )
        self._sent_to = told.goals
        self._notes.show(told.notes)
        if refusal is not None:
            why_not = refused(sentence(str(refusal)))
            self._pose.show(why_not)
            self._jacobian.show("")
            self._velocities.show(None, why_not)
            return
        self._pose.show(pose_html(self._robot, q))
        self._jacobian.show(jacobian_html(self._robot, q))
        self._velocities.show(q)

    def _said(self, q: FloatArray, shown: str) -> str:
        """What the ghost shows, of this screen; ``q`` (n,) [rad]: what is ``shown`` now."""
        if not self._writer.shown:
            return ""
        as_now = np.abs(self._session.next.shown(q) - q).max() < _SAME_RAD
        return shown if as_now else f"{shown}, as it was then"

    def _write(self, q: FloatArray | None) -> None:
        """Make ``q`` (n,) [rad] the next pose; None, or out of limits: no button would send the arm there."""
        try:
            within = None if q is None else self._robot.check_limits(q)
        except ArmctlError:
            within = None
        if within is None:
            self._writer.hide()
        else:
            self._writer.show(within)


# Joint angles and tool pose, coupled both ways while they are typed.

_POSE_FIELDS = 5
"""X, Y, Z, pitch and roll stand in a row"""
_PITCH_HINT = "Angle of the tool's axis above the horizontal: 0 level, −90 straight down."
_DECIDED_HINT = "The position alone decides the pitch of this arm's tool."
_ROLL_HINT = "Angle of the tool about its own axis: the roll joint's own angle."
_HOLD_HINT = (
    "On: the {0} stays what it is while X, Y or Z change, so that the joint angles follow uniquely. "
    "Off: any {0} will do, and the field shows what it becomes."
)


class PoseFields:
    """Position [mm] of the tool, with its pitch and roll [degrees], as far as it has them, or orientation."""

    def __init__(self, gui: viser.GuiApi, robot: Robot, q: FloatArray) -> None:
        """Add the fields to the present container, filled with the pose at ``q`` (n,) [rad]."""
        self._robot, solver = robot, robot.inverse_kinematics
        pitch, _ = solver.pitch_and_roll(q)
        orients = robot.orients_tool
        self.xyz = FieldArray([NumberField(gui, f"{name} mm", None) for name in "XYZ"], MILLIMETRES)
        self.orientation = OrientationFields(gui, robot.forward(q)[:3, :3]) if orients else None
        asks_pitch = pitch is not None and not orients and position_leaves_pitch(robot.chain, robot.limits)
        self.pitch = NumberField(
            gui, "Pitch °", None, hint=_PITCH_HINT if asks_pitch else _DECIDED_HINT,
            visible=pitch is not None and not orients, disabled=not asks_pitch,
        )  # fmt: skip
        roll = None if orients else solver.roll_joint
        asks_roll = roll is not None and held_at(robot.joints[roll]) is None
        self.roll = NumberField(gui, "Roll °", None, hint=_ROLL_HINT, visible=asks_roll)
        what = "orientation" if orients else "pitch"
        self._asks_turn = orients or asks_pitch
        self.hold = gui.add_checkbox(
            f"Hold {what}", orients or bool(solver.pitch_joints), hint=_HOLD_HINT.format(what),
            visible=self._asks_turn,
        )  # fmt: skip
        self._turns: tuple[TextEntry, ...] = (self.pitch,) if asks_pitch else ()
        if self.orientation is not None:
            self._turns = self.orientation.fields
        self.fields: tuple[TextEntry, ...] = (*self.xyz.fields, *self._turns, *([self.roll] * asks_roll))
        """all that can be typed into"""
        self.fill(q)

    def attach(self, on: On, edited: Callable[[TextEntry], Awaitable[object]]) -> None:
        """Run ``edited`` with the field that was typed into."""
        if self.orientation is not None:
            self.orientation.attach(on, partial(edited, self.orientation.fields[0]))
        for field in self.fields:
            if self.orientation is None or field not in self._turns:
                on(field.handle.on_update, partial(edited, field))

    def fill(self, q: FloatArray, *, turn_only: bool = False) -> None:
        """Show the tool's pose at ``q`` (n,) [rad], or its pitch or orientation and nothing else."""
        pitch, roll = self._robot.inverse_kinematics.pitch_and_roll(q)
        pose = self._robot.forward(q)
        if self.orientation is not None:
            self.orientation.fill(pose[:3, :3])
        elif pitch is not None:
            self.pitch.fill(to_degrees(pitch))
        if turn_only:
            return
        self.xyz.fill(pose[:3, 3])
        if roll is not None:
            self.roll.fill(to_degrees(roll))

    def holds_turn(self, edited: TextEntry) -> bool:
        """Whether pitch or orientation is asked for when ``edited`` is the field that was typed into."""
        return self._asks_turn and (self.hold.value or edited in self._turns)

    def target(self, edited: TextEntry) -> Target:
        """The pose in the fields, when ``edited`` is the one that was typed into; errors name the field."""
        position, held = self.xyz.array, self.holds_turn(edited)
        if self.orientation is not None:
            return Target.of(position, rotation=self.orientation.rotation if held else None)
        pitch = from_degrees(self.pitch.value) if held else None
        roll = from_degrees(self.roll.value) if self.roll.visible else None
        return Target.of(position, pitch, roll)


@dataclass(frozen=True, eq=False)
class CoupledJoints:
    """The joint angles for a pose, or why there are none."""

    q: FloatArray | None
    """(n,) the solution nearest to the joint angles before [rad]"""
    why_not: Reason | None = None
    """why there is none, and what is nearest; None where there is one"""
    nearest_q: FloatArray | None = None
    """(n,) the configuration that comes nearest where there is none [rad]"""


def coupled_joints(robot: Robot, target: Target, before: FloatArray) -> CoupledJoints:
    """The solution of a pose that takes the least travel from joint angles ``before`` (n,) [rad]."""
    solutions = robot.inverse_kinematics.solve(target, DEFAULT_STEP, before)
    if (why := solutions.refusal) is not None:
        return CoupledJoints(None, why, solutions.nearest_q)
    ways = [solutions]
    if solutions.free_joint is not None and target.rotation is None:
        # a sweep holds grid values only; the pitch before lies between them, and the same pose must come back
        pitch, _ = robot.inverse_kinematics.pitch_and_roll(before)
        held = robot.inverse(target.position, pitch, target.roll, start=before)
        ways += [held] if held.success else []
    nearest = min(ways, key=lambda way: float(way.energies("least-travel", before).min()))
    q = nearest.best("least-travel", before)
    turned_off = robot.off_rotation(nearest, q)
    return CoupledJoints(q) if turned_off is None else CoupledJoints(None, turned_off, q)


class PoseCoupling:
    """Keeps pose and angle fields the same pose; out of reach, the angles stay and nothing may move."""

    def __init__(self, session: Session, angles: FieldArray, changed: Callable[[], None]) -> None:
        """Add the pose fields to the present container; ``changed`` is called with new joint angles."""
        self._session, self._angles, self._changed = session, angles, changed
        self._robot = session.console.robot
        gui = session.gui
        self._before: FloatArray = session.snapshot.q_command.copy()
        with field_grid(gui, _POSE_FIELDS if not self._robot.orients_tool else 3):
            self.pose = PoseFields(gui, self._robot, self._before)
        self._line = LiveHtml(gui, visible=False)
        self._take = gui.add_button("Take nearest pose", color="orange", visible=False)
        self.unmet: Reason | None = None
        """why the pose fields and the angle fields are not the same pose; None: they are, or ``computing``"""
        self.computing = False
        """whether the joint angles for the pose fields are not known yet"""
        self._nearest: FloatArray | None = None
        self._edited: TextEntry | None = None
        self._newest = Newest()
        self._solver = OneAtATime(self._solve)
        self.pose.attach(session.on, self._follow_pose)
        session.on(self.pose.hold.on_update, self._on_hold)
        session.on(self._take.on_click, self._on_take)

    def require_met(self) -> None:
        """Refuse while the pose fields show another pose than the angle fields, and say why they do."""
        if self.unmet or self.computing:
            raise UnreachableError(Several((PoseUnmet(self.unmet), ToDo("mend pose"))))

    def follow_angles(self) -> None:
        """The joint angles are what counts: show their pose, if they are complete."""
        self._newest.drop()
        self._edited, self.unmet, self.computing = None, None, False
        try:
            q = self._angles.array
        except ArmctlError:  # half-typed, which the screen says and refuses to use
            return
        self.pose.fill(q)
        self._met()

    async def _follow_pose(self, field: TextEntry) -> None:
        """Solve what the pose fields hold; ``field`` is the one that is typed into."""
        if field is not self._edited:
            self._edited = field
            try:
                self._before = self._angles.array  # those to stay near to
            except ArmctlError:  # half-typed: those before
                pass
        self._newest.drop()
        self.unmet, self.computing = None, True
        await self._solver.run()

    async def _on_hold(self) -> None:
        """Holding or not asks for no other pose, unless the present one cannot be had."""
        if self.unmet or self.computing:
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
            found = CoupledJoints(None, half_typed.reason)
        else:
            found = await asyncio.to_thread(coupled_joints, self._robot, target, self._before)
            if self._session.closed or not is_newest():
                return
        q = self._before if found.q is None else found.q
        self._angles.fill(q)
        if not self.pose.holds_turn(edited):
            self.pose.fill(q, turn_only=True)
        self._met(found)
        self._changed()

    def _met(self, found: CoupledJoints | None = None) -> None:
        """Tell whether the fields are one pose, or why ``found`` is not."""
        self.computing = False
        self.unmet, self._nearest = (found.why_not, found.nearest_q) if found else (None, None)
        self._take.visible = self._nearest is not None
        why = refused(f"The joint angles stay as they are: {say(self.unmet)}.") if self.unmet else ""
        self._line.show(why)
        self._line.visible = bool(why)

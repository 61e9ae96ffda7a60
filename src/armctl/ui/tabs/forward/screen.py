"""Forward: joint angles and tool pose, coupled; go there, absolutely or by so much from where the arm is."""

from __future__ import annotations

import math

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.robot import Robot
from armctl.runtime import MoveJoints, Snapshot, State
from armctl.ui.scene.ghost import Preview
from armctl.ui.session import Session
from armctl.ui.tabs.forward.coupling import PoseCoupling, angle_fields
from armctl.ui.tabs.forward.figures import jacobian_html, joint_rates_html, pose_html, tool_velocity_html
from armctl.ui.widgets.html import LiveHtml, fixed, muted, refused, table
from armctl.ui.widgets.joint_angles import held_at
from armctl.ui.widgets.number_field import DEGREES, MILLIMETRES, EditWatch, FieldArray, NumberField
from armctl.ui.widgets.profile_choice import MOVEMENTS, ProfileChoice

REFERENCE = "Go with respect to reference"
LAST = "Go with respect to last position"
PRESENT = "present pose (live)"
SHOWN = ("angles as reference", "angles added to last position", PRESENT)
_GO_NOTE = "Reference: each joint goes to its angle. Last position: the angles are added to where it stands."
_SHOWN_NOTE = "What the ghost and the figures below stand for."
_NOTE = "Type joint angles, or a tool pose. Nothing moves until a Go button is pressed."


def resulting_pose(how: str, asked: FloatArray, present: FloatArray) -> FloatArray:
    """Where the arm would go: ``asked`` itself, or added to where it is commanded to be (n,) [rad]."""
    return present + asked if how in (LAST, SHOWN[1]) else asked


class ForwardScreen:
    """Angle and pose fields, the two ways to go, and the figures of a configuration."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._preview = Preview(session.ghost)
        self._drawn: tuple[object, ...] = ()
        self._edited = False
        gui = session.gui
        LiveHtml(gui, _NOTE)
        self._angles = angle_fields(gui, self._robot, session.snapshot.q_command)
        self._coupling = PoseCoupling(session, self._angles, self._on_coupled)
        self._fill = gui.add_button_group("Fill with", ("present pose", *self._robot.poses))
        self._results = LiveHtml(gui)
        self._movement = ProfileChoice(gui, session.on, MOVEMENTS)
        LiveHtml(gui, muted(_GO_NOTE))
        absolute = gui.add_button(REFERENCE, icon=viser.Icon.PLAYER_PLAY)
        relative = gui.add_button(LAST, icon=viser.Icon.PLAYER_PLAY)
        self._shown = gui.add_dropdown("Show for", SHOWN, initial_value=SHOWN[0])
        LiveHtml(gui, muted(_SHOWN_NOTE))  # no hint: it would lie over the Go buttons above
        with gui.add_folder("Tool pose"):
            self._pose = LiveHtml(gui)
        with gui.add_folder("Jacobian and manipulability"):
            self._jacobian = LiveHtml(gui)
        with gui.add_folder("Velocities"):
            self._velocities = VelocityForm(session)
        pose_fields = self._coupling.pose.fields
        self._watch = EditWatch([*self._angles.fields, *pose_fields, self._movement.duration])
        for field in self._angles.fields:
            session.on(field.handle.on_update, self._on_angle)
        session.on(self._fill.on_click, self._on_fill)
        session.on(self._shown.on_update, self._edit)
        session.on(absolute.on_click, lambda: self._go(REFERENCE))
        session.on(relative.on_click, lambda: self._go(LAST))

    def refresh(self, snapshot: Snapshot) -> None:
        """Keep what depends on where the arm is up to date."""
        self._draw(snapshot)
        self._preview.refresh(snapshot.q_command)

    def _on_angle(self) -> None:
        self._coupling.follow_angles()
        self._edit()

    def _on_fill(self) -> None:
        asked = self._fill.value
        present = asked == "present pose"
        self._angles.fill(self._present(self._session.snapshot) if present else self._robot.pose(asked))
        self._on_angle()

    def _on_coupled(self) -> None:
        """A pose was typed and the joint angles have followed: a pose is absolute, so that is shown."""
        self._shown.value = SHOWN[0]
        self._edit()

    def _edit(self) -> None:
        self._edited = True
        self._preview.hide()  # from here on the ghost is this screen's again, whoever had it
        self._drawn = ()
        self._draw(self._session.snapshot)

    async def _go(self, how: str) -> None:
        """Show a configuration and send that very one."""
        self._watch.require_settled()
        self._coupling.require_met()
        asked, present = self._angles.array, self._session.snapshot.q_command
        profile, duration = self._movement.checked()
        q = self._robot.check_limits(resulting_pose(how, asked, present))
        self._preview.show(q, present)
        await self._session.submit(MoveJoints(q, duration, profile))
        self._edited = False

    def _draw(self, snapshot: Snapshot) -> None:
        """Draw results, ghost and figures, if fields or arm have changed."""
        present, shown = self._present(snapshot), self._shown.value
        key = (self._angles.texts, shown, present.tobytes())
        if key == self._drawn:
            return
        self._drawn = key
        self._results.show(results_html(self._robot, self._angles, present))
        try:
            q = present if shown == PRESENT else resulting_pose(shown, self._angles.array, present)
        except ArmctlError as refusal:
            self._preview.hide()
            self._pose.show(refused(str(refusal)))
            self._jacobian.show("")
            self._velocities.show(None)
            return
        if shown == PRESENT:
            self._preview.hide()
        elif self._edited and not self._preview.taken and snapshot.state is not State.MOVING:
            try:
                self._robot.check_limits(q)
            except ArmctlError:
                self._preview.hide()  # no button would send the arm there
            else:
                self._preview.show(q, present)
        self._pose.show(pose_html(self._robot, q))
        self._jacobian.show(jacobian_html(self._robot, q))
        self._velocities.show(q)

    def _present(self, snapshot: Snapshot) -> FloatArray:
        return self._session.console.last_known.standing(snapshot)


def results_html(robot: Robot, angles: FieldArray, present: FloatArray) -> str:
    """A row for where the arm is, and one for where each button would send it."""
    poses = {"now": present}
    problems = ""
    try:
        asked = angles.array
    except ArmctlError as refusal:
        problems = refused(f"Nothing can be sent: {refusal}.")
    else:
        for name, how in (("reference", REFERENCE), ("last position", LAST)):
            poses[f"→ {name}"] = q = resulting_pose(how, asked, present)
            try:
                robot.check_limits(q)
            except ArmctlError as refusal:
                problems += muted(f"✗ With respect to {name}: {refusal}.")
    head = ["will go to", *(f"θ{i + 1}°" for i in range(robot.n)), "x mm", "y mm", "z mm"]
    rows = [
        [name, *(fixed(v, 1) for v in (*np.degrees(q).tolist(), *(1000 * robot.forward(q)[:3, 3]).tolist()))]
        for name, q in poses.items()
    ]
    html = table(head, rows, small=True)
    return html + (problems or muted("Both are inside the joint limits."))


# Joint rates in, tool velocity out, and the other way round, in the configuration that is shown.

_RATE_DEG_S = 20.0
_SPEED_MM_S = 50.0
_KEEP_HINT = "The tool shall not turn. With fewer than six joints that is not always possible."


class VelocityForm:
    """Fields for rates and velocities; nothing here moves the arm."""

    def __init__(self, session: Session) -> None:
        self._robot = session.console.robot
        self._q: FloatArray | None = None
        self._turning = np.array([held_at(joint) is None for joint in self._robot.joints])
        gui = session.gui
        with gui.add_folder("Joint rates (°/s) → tool velocity"):
            rates = [
                NumberField(gui, joint.title, min(_RATE_DEG_S, math.degrees(joint.speed)))
                for joint in self._robot.joints
                if held_at(joint) is None
            ]
            self._rates = FieldArray(rates, DEGREES)
            self._velocity = LiveHtml(gui)
        with gui.add_folder("Tool velocity → joint rates"):
            speeds = zip("xyz", (_SPEED_MM_S, 0.0, 0.0), strict=True)
            linear = [NumberField(gui, f"v{axis} mm/s", value) for axis, value in speeds]
            self._linear = FieldArray(linear, MILLIMETRES)
            self._keep = gui.add_checkbox("Do not turn", initial_value=False, hint=_KEEP_HINT)
            self._answer = LiveHtml(gui)
        for handle in (*(field.handle for field in (*rates, *linear)), self._keep):
            session.on(handle.on_update, lambda: self.show(self._q))

    def show(self, q: FloatArray | None) -> None:
        """Compute for a configuration (n,) [rad]; None: there is none to compute for."""
        self._q = q
        if q is None:
            self._velocity.show("")
            self._answer.show("")
            return
        J, rates = self._robot.jacobian(q), np.zeros(self._robot.n)
        try:
            rates[self._turning] = self._rates.array
            self._velocity.show(tool_velocity_html(self._robot, J, rates))
        except ArmctlError as half_typed:
            self._velocity.show(refused(f"{half_typed}."))
        try:
            html = joint_rates_html(self._robot, J, self._linear.array, keep=self._keep.value)
            self._answer.show(html)
        except ArmctlError as half_typed:
            self._answer.show(refused(f"{half_typed}."))

"""Forward: joint angles and tool pose, coupled; go there, absolutely or by so much from where the arm is."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.runtime import MoveJoints, Snapshot, State
from armctl.ui.session import Session
from armctl.ui.tabs.forward.coupling import (
    LAST,
    PRESENT,
    REFERENCE,
    SHOWN,
    AngleFields,
    PoseCoupling,
    resulting_pose,
    results_html,
)
from armctl.ui.tabs.forward.velocity import VelocityForm
from armctl.ui.widgets.html import LiveHtml, muted, refused
from armctl.ui.widgets.number_field import EditWatch
from armctl.ui.widgets.pose_figures import jacobian_html, pose_html
from armctl.ui.widgets.preview import Preview
from armctl.ui.widgets.profile_choice import MOVEMENTS, ProfileChoice

FloatArray = NDArray[np.float64]
_GO_NOTE = "Reference: each joint goes to its angle. Last position: the angles are added to where it stands."
_SHOWN_NOTE = "What the ghost and the figures below stand for."
_NOTE = "Type joint angles, or a tool pose. Nothing moves until a Go button is pressed."


class ForwardScreen:
    """Angle and pose fields, the two ways to go, and the figures of a configuration."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._preview = Preview(session.ghost)
        self._drawn: tuple[object, ...] = ()
        self._edited = False
        gui = session.gui
        self._note = LiveHtml(gui, _NOTE)
        self._angles = AngleFields(gui, self._robot, session.snapshot.q_command)
        self._coupling = PoseCoupling(session, self._angles, self._on_coupled)
        self._fill = gui.add_button_group("Fill with", ("present pose", *self._robot.poses))
        self._results = LiveHtml(gui)
        self._movement = ProfileChoice(session, MOVEMENTS)
        LiveHtml(gui, muted(_GO_NOTE))
        self._absolute = gui.add_button(REFERENCE, icon=viser.Icon.PLAYER_PLAY)
        self._relative = gui.add_button(LAST, icon=viser.Icon.PLAYER_PLAY)
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
        self._attach()

    def _attach(self) -> None:
        session = self._session
        for field in self._angles.fields:
            session.on(field.handle.on_update, self._on_angle)
        session.on(self._fill.on_click, self._on_fill)
        session.on(self._shown.on_update, self._on_shown)
        session.on(self._absolute.on_click, self._on_absolute)
        session.on(self._relative.on_click, self._on_relative)

    def refresh(self, snapshot: Snapshot) -> None:
        """Keep what depends on where the arm is up to date."""
        self._draw(snapshot)
        self._preview.refresh(snapshot)

    async def _on_angle(self) -> None:
        self._coupling.follow_angles()
        self._edit()

    async def _on_shown(self) -> None:
        self._edit()

    async def _on_fill(self) -> None:
        asked = self._fill.value
        present = asked == "present pose"
        self._angles.fill(self._present(self._session.snapshot) if present else self._robot.pose(asked))
        self._coupling.follow_angles()
        self._edit()

    def _on_coupled(self) -> None:
        """A pose was typed and the joint angles have followed: a pose is absolute, so that is shown."""
        self._shown.value = SHOWN[0]
        self._edit()

    def _edit(self) -> None:
        self._edited = True
        self._preview.hide()  # from here on the ghost is this screen's again, whoever had it
        self._drawn = ()
        self._draw(self._session.snapshot)

    async def _on_absolute(self) -> None:
        await self._go(REFERENCE)

    async def _on_relative(self) -> None:
        await self._go(LAST)

    async def _go(self, how: str) -> None:
        self._watch.require_settled()
        self._coupling.require_met()
        asked = self._angles.radians()
        profile, duration = self._movement.checked()
        q = self._robot.check_limits(resulting_pose(how, asked, self._session.snapshot.q_command))
        await self._session.submit(MoveJoints(q, duration, profile))
        self._edited = False
        self._preview.show(q, self._session.snapshot.q_command)

    def _draw(self, snapshot: Snapshot) -> None:
        """Results, ghost and figures; nothing where neither fields nor arm have changed."""
        present = self._present(snapshot)
        key = (self._angles.texts(), self._shown.value, present.tobytes())
        if key == self._drawn:
            return
        self._drawn = key
        shown = self._shown.value
        self._results.show(results_html(self._robot, self._angles, present))
        try:
            q = present if shown == PRESENT else resulting_pose(shown, self._angles.radians(), present)
        except ArmctlError as refusal:
            self._preview.hide()
            self._figures(None, str(refusal))
            return
        if shown == PRESENT:
            self._preview.hide()
        elif self._edited and not self._preview.taken and snapshot.state is not State.MOVING:
            self._show_ghost(q, present)
        self._figures(q)

    def _present(self, snapshot: Snapshot) -> FloatArray:
        return self._session.console.last_known.standing(snapshot)

    def _show_ghost(self, q: FloatArray, present: FloatArray) -> None:
        """The ghost stands where a button would send the arm; where none would, there is none."""
        try:
            self._robot.check_limits(q)
        except ArmctlError:
            self._preview.hide()
            return
        self._preview.show(q, present)

    def _figures(self, q: FloatArray | None, why: str = "") -> None:
        if q is None:
            self._pose.show(refused(why))
            self._jacobian.show("")
            self._velocities.show(None)
            return
        self._pose.show(pose_html(self._robot, q))
        self._jacobian.show(jacobian_html(self._robot, q))
        self._velocities.show(q)

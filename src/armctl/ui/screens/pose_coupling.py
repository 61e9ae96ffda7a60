"""Joint angles and tool pose of the Forward screen, coupled both ways while they are typed."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError, UnreachableError
from armctl.ui.screens.forward_angles import AngleFields
from armctl.ui.screens.pose_fields import CoupledJoints, PoseFields, coupled_joints
from armctl.ui.widgets.html_bits import muted, refused
from armctl.ui.widgets.number_field import NumberField
from armctl.ui.widgets.pose_figures import base_turns
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]
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

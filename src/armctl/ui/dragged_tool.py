"""The arrows at the tool, on every tab: dragging them writes the next pose. The arm does not move.

Where the tool cannot follow, the next pose is the nearest one, and the page says so at once.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, UnreachableError
from armctl.facts import State
from armctl.kinematics import DEFAULT_STEP, Solutions
from armctl.kinematics.families.numeric.descent import PositionGoal, come_nearest
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.events import OneAtATime
from armctl.ui.next_pose import PoseWriter
from armctl.ui.session import Session
from armctl.ui.widgets.html import fixed, sentence

_SCALE, _LINE_PX = 0.11, 2.0
"""of the reach; width of the arrows"""
_COARSE_STEP = 20 * DEFAULT_STEP
"""of a joint that is free, while the tool is still dragged"""
_THERE_M = 1e-5
_AS_NEAR_M = 2e-3
"""a posture that the arm comes to without a jump may be farther away by so much"""
_WORDS = "dragged tool"


class DraggedTool:
    """One page's arrows; they stand at the tool of the next pose, or of the arm."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._writer = PoseWriter(session, _WORDS, kept_words=_WORDS)
        self._solving = OneAtATime(self._solve)
        self._dragged = self._held = False
        """not worked out yet; and still held"""
        self._told_out = False
        """that this drag leads out of reach"""
        self._point = self._stood = self._tool(session.snapshot)
        """where they were dragged last; and where they stood before"""
        self._arrows = session.client.scene.add_transform_controls(
            "/tool",
            scale=_SCALE * self._robot.chain.length,
            line_width=_LINE_PX,
            disable_rotations=True,
            disable_sliders=True,
            depth_test=False,
            position=self._point,
        )

        async def drag(event: viser.TransformControlsEvent) -> None:
            if event.client is None or session.closed:
                return
            self._point, held = np.array(self._arrows.position), event.phase != "end"
            if not self._held and not self._dragged and np.abs(self._point - self._stood).max() <= _THERE_M:
                return  # a click that drags nothing
            self._dragged, self._held = True, held
            session.view.held = held
            self._stood = self._point
            self._writer.begin()
            await session.attempt(self._solving.run)

        self._arrows.on_update(drag)

    def refresh(self, snapshot: Snapshot) -> None:
        """Stand at the tool, unless they are held; hidden while the arm moves, and beside other arrows.

        Hidden as well where there is no ghost for them to lead: in a program that pauses, and while another
        motion is looked at.
        """
        others = any(arrows.visible for arrows in self._session.other_arrows)
        away = snapshot.program is not None
        away |= self._session.next.q is not None and self._session.next.in_view is None
        if visible := not (snapshot.state is State.MOVING or others or away):
            self._stand(self._tool(snapshot))
        if self._arrows.visible is not visible:
            self._arrows.visible = visible

    def _tool(self, snapshot: Snapshot) -> FloatArray:
        return self._robot.forward(self._session.next.shown_in(snapshot))[:3, 3]

    def _stand(self, point: FloatArray) -> None:
        if not self._dragged and np.abs(self._arrows.position - point).max() > _THERE_M:
            self._arrows.position = self._stood = point

    async def _solve(self) -> None:
        """Make what has the tool there the next pose; out of reach that which comes nearest."""
        point, done = self._point, not self._held
        if not np.isfinite(point).all():  # no page drags it there
            self._dragged = False
            return
        before = self._session.next.shown_in(self._session.snapshot)
        try:
            q, missed = await asyncio.to_thread(dragged_near, self._robot, point, before, done=done)
            if not (self._session.closed or self._writer.overtaken):
                self._tell(missed, point, q)
                if q is not None:
                    self._writer.show(q)
        finally:
            if done and not (self._held or self._session.closed):
                self._told_out = self._dragged = False
                self._stand(self._tool(self._session.snapshot))

    def _tell(self, missed: Solutions | None, point: FloatArray, q: FloatArray | None) -> None:
        """Say at once, and once a drag, that the tool cannot go there; the line says how far it is away."""
        self._writer.words = _WORDS
        if missed is not None and q is not None:
            away = float(np.linalg.norm(self._robot.forward(q)[:3, 3] - point))
            self._writer.words += f", {fixed(1000 * away, 1)} mm out of reach"
        if missed is not None and not self._told_out:
            self._told_out = True
            why = sentence(missed.reason or "the arm cannot reach that")
            self._session.notify("Out of reach", f"{why} The next pose is the nearest one.", "yellow")


def dragged_near(
    robot: Robot, point: FloatArray, before: FloatArray, *, done: bool = True
) -> tuple[FloatArray | None, Solutions | None]:
    """As ``dragged_to``, or with the tool as near as it comes; and why that is not there (None: it is).

    Where the arm is stretched, all but the way back is out of its reach: it follows downhill from ``before``.
    Where that ends too early, the nearest point is solved, in a posture like that one if there is one.
    ``InputError``: a point that is none.
    """
    q, missed = _led(robot, point, before, done=done)
    if q is not None:
        return q, None
    if missed.nearest_m is None or missed.nearest_q is None:
        return None, missed
    chain = robot.chain
    if chain.coupling is None:
        q = come_nearest(chain, PositionGoal(point, chain.length), before[None], robot.limits)[0]
        if np.linalg.norm(robot.forward(q)[:3, 3] - point) < missed.nearest_away_m + _AS_NEAR_M:
            return q, missed
    q = dragged_to(robot, missed.nearest_m, before, done=done)
    return missed.nearest_q if q is None else q, missed


def dragged_to(
    robot: Robot, point: FloatArray, before: FloatArray, *, done: bool = True
) -> FloatArray | None:
    """The configuration (n,) [rad] nearest to ``before`` (n,) [rad] with the tool at ``point`` (3,) [m].

    An arm that can turn its tool about any axis keeps it turned as it is, where it can. ``done``: exactly;
    else a joint that is free is stepped more coarsely. None: there is none.
    """
    try:
        return _led(robot, point, before, done=done)[0]
    except ArmctlError:
        return None


def _led(
    robot: Robot, point: FloatArray, before: FloatArray, *, done: bool
) -> tuple[FloatArray | None, Solutions]:
    """As ``dragged_to``, and among which solutions that was found."""
    step = DEFAULT_STEP if done else _COARSE_STEP
    if robot.orients_tool:
        with suppress(UnreachableError):  # an orientation that cannot be kept is given up
            found = robot.inverse(point, rotation=robot.forward(before)[:3, :3], step=step, start=before)
            q = found.best("least-travel", before)
            if robot.off_rotation(found, q) is None:
                return q, found
    found = robot.inverse(point, step=step, start=before)
    return found.best("least-travel", before) if found.success else None, found

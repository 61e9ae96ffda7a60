"""The arrows at the tool, on every tab: dragging them writes the next pose. The arm does not move."""

from __future__ import annotations

import asyncio

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.facts import State
from armctl.kinematics import DEFAULT_STEP
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.events import OneAtATime
from armctl.ui.next_pose import PoseWriter
from armctl.ui.session import Session

_SCALE, _LINE_PX = 0.11, 2.0
"""of the reach; width of the arrows"""
_COARSE_STEP = 20 * DEFAULT_STEP
"""of a joint that is free, while the tool is still dragged"""
_THERE_M = 1e-5


class DraggedTool:
    """One page's arrows; they stand at the tool of the next pose, or of the arm."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._writer = PoseWriter(session, "dragged tool")
        self._solving = OneAtATime(self._solve)
        self._dragged = self._held = False
        """not worked out yet; and still held"""
        self._point = self._tool(session.snapshot)
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
            if event.client is not None and not session.closed:
                self._point, self._dragged = np.array(self._arrows.position), True
                self._held = event.phase != "end"
                await session.attempt(self._solving.run)

        self._arrows.on_update(drag)

    def refresh(self, snapshot: Snapshot) -> None:
        """Stand at the tool, unless they are held; hidden while the arm moves, and beside other arrows."""
        others = any(arrows.visible for arrows in self._session.other_arrows)
        if visible := snapshot.state is not State.MOVING and not others:
            self._stand(self._tool(snapshot))
        if self._arrows.visible is not visible:
            self._arrows.visible = visible

    def _tool(self, snapshot: Snapshot) -> FloatArray:
        return self._robot.forward(self._session.next.shown_in(snapshot))[:3, 3]

    def _stand(self, point: FloatArray) -> None:
        if not self._dragged and np.abs(self._arrows.position - point).max() > _THERE_M:
            self._arrows.position = point

    async def _solve(self) -> None:
        """Make what has the tool there the next pose; out of reach it stays where it was last."""
        point, done = self._point, not self._held
        if not np.isfinite(point).all():  # no page drags it there
            self._dragged = False
            return
        before = self._session.next.shown_in(self._session.snapshot)
        q = await asyncio.to_thread(dragged_to, self._robot, point, before, done=done)
        if self._session.closed:
            return
        if q is not None:
            self._writer.show(q)
        elif done:
            self._session.notify(
                "Out of reach", "The next pose stays where the tool could be last.", "yellow"
            )
        if done and not self._held:
            self._dragged = False
            self._stand(self._tool(self._session.snapshot))


def dragged_to(
    robot: Robot, point: FloatArray, before: FloatArray, *, done: bool = True
) -> FloatArray | None:
    """The configuration (n,) [rad] nearest to ``before`` (n,) [rad] with the tool at ``point`` (3,) [m].

    An arm that can turn its tool about any axis keeps it turned as it is, where it can. ``done``: exactly;
    else a joint that is free is stepped more coarsely. None: there is none.
    """
    step = DEFAULT_STEP if done else _COARSE_STEP
    turned = [robot.forward(before)[:3, :3]] if robot.orients_tool else []
    for rotation in (*turned, None):
        try:
            found = robot.inverse(point, rotation=rotation, step=step, start=before)
            q = found.best("least-travel", before)
        except ArmctlError:
            continue
        if rotation is None or robot.off_rotation(found, q) is None:
            return q
    return None

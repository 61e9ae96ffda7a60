"""A click on a link of the arm: a ring about its joint, which turns that joint of the next pose."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.facts import State
from armctl.kinematics import quaternion_wxyz
from armctl.kinematics.angles import wrap
from armctl.kinematics.target import rotation_from_quaternion
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.robot.body.hulls import segment_distance
from armctl.ui.next_pose import PoseWriter
from armctl.ui.session import Session
from armctl.ui.tabs.manual.scene_menu import read_ray
from armctl.ui.widgets.angle_fields import held_at

_SCALE, _LINE_PX = 0.3, 4.0
"""of the reach; width of the ring"""
_FAR = 10.0
"""times the reach: so long is the ray that is looked along"""
_THERE = 1e-9


def clicked_joint(robot: Robot, q: FloatArray, origin: FloatArray, direction: FloatArray) -> int | None:
    """The joint whose link a ray meets first, of the arm at ``q`` (n,) [rad]; None: of none.

    ``origin`` (3,) [m], ``direction`` (3,) of length 1. Links of a parallel linkage have no ring.
    """
    if robot.chain.coupling is not None:
        return None
    collision = robot.collision
    starts, spans = (one[:, :, 0] for one in collision.placed(collision.frames(q[None])))
    ray = _FAR * robot.chain.length * direction
    k = starts.shape[1]
    off = segment_distance(
        starts, spans, np.repeat(origin[:, None], k, axis=1), np.repeat(ray[:, None], k, axis=1)
    )
    along = direction @ (starts + 0.5 * spans - origin[:, None])
    met = np.flatnonzero(off <= np.array([one.radius for one in collision.capsules]))
    if not len(met):
        return None
    link: int = collision.capsules[int(met[along[met].argmin()])].link
    link = link if link < robot.n else collision.mounts[link - robot.n].turns
    return link if link >= 0 and held_at(robot.joints[link]) is None else None


def ring_frame(robot: Robot, q: FloatArray, joint: int) -> tuple[FloatArray, FloatArray]:
    """Where the ring of a joint stands (3,) [m], and its frame (3, 3), with z along the joint's axis."""
    points, axes = robot.chain.axes(q)
    z = axes[joint]
    x = np.cross(z, np.eye(3)[np.abs(z).argmin()])
    x /= np.linalg.norm(x)
    return points[joint], np.stack([x, np.cross(z, x), z], axis=1)


class LinkRing:
    """One page's ring; a click on the same link, or beside the arm, takes it away."""

    def __init__(self, session: Session, taken: Callable[[FloatArray, FloatArray], bool]) -> None:
        """``taken``: whether a click's ray, from (3,) [m] along (3,), was for something else."""
        self._session, self._taken = session, taken
        self._robot = session.console.robot
        self._writer = PoseWriter(session, "")
        self._joint: int | None = None
        self._ring: viser.TransformControlsHandle | None = None
        self._began: FloatArray | None = None
        """(n,) [rad] the pose that is turned; None: the ring is not dragged"""
        self._frame = np.eye(3)
        """of the ring as it was placed"""
        self._angle = 0.0
        """by how much it is turned since then [rad]"""
        session.on_part_value("scene-click", self._on_click)

    @property
    def joint(self) -> int | None:
        """Whose ring is shown."""
        return self._joint

    def refresh(self, snapshot: Snapshot) -> None:
        """Stand at the joint of the next pose, or of the arm; not while the arm moves."""
        if self._ring is not None and self._began is None:
            self._stand(snapshot)
            visible = snapshot.state is not State.MOVING
            if self._ring.visible is not visible:
                self._ring.visible = visible

    async def _on_click(self, _: str, value: str) -> None:
        origin, direction, _place = read_ray(value)
        session, robot = self._session, self._robot
        joint = None
        if not self._taken(origin, direction):
            shown = session.next.shown_in(session.snapshot)
            standing = session.console.last_known.drawn(session.snapshot)
            for q in (shown, standing):  # beside the event loop: an arm with meshes may be worked out by it
                joint = await asyncio.to_thread(clicked_joint, robot, q, origin, direction)
                if joint is not None:
                    break
        if not session.closed:
            self._show(None if joint == self._joint else joint)

    def _show(self, joint: int | None) -> None:
        if self._ring is not None:
            self._ring.remove()
            self._ring = None
        self._joint, self._began = joint, None
        if joint is None:
            return
        self._ring = ring = self._session.client.scene.add_transform_controls(
            "/ring", scale=_SCALE * self._robot.chain.length, line_width=_LINE_PX, disable_axes=True,
            disable_sliders=True, active_axes=(True, True, False), depth_test=False,
        )  # fmt: skip  # the ring about z is the one between the other two axes
        self._stand(self._session.snapshot)

        async def drag(event: viser.TransformControlsEvent) -> None:
            if event.client is not None and not self._session.closed:
                self._session.view.held = event.phase != "end"
                self.turn(np.array(ring.wxyz), done=event.phase == "end")

        ring.on_update(drag)

    def _stand(self, snapshot: Snapshot) -> None:
        if self._ring is None or self._joint is None:
            return
        q = self._session.next.shown_in(snapshot)
        point, self._frame = ring_frame(self._robot, q, self._joint)
        wxyz = quaternion_wxyz(self._frame)
        self._angle = 0.0
        if (
            np.abs(self._ring.position - point).max() > _THERE
            or np.abs(self._ring.wxyz - wxyz).max() > _THERE
        ):
            self._ring.position, self._ring.wxyz = point, wxyz

    def turn(self, wxyz: FloatArray, *, done: bool) -> None:
        """The ring is dragged to this orientation (4,): its joint turns, inside its limits."""
        joint = self._joint
        if joint is None or not np.isfinite(wxyz).all() or not wxyz.any():
            return
        if self._began is None:
            self._began = self._session.next.shown_in(self._session.snapshot).copy()
        self._angle += wrap(_turned(self._frame, wxyz) - self._angle)
        q, one = self._began.copy(), self._robot.joints[joint]
        q[joint] = min(max(q[joint] + self._angle, one.lower), one.upper)
        self._writer.words = f"ring at {one.title}"
        self._writer.show(q)
        if done:
            self._began = None
            self._stand(self._session.snapshot)


def _turned(frame: FloatArray, wxyz: FloatArray) -> float:
    """By how much an orientation is turned about the z of a frame (3, 3) [rad]."""
    turned = frame.T @ rotation_from_quaternion(wxyz / np.linalg.norm(wxyz))
    return math.atan2(turned[1, 0], turned[0, 0])

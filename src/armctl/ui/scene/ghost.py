"""What one page draws in its own view beside the arm: ghosts, lines, and the body that checks keep apart."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.kinematics import quaternion_wxyz
from armctl.protocol import Snapshot
from armctl.robot import CarriedPart, Robot
from armctl.robot.body.arm_body import Capsule
from armctl.robot.look.pieces import Mount
from armctl.robot.parts import Color
from armctl.robot.solids import Solid, grown, joined, tube
from armctl.ui.scene.arm_model import ARM, ArmFigure, add_solid, arm_model

LOOKED_AT, _OPACITY = (217, 115, 13), 0.35
THICKER = 1.08
"""A ghost is this much thicker than the arm: where both are in one place, equal surfaces would flicker."""
NEAREST = "nearest"
"""what stands beside the ghost of a target that is out of reach"""
SAME_RAD = 1e-4
"""a pose that is no farther off is the one where the arm stands"""


class Ghost:
    """A translucent arm, built when it is first needed; its owner is who showed something last.

    It is in view while the tab of its owner is open. A page has one for what is only looked at, and one for
    its next pose (``NextPose``).
    """

    def __init__(
        self,
        scene: viser.SceneApi,
        robot: Robot,
        snapshot: Callable[[], Snapshot | None] = lambda: None,
        name: str = "/looked_at",
        color: Color = LOOKED_AT,
    ) -> None:
        """``snapshot``: of the arm; the ghost holds its jaws as the arm does when it is shown."""
        self._scene, self._robot, self._snapshot = scene, robot, snapshot
        self._name, self._color = name, color
        self._figure: ArmFigure | None = None
        self.q: FloatArray | None = None
        """(n,) the configuration that is shown [rad]; None: nothing"""
        self.owner: object = None
        self.tab: str | None = None
        """the label of the tab that is open; None: not known"""
        self._words: str | None = None
        self.label: str | None = None
        """what is written beside it, where that is not the label of the owner's tab"""
        self._lost: Callable[[], None] | None = None

    @property
    def held(self) -> tuple[float | None, CarriedPart | None]:
        """How far the arm's gripper is open, 0..1 (None: not known), and what it carries."""
        now = self._snapshot()
        return (None, None) if now is None else (now.gripper, CarriedPart.of(now.part_mm))

    def claim(self, owner: object, lost: Callable[[], None] | None = None) -> None:
        """Give the ghost to ``owner``; the ``lost`` of the owner before is called once."""
        if owner is self.owner:
            return
        before, self.owner, self._lost = self._lost, owner, lost
        self.hide(owner)
        if before is not None:
            before()

    def see(self, tab: str | None) -> bool:
        """This tab is open; None: not known. Whether it is another one than before."""
        another, self.tab = tab != self.tab, tab
        self._show_in_view()
        return another

    @property
    def seen(self) -> bool:
        """Whether a configuration is shown, and in view."""
        return self.q is not None and self.in_view(self._words)

    def is_open(self, tab: str) -> bool:
        """Whether this tab is known to be open."""
        return self.tab == tab

    def _show_in_view(self) -> None:
        if self._figure is not None:
            self._figure.root.visible = self.seen

    def in_view(self, tab: str | None) -> bool:
        """Whether what belongs to a tab can be seen; None: it belongs to none."""
        return tab is None or self.tab is None or tab == self.tab

    def show(
        self, q: FloatArray, owner: object = None, words: str | None = None, label: str | None = None
    ) -> None:
        """Show the arm at ``q`` (n,) [rad]; the ghost is ``owner``'s from now on.

        ``words``: the label of the owner's tab, written beside it; None: it belongs to no tab. ``label``:
        written there instead.
        """
        if self._figure is None:
            self._figure = ArmFigure(
                self._scene, self._robot, self._name, color=self._color, opacity=_OPACITY, thicker=THICKER
            )
        self.claim(owner)
        self.q = q.copy()
        opening, part = self.held
        self._figure.pose(q, opening)
        self._figure.carry(part)
        self._figure.say(words if label is None else label)
        self._words, self.label = words, label
        self._show_in_view()

    def hide(self, owner: object = None) -> None:
        """Show nothing, if the ghost is ``owner``'s."""
        if self.owner is owner:
            self.q = None
            if self._figure is not None:
                self._figure.root.visible = False


class Preview:
    """The page's ghost for one screen: shown until the arm stands there or another screen takes it."""

    def __init__(self, ghost: Ghost, words: str | None, label: str | None = None) -> None:
        """``words``: the label of the screen's tab; None: it has none. ``label``: as in ``Ghost.show``."""
        self._ghost, self._words, self._label = ghost, words, label
        self._said = label
        self._q: FloatArray | None = None
        """(n,) what this screen has shown last [rad]; None: nothing"""

    @property
    def shown(self) -> bool:
        """Whether this screen's ghost is shown."""
        return self._q is not None and self._ghost.owner is self

    @property
    def taken(self) -> bool:
        """Whether another screen shows something, in view, in place of what this one has shown last."""
        return self._q is not None and self._ghost.owner is not self and self._ghost.seen

    def show(self, q: FloatArray, present: FloatArray, label: str | None = None) -> None:
        """Show ``q`` (n,) [rad], unless the arm stands there now; ``label``: in place of the usual one."""
        if np.abs(q - present).max() < SAME_RAD:
            self.hide()
        else:
            self._q, self._said = q.copy(), label or self._label
            self._ghost.show(q, self, self._words, self._said)

    def hide(self) -> None:
        """Show nothing, if it is this screen's ghost that is shown."""
        self._q = None
        self._ghost.hide(self)

    def refresh(self, present: FloatArray) -> None:
        """Hide the ghost once the arm, at ``present`` (n,) [rad], has come to it.

        One that another tab's screen has taken comes back when this screen's tab is open again.
        """
        if self._q is None:
            return
        if np.abs(self._q - present).max() < SAME_RAD:
            self.hide()
        elif not (self.shown or self.taken) and self._words is not None and self._ghost.is_open(self._words):
            self._ghost.show(self._q, self, self._words, self._said)


async def played(
    begin: float, end: float, speed: Callable[[], float], frame_s: float
) -> AsyncIterator[float]:
    """Times of a motion from ``begin`` to ``end`` [s] as it is played, a frame apart, the end included."""
    clock = asyncio.get_running_loop().time
    time, before = begin, clock()
    yield time
    while time < end:
        await asyncio.sleep(frame_s)
        now = clock()
        time = min(time + (now - before) * speed(), end)
        before = now
        yield time


def segments(points: FloatArray) -> FloatArray:
    """The line segments (k - 1, 2, ...) between consecutive points (k, ...)."""
    return np.stack([points[:-1], points[1:]], axis=1)


class Lines:
    """Line segments under one name."""

    def __init__(self, scene: viser.SceneApi, name: str, color: Color, thickness: float = 2.0) -> None:
        """Draw nothing yet; ``thickness`` in pixels."""
        self._scene, self._name = scene, name
        self._color, self._thickness = color, thickness
        self._handle: viser.LineSegmentsHandle | None = None
        self._pose: FloatArray | None = None

    def show(self, segments: FloatArray) -> None:
        """Draw line segments (k, 2, 3) [m] in place of those before."""
        if self._handle is not None and self._handle.points.shape == segments.shape:
            self._handle.points = segments.astype(np.float32)
            return
        self.hide()
        if len(segments):
            self._handle = self._scene.add_line_segments(
                self._name, segments, self._color, thickness=self._thickness, thickness_units="screen"
            )
            self._place()

    def hide(self) -> None:
        """Draw nothing."""
        if self._handle is not None:
            self._handle.remove()
            self._handle = None

    def set_visible(self, visible: bool) -> None:
        """Show or hide the lines; those drawn anew are shown."""
        if self._handle is not None:
            self._handle.visible = visible

    def place(self, T: FloatArray) -> None:
        """Move the lines to a pose (4, 4) in the base frame [m]."""
        if self._pose is None or not np.array_equal(T, self._pose):
            self._pose = T
            self._place()

    def _place(self) -> None:
        if self._handle is not None and self._pose is not None:
            self._handle.wxyz = quaternion_wxyz(self._pose[:3, :3])
            self._handle.position = self._pose[:3, 3]


# The body that checks of a motion keep apart, over the arm.


_BODY_COLOR, _BODY_OPACITY = (174, 62, 201), 0.4
_OUT = 0.002
"""of the reach: so much larger it is drawn all round, or surfaces that the arm has, too, would flicker"""


def body_solids(robot: Robot) -> list[tuple[str, FloatArray, Solid]]:
    """What is kept apart: a frame of the arm's figure, and a mesh [m] with its pose (4, 4) in there.

    Takes tenths of a second, and seconds where the body is not worked out yet.
    """
    model, collision, links = arm_model(robot), robot.collision, len(robot.chain.segments)
    parts: dict[int, list[Solid]] = {}
    for capsule in collision.capsules:
        solid = grown(_solid(capsule), _OUT * robot.chain.length)
        parts.setdefault(capsule.link, []).append(solid)
    mounts = {link: Mount(link, link) if link < links else collision.mounts[link - links] for link in parts}
    return [(*model.frame_of(mounts[link]), joined(solids)) for link, solids in parts.items()]


def _solid(capsule: Capsule) -> Solid:
    hull = capsule.hull
    if hull is None:
        start, end = capsule.start.tolist(), capsule.end.tolist()
        if start == end:  # a ball
            end = [end[0], end[1], end[2] + 1e-6]
        return tube(tuple(start), tuple(end), 2 * capsule.radius)
    from scipy.spatial import ConvexHull

    made = ConvexHull(hull.corners, qhull_options="QJ")  # flat ones, too
    normals = made.equations[:, :3]
    a, b, c = (hull.corners[made.simplices[:, k]] for k in range(3))
    inwards = (np.cross(b - a, c - a) * normals).sum(axis=1) < 0
    faces = np.where(inwards[:, None], made.simplices[:, ::-1], made.simplices).astype(np.int64)
    kept, index = np.unique(faces, return_inverse=True)
    return grown(Solid(hull.corners[kept], index.reshape(-1, 3)), hull.margin)


class BodyView:
    """The body, with what the gripper carries, in the frames of the arm that all pages share."""

    def __init__(self, scene: viser.SceneApi, spawn: Callable[[Coroutine[Any, Any, None]], None]) -> None:
        """Draw nothing yet; ``spawn`` runs something beside the callbacks of the page."""
        self._scene, self._spawn = scene, spawn
        self._wanted: Robot | None = None
        """the arm with its gripper as it is; None: nothing is to be shown"""
        self._nodes: list[viser.MeshHandle] = []
        self._at_work = False

    def show(self, wanted: Robot | None) -> None:
        """Show the body of the arm, with its jaws and what they carry; None: nothing."""
        if wanted is self._wanted:
            return
        self._wanted = wanted
        if wanted is None:
            self._remove()
        elif not self._at_work:
            self._spawn(self._draw())

    def _remove(self) -> None:
        while self._nodes:
            self._nodes.pop().remove()

    async def _draw(self) -> None:
        """Work the newest one out, beside the event loop, and draw it."""
        self._at_work = True
        drawn: Robot | None = None
        try:
            while (wanted := self._wanted) is not None and wanted is not drawn:
                solids = await asyncio.to_thread(body_solids, wanted)
                drawn = wanted
                if self._is_wanted():
                    self._remove()
                    self._nodes = [
                        self._add(f"{ARM}/{name}/body{i}", pose, solid)
                        for i, (name, pose, solid) in enumerate(solids)
                    ]
        finally:
            self._at_work = False

    def _is_wanted(self) -> bool:
        return self._wanted is not None

    def _add(self, name: str, pose: FloatArray, solid: Solid) -> viser.MeshHandle:
        node = add_solid(self._scene, name, solid, _BODY_COLOR, _BODY_OPACITY, flat=True)
        node.position, node.wxyz = pose[:3, 3], quaternion_wxyz(pose[:3, :3])
        return node

"""What checks of a motion keep apart, drawn over the arm in one page's view."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.kinematics import quaternion_wxyz
from armctl.robot import Robot
from armctl.robot.body.arm_body import Capsule
from armctl.robot.look.pieces import Mount
from armctl.robot.solids import Solid, grown, joined, tube
from armctl.ui.scene.arm_figure import ARM, add_solid
from armctl.ui.scene.arm_model import arm_model

_COLOR, _OPACITY = (174, 62, 201), 0.4
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
        node = add_solid(self._scene, name, solid, _COLOR, _OPACITY, flat=True)
        node.position, node.wxyz = pose[:3, 3], quaternion_wxyz(pose[:3, :3])
        return node

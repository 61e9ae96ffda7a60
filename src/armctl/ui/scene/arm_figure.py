"""An arm in a scene: a node for each frame that moves, and for each mesh in it."""

from __future__ import annotations

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.kinematics import quaternion_wxyz
from armctl.robot import CarriedPart, Robot
from armctl.robot.body.arm_body import width
from armctl.robot.look.rows import Theme
from armctl.robot.parts import Color
from armctl.robot.solids import Solid, grown
from armctl.ui.scene.arm_model import TOOL, arm_model

ARM = "/arm"
"""the name of the present arm's figure, which all pages share"""
_PART: Color = (176, 137, 96)
HALF_OPEN = 0.5
"""the gripper, where nobody has seen it"""


def send_pose(node: viser.SceneNodeHandle) -> None:
    """Send a new node's pose even where it is the default: a page keeps that of an older node of its name."""
    position, wxyz = node.position.copy(), node.wxyz.copy()
    node.position, node.wxyz = position + 1.0, np.roll(wxyz, 1)
    node.position, node.wxyz = position, wxyz


def add_solid(
    scene: viser.SceneApi,
    name: str,
    solid: Solid,
    color: Color,
    opacity: float | None = None,
    *,
    flat: bool = False,
) -> viser.MeshHandle:
    """Draw a solid; ``flat``: with edges, as machines have. One that is seen through casts no shadow."""
    return scene.add_mesh_simple(
        name,
        solid.vertices,
        solid.faces,
        color=color,
        opacity=opacity,
        flat_shading=flat,
        cast_shadow=opacity is None,
        receive_shadow=opacity is None,
    )


def repaint(scene: viser.SceneApi, robot: Robot, name: str, theme: Theme) -> list[viser.MeshHandle]:
    """Draw the meshes of a figure of all pages in one page's own scene, in the colours of its theme.

    They hide those of all pages, and move with them, as they are in the same frames.
    """
    meshes = (mesh for mesh in arm_model(robot).meshes if mesh.color_in(theme) != mesh.color_in("light"))
    return [
        add_solid(scene, f"{name}/{mesh.name}", mesh.solid, mesh.color_in(theme), flat=mesh.flat)
        for mesh in meshes
    ]


class ArmFigure:
    """One drawing of an arm in a scene; ``pose`` moves it, its ``root`` shows, hides and removes it."""

    def __init__(
        self,
        scene: viser.SceneApi,
        robot: Robot,
        name: str,
        *,
        color: Color | None = None,
        opacity: float | None = None,
        thicker: float = 1.0,
        theme: Theme = "light",
    ) -> None:
        """Draw the arm as it looks; ``color`` and ``opacity`` replace its own.

        ``thicker``: so many times as wide as the arm. Equal surfaces of two in one place would flicker.
        """
        self._scene, self._name = scene, name
        self._part_color, self._opacity = color or _PART, opacity
        self._grown = 0.5 * (thicker - 1.0) * width(robot.chain, robot.look)
        self._model = arm_model(robot, thicker, ghostly=color is not None)
        self.root = scene.add_frame(name, show_axes=False)
        self._frames = [scene.add_frame(f"{name}/{frame}", show_axes=False) for frame in self._model.frames]
        self._q: FloatArray | None = None
        self._opening = HALF_OPEN
        self._shown: FloatArray | None = None
        for frame in self._frames:
            send_pose(frame)
        for mesh in self._model.meshes:
            shown = color or mesh.color_in(theme)
            add_solid(scene, f"{name}/{mesh.name}", mesh.solid, shown, opacity, flat=mesh.flat)
        self._label: viser.LabelHandle | None = None
        self._part: CarriedPart | None = None
        self._drawn_part: viser.MeshHandle | None = None
        if self._model.tool_axes and opacity is None:
            size = width(robot.chain, robot.look)
            axes = scene.add_frame(f"{name}/{TOOL}/axes", axes_length=size, axes_radius=0.04 * size)
            send_pose(axes)

    def pose(self, q: FloatArray, opening: float | None = None) -> None:
        """Move the figure to joint angles ``q`` (n,) [rad] and a gripper opening 0..1 (None: as it is)."""
        opening = self._opening if opening is None else opening
        if self._q is not None and opening == self._opening and np.array_equal(q, self._q):
            return
        self._q, self._opening = q.copy(), opening
        placed = self._model.place(q[None], np.array([opening]))[0]
        for i, handle in enumerate(self._frames):
            if self._shown is None or not np.array_equal(self._shown[i], placed[i]):
                handle.position = placed[i, :3, 3]
                handle.wxyz = quaternion_wxyz(placed[i, :3, :3])
        self._shown = placed

    def carry(self, part: CarriedPart | None) -> None:
        """Draw what is between the jaws as a box; None: nothing."""
        if part == self._part:
            return
        self._part = part
        if self._drawn_part is not None:
            self._drawn_part.remove()
        self._drawn_part = None if part is None else self.add_part(part, "part")

    def add_part(self, part: CarriedPart, name: str) -> viser.MeshHandle:
        """Draw a part between the jaws, as a node of this name in the tool frame, which stays."""
        solid = grown(part.solid, self._grown)
        node = f"{self._name}/{TOOL}/{name}"
        drawn = add_solid(self._scene, node, solid, self._part_color, self._opacity, flat=True)
        send_pose(drawn)
        return drawn

    def tracks(self, q: FloatArray, opening: FloatArray) -> dict[str, FloatArray]:
        """Where ``pose`` would put its parts at angles (k, n) [rad] and openings (k,): by name (k, 7).

        Columns: x, y, z [m] and the quaternion w, x, y, z, whose sign does not jump.
        """
        placed, tracks = self._model.place(q, opening), dict[str, FloatArray]()
        for i, handle in enumerate(self._frames):
            turned = np.array([quaternion_wxyz(T[:3, :3]) for T in placed[:, i]])
            flips = np.where((turned[1:] * turned[:-1]).sum(axis=1) < 0, -1.0, 1.0)
            turned[1:] *= np.cumprod(flips)[:, None]
            tracks[handle.name] = np.hstack([placed[:, i, :3, 3], turned])
        return tracks

    def say(self, words: str | None) -> None:
        """Write words at the tool point; None: nothing."""
        if words is not None and (self._label is None or self._label.text != words):
            self.say(None)
            self._label = self._scene.add_label(f"{self._name}/{TOOL}/words", words, anchor="bottom-center")
            send_pose(self._label)
        elif words is None and self._label is not None:
            self._label.remove()
            self._label = None

"""An arm drawn from its DH rows: a tube along each row's a and d, a drum on each joint axis, two fingers."""

from __future__ import annotations

import math

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from armctl.kinematics import quaternion_wxyz
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
Color = tuple[int, int, int]
LINK_COLORS: tuple[Color, ...] = ((52, 73, 94), (41, 128, 185), (230, 126, 34), (39, 174, 96), (142, 68, 173))
_JOINT_COLOR: Color = (60, 60, 65)
_TOOL_COLOR: Color = (90, 90, 95)


class ArmFigure:
    """One drawing of an arm in a scene; ``pose`` moves it."""

    def __init__(
        self,
        scene: viser.SceneApi,
        robot: Robot,
        name: str,
        *,
        color: Color | None = None,
        opacity: float | None = None,
        visible: bool = True,
    ) -> None:
        self._robot = robot
        self._scene, self._name = scene, name
        self._color, self._opacity = color, opacity
        self._root = scene.add_frame(name, show_axes=False, visible=visible)
        self._size = _reach(robot)
        chain = robot.chain
        self._frames = [
            scene.add_frame(f"{name}/f{i}", show_axes=False) for i in range(len(chain.rows) + 1)
        ]
        self._shown: FloatArray | None = None
        self._draw_rows()
        self._fingers = self._draw_gripper()

    @property
    def visible(self) -> bool:
        """Whether the arm is shown."""
        return self._root.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if self._root.visible != visible:
            self._root.visible = visible

    def pose(self, q: FloatArray, opening: float | None = None) -> None:
        """Move the figure to joint angles ``q`` (n,) [rad] and a gripper opening 0..1."""
        frames = self._robot.frames(q)
        shown = self._shown
        for i, handle in enumerate(self._frames):
            if shown is None or not np.array_equal(shown[i], frames[i]):
                handle.position = frames[i, :3, 3]
                handle.wxyz = quaternion_wxyz(frames[i, :3, :3])
        self._shown = frames
        if self._fingers and opening is not None:
            gap = (0.006 + 0.03 * opening) * self._size / 0.33
            for side, finger in zip((1, -1), self._fingers, strict=True):
                position = (0.0, side * gap, 0.0)
                if tuple(finger.position) != position:
                    finger.position = position

    def _draw_rows(self) -> None:
        chain = self._robot.chain
        radius = 0.035 * self._size
        joint = -1
        for i, row in enumerate(chain.rows):
            joint += row.joint
            color = LINK_COLORS[max(joint, 0) % len(LINK_COLORS)]
            before = LINK_COLORS[max(joint - row.joint, 0) % len(LINK_COLORS)]
            if chain.convention == "modified":  # a lies on the frame before, d on the axis of this one
                self._tube(i, f"a{i}", (0, 0, 0), (row.a_m, 0, 0), radius, before)
                self._tube(i + 1, f"d{i}", (0, 0, -row.d_m), (0, 0, 0), radius, color)
                axis_frame = i + 1
            else:  # d lies on the frame before, a on this one
                self._tube(i, f"d{i}", (0, 0, 0), (0, 0, row.d_m), radius, before)
                self._tube(i + 1, f"a{i}", (-row.a_m, 0, 0), (0, 0, 0), radius, color)
                axis_frame = i
            if row.joint:
                self._drum(axis_frame, f"j{i}", 1.35 * radius, 2.6 * radius)
        base = trimesh.creation.cylinder(0.09 * self._size * 2, 0.02 * self._size, sections=40)
        self._mesh("base", base.apply_translation((0, 0, 0.01 * self._size)), _JOINT_COLOR)

    def _tube(
        self, frame: int, name: str, start: tuple[float, float, float], end: tuple[float, float, float],
        radius: float, color: Color,
    ) -> None:  # fmt: skip
        span = np.array(end, dtype=np.float64) - np.array(start, dtype=np.float64)
        length = float(np.linalg.norm(span))
        if length < 0.25 * radius:
            return
        mesh = trimesh.creation.capsule(height=length, radius=radius, count=(20, 12))
        mesh.apply_translation((0, 0, -float(mesh.bounds.mean(axis=0)[2]) + 0.5 * length))  # from its start, whatever trimesh centres
        align = trimesh.geometry.align_vectors([0, 0, 1], span / length)
        mesh.apply_transform(align)
        mesh.apply_translation(start)
        self._mesh(f"f{frame}/{name}", mesh, color)

    def _drum(self, frame: int, name: str, radius: float, height: float) -> None:
        mesh = trimesh.creation.cylinder(radius, height, sections=32)
        self._mesh(f"f{frame}/{name}", mesh, _JOINT_COLOR)

    def _draw_gripper(self) -> tuple[viser.FrameHandle, ...]:
        """Two fingers along the tool's z axis, ending at the tool point."""
        if self._robot.gripper is None:
            return ()
        scale = self._size / 0.33
        tool = f"{self._name}/f{len(self._robot.chain.rows)}"
        palm = trimesh.creation.box((0.014 * scale, 0.07 * scale, 0.008 * scale))
        self._mesh(
            f"f{len(self._robot.chain.rows)}/palm", palm.apply_translation((0, 0, -0.042 * scale)), _TOOL_COLOR
        )
        fingers: list[viser.FrameHandle] = []
        for side in ("left", "right"):
            handle = self._scene.add_frame(f"{tool}/{side}", show_axes=False)
            finger = trimesh.creation.box((0.012 * scale, 0.006 * scale, 0.04 * scale))
            self._mesh(
                f"f{len(self._robot.chain.rows)}/{side}/finger",
                finger.apply_translation((0, 0, -0.02 * scale)),
                _TOOL_COLOR,
            )
            fingers.append(handle)
        return tuple(fingers)

    def _mesh(self, name: str, mesh: trimesh.Trimesh, color: Color) -> None:
        self._scene.add_mesh_simple(
            f"{self._name}/{name}",
            np.asarray(mesh.vertices, dtype=np.float64),
            np.asarray(mesh.faces),
            color=self._color or color,
            opacity=self._opacity,
            cast_shadow=False,
            receive_shadow=False,
        )


def _reach(robot: Robot) -> float:
    """Rough size of the arm [m]: the sum of its row lengths."""
    return sum(math.hypot(row.a_m, row.d_m) for row in robot.chain.rows) * 0.65

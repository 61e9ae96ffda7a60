"""An arm drawn from its DH rows: a tube along each row's a and d, a drum on each joint axis, two fingers."""

from __future__ import annotations

import math

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.kinematics import DHRow, quaternion_wxyz
from armctl.robot import Robot
from armctl.ui.scene.shapes import Point, Solid, block, drum, tube

FloatArray = NDArray[np.float64]
Color = tuple[int, int, int]
LINK_COLORS: tuple[Color, ...] = (
    (52, 73, 94),
    (41, 128, 185),
    (230, 126, 34),
    (39, 174, 96),
    (142, 68, 173),
)
_JOINT_COLOR: Color = (60, 60, 65)
_TOOL_COLOR: Color = (90, 90, 95)
# Proportions, as fractions of the arm's reach.
_TUBE_RADIUS, _DRUM_RADIUS, _DRUM_HEIGHT = 0.026, 0.034, 0.066
_BASE_RADIUS, _BASE_HEIGHT = 0.14, 0.02
_FINGER, _PALM = (0.026, 0.012, 0.085), (0.03, 0.15, 0.022)
_GAP_CLOSED, _GAP_OPEN = 0.008, 0.065


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
        """Draw the arm; ``color`` and ``opacity`` replace those of the links."""
        self._robot, self._scene, self._name = robot, scene, name
        self._color, self._opacity = color, opacity
        self._reach = float(np.linalg.norm(np.diff(robot.chain.axes()[0], axis=0), axis=1).sum())
        self._reach += abs(robot.chain.rows[-1].d_m) + abs(robot.chain.rows[-1].a_m)
        self._root = scene.add_frame(name, show_axes=False, visible=visible)
        self._frames = [
            scene.add_frame(f"{name}/f{i}", show_axes=False) for i in range(len(robot.chain.rows) + 1)
        ]
        self._shown: FloatArray | None = None
        self._draw_links()
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
        """Move the figure to joint angles ``q`` (n,) [rad] and a gripper opening 0..1 (None: as it is)."""
        frames = self._robot.frames(q)
        for i, handle in enumerate(self._frames):
            if self._shown is None or not np.array_equal(self._shown[i], frames[i]):
                handle.position = frames[i, :3, 3]
                handle.wxyz = quaternion_wxyz(frames[i, :3, :3])
        self._shown = frames
        if self._fingers and opening is not None:
            gap = self._reach * (_GAP_CLOSED + (_GAP_OPEN - _GAP_CLOSED) * opening)
            for side, finger in zip((1, -1), self._fingers, strict=True):
                if finger.position[1] != side * gap:
                    finger.position = (0.0, side * gap, 0.0)

    def _draw_links(self) -> None:
        rows = self._robot.chain.rows
        joint = -1
        for i, row in enumerate(rows):
            before = LINK_COLORS[max(joint, 0) % len(LINK_COLORS)]
            joint += row.joint
            after = LINK_COLORS[max(joint, 0) % len(LINK_COLORS)]
            self._draw_row(i, row, before, after, shorten=self._finger_room(i))
        floor = self._robot.floor_z
        self._add("base", drum(self._reach * _BASE_RADIUS, self._reach * _BASE_HEIGHT,
                               (0, 0, floor + 0.5 * self._reach * _BASE_HEIGHT)), _JOINT_COLOR)  # fmt: skip

    def _finger_room(self, row: int) -> float:
        """How much shorter the last tube is drawn, so that the fingers end at the tool point."""
        last = row == len(self._robot.chain.rows) - 1
        return self._reach * _FINGER[2] if last and self._robot.gripper is not None else 0.0

    def _draw_row(self, i: int, row: DHRow, before: Color, after: Color, shorten: float) -> None:
        """Modified rows go along a on the frame before and along d on their own; standard ones vice versa."""
        d = math.copysign(max(0.0, abs(row.d_m) - shorten), row.d_m)
        if self._robot.chain.convention == "modified":
            self._draw_tube(i, f"a{i}", (0, 0, 0), (row.a_m, 0, 0), before)
            self._draw_tube(i + 1, f"d{i}", (0, 0, -row.d_m), (0, 0, d - row.d_m), after)
            axis = i + 1
        else:
            self._draw_tube(i, f"d{i}", (0, 0, 0), (0, 0, d), before)
            self._draw_tube(i + 1, f"a{i}", (-row.a_m, 0, 0), (0, 0, 0), after)
            axis = i
        if row.joint:
            solid = drum(self._reach * _DRUM_RADIUS, self._reach * _DRUM_HEIGHT)
            self._add(f"f{axis}/j{i}", solid, _JOINT_COLOR)

    def _draw_tube(self, frame: int, name: str, start: Point, end: Point, color: Color) -> None:
        radius = self._reach * _TUBE_RADIUS
        if math.dist(start, end) > 0.25 * radius:
            self._add(f"f{frame}/{name}", tube(start, end, radius), color)

    def _draw_gripper(self) -> tuple[viser.FrameHandle, ...]:
        """A palm and two fingers along the tool's z axis, ending at the tool point."""
        if self._robot.gripper is None:
            return ()
        tool = f"f{len(self._robot.chain.rows)}"
        width, thickness, length = (self._reach * size for size in _FINGER)
        palm = (self._reach * _PALM[0], self._reach * _PALM[1], self._reach * _PALM[2])
        self._add(f"{tool}/palm", block(palm, (0, 0, -length - 0.5 * palm[2])), _TOOL_COLOR)
        fingers: list[viser.FrameHandle] = []
        for side in ("left", "right"):
            fingers.append(self._scene.add_frame(f"{self._name}/{tool}/{side}", show_axes=False))
            finger = block((width, thickness, length), (0, 0, -0.5 * length))
            self._add(f"{tool}/{side}/finger", finger, _TOOL_COLOR)
        return tuple(fingers)

    def _add(self, name: str, solid: Solid, color: Color) -> None:
        self._scene.add_mesh_simple(
            f"{self._name}/{name}", solid.vertices, solid.faces, color=self._color or color,
            opacity=self._opacity, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

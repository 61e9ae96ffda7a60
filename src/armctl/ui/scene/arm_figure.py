"""An arm drawn from its DH rows: a bar along each a and d, a drum on each joint axis, gripper or tip."""

from __future__ import annotations

import math

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.kinematics import DHRow, quaternion_wxyz
from armctl.robot import Robot
from armctl.robot.look import Color
from armctl.ui.scene.placing import send_pose
from armctl.ui.scene.proportions import reach
from armctl.ui.scene.shapes import Point, Solid, beam, block, drum, spike, tube

FloatArray = NDArray[np.float64]
_TOOL_COLOR: Color = (90, 90, 95)
# Proportions of joints and tip, as multiples of the links' width ...
_DRUM_RADIUS, _DRUM_HEIGHT = {"round": 0.65, "square": 0.74}, 1.27
_TIP_RADIUS, _TIP_LENGTH = 0.4, 1.6
# ... and of the gripper, as fractions of the arm's reach.
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
        """Draw the arm as it looks; ``color`` and ``opacity`` replace its own."""
        self._robot, self._scene, self._name = robot, scene, name
        self._color, self._opacity = color, opacity
        self._reach = reach(robot)
        self._width = robot.look.width * self._reach
        self._root = scene.add_frame(name, show_axes=False, visible=visible)
        self._frames = [
            scene.add_frame(f"{name}/f{i}", show_axes=False) for i in range(len(robot.chain.rows) + 1)
        ]
        self._shown: FloatArray | None = None
        for frame in self._frames:
            send_pose(frame)
        self._draw_links()
        self._fingers: tuple[viser.FrameHandle, ...] = ()
        if robot.gripper is None:
            self._draw_tip()
        else:
            self._fingers = self._draw_gripper()

    @property
    def visible(self) -> bool:
        """Whether the arm is shown."""
        return self._root.visible

    @visible.setter
    def visible(self, visible: bool) -> None:
        if self._root.visible != visible:
            self._root.visible = visible

    def remove(self) -> None:
        """Take the drawing out of the scene."""
        self._root.remove()

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
        rows, colors = self._robot.chain.rows, self._robot.look.links
        joint = -1
        for i, row in enumerate(rows):
            before = colors[max(joint, 0) % len(colors)]
            joint += row.joint
            after = colors[max(joint, 0) % len(colors)]
            shorten = self._tool_length() if i == len(rows) - 1 else 0.0
            self._draw_row(i, row, before, after, shorten)

    def _tool_length(self) -> float:
        """How much shorter the last bar is drawn, so that the fingers or the tip end at the tool point."""
        if self._robot.gripper is not None:
            return self._reach * _FINGER[2]
        return self._width * _TIP_LENGTH

    def _draw_row(self, i: int, row: DHRow, before: Color, after: Color, shorten: float) -> None:
        """Modified rows go along a on the frame before and along d on their own; standard ones vice versa."""
        d = math.copysign(max(0.0, abs(row.d_m) - shorten), row.d_m)
        if self._robot.chain.convention == "modified":
            self._draw_bar(i, f"a{i}", (0, 0, 0), (row.a_m, 0, 0), before)
            self._draw_bar(i + 1, f"d{i}", (0, 0, -row.d_m), (0, 0, d - row.d_m), after)
            axis = i + 1
        else:
            self._draw_bar(i, f"d{i}", (0, 0, 0), (0, 0, d), before)
            self._draw_bar(i + 1, f"a{i}", (-row.a_m, 0, 0), (0, 0, 0), after)
            axis = i
        if row.joint:
            radius = self._width * _DRUM_RADIUS[self._robot.look.shape]
            solid = drum(radius, self._width * _DRUM_HEIGHT)
            self._add(f"f{axis}/j{i}", solid, self._robot.look.joints)

    def _draw_bar(self, frame: int, name: str, start: Point, end: Point, color: Color) -> None:
        if math.dist(start, end) > 0.125 * self._width:
            bar = beam if self._robot.look.shape == "square" else tube
            self._add(f"f{frame}/{name}", bar(start, end, self._width), color)

    def _draw_tip(self) -> None:
        """A cone along the tool's z axis, its point in the tool point."""
        solid = spike(self._width * _TIP_RADIUS, self._width * _TIP_LENGTH)
        self._add(f"f{len(self._robot.chain.rows)}/tip", solid, _TOOL_COLOR)

    def _draw_gripper(self) -> tuple[viser.FrameHandle, ...]:
        """A palm and two fingers along the tool's z axis, ending at the tool point."""
        tool = f"f{len(self._robot.chain.rows)}"
        width, thickness, length = (self._reach * size for size in _FINGER)
        palm = (self._reach * _PALM[0], self._reach * _PALM[1], self._reach * _PALM[2])
        self._add(f"{tool}/palm", block(palm, (0, 0, -length - 0.5 * palm[2])), _TOOL_COLOR)
        fingers: list[viser.FrameHandle] = []
        for side in ("left", "right"):
            fingers.append(self._scene.add_frame(f"{self._name}/{tool}/{side}", show_axes=False))
            send_pose(fingers[-1])
            finger = block((width, thickness, length), (0, 0, -0.5 * length))
            self._add(f"{tool}/{side}/finger", finger, _TOOL_COLOR)
        return tuple(fingers)

    def _add(self, name: str, solid: Solid, color: Color) -> None:
        self._scene.add_mesh_simple(
            f"{self._name}/{name}", solid.vertices, solid.faces, color=self._color or color,
            opacity=self._opacity, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip

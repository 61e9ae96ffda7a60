"""An arm drawn from its DH rows: a bar along each a and d, a drum on each joint axis, gripper or tip."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import FloatArray
from armctl.kinematics import quaternion_wxyz
from armctl.robot import Robot
from armctl.robot.parts import Color
from armctl.robot.shape import (
    FINGER,
    GAP_CLOSED,
    GAP_OPEN,
    PALM,
    TIP_LENGTH,
    TIP_RADIUS,
    Point,
    bars,
    reach,
    tool_length,
    width,
)

# Meshes of simple solids, as vertices (v, 3) [m] and faces (f, 3), each counter-clockwise from outside.


@dataclass(frozen=True, slots=True)
class Solid:
    """One mesh."""

    vertices: FloatArray
    faces: NDArray[np.int64]


def tube(start: Point, end: Point, width: float) -> Solid:
    """A round-ended tube between two points that are apart."""
    radius, half = 0.5 * width, 0.5 * math.dist(start, end)
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 14)
    height = radius * np.sin(latitude) + np.copysign(half, latitude)
    return _placed(_revolved(radius * np.cos(latitude), height, 20), start, end)


def beam(start: Point, end: Point, width: float) -> Solid:
    """A square beam between two points that are apart, half its width longer at both ends, for corners."""
    return _placed(block((width, width, math.dist(start, end) + width)), start, end)


def drum(radius: float, height: float, centre: Point = (0, 0, 0)) -> Solid:
    """A cylinder about z."""
    solid = _revolved((0, radius, radius, 0), (-0.5 * height, -0.5 * height, 0.5 * height, 0.5 * height), 36)
    return Solid(solid.vertices + centre, solid.faces)


def spike(radius: float, length: float) -> Solid:
    """A cone about z with its tip in the origin, pointing along z."""
    return _revolved((0, radius, 0), (-length, -length, 0), 36)


def block(size: Point, centre: Point = (0, 0, 0)) -> Solid:
    """A box along the axes."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    sides = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = [face for a, b, c, d in sides for face in ((a, b, c), (a, c, d))]
    return Solid(corners * size + centre, np.array(faces, dtype=np.int64))


def _revolved(radius: ArrayLike, height: ArrayLike, sections: int) -> Solid:
    """A profile turned about z: ``radius``, ``height`` (k,) [m] upwards, the first and last on the axis."""
    r, z = np.asarray(radius, dtype=np.float64)[1:-1], np.asarray(height, dtype=np.float64)
    angle = np.arange(sections) * (2 * np.pi / sections)
    rings = np.empty((len(r), sections, 3))
    rings[..., 0] = r[:, None] * np.cos(angle)
    rings[..., 1] = r[:, None] * np.sin(angle)
    rings[..., 2] = z[1:-1, None]
    vertices = np.vstack([rings.reshape(-1, 3), [(0, 0, z[0]), (0, 0, z[-1])]])
    here = np.arange(rings[..., 0].size).reshape(rings.shape[:2])
    after = np.roll(here, -1, axis=1)
    bottom, top = np.full(sections, here.size), np.full(sections, here.size + 1)
    triangles = [
        (bottom, after[0], here[0]),
        (here[:-1], after[:-1], after[1:]),
        (here[:-1], after[1:], here[1:]),
        (here[-1], after[-1], top),
    ]
    return Solid(vertices, np.vstack([np.stack(one, axis=-1).reshape(-1, 3) for one in triangles]))


def _placed(solid: Solid, start: Point, end: Point) -> Solid:
    """A solid about the origin along z, put half way between two points, along the line between them."""
    span = np.array(end) - np.array(start)
    along = span / np.linalg.norm(span)
    aside = np.cross(np.eye(3)[np.abs(along).argmin()], along)
    aside /= np.linalg.norm(aside)
    rotation = np.column_stack([aside, np.cross(along, aside), along])
    return Solid(solid.vertices @ rotation.T + np.array(start) + 0.5 * span, solid.faces)


# The figure.


def send_pose(node: viser.SceneNodeHandle) -> None:
    """Send a new node's pose even where it is the default: a page keeps that of an older node of its name."""
    position, wxyz = node.position.copy(), node.wxyz.copy()
    node.position, node.wxyz = position + 1.0, np.roll(wxyz, 1)
    node.position, node.wxyz = position, wxyz


def add_solid(
    scene: viser.SceneApi, name: str, solid: Solid, color: Color, opacity: float | None = None
) -> None:
    """Draw a solid without shadows."""
    scene.add_mesh_simple(
        name,
        solid.vertices,
        solid.faces,
        color=color,
        opacity=opacity,
        cast_shadow=False,
        receive_shadow=False,
    )


_TOOL_COLOR: Color = (90, 90, 95)
# Proportions of the joints, as multiples of the links' width.
_DRUM_RADIUS, _DRUM_HEIGHT = {"round": 0.65, "square": 0.74}, 1.27


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
        visible: bool = True,
    ) -> None:
        """Draw the arm as it looks; ``color`` and ``opacity`` replace its own."""
        self._robot, self._scene, self._name = robot, scene, name
        self._color, self._opacity = color, opacity
        self._tool = f"f{len(robot.chain.places) - 1}"
        self._reach = reach(robot.chain)
        self._width = width(robot.chain, robot.look)
        self.root = scene.add_frame(name, show_axes=False, visible=visible)
        self._frames = [
            scene.add_frame(f"{name}/f{i}", show_axes=False) for i in range(len(robot.chain.places))
        ]
        self._asked: tuple[bytes, float | None] | None = None
        self._shown: FloatArray | None = None
        for frame in self._frames:
            send_pose(frame)
        self._draw_links()
        self._label: viser.LabelHandle | None = None
        self._fingers: tuple[viser.FrameHandle, ...] = ()
        if robot.gripper is None:  # a cone along the tool's z axis, its point in the tool point
            tip = spike(self._width * TIP_RADIUS, self._width * TIP_LENGTH)
            self._add(f"{self._tool}/tip", tip, _TOOL_COLOR)
        else:
            self._fingers = self._draw_gripper()

    def pose(self, q: FloatArray, opening: float | None = None) -> None:
        """Move the figure to joint angles ``q`` (n,) [rad] and a gripper opening 0..1 (None: as it is)."""
        asked = (q.tobytes(), opening)
        if asked == self._asked:  # it stands, thirty times a second
            return
        self._asked = asked
        frames = self._robot.frames(q)
        for i, handle in enumerate(self._frames):
            if self._shown is None or not np.array_equal(self._shown[i], frames[i]):
                handle.position = frames[i, :3, 3]
                handle.wxyz = quaternion_wxyz(frames[i, :3, :3])
        self._shown = frames
        if self._fingers and opening is not None:
            gap = self._reach * (GAP_CLOSED + (GAP_OPEN - GAP_CLOSED) * opening)
            for side, finger in zip((1, -1), self._fingers, strict=True):
                finger.position = (0.0, side * gap, 0.0)

    def say(self, words: str | None) -> None:
        """Write words at the tool point; None: nothing."""
        if words is not None and (self._label is None or self._label.text != words):
            self.say(None)
            self._label = self._scene.add_label(f"{self._name}/{self._tool}/words", words)
            send_pose(self._label)
        elif words is None and self._label is not None:
            self._label.remove()
            self._label = None

    def _draw_links(self) -> None:
        chain, look = self._robot.chain, self._robot.look
        solid = beam if look.shape == "square" else tube
        shorten = tool_length(chain, look, gripper=self._robot.gripper is not None)
        for bar in bars(chain, shorten):
            if bar.length > 0.125 * self._width:
                color = look.links[max(bar.link, 0) % len(look.links)]
                self._add(f"f{bar.frame}/{bar.name}", solid(bar.start, bar.end, self._width), color)
        axis = 0 if chain.convention == "standard" else 1  # the frame whose z a joint turns about
        for i in chain.joint_rows:
            joint = drum(self._width * _DRUM_RADIUS[look.shape], self._width * _DRUM_HEIGHT)
            self._add(f"f{i + axis}/j{i}", joint, look.joints)

    def _draw_gripper(self) -> tuple[viser.FrameHandle, ...]:
        """A palm and two fingers along the tool's z axis, ending at the tool point."""
        across, thickness, length = (self._reach * size for size in FINGER)
        palm = (self._reach * PALM[0], self._reach * PALM[1], self._reach * PALM[2])
        self._add(f"{self._tool}/palm", block(palm, (0, 0, -length - 0.5 * palm[2])), _TOOL_COLOR)
        fingers: list[viser.FrameHandle] = []
        for side in ("left", "right"):
            fingers.append(self._scene.add_frame(f"{self._name}/{self._tool}/{side}", show_axes=False))
            send_pose(fingers[-1])
            finger = block((across, thickness, length), (0, 0, -0.5 * length))
            self._add(f"{self._tool}/{side}/finger", finger, _TOOL_COLOR)
        return tuple(fingers)

    def _add(self, name: str, solid: Solid, color: Color) -> None:
        add_solid(self._scene, f"{self._name}/{name}", solid, self._color or color, self._opacity)

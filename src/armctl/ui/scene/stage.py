"""What the arm stands on, and the names in the scene."""

from __future__ import annotations

import math

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.kinematics import quaternion_wxyz
from armctl.robot import Robot
from armctl.robot.solids import Point, Solid, beam, block, drum, tube
from armctl.ui.scene.arm_model import add_solid, send_pose

# Proportions, as fractions of the arm's reach.
_PLATE_WIDTH, _PLATE_HEIGHT = 0.28, 0.02
_BASE_AXES = 0.26
"""they reach beyond the plate and out of the column"""
_AXIS_WIDTH = 0.01
_AXES = {"x": (224, 49, 49), "y": (64, 160, 43)}
_OBSTACLE = (201, 42, 42)
_COLUMN_WIDTH, _COLUMN_BEHIND = 0.11, 0.24
_HIGH = 0.3
"""a base frame this far above the floor lets the arm hang below it: the column goes behind"""
_ABOVE_BASE = 0.02
"""a tool nearer to the base axis than this is to no side of it"""
_LIGHT_GRID = (205, 210, 216), (150, 158, 166)
_DARK_GRID = (48, 52, 58), (72, 78, 86)
_SHADOW = 0.25
"""how dark the arm's shadow on the floor is, where it has one"""
_FLOOR_M, _FLOOR_STEP_M = 1.0, 0.5
"""the floor is so large at least; a longer arm stands on one that is larger by whole sections"""


def front(robot: Robot) -> FloatArray:
    """The horizontal direction (2,) from the base axis to the tool in the home pose, of length 1."""
    tool = robot.forward(robot.pose("home"))[:2, 3]
    distance = float(np.linalg.norm(tool))
    return np.array([1.0, 0.0]) if distance < _ABOVE_BASE * robot.chain.length else tool / distance


def stand_parts(robot: Robot) -> dict[str, Solid]:
    """The stand in the base frame; behind the base under an arm so high that it may hang straight down.

    None where the look of the arm shows what it stands on.
    """
    if robot.look.rows or (
        not robot.shapes and any(piece.body and max(piece.mount.links) < 0 for piece in robot.pieces)
    ):
        return {}
    size, floor, square = robot.chain.length, robot.floor_z, robot.look.shape == "square"
    link = beam if square else tube
    foot: Point = (0.0, 0.0, floor)
    parts: dict[str, Solid] = {}
    if -floor > _HIGH * size:
        x, y = (-_COLUMN_BEHIND * size * front(robot)).tolist()
        width = _COLUMN_WIDTH * size
        foot = (x, y, floor)
        parts["column"] = link((x, y, floor + width / 2), (x, y, 0.0), width)
        parts["bracket"] = link((x, y, 0.0), (0.0, 0.0, 0.0), robot.look.width * size)
    elif -floor > _PLATE_HEIGHT * size:
        parts["column"] = link(foot, (0.0, 0.0, 0.0), robot.look.width * size)
    height, width = _PLATE_HEIGHT * size, _PLATE_WIDTH * size
    middle: Point = (foot[0], foot[1], floor + height / 2)
    parts["plate"] = block((width, width, height), middle) if square else drum(width / 2, height, middle)
    return parts


def set_lights(scene: viser.SceneApi) -> None:
    """Directions and lights that software rendering can afford; the same for every arm."""
    # Shadows are for a page with a graphics card; the environment map is a freeze of seconds without one.
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_environment_map(hdri=None)
    scene.set_up_direction("+z")
    scene.add_light_hemisphere("/lights/sky", intensity=2.0)
    scene.world_axes.visible = False


def add_floor(scene: viser.SceneApi, robot: Robot, *, dark: bool = False) -> viser.GridHandle:
    """A floor with 50 mm cells, in the colours of a theme; a page's own one hides that of all pages."""
    cell, section = _DARK_GRID if dark else _LIGHT_GRID
    size = floor_size(robot)
    floor = scene.add_grid(
        "/floor", size, size, plane="xy", cell_size=0.05, section_size=0.25, cell_color=cell,
        section_color=section, shadow_opacity=_SHADOW, position=(0.0, 0.0, robot.floor_z),
    )  # fmt: skip
    send_pose(floor)
    return floor


class Stage:
    """Floor with 50 mm cells, stand and base axes of one arm, and the obstacles that its file names."""

    def __init__(self, scene: viser.SceneApi, robot: Robot) -> None:
        size = robot.chain.length
        stand = scene.add_frame("/stand", show_axes=False)
        axes = scene.add_frame("/base_axes", show_axes=False)
        self._parts = add_floor(scene, robot), axes, stand
        for i, (axis, color) in enumerate(_AXES.items()):  # z would be seen between the arm's parts
            length = np.where(np.arange(3) == i, _BASE_AXES, _AXIS_WIDTH) * size
            middle = np.where(np.arange(3) == i, 0.5 * length, 0.0)
            bar = block(tuple(length.tolist()), tuple(middle.tolist()))
            add_solid(scene, f"/base_axes/{axis}", bar, color, flat=True)
        for part, solid in stand_parts(robot).items():
            add_solid(scene, f"/stand/{part}", solid, robot.look.joints)
        for i, one in enumerate(robot.obstacles):
            middle = 0.5 * (one.low + one.high)
            box = scene.add_box(
                f"/stand/obstacle{i}", _OBSTACLE, tuple((one.high - one.low).tolist()), opacity=0.5,
                position=middle,
            )  # fmt: skip
            send_pose(box)
            scene.add_label(f"/stand/obstacle{i}/title", one.title)
        for part in self._parts:
            send_pose(part)

    def remove(self) -> None:
        """Take it out of the scene."""
        for part in self._parts:
            part.remove()


def floor_size(robot: Robot) -> float:
    """The side of a floor that the arm does not reach beyond [m]."""
    return max(_FLOOR_M, _FLOOR_STEP_M * math.ceil(2 * robot.chain.length / _FLOOR_STEP_M))


class Marks:
    """The joints' names, and the base and tool frames with theirs, in one page's view."""

    def __init__(self, scene: viser.SceneApi, robot: Robot) -> None:
        self._scene, self._robot = scene, robot
        self._names: list[viser.LabelHandle] = []
        self._frames: list[viser.FrameHandle | viser.LabelHandle] = []
        self._shown: FloatArray | None = None
        # the frame whose z a joint turns about
        after = 0 if robot.chain.convention == "standard" else 1
        self._places = [row + after for row in robot.chain.joint_rows]

    def show(self, q: FloatArray, *, names: bool, frames: bool) -> None:
        """Show them for the arm at ``q`` (n,) [rad], or not."""
        if names != bool(self._names) or frames != bool(self._frames):
            for node in (*self._names, *self._frames):
                node.remove()
            self._names, self._frames, self._shown = [], [], None
            if names:
                titles = enumerate(joint.title for joint in self._robot.joints)
                self._names = [self._scene.add_label(f"/marks/joint{i}", title) for i, title in titles]
            if frames:
                self._frames = self._add_frames()
        if not (names or frames) or (self._shown is not None and np.array_equal(q, self._shown)):
            return
        self._shown = q.copy()
        poses = self._robot.frames(q)
        for label, place in zip(self._names, self._places, strict=False):
            label.position = poses[place, :3, 3]
        for node in self._frames[:2]:
            node.position, node.wxyz = poses[-1, :3, 3], quaternion_wxyz(poses[-1, :3, :3])

    def _add_frames(self) -> list[viser.FrameHandle | viser.LabelHandle]:
        size, scene = self._robot.chain.length, self._scene
        thick = 0.5 * _AXIS_WIDTH * size
        axes = scene.add_frame("/marks/tool", axes_length=0.15 * size, axes_radius=thick)
        tool = scene.add_label("/marks/tool_name", "tool frame")
        base = scene.add_frame("/marks/base", axes_length=_BASE_AXES * size, axes_radius=thick)
        send_pose(base)
        at = (1.1 * _BASE_AXES * size, 0.0, 0.0)
        return [axes, tool, base, scene.add_label("/marks/base_name", "base frame: x", position=at)]

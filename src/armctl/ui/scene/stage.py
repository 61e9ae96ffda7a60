"""What the arm stands on, and from where it is first seen."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.kinematics import quaternion_wxyz
from armctl.robot import Robot
from armctl.robot.solids import Point, Solid, beam, block, drum, tube
from armctl.ui.scene.arm_model import add_solid, arm_model, send_pose

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
_IN_FRONT, _BESIDE, _ABOVE = 0.62, 0.72, 0.32
"""the direction from the arm to the camera"""
_STRETCHED = 0.75
"""of the reach, to each side: the arm fills the picture, and mostly stays in it"""
_FILLED = 0.95
"""of the picture, by the arm and how far it reaches"""
_SHEET = 0.6
"""of the picture of a phone, covered by the panels"""
_SMALL = 0.6
"""of an arm's reach, that of another one beside it"""
_LEAST_ASPECT = 0.5
"""where the panels leave the scene a narrower strip, the arm may go beyond it"""


def front(robot: Robot) -> FloatArray:
    """The horizontal direction (2,) from the base axis to the tool in the home pose, of length 1."""
    tool = robot.forward(robot.pose("home"))[:2, 3]
    distance = float(np.linalg.norm(tool))
    return np.array([1.0, 0.0]) if distance < _ABOVE_BASE * robot.chain.length else tool / distance


def framed(
    points: FloatArray, away: FloatArray, fov: float, aspect: float, filled: float
) -> tuple[FloatArray, FloatArray]:
    """Where a camera stands, and the middle of its picture (3,) [m], with points (k, 3) [m] in view; z is up.

    ``away`` (3,): the direction to it, not along z; ``fov`` [rad] upright; ``aspect`` width by height;
    ``filled``: the part of the shorter of them that the points may take (0 … 1).
    """
    back = away / np.linalg.norm(away)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(back, right), back])  # to the right, up, towards the camera
    seen = points @ axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    x, y, nearer = (seen - middle).T
    high = filled * math.tan(0.5 * fov)
    distance = float((nearer + np.maximum(np.abs(x) / (high * aspect), np.abs(y) / high)).max())
    centre: FloatArray = middle @ axes
    return centre + distance * back, centre


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


VIEWS: dict[str, tuple[float, float, float]] = {
    "Reset": (_IN_FRONT, _BESIDE, _ABOVE),
    "Front": (1.0, 0.0, 0.12),
    "Side": (0.0, 1.0, 0.12),
    "Top": (0.02, 0.0, 1.0),
}
"""the directions to the camera: ahead of the home pose, to its right, up"""


def look_at_arm(
    client: viser.ClientHandle,
    robot: Robot,
    view: str = "Reset",
    *,
    beside: tuple[Robot, float] | None = None,
    shown: Sequence[FloatArray] = (),
    picture: tuple[int, int] | None = None,
    sheet: bool = False,
) -> None:
    """See the arm by one of ``VIEWS``; ``picture``: width and height that will be free; None: as they are.

    ``beside``: another arm that is seen, too, and how far along y it stands [m]; one that is much smaller is
    seen alone, or nothing could be made out of it, as on a phone. ``shown``: configurations
    (n,) [rad] of the arm, or of ghosts, that are not to be outside of the picture.
    ``sheet``: the panels lie over the lower part of the picture, so the arm is seen in the upper one.
    """
    camera = client.camera
    width, height = (camera.image_width, camera.image_height) if picture is None else picture
    free = 1.0 - _SHEET if sheet else 1.0
    aspect = max(width / (free * height), _LEAST_ASPECT)
    high = math.tan(0.5 * camera.fov)
    fov = 2 * math.atan(free * high)
    points = in_view(robot, shown)
    if beside is not None:
        other, aside = beside
        others = in_view(other) + np.array([0.0, aside, 0.0])
        small = other.chain.length < _SMALL * robot.chain.length
        points = others if small or sheet else np.vstack([points, others])
    position, middle = first_view(robot, points, fov, aspect, view)
    away = position - middle
    right = np.cross([0.0, 0.0, 1.0], away)
    down = (1.0 - free) * high * np.cross(right, away) / np.linalg.norm(right)
    camera.up_direction = np.array([0.0, 0.0, 1.0])
    camera.position, camera.look_at = position + down, middle + down


def in_picture(camera: viser.CameraHandle, robot: Robot, q: FloatArray, *, sheet: bool) -> bool:
    """Whether all joints and the tool at ``q`` (n,) [rad] are in view; ``sheet`` as in ``look_at_arm``."""
    points = np.vstack([robot.frames(q)[..., :3, 3].reshape(-1, 3), robot.forward(q)[:3, 3]])
    away = np.asarray(camera.position) - np.asarray(camera.look_at)
    right = np.cross([0.0, 0.0, 1.0], away)
    length = float(np.linalg.norm(right))
    if length == 0.0 or not camera.image_height:  # straight from above, or nobody has told yet
        return True
    back, right = away / np.linalg.norm(away), right / length
    axes = np.stack([right, np.cross(back, right), back])
    x, y, nearer = axes @ (points - np.asarray(camera.position)).T
    high = -nearer * math.tan(0.5 * camera.fov)
    wide = high * camera.image_width / camera.image_height
    low = 2 * _SHEET - 1 if sheet else -1.0
    return bool(((np.abs(x) <= wide) & (y <= high) & (y >= low * high)).all())


def first_view(
    robot: Robot, points: FloatArray, fov: float, aspect: float, view: str = "Reset"
) -> tuple[FloatArray, FloatArray]:
    """Where the camera stands by one of ``VIEWS``, and what it looks at (3,) [m]; as ``framed``."""
    return framed(points, towards_camera(robot, view), fov, aspect, _FILLED)


def towards_camera(robot: Robot, view: str = "Reset") -> FloatArray:
    """The direction (3,) from the arm to the camera in one of ``VIEWS``; of no length in particular."""
    ahead = front(robot)
    side = np.array([ahead[1], -ahead[0]])
    forward, beside, above = VIEWS[view]
    return np.array([*(forward * ahead + beside * side), above])


def in_view(robot: Robot, shown: Sequence[FloatArray] = ()) -> FloatArray:
    """Home and rest poses, the foot, and the arm stretched ahead, to both sides and upwards (k, 3) [m].

    ``shown``: other configurations (n,) [rad].
    """
    size, ahead = robot.chain.length, front(robot)
    shoulder = float(robot.chain.axes()[0][:2, 2][-1])
    level = size - abs(shoulder)  # the column below the shoulder reaches nowhere
    side = np.array([-ahead[1], ahead[0]])
    poses = arm_model(robot).bounds(np.stack([robot.pose("home"), robot.pose("rest"), *shown]))
    level *= _STRETCHED
    stretched = [[*(level * way), shoulder] for way in (ahead, side, -side)]
    return np.vstack([poses, stretched, [[0.0, 0.0, robot.floor_z], [0.0, 0.0, shoulder + level]]])


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

"""What holds an arm up: a plate on the floor, and a column where the base frame is high above it."""

from __future__ import annotations

import viser

from armctl.robot import Robot
from armctl.ui.scene.proportions import front, reach
from armctl.ui.scene.shapes import Point, Solid, beam, block, drum, tube

# Proportions, as fractions of the arm's reach.
_PLATE_WIDTH, _PLATE_HEIGHT = 0.28, 0.02
_COLUMN_WIDTH, _COLUMN_BEHIND = 0.11, 0.24
_HIGH = 0.3
"""A base frame this far above the floor lets the arm hang below it: the column goes behind."""


def draw_stand(scene: viser.SceneApi, robot: Robot, name: str = "/stand") -> viser.FrameHandle:
    """Draw the stand; removing the frame that is returned removes all of it."""
    root = scene.add_frame(name, show_axes=False)
    for part, solid in stand_parts(robot).items():
        scene.add_mesh_simple(
            f"{name}/{part}", solid.vertices, solid.faces, color=robot.look.joints,
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
    return root


def stand_parts(robot: Robot) -> dict[str, Solid]:
    """The parts of the stand, in the base frame.

    An arm whose base frame is high above the floor may hang straight down, so its column stands behind the
    base, seen from where the tool is at home, and a bracket reaches forward to it.
    """
    size, floor, square = reach(robot), robot.floor_z, robot.look.shape == "square"
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

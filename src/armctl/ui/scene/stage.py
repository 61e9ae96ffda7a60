"""What the arm stands on, and from where it is first seen."""

from __future__ import annotations

import numpy as np
import viser

from armctl.robot import Robot
from armctl.ui.scene.placing import send_pose
from armctl.ui.scene.proportions import front, reach, top
from armctl.ui.scene.stand import draw_stand

_TARGET_COLOR = (214, 51, 108)
_FLOOR_M = 1.6
# The camera: how far ahead of the base it looks and how far away it is, in reaches.
_AHEAD, _DISTANCE = 0.25, 1.3
_ROOM_ABOVE = 0.35
"""How far above the base frame there is room at least, for an arm that hangs down may be lifted."""


def set_lights(scene: viser.SceneApi) -> None:
    """Directions and lights that software rendering can afford; the same for every arm."""
    # Shadows cost two thirds of the frame rate on software WebGL, the environment map a freeze of seconds.
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_environment_map(hdri=None)
    scene.set_up_direction("+z")
    scene.add_light_hemisphere("/lights/sky", intensity=2.0)
    scene.world_axes.visible = False


class Stage:
    """Floor with 50 mm cells, stand and base axes of one arm."""

    def __init__(self, scene: viser.SceneApi, robot: Robot) -> None:
        size = reach(robot)
        self._parts = (
            scene.add_grid(
                "/floor", _FLOOR_M, _FLOOR_M, plane="xy", cell_size=0.05, section_size=0.25,
                cell_color=(205, 210, 216), section_color=(150, 158, 166), shadow_opacity=0.0,
                position=(0.0, 0.0, robot.floor_z),
            ),
            scene.add_frame(
                "/base_axes", axes_length=0.16 * size, axes_radius=0.005 * size, origin_radius=0.008 * size
            ),
            draw_stand(scene, robot),
        )  # fmt: skip
        for part in self._parts:
            send_pose(part)

    def remove(self) -> None:
        """Take it out of the scene."""
        for part in self._parts:
            part.remove()


def look_at_arm(client: viser.ClientHandle, robot: Robot) -> None:
    """Put a page's camera where the whole arm is in view, from the front and the right of its home pose."""
    size, forward = reach(robot), front(robot)
    highest = max(top(robot), _ROOM_ABOVE * size)
    centre = np.array([*(_AHEAD * size * forward), 0.5 * (robot.floor_z + highest)])
    height = highest - robot.floor_z
    side = np.array([forward[1], -forward[0]])
    away = np.array([*(0.62 * forward + 0.72 * side), 0.32])
    client.camera.up_direction = np.array([0.0, 0.0, 1.0])
    client.camera.position = centre + _DISTANCE * max(size, height) * away
    client.camera.look_at = centre


class TargetMark:
    """A small ball where a target was asked for."""

    def __init__(self, scene: viser.SceneApi, name: str = "/target") -> None:
        self._ball = scene.add_icosphere(name, 0.006, color=_TARGET_COLOR, visible=False)

    def show(self, position_m: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
        """Show the target at a point (3,) [m]."""
        self._ball.position = position_m
        self._ball.visible = True

    def hide(self) -> None:
        """Show none."""
        self._ball.visible = False

"""What the arm stands on, and from where it is first seen."""

from __future__ import annotations

import numpy as np
import viser

from armctl.robot import Robot

_TARGET_COLOR = (214, 51, 108)


def set_stage(scene: viser.SceneApi, robot: Robot) -> None:
    """Floor with 50 mm cells, base axes, and lights that software rendering can afford."""
    # Shadows cost two thirds of the frame rate on software WebGL, the environment map a freeze of seconds.
    scene.configure_default_lights(cast_shadow=False)
    scene.configure_environment_map(hdri=None)
    scene.set_up_direction("+z")
    scene.add_light_hemisphere("/lights/sky", intensity=2.0)
    scene.world_axes.visible = False
    scene.add_grid(
        "/floor", 1.6, 1.6, plane="xy", cell_size=0.05, section_size=0.25, cell_color=(205, 210, 216),
        section_color=(150, 158, 166), shadow_opacity=0.0, position=(0.0, 0.0, robot.floor_z),
    )  # fmt: skip
    scene.add_frame("/base_axes", axes_length=0.08, axes_radius=0.0025, origin_radius=0.004)


def look_at_arm(client: viser.ClientHandle) -> None:
    """Put a page's camera where the whole arm is in view, left of the docked panel."""
    client.camera.up_direction = np.array([0.0, 0.0, 1.0])
    client.camera.position = np.array([0.58, -0.54, 0.40])
    client.camera.look_at = np.array([0.12, 0.0, 0.16])


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

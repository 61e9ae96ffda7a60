"""A translucent arm in one page's view: where the arm would stand."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.robot import Robot
from armctl.ui.scene.arm_figure import ArmFigure

FloatArray = NDArray[np.float64]


class Ghost:
    """Shows a configuration; built when it is first needed."""

    def __init__(self, scene: viser.SceneApi, robot: Robot) -> None:
        self._scene, self._robot = scene, robot
        self._figure: ArmFigure | None = None

    def show(self, q: FloatArray) -> None:
        """Show the arm at ``q`` (n,) [rad]."""
        if self._figure is None:
            self._figure = ArmFigure(self._scene, self._robot, "/ghost", color=(0, 180, 216), opacity=0.35)
        self._figure.pose(q)
        self._figure.visible = True

    def hide(self) -> None:
        """Show nothing."""
        if self._figure is not None:
            self._figure.visible = False

"""A translucent arm in one page's view: where the arm would stand."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.robot import Robot
from armctl.ui.scene.arm_figure import ArmFigure

FloatArray = NDArray[np.float64]
_COLOR, _OPACITY = (0, 180, 216), 0.35
_SWELL = 1.08
"""How much thicker than the arm its ghost is: where both stand in one place, equal surfaces would flicker."""


class Ghost:
    """Shows one configuration; built when it is first needed.

    A page has one ghost, and all its screens use it: it belongs to whoever has shown something last.
    """

    def __init__(self, scene: viser.SceneApi, robot: Robot) -> None:
        self._scene, self._robot = scene, robot
        self._figure: ArmFigure | None = None
        self._owner: object = None
        self._lost: Callable[[], None] | None = None

    def claim(self, owner: object, lost: Callable[[], None] | None = None) -> None:
        """The view of what might be is ``owner``'s from now on; who had it before is told, once."""
        if owner is self._owner:
            return
        before, self._owner, self._lost = self._lost, owner, lost
        if self._figure is not None:
            self._figure.visible = False
        if before is not None:
            before()

    def show(self, q: FloatArray, owner: object = None) -> None:
        """Show the arm at ``q`` (n,) [rad]; the ghost is ``owner``'s from now on."""
        if self._figure is None:
            self._figure = ArmFigure(
                self._scene, thicker(self._robot), "/ghost", color=_COLOR, opacity=_OPACITY
            )
        self.claim(owner)
        self._figure.pose(q)
        self._figure.visible = True

    def hide(self, owner: object = None) -> None:
        """Show nothing, if what is shown is ``owner``'s."""
        if self.shown_by(owner) and self._figure is not None:
            self._figure.visible = False

    def shown_by(self, owner: object = None) -> bool:
        """Whether the ghost is shown, and ``owner``'s."""
        return self._figure is not None and self._figure.visible and self._owner is owner


def thicker(robot: Robot) -> Robot:
    """The arm as it is drawn beside itself, a little larger all round."""
    look = dataclasses.replace(robot.look, width=_SWELL * robot.look.width)
    return dataclasses.replace(robot, look=look)

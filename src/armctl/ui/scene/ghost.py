"""A translucent arm in one page's view: where the arm would stand."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import viser
from numpy.typing import NDArray

from armctl.robot import Robot
from armctl.ui.scene.arm_figure import ArmFigure, Color

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


# Several translucent arms in one page's view, numbered: the branches of a target side by side.

_ROOT = "/branches"
_BRANCH_GHOSTS_OPACITY = 0.4
_BRANCH_GHOSTS_SWELL, _MORE = 1.08, 0.03


@dataclass(frozen=True, slots=True)
class GhostMark:
    """One arm to be shown."""

    q: FloatArray
    """(n,) [rad]"""
    color: Color
    label: str
    """written beside it"""


class BranchGhosts:
    """Draws them; those of the last call are gone."""

    def __init__(self, scene: viser.SceneApi, robot: Robot) -> None:
        self._scene, self._robot = scene, robot
        self._figures: list[ArmFigure] = []
        self._labels: list[viser.LabelHandle] = []

    def show(self, marks: Sequence[GhostMark]) -> None:
        """Show these arms; none: nothing."""
        self.hide()
        for i, (mark, place) in enumerate(zip(marks, self._label_places(marks), strict=True)):
            # each a little thicker than the one before: what they share would flicker, or mix its colours
            width = (_BRANCH_GHOSTS_SWELL + i * _MORE) * self._robot.look.width
            robot = replace(self._robot, look=replace(self._robot.look, width=width))
            figure = ArmFigure(
                self._scene, robot, f"{_ROOT}/{i}", color=mark.color, opacity=_BRANCH_GHOSTS_OPACITY
            )
            figure.pose(mark.q)
            self._figures.append(figure)
            self._labels.append(self._scene.add_label(f"{_ROOT}/label{i}", mark.label, position=place))

    def hide(self) -> None:
        """Show nothing."""
        for node in (*self._figures, *self._labels):
            node.remove()
        self._figures, self._labels = [], []

    def _label_places(self, marks: Sequence[GhostMark]) -> FloatArray:
        """(k, 3) for each arm the same frame's origin: of the frame at which they lie farthest apart [m]."""
        if not marks:
            return np.empty((0, 3))
        points = self._robot.frames(np.array([mark.q for mark in marks]))[:, :, :3, 3]  # (k, frames, 3)
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)  # (k, k, frames)
        apart[np.arange(len(marks)), np.arange(len(marks))] = np.inf
        nearest = apart.min(axis=(0, 1))
        frame = int(nearest.argmax()) if len(marks) > 1 else points.shape[1] // 2
        return points[:, frame]

"""Two motions side by side: A is kept, B is what is shown now."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import viser

from armctl.errors import InputError
from armctl.robot import Robot
from armctl.ui.screens.trajectory_motion import ShownMotion
from armctl.ui.widgets.html_bits import fixed, muted
from armctl.ui.widgets.text import LiveHtml, table

if TYPE_CHECKING:
    from collections.abc import Callable

    from armctl.ui.session import Session

_HOW = "Keep the shown motion as A, then show another: A is drawn thin and dashed beside it."


class CompareView:
    """Keeps a motion, and sets its figures against those of the one that is shown."""

    def __init__(self, session: Session, changed: Callable[[], None]) -> None:
        """Add the widgets to the present container; ``changed()`` is told when A is another."""
        self._robot, self._changed = session.console.robot, changed
        self._a: ShownMotion | None = None
        self._shown: ShownMotion | None = None
        gui = session.gui
        self._text = LiveHtml(gui, muted(_HOW))
        self._keep = gui.add_button("Keep as A", icon=viser.Icon.PIN, color="gray")
        self._drop = gui.add_button("Drop A", icon=viser.Icon.PINNED_OFF, color="gray", visible=False)
        session.on(self._keep.on_click, self._on_keep)
        session.on(self._drop.on_click, self._on_drop)

    @property
    def beside(self) -> ShownMotion | None:
        """A, where it is another motion than the one that is shown."""
        return None if self._a is self._shown else self._a

    def take(self, shown: ShownMotion) -> None:
        """Another motion is shown: it is B from now on."""
        self._shown = shown
        self._draw()

    async def _on_keep(self) -> None:
        if self._shown is None:
            raise InputError("there is no motion to keep: press Show first")
        self._a = self._shown
        self._draw()
        self._changed()

    async def _on_drop(self) -> None:
        self._a = None
        self._draw()
        self._changed()

    def _draw(self) -> None:
        if self._drop.visible != (self._a is not None):
            self._drop.visible = self._a is not None
        if self._a is None or self._shown is None:
            self._text.show(muted(_HOW))
        elif self.beside is None:
            self._text.show(muted(f"A is {self._a.planned.title}. Choose another motion and press Show."))
        else:
            self._text.show(compare_html(self._robot, self._a, self._shown))


def compare_html(robot: Robot, a: ShownMotion, b: ShownMotion) -> str:
    """Durations, peaks of the joints as a share of their limits, and the largest tool speeds of both."""
    rows = [
        ["duration s", *(fixed(shown.planned.trajectory.duration, 3) for shown in (a, b))],
        ["tool, largest mm/s", *(fixed(1000 * float(shown.motion.tool_speed.max()), 1) for shown in (a, b))],
    ]
    speeds = [100 * shown.peaks.speed / robot.speed_limits for shown in (a, b)]
    pushes = [100 * shown.peaks.acceleration / robot.acceleration_limits for shown in (a, b)]
    jerks = [100 * np.abs(shown.motion.jerk).max(axis=0) / robot.jerk_limits for shown in (a, b)]
    shares = [
        [
            joint.title,
            *(fixed(float(of[i]), 0) for both in (speeds, pushes, jerks) for of in both),
        ]
        for i, joint in enumerate(robot.joints)
    ]
    head = ["% of limit", "speed A", "B", "acc. A", "B", "jerk A", "B"]
    return (
        muted(f"A (dashed): {a.planned.title}")
        + muted(f"B: {b.planned.title}")
        + table(["", "A", "B"], rows)
        + table(head, shares)
        + muted("Only quintic and s-curve keep the jerk limits; trapezoid and cubic jump in acceleration.")
    )

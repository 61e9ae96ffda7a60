"""Moving one joint slowly, to a mark on a protractor."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.robot import Robot
from armctl.runtime import Jog
from armctl.ui.screens.joint_stepper import JointStepper
from armctl.ui.widgets.hold import Hold, attach_hold
from armctl.ui.widgets.html_bits import muted
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]
STEPS = {"−10": -10.0, "−1": -1.0, "−0.1": -0.1, "+0.1": 0.1, "+1": 1.0, "+10": 10.0}
_SLOW_RAD_S, _SLOW_FRACTION, _SHORTEST_S = math.radians(10.0), 0.15, 0.3
_STEP_HINT = "Turns the joint at once, at no more than 10°/s. Degrees by the calibration in force."
_JOG_NOTE = "Jog turns the joint slowly for as long as the button is held."


def slow_speeds(robot: Robot) -> FloatArray:
    """(n,) how fast each joint is moved here [rad/s]."""
    return np.minimum(_SLOW_RAD_S, _SLOW_FRACTION * robot.speed_limits)


def slow_duration(robot: Robot, way: FloatArray) -> float:
    """How long a way (n,) [rad] takes at those speeds [s]."""
    return max(_SHORTEST_S, float((np.abs(way) / slow_speeds(robot)).max()))


class CalibrationJog:
    """Step and hold buttons of the joint that is being calibrated."""

    def __init__(self, session: Session, chosen: Callable[[], int]) -> None:
        """Add the controls to the present container; ``chosen`` gives the joint's index."""
        self._session = session
        self._chosen = chosen
        self._robot = session.console.robot
        self._stepper = JointStepper(session, partial(slow_duration, self._robot))
        self._hold = Hold()
        gui = session.gui
        self._steps = gui.add_button_group("Step °", tuple(STEPS), hint=_STEP_HINT)
        minus = gui.add_button("Jog −")
        plus = gui.add_button("Jog +")
        LiveHtml(gui, muted(_JOG_NOTE))
        session.on(self._steps.on_click, self._on_step)
        session.on(partial(attach_hold, minus), partial(self._on_hold, -1.0))
        session.on(partial(attach_hold, plus), partial(self._on_hold, 1.0))

    async def _on_step(self) -> None:
        self._session.require_operator()
        await self._stepper.step(self._chosen(), STEPS[self._steps.value])

    async def _on_hold(self, sign: float) -> None:
        """One tick of a held button: a short command that expires by itself."""
        if not self._hold.wants(self._session.snapshot.stamp):
            return
        joint, rate = self._chosen(), np.zeros(self._robot.n)
        rate[joint] = sign * slow_speeds(self._robot)[joint] / self._robot.speed_limits[joint]
        try:
            await self._session.submit(Jog(rate))
        except ArmctlError:
            self._hold.refuse()
            raise

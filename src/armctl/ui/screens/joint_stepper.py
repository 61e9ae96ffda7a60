"""Steps of one joint that are taken at once, and add up while the arm is under way."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.errors import ArmctlError
from armctl.runtime import MoveJoints
from armctl.ui.widgets.joint_step import stepped

if TYPE_CHECKING:
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]


class JointStepper:
    """Clicks during a step add up: the arm goes on to where all of them together lead."""

    def __init__(self, session: Session, duration_s: Callable[[FloatArray], float] | None = None) -> None:
        """``duration_s``: how long a way (n,) [rad] shall take; None: as short as it can."""
        self._session = session
        self._duration_s = duration_s
        self._goal: FloatArray | None = None

    async def step(self, joint: int, step_deg: float) -> None:
        """Turn one joint by ``step_deg``.

        Raises:
            ArmctlError: the joint would pass its limit, or the arm cannot move now.
        """
        session = self._session
        start = session.snapshot.q_command if self._goal is None else self._goal
        goal = stepped(session.console.robot, start, joint, step_deg)
        under_way, self._goal = self._goal is not None, goal
        if not under_way:
            try:
                await self._go()
            finally:
                self._goal = None

    async def _go(self) -> None:
        """Move to the goal, and on for as long as clicks have moved it further."""
        reached: FloatArray | None = None
        while self._goal is not None and self._goal is not reached:
            reached = self._goal
            way = reached - self._session.snapshot.q_command
            duration_s = None if self._duration_s is None else self._duration_s(way)
            ticket = await self._session.submit(MoveJoints(reached, duration_s))
            try:
                await asyncio.wrap_future(ticket.finished)
            except ArmctlError:  # stopped or broken: the session tells, and later clicks start afresh
                return

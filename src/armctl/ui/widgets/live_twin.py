"""The orange twin that follows a target, exactly as the arm would, on the page's own clock."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import Target
from armctl.runtime.follower import FOLLOW_EXPIRY_S, Follower
from armctl.runtime.keep_clear import KeepClear
from armctl.runtime.live_goal import LiveGoal, live_goal
from armctl.ui.scene.arm_figure import ArmFigure
from armctl.ui.scene.ghost import thicker

if TYPE_CHECKING:
    from armctl.ui.session import Session

FloatArray = NDArray[np.float64]
_FRAME_S = 1 / 30
_LONGEST_S = 0.1
_COLOR = (240, 140, 0)


class LiveTwin:
    """Begins where the arm stands; ends with ``remove``."""

    def __init__(self, session: Session, q: FloatArray) -> None:
        """Stand at ``q`` (n,) [rad]."""
        self._session = session
        self._robot = session.console.robot
        self._clear = KeepClear(self._robot)
        self._executor = ThreadPoolExecutor(1, thread_name_prefix="armctl-twin")
        self._follower = Follower(self._robot, self._clear, q, session.snapshot.speed, self._solve)
        self._figure = ArmFigure(
            session.client.scene, thicker(self._robot), "/live_twin", color=_COLOR, opacity=0.55
        )
        self._removed = False

    @property
    def notice(self) -> str | None:
        """What is not as the target asks for it."""
        return self._follower.notice

    @property
    def q(self) -> FloatArray:
        """(n,) where the twin is [rad]."""
        return self._follower.q

    def remove(self) -> None:
        """Take it out of the view."""
        if not self._removed:
            self._removed = True
            self._figure.remove()

    async def play(self, target: Callable[[], Target]) -> None:
        """Follow what ``target`` gives at each frame, at the speed override, until removed."""
        clock = asyncio.get_running_loop().time
        before = clock()
        try:
            while not self._removed:
                now = clock()
                self._follower.set_speed(self._session.snapshot.speed)
                self._follower.aim(target(), now + FOLLOW_EXPIRY_S)
                if now > before:
                    self._follower.advance(now, min(now - before, _LONGEST_S))
                before = now
                with self._session.client.atomic():
                    self._figure.pose(self._follower.q, self._session.snapshot.gripper)
                await asyncio.sleep(_FRAME_S)
        finally:
            self._executor.shutdown(wait=False, cancel_futures=True)

    def _solve(self, q: FloatArray, target: Target, pitch: float | None) -> Future[LiveGoal]:
        return self._executor.submit(live_goal, self._robot, self._clear, q, target, pitch)

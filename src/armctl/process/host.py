"""One arm as a process runs it: its boards and its controller."""

from __future__ import annotations

import asyncio
import gc
import sys
from collections.abc import Callable
from typing import Self

from armctl.boards import ANY_BOARD, Boards
from armctl.process.registry import holder
from armctl.protocol import ArmLink, Command, MonotonicClock, Origin, Recording, Snapshot, Ticket, black_boxes
from armctl.robot import Robot
from armctl.runtime import Controller, PoseFolder

_SWITCH_INTERVAL_S = 2e-4


class Host:
    """A robot with its boards and a controller that runs, in this process."""

    def __init__(
        self,
        robot: Robot,
        board: str = ANY_BOARD,
        rate_hz: float = 50.0,
        published: Callable[[Snapshot], None] | None = None,
        pin: str = "",
    ) -> None:
        """Wire up an arm as it is calibrated with ``board`` (see ``board_name``), without opening a line.

        ``rate_hz``: ticks a second, 10 … 200. ``board``: ``NO_BOARD`` where none was there when the
        calibration was looked up; another real board than that one is refused. ``published`` is called
        after each tick, by the controller's thread. ``pin``: the teacher's, who can always take control.
        """
        # The interpreter's default of 5 ms is what a tick would be late when other threads run Python.
        sys.setswitchinterval(min(sys.getswitchinterval(), _SWITCH_INTERVAL_S))
        clock = MonotonicClock()
        self.boards = Boards(robot, clock.now, board=board, held=holder)
        self._controller = Controller(
            robot, self.boards.driver, clock, rate_hz,
            published=published, pin=pin, black_boxes=black_boxes(), poses=PoseFolder.of_user(robot),
            simulate=self.boards,
        )  # fmt: skip
        self._controller.start()

    @property
    def robot(self) -> Robot:
        """The arm, as it is calibrated."""
        return self._controller.robot

    @property
    def snapshot(self) -> Snapshot:
        """The arm at the last tick."""
        return self._controller.snapshot

    @property
    def ended(self) -> bool:
        """It was closed."""
        return self._controller.ended

    def submit(self, command: Command, origin: Origin | None = None) -> Ticket:
        """Ask for something."""
        return self._controller.submit(command, origin)

    def stop(self, origin: Origin | None = None) -> Ticket:
        """STOP."""
        return self._controller.stop(origin)

    def black_box(self) -> Recording:
        """The last minute."""
        return self._controller.black_box()

    def simulated_port(self) -> str:
        """Where the simulated board is served."""
        return self.boards.simulated().port

    def beat(self) -> None:
        """Nothing: who calls is part of the same process."""

    def close(self) -> None:
        """Bring the arm to rest, close the line, take the simulated board away."""
        try:
            self._controller.close()
        finally:
            self.boards.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


# Garbage: what lives from the start is never looked at. What is young is looked at often, a little at a time:
# 200,000 objects take 40 to 130 ms, some ticks, 3,000 take 0.1. What lives on is looked at once a minute, and
# what has lived for long while the arm stands.

_LOOK_EVERY_S, _OLD_EVERY_S = 0.1, 60.0
_MOST_YOUNG = 3_000


async def collect_at_rest(arm: ArmLink) -> None:
    """Collect garbage in place of Python's own collector: while the arm moves, only what is young."""
    gc.collect()
    gc.freeze()
    gc.disable()
    now = asyncio.get_running_loop().time
    looked_at = now()
    try:
        while True:
            await asyncio.sleep(_LOOK_EVERY_S)
            if gc.get_count()[0] > _MOST_YOUNG:
                gc.collect(0)
            if now() - looked_at > _OLD_EVERY_S:
                gc.collect(1 if arm.snapshot.busy else 2)
                looked_at = now()
    finally:
        gc.enable()

"""One arm as a process runs it: its boards and its controller."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Self

from armctl.boards import ANY_BOARD, Boards
from armctl.process.registry import holder
from armctl.robot import Robot
from armctl.runtime import (
    Command,
    Controller,
    MonotonicClock,
    Origin,
    PoseFolder,
    Recording,
    Snapshot,
    Ticket,
    black_boxes,
)

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

"""A real driver and a simulated board on the controller's own clock: true bytes, no threads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar

from tests.hardware.lines import LoopTransport
from tests.runtime.kit import TEST, TICK

from armctl.facts import State
from armctl.hardware import ByteModel, Driver
from armctl.hardware.faults import FaultyModel, Trouble
from armctl.protocol import Command, ManualClock, Snapshot, Ticket
from armctl.robot import Robot
from armctl.runtime import Controller, InlineExecutor

Model = TypeVar("Model", bound=ByteModel)


@dataclass
class BoardBench(Generic[Model]):
    """A controller that is ticked by hand, the board that it drives, and the line between them."""

    clock: ManualClock
    board: Model
    line: FaultyModel
    controller: Controller

    @classmethod
    def of(
        cls,
        robot: Robot,
        board: Model,
        driver: Callable[[Callable[[], LoopTransport], Callable[[], float]], Driver],
        black_boxes: Path | None = None,
        troubles: Sequence[Trouble] = (),
        planner: Executor | None = None,
    ) -> BoardBench[Model]:
        """Wire up ``board``; ``driver`` makes its driver from what opens the line and the clock."""
        clock = ManualClock(100.0)
        line = FaultyModel(board, 0, troubles)
        opened = driver(lambda: LoopTransport(line, clock.now, clock.advance), clock.now)
        controller = Controller(
            robot, lambda _: opened, clock, executor=planner or InlineExecutor(), black_boxes=black_boxes
        )
        return cls(clock, board, line, controller)

    @property
    def now(self) -> Snapshot:
        return self.controller.snapshot

    def run(self, seconds: float) -> Snapshot:
        for _ in range(round(seconds / TICK)):
            self.clock.advance(TICK)
            self.controller.tick()
        return self.now

    def do(self, command: Command) -> Ticket:
        """Submit and tick once; it must be accepted."""
        ticket = self.controller.submit(command, TEST)
        self.run(TICK)
        ticket.accepted.result(0)
        return ticket

    def until(self, *states: State, seconds: float = 40.0) -> Snapshot:
        for _ in range(round(seconds / TICK)):
            if self.run(TICK).state in states:
                return self.now
        raise AssertionError(f"{self.now.state}: {self.now.cause}")

"""The whole console on a simulated board, served to the test's browser."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tests.arms import FIVE
from tests.browser.kit import Screen
from tests.browser.serving import page_port

from armctl.arm import Arm
from armctl.calibration import CalibrationStore
from armctl.facts import State
from armctl.process.host import Host
from armctl.program import MoveStep, Program, Step
from armctl.protocol import Command, Connect, Enable, Origin, Party, Snapshot, Ticket
from armctl.robot import Robot, load_robot
from armctl.ui import App, CalibrationInForce, Console, PortChoice, RobotChoice, RobotSwitch
from armctl.ui.docs import ServedDocs
from armctl.ui.guard import guarded_server
from armctl.ui.tabs.manual.shared_program import SharedProgram

HOME = [0.0, 90.0, -80.0, -40.0, 0.0]
"""the joint angles [degrees] at which a served Uzuner arm begins"""
SIMULATED = PortChoice("sim", "Simulated board")
_SILENCE_S = 30.0
"""a browser may hang for seconds on a test's loaded machine; ``test_stop_in_browser`` sets the real limit"""


@dataclass(frozen=True)
class ServedArm:
    """The arm that the test began with, and the pages; what is asked here is of the present arm."""

    arm: Arm
    app: App

    @property
    def console(self) -> Console:
        return self.app.robots.console

    @property
    def url(self) -> str:
        return self.app.server.links[0]

    @property
    def robot(self) -> Robot:
        return self.console.robot

    @property
    def now(self) -> Snapshot:
        return self.console.controller.snapshot

    @property
    def commanded_deg(self) -> list[float]:
        return np.degrees(self.now.q_command).round(2).tolist()

    @property
    def tool_mm(self) -> NDArray[np.float64]:
        """Where the tool is commanded to be (3,) [mm]."""
        return 1000 * self.robot.forward(self.now.q_command)[:3, 3]

    def order(self, command: Command) -> Ticket:
        return self.console.controller.submit(command, Origin("test"))

    def wait_for(self, screen: Screen, state: State) -> None:
        screen.wait_until(lambda: self.now.state is state, f"the arm is {state.value}")

    def wait_for_deg(self, screen: Screen, degrees: list[float], within: float = 0.005) -> None:
        """Wait until the arm holds at joint angles [degrees]."""

        def there() -> bool:
            off = np.abs(np.degrees(self.now.q_command) - degrees).max()
            return self.now.state is State.HOLDING and bool(off <= within)

        screen.wait_until(there, f"the arm stands at {np.round(degrees, 2).tolist()}")

    def go_deg(self, screen: Screen, degrees: list[float]) -> None:
        """Move the arm to joint angles [degrees] once it holds, and wait until it is there."""
        self.wait_for(screen, State.HOLDING)
        self.arm.go_joints(degrees)

    @property
    def steps_run(self) -> list[tuple[int, int]]:
        """Each pass and step of a program that came to run, in order."""
        assert isinstance(self.arm.link, TestHost)
        return self.arm.link.steps_run

    @property
    def steps(self) -> tuple[Step, ...]:
        return self.edited.program.steps

    @property
    def edited(self) -> SharedProgram:
        return self.console.shared(SharedProgram)

    def put(self, *poses_deg: tuple[float, ...]) -> None:
        """A program of poses on the list."""
        self.put_steps(*(MoveStep(joints_deg=pose) for pose in poses_deg))

    def put_steps(self, *steps: Step, by: Party | None = None) -> None:
        """A program on the list, as edited ``by`` somebody."""

        async def put() -> None:  # where the pages live
            self.edited.edit(Program(robot=self.robot.name, name="test", steps=steps), by)

        asyncio.run_coroutine_threadsafe(put(), self.app.server.get_event_loop()).result(_SILENCE_S)


class TestHost(Host):
    """What the test asks for is asked for as the page does that operates."""

    __test__ = False

    def __init__(self, robot: Robot, pin: str = "") -> None:
        self.steps_run: list[tuple[int, int]] = []
        super().__init__(robot, published=self._note_step, pin=pin)

    def _note_step(self, snapshot: Snapshot) -> None:
        progress = snapshot.program
        if progress is not None and (at := (progress.loop, progress.step)) not in self.steps_run[-1:]:
            self.steps_run.append(at)

    def submit(self, command: Command, origin: Origin | None = None) -> Ticket:
        operator = self.snapshot.control.operator
        if operator is not None and origin is not None and origin.who in ("test", "library"):
            origin = Origin(operator.id)
        return super().submit(command, origin)


@contextmanager
def served_arm(
    folder: Path, robot: str = "uzuner", pin: str = "", port: PortChoice = SIMULATED
) -> Iterator[ServedArm]:
    """An enabled arm at its home pose, and its console; the page can change it for any shipped robot.

    ``pin``: the teacher's. On another ``port`` than the simulated board's own the arm is not enabled.
    """

    store = CalibrationStore(folder / "calibrations")

    def console(arm: Arm, calibration: CalibrationInForce) -> Console:
        return Console(
            calibration=calibration,
            controller=arm.link,
            list_ports=lambda: [port],
            files=folder,
            close=arm.close,
            state=folder / "state",
            pin=pin,
        )

    def anew(name: str, port: str, _: object) -> Console:
        calibration = CalibrationInForce.of(load_robot(name), port, store)
        return console(Arm(TestHost(calibration.robot, pin=pin)), calibration)

    choices = [RobotChoice(name, load_robot(name).title) for name in {robot: None, **dict.fromkeys(FIVE)}]
    begun = CalibrationInForce.of(load_robot(robot), "sim", store)
    arm = Arm(TestHost(begun.robot, pin=pin))
    arm.link.submit(Connect(port.port)).result(10)
    robots = RobotSwitch(
        console(arm, begun),
        next(choice for choice in choices if choice.name == robot),
        choices,
        anew,
    )
    try:
        server = guarded_server(port=page_port(), docs=ServedDocs(), label="armctl")
        app = App(robots, server, silence_s=_SILENCE_S)
        try:
            if port is SIMULATED:
                arm.link.submit(Enable(arm.robot.pose("home")), Origin("test")).result(10)
            yield ServedArm(arm, app)
        finally:
            app.close()
    finally:
        robots.close()

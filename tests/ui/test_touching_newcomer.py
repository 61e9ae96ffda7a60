"""Known points from opening to the proof, by its own buttons, on an arm with zeros and sag of its own."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.calibration.plant import Plant
from tests.ui.page_kit import FakePage

from armctl.arrays import FloatArray
from armctl.calibration import CalibrationStore, TouchFit, calibrated, own_map
from armctl.errors import InputError
from armctl.facts import State
from armctl.hardware import Source
from armctl.protocol import Command, MoveJoints
from armctl.robot import Robot, load_robot
from armctl.ui import CalibrationInForce
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.calibration.points import CalibrationPoints
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration
from armctl.ui.tabs.manual.shared_program import SharedProgram

FILE = load_robot("uzuner")
OFF_DEG, SAG_RAD_NM = (1.0, -3.0, 2.5, -2.0, 0.0), 0.02
SEEN_MM = 1.0
"""how well a person sees how far the tip is from a crosshair"""
AGAIN = "Touch point 1 again"
"""as that button is named before a point does not fit"""
ROWS = ("X ahead mm", "Y left mm", "Z up mm")


class Newcomer(FakePage):
    """A page and who sits before it, and looks at the true arm."""

    def __init__(self, server: GuardedServer, robot: Robot, store: CalibrationStore, plant: Plant) -> None:
        super().__init__(server, robot, robot.pose("home"))
        self.desk = SharedCalibration(CalibrationInForce(robot, "77", store))
        self.plant, self.clicks = plant, 0
        program, others = SharedProgram(FILE.name, Path("nowhere")), self.console.shared
        kept = {SharedCalibration: self.desk, SharedProgram: program}
        self.console.shared = lambda kind: kept.get(kind) or others(kind)
        vars(self.snapshot).update(source=Source.TRANSMITTED, limp=(), board=None)
        vars(self.robots)["require_reopenable"] = lambda: None
        self.screen = CalibrationPoints(self.session)
        self.look()

    def require_operator(self) -> None:
        pass

    def notify(self, *_: str) -> None:
        pass

    async def reopen_arm(self) -> None:
        pass

    async def submit(self, command: Command) -> Any:
        """Motions end at once."""
        await super().submit(command)
        assert isinstance(command, MoveJoints)
        q = self.snapshot.q_command
        for share in (0.5, 1.0):  # the page sees in which sense the joints turn
            self.snapshot.q = self.snapshot.q_command = q + share * (command.q - q)
            self.desk.points.follow(self.session.snapshot)
        done = Future[None]()
        done.set_result(None)
        return SimpleNamespace(finished=done)

    def click(self, label: str, value: object = None, *, times: int = 1) -> None:
        self.clicks += times
        self.press(label, value, times=times)
        self.look()

    def look(self) -> None:
        self.act(lambda: self.screen.refresh(self.session.snapshot))

    def label_of(self, button: str) -> str:
        return self._handles[button].label

    @property
    def tip(self) -> FloatArray:
        """Where the true tip is (3,) [m]."""
        shaft = FILE.outputs.angles(self.console.robot.outputs.outputs(self.snapshot.q_command))
        return self.plant.tip(shaft[None], np.array(self.desk.points.sense)[None])[0]

    def bring_to(self, target: FloatArray) -> float:
        """Press Go, then steps, until it seems to be there; gives how high it came to stand first [m]."""
        self.clicks += 1
        self.act(lambda: self.next.refresh(self.session.snapshot))
        self.go()
        came = float((self.tip - target)[2])
        for _ in range(12):
            heading = self.desk.points.heading or 0.0
            c, s = np.cos(heading), np.sin(heading)
            along = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ (target - self.tip)
            off = SEEN_MM * np.round(1000 * along / SEEN_MM)
            if not off.any():
                break
            axis = int(np.argmax(np.abs(off[:2]))) if np.abs(off[:2]).max() > 0.2 * abs(off[2]) else 2
            size = next(one for one in (10, 3, 1) if one <= abs(off[axis]))
            self.click(
                ROWS[axis], f"{'+' if off[axis] > 0 else '−'}{size}", times=int(abs(off[axis]) // size)
            )
        assert np.linalg.norm(target - self.tip) < 0.0015
        return came


@pytest.fixture
def plant() -> Plant:
    plant = Plant.of(FILE, np.random.default_rng(5))
    plant.zero, plant.compliance = (
        np.radians(OFF_DEG),
        np.where(FILE.gravity.weighs, SAG_RAD_NM, 0.0) * np.ones(5),
    )
    return plant


def where(page: Newcomer, number: int) -> FloatArray:
    """Where a crosshair of the sheet truly lies (3,) [m]: some millimetres and degrees off."""
    sheet = page.desk.points.sheet
    assert sheet is not None
    c, s = np.cos(0.06), np.sin(0.06)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn @ page.desk.points.crosshair(number) + sheet.place_m + (0.008, -0.006, 0.0)


def touch_next(page: Newcomer, instead: int | None = None) -> float:
    proposed = page.desk.points.next
    assert proposed is not None
    came = page.bring_to(where(page, instead or proposed.number))
    page.click("Here")
    page.click("Lift the tip")
    return came


def test_from_opening_to_the_proof_by_the_buttons_alone(
    server: GuardedServer, tmp_path: Path, plant: Plant
) -> None:
    store = CalibrationStore(tmp_path)
    page = Newcomer(server, FILE, store, plant)
    page.click("Points", "a printed sheet, A4")
    points = page.desk.points
    assert points.sheet is not None and points.sheet.height_m == 0.05  # the arm was never calibrated
    came = [touch_next(page) for _ in range(6)]
    assert min(came) > 0.012  # the tip never comes into the paper, nor
    assert max(came[3:]) < 0.03  # far above it, once it is known where that is
    proposed = points.next
    assert proposed is not None
    away = np.linalg.norm(points.sheet.points_m - points.crosshair(proposed.number), axis=1)
    touch_next(page, instead=1 + int(np.argsort(away)[1]))  # its neighbour
    assert points.doubtful == 6
    assert page.label_of(AGAIN) == "Touch point 7 again"
    assert "Point 7 does not fit" in page.html  # beside what is touched next, where who touches looks
    page.click(AGAIN)
    touch_next(page)
    assert points.doubtful is None and len(points.touches) == 7
    assert "does not fit" not in page.html
    touch_next(page)
    fit = points.result
    assert isinstance(fit, TouchFit) and fit.correct and len(points.touches) == 8
    page.click("Apply the correction")
    assert page.clicks < 120

    kept = store.load(FILE.name, "77")
    assert kept is not None
    robot = calibrated(FILE, kept)
    proof = Newcomer(server, robot, store, plant)
    proof.desk.adopt(page.desk)
    asyncio.run(proof.desk.points.compute())
    proof.look()
    proof.click("Next pose above it")
    for _ in range(3):
        touch_next(proof)
    checked = proof.desk.points
    assert checked.errors_m is not None and checked.used == 8
    now = float(np.sqrt(np.mean(checked.errors_m[8:] ** 2)))
    assert now < 0.0015 and now < 0.4 * fit.before.rms
    with pytest.raises(InputError, match="every point fits"):
        proof.press(AGAIN)


def test_here_counts_once_the_step_before_it_has_ended(
    server: GuardedServer, tmp_path: Path, plant: Plant
) -> None:
    page = Newcomer(server, FILE, CalibrationStore(tmp_path), plant)
    page.click("Points", "a printed sheet, A4")
    points, go, state, here = page.desk.points, page.submit, page.snapshot.state, list[asyncio.Task[Any]]()

    async def press_here() -> None:
        await page.act_on("Here")

    async def submit(command: Command) -> Any:
        page.snapshot.state = State.MOVING
        here.append(asyncio.create_task(press_here()))
        for _ in range(5):
            await asyncio.sleep(0)
        assert not points.touches and not here[0].done()
        ticket = await go(command)
        page.snapshot.state = state
        return ticket

    async def step_and_here() -> None:
        await page.act_on("Y left mm", "+10")
        await here[0]

    vars(page)["submit"] = submit
    page.act(step_and_here)
    (touch,) = points.touches
    assert len(here) == 1
    assert touch.outputs == own_map(FILE).outputs(page.snapshot.q_command)

"""Steps of the tool: a click moves it by so much, also where friction swallows what servos are sent."""

from __future__ import annotations

import asyncio
from concurrent.futures import Future
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, MotionRefusedError, StateError
from armctl.facts import State
from armctl.facts.targets import ToolStepRefused
from armctl.hardware import Source
from armctl.protocol import Command, MoveJoints
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.tool_steps import ToolSteps, tool_stepped

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")
SO101 = load_robot("so101")
COUNT = np.radians(360 / 4096)
STUCK = np.radians(1.0)
"""so far from where it was sent a servo stands without turning"""


@pytest.mark.parametrize("name", ["uzuner", "so101", "parol6"])
def test_a_step_of_the_tool_goes_as_far_along_an_axis_as_it_says(name: str) -> None:
    robot = load_robot(name)
    q = robot.pose("home")
    point, turned = robot.forward(q)[:3, 3], robot.forward(q)[:3, :3]
    for step in (0.01 * np.eye(3)[0], -0.005 * np.eye(3)[1], 0.001 * np.eye(3)[2]):
        there = robot.forward(tool_stepped(robot, q, step))
        np.testing.assert_allclose(there[:3, 3], point + step, atol=1e-6)
        assert there[2, 2] == pytest.approx(turned[2, 2], abs=1e-6)  # it is pitched as before
    for beyond, turns in (((5.0, 0.0, 0.0), None), ((-2.0 * point[0], 0.01, 0.0), np.radians(30.0))):
        with pytest.raises(MotionRefusedError) as refusal:  # out of reach, and on the other side
            tool_stepped(robot, q, np.array(beyond))
        assert refusal.value.reason == ToolStepRefused(beyond, turns)


class SteppedPage(FakePage):
    """Motions end at once; what they led to is where the arm stands."""

    def require_operator(self) -> None:
        if not self.operates:
            raise ArmctlError("this page is watching")

    async def submit(self, command: Command) -> Any:
        await super().submit(command)
        assert isinstance(command, MoveJoints)
        self.snapshot.q_command, done = command.q, Future[None]()
        done.set_result(None)
        return SimpleNamespace(finished=done)


def test_clicks_on_steps_of_the_tool_add_up(server: GuardedServer) -> None:
    page = SteppedPage(server, ROBOT, HOME)
    ToolSteps(page.session)
    page.press("X ahead mm", "+10", times=3)
    page.press("Z up mm", "−3")
    moved = ROBOT.forward(page.snapshot.q_command)[:3, 3] - ROBOT.forward(HOME)[:3, 3]
    np.testing.assert_allclose(moved, (0.03, 0.0, -0.003), atol=1e-6)
    for one in page.sent:
        assert isinstance(one, MoveJoints) and one.duration_s is not None and one.duration_s >= 0.3
    page.operates = False
    with pytest.raises(ArmctlError, match="watching"):
        page.press("X ahead mm", "+10")


@pytest.mark.parametrize(("clicks", "goes"), [(12, 12), (60, None)])
def test_clicks_that_wait_are_done_in_as_many_motions_as_they_need(
    server: GuardedServer, clicks: int, goes: int | None
) -> None:
    page = SteppedPage(server, ROBOT, HOME)
    steps, at, turns = ToolSteps(page.session), [HOME], []

    async def submit(command: Command) -> Any:
        assert isinstance(command, MoveJoints)
        for _ in range(0 if turns else clicks):  # clicked while the arm goes by the first one
            await steps.step(np.array((0.0, 0.01, 0.0)))
        turns.append(np.abs(command.q - at[-1]).max())
        at.append(command.q)
        return await SteppedPage.submit(page, command)

    vars(page)["submit"] = submit
    if goes is None:  # more than the arm reaches: it goes as far as whole clicks lead
        with pytest.raises(MotionRefusedError) as refusal:
            page.press("Y left mm", "+10")
        assert isinstance(refusal.value.reason, ToolStepRefused)
        assert refusal.value.reason.step_m == (0.0, 0.01, 0.0)
    else:
        page.press("Y left mm", "+10")
    moved = ROBOT.forward(at[-1])[:3, 3] - ROBOT.forward(HOME)[:3, 3]
    way = 0.01 * (1 + goes) if goes is not None else 0.01 * round(100 * moved[1])
    np.testing.assert_allclose(moved, (0.0, way, 0.0), atol=1e-6)
    assert way > 0.1 and max(turns) <= np.radians(30.0) + 1e-9 and len(turns) > 2


class Sticky(FakePage):
    """An arm whose servos hang by ``SAG``, and turn only when they are further off than their friction."""

    SAG = np.radians([0.0, 2.0, 1.5, -0.5, 0.0])

    def __init__(self, server: GuardedServer) -> None:
        super().__init__(server, SO101, SO101.pose("home"))
        q = SO101.pose("home") - self.SAG - STUCK
        vars(self.snapshot).update(q=q, source=Source.MEASURED)
        self.blocked = np.zeros(SO101.n, dtype=np.bool_)
        self.after = 0
        """motions until STOP is pressed; 0: never"""
        self.steps = ToolSteps(self.session, pause=self.wait)
        self.waited = 0.0

    async def wait(self, seconds: float) -> None:
        self.waited += seconds
        self.snapshot.q = self.snapshot.q.copy()  # a new reading

    def require_operator(self) -> None:
        pass

    async def submit(self, command: Command) -> Any:
        await super().submit(command)
        assert isinstance(command, MoveJoints)
        now, done = self.snapshot, Future[None]()
        self.move_to(command.q)
        self.after -= 1
        if self.after == 0:
            now.stops += 1
        done.set_result(None)
        return SimpleNamespace(finished=done)

    def move_to(self, command: FloatArray) -> None:
        now, stands = self.snapshot, command - self.SAG
        q: FloatArray = COUNT * np.round(np.clip(now.q, stands - STUCK, stands + STUCK) / COUNT)
        now.q_command, now.q = command, np.where(self.blocked, now.q, q)

    @property
    def tip(self) -> FloatArray:
        return SO101.forward(self.snapshot.q)[:3, 3]

    def click(self, label: str, value: str) -> FloatArray:
        """How far the tip came [mm]."""
        before = self.tip
        self.press(label, value)
        return 1000 * (self.tip - before)


def test_a_click_moves_the_tool_by_a_millimetre_where_friction_swallows_ten_of_them(
    server: GuardedServer,
) -> None:
    page = Sticky(server)
    lines = page.html.rsplit("arrow at the tool", 1)[1].count("<div")
    page.click("X ahead mm", "+3")
    page.click("Y left mm", "−3")
    page.click("Y left mm", "+3")
    page.click("Z up mm", "−3")
    page.click("Z up mm", "+3")  # each joint has turned both ways
    page.sent.clear()
    target, clicks = page.tip, ("X+1", "X−1", "Y+1", "Y+1", "Z−1", "Y−1", "Z+1", "X−1", "Z−3", "Z+3")
    rows = {"X": "X ahead mm", "Y": "Y left mm", "Z": "Z up mm"}
    for row, value in ((one[0], one[1:]) for one in clicks):
        page.click(rows[row], value)
        target["XYZ".index(row)] += float(value.replace("−", "-")) / 1000
        assert np.linalg.norm(page.tip - target) < 0.0009  # nothing adds up
    assert len(page.sent) < 2 * len(clicks)
    for one in page.sent:
        assert isinstance(one, MoveJoints) and one.duration_s is not None and one.duration_s >= 0.3
    assert "as measured" in page.html
    assert page.html.rsplit("arrow at the tool", 1)[1].count("<div") == lines  # nothing below it moves


def test_a_joint_that_is_held_is_not_pressed_any_harder_than_by_the_click(server: GuardedServer) -> None:
    page = Sticky(server)
    page.click("Z up mm", "−3")
    page.blocked[:] = True
    before = page.snapshot.q_command
    page.click("Z up mm", "−1")
    tries = np.array([one.q for one in page.sent if isinstance(one, MoveJoints)])
    assert np.abs(tries - before).max() < np.radians(5.0)
    assert np.abs(page.snapshot.q_command - before).max() < np.radians(0.1)
    page.blocked[:] = False
    page.click("Z up mm", "+10")
    page.click("Z up mm", "+10")
    np.testing.assert_allclose(page.click("Z up mm", "−3"), (0.0, 0.0, -3.0), atol=1.0)


@pytest.mark.parametrize("what", ["stop", "off", "limp"])
def test_nothing_is_sent_after_a_stop_or_once_the_arm_holds_no_more(server: GuardedServer, what: str) -> None:
    page = Sticky(server)
    if what == "stop":
        page.after = 1
    else:
        vars(page.snapshot).update({"off": {"state": State.OFF}, "limp": {"limp": ("Elbow flex",)}}[what])
    page.click("Y left mm", "+1")  # pan has to turn round: one motion is not enough
    assert len(page.sent) == 1
    page.after = 0
    vars(page.snapshot).update(state=State.HOLDING, limp=())
    page.click("Y left mm", "+1")
    assert len(page.sent) > 2


def test_a_click_after_a_stop_begins_from_what_was_sent_before_it_pressed(server: GuardedServer) -> None:
    page = Sticky(server)
    page.click("Z up mm", "−3")
    page.click("Z up mm", "+3")
    calm, page.blocked[:], page.after = page.snapshot.q_command, True, 1
    page.click("Z up mm", "−10")  # STOP, while it presses on the table
    assert np.abs(page.snapshot.q_command - calm).max() > np.radians(4.0)
    page.blocked[:] = False
    page.sent.clear()
    assert page.click("Z up mm", "+1")[2] == pytest.approx(1.0, abs=0.9)
    first = page.sent[0]
    assert isinstance(first, MoveJoints) and np.abs(first.q - calm).max() < np.radians(1.0)
    page.after = 1
    page.click("Z up mm", "−10")
    page.snapshot.q_command = stands = page.snapshot.q  # released, and enabled where it stands
    page.sent.clear()
    assert page.click("Z up mm", "+1")[2] == pytest.approx(1.0, abs=0.9)
    first = page.sent[0]
    assert isinstance(first, MoveJoints) and np.abs(first.q - stands).max() < np.radians(1.0)


@pytest.mark.parametrize(("stops", "words"), [(1, "did not come there"), (0, "waits already")])
def test_who_waits_for_a_step_hears_that_it_was_stopped_and_waits_once(
    server: GuardedServer, stops: int, words: str
) -> None:
    page = Sticky(server)
    page.after, heard = stops, list[object]()

    async def step_and_wait() -> None:
        step = asyncio.create_task(page.act_on("Y left mm", "+1"))
        while not page.steps.stepping:
            await asyncio.sleep(0)
        heard.extend(await asyncio.gather(page.steps.settled(), page.steps.settled(), return_exceptions=True))
        await step

    page.act(step_and_wait)
    assert any(words in str(one) for one in heard)
    assert (heard[0] is None) == (stops == 0)
    page.after = 0
    page.click("Y left mm", "+1")
    page.act(page.steps.settled)  # nothing goes on


def test_an_arm_that_something_else_moves_meanwhile_is_not_drawn_back(server: GuardedServer) -> None:
    page = Sticky(server)

    async def jogged(seconds: float) -> None:
        """Between two looks."""
        turned = np.radians([10.0, 0.0, 0.0, 0.0, 0.0])
        vars(page.snapshot).update(q=page.snapshot.q + turned, q_command=page.snapshot.q_command + turned)

    vars(page.steps)["_pause"] = jogged
    page.click("Y left mm", "+1")
    assert len(page.sent) == 1


def test_a_motion_that_is_stopped_ends_the_step(server: GuardedServer) -> None:
    page = Sticky(server)

    async def stopped(command: Command) -> Any:
        page.sent.append(command)
        await page.steps.step(np.array((0.0, 0.005, 0.0)))
        done = Future[None]()
        done.set_exception(StateError("stopped"))
        return SimpleNamespace(finished=done)

    vars(page)["submit"] = stopped  # and what was clicked meanwhile is dropped
    page.click("Y left mm", "−10")
    assert len(page.sent) == 1 and page.waited == 0.0


@pytest.mark.parametrize("heading_deg", [None, 30.0])
def test_steps_are_along_the_sheet_where_there_is_one(
    server: GuardedServer, heading_deg: float | None
) -> None:
    page = SteppedPage(server, ROBOT, HOME)
    heading = None if heading_deg is None else np.radians(heading_deg)
    steps = ToolSteps(page.session, heading=lambda: heading)
    page.act(steps.refresh)
    page.press("X ahead mm", "+10")
    page.press("Y left mm", "−3")
    moved = ROBOT.forward(page.snapshot.q_command)[:3, 3] - ROBOT.forward(HOME)[:3, 3]
    turned = (0.01, -0.003) if heading is None else (0.01016025, 0.00240192)
    np.testing.assert_allclose(moved, (*turned, 0.0), atol=1e-6)
    label = vars(page)["_handles"]["X ahead mm"].label
    assert label == ("X ahead mm" if heading is None else "X sheet mm")
    assert ("along the sheet" in page.html.rsplit("Clicks add up", 1)[0][-160:]) == (heading is not None)

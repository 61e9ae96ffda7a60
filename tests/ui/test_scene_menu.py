"""What is offered where the scene is pressed, and what it does."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.errors import InputError, UnreachableError
from armctl.program import LineStep, MoveStep, PointStep, Program
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.next_pose import NextPoses, PoseWriter
from armctl.ui.tabs.manual.program_ahead import ProgramAhead
from armctl.ui.tabs.manual.program_editor import ProgramEditor
from armctl.ui.tabs.manual.program_pins import ProgramPins
from armctl.ui.tabs.manual.scene_menu import SceneMenu, pressed_point
from armctl.ui.tabs.manual.shared_program import SharedProgram

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")
NO_PINS = np.empty((0, 3))
TIP = ROBOT.forward(HOME)[:3, 3]


@pytest.mark.parametrize("floor", [0.0, -0.8])
def test_the_floor_is_met_where_the_ray_passes_it(floor: float) -> None:
    random = np.random.default_rng(5)
    for _ in range(200):
        point = np.array([*random.uniform(-1, 1, 2), floor])
        eye = np.array([*random.uniform(-2, 2, 2), floor + random.uniform(0.1, 2)])
        met = pressed_point(eye, random.uniform(0.5, 3) * (point - eye), floor, NO_PINS, 0.01)
        assert met == pytest.approx(point)
    assert pressed_point(np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), floor, NO_PINS, 0.01) is None
    assert pressed_point(np.array([0, 0, 1.0]), np.array([1.0, 0, 1]), floor, NO_PINS, 0.01) is None


def test_a_pin_is_met_before_the_floor_the_nearest_first_and_none_behind() -> None:
    eye, near, far = np.array([1.0, 0, 0.5]), np.array([0.5, 0, 0.25]), np.array([0.25, 0, 0.125])
    pins = np.stack([far, near, np.array([1.5, 0, 0.75])])
    assert pressed_point(eye, near - eye, 0.0, pins, 0.01) == pytest.approx(near)
    beside = np.array([0.0, 0.02, 0.0])
    met = pressed_point(eye, near + beside - eye, 0.0, pins, 0.01)
    assert met is not None and met[2] == 0.0  # it passes both
    assert pressed_point(eye, near + 0.4 * beside - eye, 0.0, pins, 0.01) == pytest.approx(near)


class Bench:
    def __init__(self, server: GuardedServer) -> None:
        self.page = FakePage(server, ROBOT, HOME)
        self.page.require_operator = lambda: None  # type: ignore[attr-defined]
        self.page.name = "browser page 1"  # type: ignore[attr-defined]
        self.page.snapshot.program = None
        self.shared = SharedProgram("uzuner", Path("nowhere"))
        of_all = {NextPoses: self.page.console.shared(NextPoses), SharedProgram: self.shared}
        self.page.console.shared = lambda kind: of_all[kind]
        of_all[ProgramAhead] = ProgramAhead(self.page.console)
        self.editor = ProgramEditor(self.page.session)
        self.pins = ProgramPins(self.page.session, self.editor)
        self.menu = SceneMenu(self.page.session, self.editor, self.pins)

    def press(self, point: np.ndarray, left: float = 40.0, top: float = 50.0) -> None:
        """From straight above, with the right button."""
        self.say(f"{point[0]} {point[1]} 2 0 0 -1 {left} {top}")

    def say(self, value: str) -> None:
        self.page.act(lambda: self.page.parts.done("scene-press", "", value))

    def do(self, what: str) -> None:
        self.page.act(lambda: self.page.parts.done(what, ""))

    @property
    def text(self) -> str:
        return re.sub("<[^>]*>", "|", self.page.parts["menu"])


def test_it_stands_where_it_was_pressed_and_says_where_that_is(server: GuardedServer) -> None:
    bench = Bench(server)
    assert bench.text == ""
    bench.press(np.array([0.2, -0.05]), 123, 45)
    assert "X 200.0 &ensp;Y −50.0 &ensp;Z 0.0 mm" in bench.text
    assert "--left:123px;--top:45px" in bench.page.parts["menu"]
    bench.do("menu-leave")
    assert bench.text == ""
    bench.press(np.array([50.0, 0.0]))  # far beyond the arm's reach
    assert bench.text == ""


def test_above_it_is_the_next_pose_at_the_height_of_the_tool(server: GuardedServer) -> None:
    bench = Bench(server)
    bench.press(TIP[:2] + np.array([0.01, 0.02]))
    bench.do("menu-above")
    q = bench.page.next.q
    assert q is not None and bench.text == "" and not bench.page.sent
    assert ROBOT.forward(q)[:3, 3] == pytest.approx([TIP[0] + 0.01, TIP[1] + 0.02, TIP[2]], abs=1e-6)
    assert "pointed at in the scene" in bench.page.parts["next"]


def test_what_is_out_of_reach_says_why_and_leaves_no_menu(server: GuardedServer) -> None:
    bench = Bench(server)
    bench.press(np.array([0.9, 0.0]))
    with pytest.raises(UnreachableError, match="too far"):
        bench.do("menu-here")
    assert bench.text == "" and bench.page.next.q is None
    with pytest.raises(InputError, match="the menu is gone"):
        bench.do("menu-here")


def test_steps_are_added_where_it_was_pressed(server: GuardedServer) -> None:
    bench = Bench(server)
    for kind in ("point", "line"):
        bench.press(np.array([0.2123, 0.05]))
        bench.do(f"menu-{kind}")
    first, second = bench.shared.program.steps
    assert isinstance(first, PointStep) and isinstance(second, LineStep)
    assert (
        (first.x_mm, first.y_mm, first.z_mm) == (second.x_mm, second.y_mm, second.z_mm) == (212.3, 50.0, 0.0)
    )


def test_a_pin_that_is_pressed_is_the_place(server: GuardedServer) -> None:
    bench = Bench(server)
    aside = np.array([np.radians(20.0), *HOME[1:]])
    bench.shared.edit(
        Program(robot="uzuner", name="test", steps=(MoveStep(joints_deg=tuple(ROBOT.shown(aside).tolist())),))
    )
    tip, height = ROBOT.forward(aside)[:3, 3], f"Z {1000 * ROBOT.forward(aside)[2, 3]:.1f} mm"
    snapshot = bench.page.session.snapshot
    bench.page.act(lambda: bench.pins.refresh(snapshot, shown=True))  # it is worked out
    bench.page.act(lambda: bench.pins.refresh(snapshot, shown=True))
    bench.press(tip[:2])
    assert height in bench.text
    bench.do("menu-here")
    assert bench.page.next.q is not None
    assert ROBOT.forward(bench.page.next.q)[:3, 3] == pytest.approx(tip, abs=1e-6)
    bench.page.act(lambda: bench.pins.refresh(snapshot, shown=False))
    bench.press(tip[:2])
    assert "Z 0.0 mm" in bench.text  # nobody sees a pin there


@pytest.mark.parametrize("value", ["", "1 2 3", "0 0 1 0 0 0 1 1", "nan 0 1 0 0 -1 1 1", "x 0 1 0 0 -1 1 1"])
def test_what_no_page_says_is_refused(server: GuardedServer, value: str) -> None:
    bench = Bench(server)
    with pytest.raises(InputError):
        bench.say(value)
    assert bench.text == ""


@pytest.mark.parametrize("forgotten", [False, True])
def test_what_is_worked_out_overwrites_no_pose_that_was_written_later(
    server: GuardedServer, forgotten: bool
) -> None:
    bench = Bench(server)
    page: Any = bench.page
    other = PoseWriter(bench.page.session, "somebody")
    there = HOME + np.radians([20.0, 0, 0, 0, 0])
    page.act(lambda: other.show(HOME + 0.1))

    def later() -> None:
        other.show(there)
        if forgotten:
            page.next.clear()

    out = page.work_out

    async def work_out(*given: Any, undo: object = None) -> object:
        found = await out(*given, undo=undo)
        later()
        return found

    page.work_out = work_out
    bench.press(TIP + np.array([0.02, 0.01, 0.0]))
    bench.do("menu-here")
    at_the_menu = page.next.q
    bench.press(TIP)
    bench.do("menu-point")

    def choose() -> None:
        bench.editor.choose(0)  # worked out when ``later`` is over
        later()

    page.act(choose)
    for q in (at_the_menu, page.next.q):
        assert q is None if forgotten else q is not None and np.array_equal(q, there)
    page.act(lambda: bench.editor.choose(0))
    assert page.next.writer is not None and page.next.writer.words == "step 1"


def test_the_newer_of_two_places_is_shown_whichever_is_worked_out_first(server: GuardedServer) -> None:
    bench, first_is_out = Bench(server), asyncio.Event()
    page: Any = bench.page
    out, works = page.work_out, list[object]()

    async def work_out(*given: Any) -> object:
        works.append(given)
        found = await out(*given)
        if len(works) == 1:
            await first_is_out.wait()
        return found

    page.work_out = work_out
    older, newer = TIP + np.array([0.02, 0.01, 0.0]), TIP + np.array([-0.01, 0.03, 0.0])

    async def press_twice() -> None:
        await page.parts.done("scene-press", "", f"{older[0]} {older[1]} 2 0 0 -1 40 50")
        first = asyncio.create_task(page.parts.done("menu-above", ""))
        while not works:
            await asyncio.sleep(0)
        await page.parts.done("scene-press", "", f"{newer[0]} {newer[1]} 2 0 0 -1 40 50")
        await page.parts.done("menu-above", "")
        first_is_out.set()
        await first

    page.act(press_twice)
    assert ROBOT.forward(page.next.q)[:2, 3] == pytest.approx(newer[:2], abs=1e-6)

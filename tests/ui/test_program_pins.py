"""Where the steps of a program lead, as pins in the scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike
from tests.ui.page_kit import FakePage

from armctl.program import MoveStep, Program, Step, WaitStep
from armctl.program.rehearsal import rehearse
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.next_pose import NextPoses
from armctl.ui.tabs.manual.program_ahead import ProgramAhead
from armctl.ui.tabs.manual.program_editor import ProgramEditor
from armctl.ui.tabs.manual.program_pins import ProgramPins, path_of, pins_of
from armctl.ui.tabs.manual.shared_program import SharedProgram

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


def to(degrees: float) -> Step:
    return MoveStep(joints_deg=(degrees, *ROBOT.shown(HOME).tolist()[1:]))


def program(*steps: Step) -> Program:
    return Program(robot="uzuner", name="test", steps=steps)


def test_steps_that_lead_to_one_place_share_a_pin_and_what_moves_nothing_has_none() -> None:
    found = rehearse(ROBOT, program(to(20), WaitStep(seconds=1), to(-20), to(20)), HOME)
    pins = pins_of(ROBOT, found)
    assert [pin.label for pin in pins] == ["1, 4", "3"]
    for pin, degrees in zip(pins, (20, -20), strict=True):
        q = np.array([np.radians(degrees), *HOME[1:]])
        assert pin.point == pytest.approx(ROBOT.forward(q)[:3, 3])
    path = path_of(ROBOT, found)
    assert np.abs(path[0] - ROBOT.forward(HOME)[:3, 3]).max() < 1e-9
    assert np.linalg.norm(path[:, :2], axis=1) == pytest.approx(np.linalg.norm(path[0, :2]))  # an arc


def test_a_thousand_steps_are_no_more_points_than_can_be_drawn() -> None:
    found = rehearse(ROBOT, program(*(to(i % 40) for i in range(1, 301))), HOME)
    assert len(path_of(ROBOT, found)) <= 2400


class Bench:
    def __init__(self, server: GuardedServer) -> None:
        self.page = FakePage(server, ROBOT, HOME)
        self.shared = SharedProgram("uzuner", Path("nowhere"))
        of_all = {NextPoses: self.page.console.shared(NextPoses), SharedProgram: self.shared}
        self.page.console.shared = lambda kind: of_all[kind]
        of_all[ProgramAhead] = ProgramAhead(self.page.console)
        self.editor = ProgramEditor(self.page.session)
        self.pins = ProgramPins(self.page.session, self.editor)

    def see(self, *, shown: bool = True) -> None:
        for _ in range(2):
            self.page.act(lambda: self.pins.refresh(self.page.session.snapshot, shown=shown))

    def click(
        self,
        at: ArrayLike,
        eye: ArrayLike = (2.0, 0.3, 0.9),
        along: ArrayLike | None = None,
    ) -> bool:
        """At a point [m], from ``eye`` [m], or along another ray from there; whether it was a pin's."""
        origin = np.array(eye, dtype=np.float64)
        ray = np.array(at, dtype=np.float64) - origin if along is None else np.array(along)
        took: list[bool] = []
        self.page.act(lambda: took.append(self.pins.click(origin, ray / np.linalg.norm(ray))))
        return took[0]

    @property
    def drawn(self) -> int:
        return len(self.pins._nodes)


def test_they_come_and_go_with_the_program_and_the_choice(server: GuardedServer) -> None:
    bench = Bench(server)
    bench.see()
    assert bench.drawn == 0
    bench.shared.edit(program(to(20), to(-20)))
    bench.see()
    assert bench.drawn == 4  # a ball and a number each
    bench.see(shown=False)
    assert bench.drawn == 0
    bench.see()
    bench.shared.edit(program())
    bench.see()
    assert bench.drawn == 0


def test_a_click_selects_the_steps_of_a_place_one_after_the_other(server: GuardedServer) -> None:
    bench = Bench(server)
    bench.shared.edit(program(to(20), to(-20), to(20)))
    bench.see()
    found = bench.page.console.shared(ProgramAhead).rehearsal
    pins = pins_of(ROBOT, found)
    bench.editor.select(1)
    chosen: list[int] = []
    for _ in range(3):
        assert bench.click(pins[0].point)
        chosen.append(bench.editor.selected)
        assert bench.page.next.q == pytest.approx(np.array([np.radians(20), *HOME[1:]]))
    assert chosen == [0, 2, 0]
    bench.shared.edit(program(to(20)))
    assert bench.click(pins[1].point)  # its step has gone, and the pin will
    assert bench.editor.selected == 0


def test_a_click_beside_the_pins_or_while_they_are_hidden_is_for_others(server: GuardedServer) -> None:
    bench = Bench(server)
    bench.shared.edit(program(to(20), to(-20)))
    bench.see()
    found = bench.page.console.shared(ProgramAhead).rehearsal
    near, far = (np.array(pin.point) for pin in pins_of(ROBOT, found))
    assert not bench.click(near + 0.03)
    assert bench.click(far, eye=near + (near - far)) and bench.editor.selected == 0  # the nearer one
    assert not bench.click(near, eye=2 * near - far + 9.0, along=(0.0, 0.0, 1.0))  # behind the eye
    bench.see(shown=False)
    assert not bench.click(near)

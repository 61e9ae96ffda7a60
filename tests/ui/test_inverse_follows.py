"""Inverse: the fields follow the arm until they are edited; no answer stays beside fields of another."""

from __future__ import annotations

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts import State
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.inverse.screen import InverseScreen

ROBOT = load_robot("uzuner")
HOME, REST = ROBOT.pose("home"), ROBOT.pose("rest")


@pytest.fixture
def page(server: GuardedServer) -> FakePage:
    server.gui.reset()
    return FakePage(server, ROBOT, HOME)


def fields_m(screen: InverseScreen) -> FloatArray:
    return screen._form.point.xyz.array


def stand_at(page: FakePage, screen: InverseScreen, q: FloatArray, state: State = State.HOLDING) -> None:
    page.snapshot.q_command, page.snapshot.state = q, state
    page.refresh(screen)


def test_fields_follow_until_they_are_edited_and_again_when_filled(page: FakePage) -> None:
    screen = InverseScreen(page.session)
    stand_at(page, screen, REST, State.MOVING)
    assert fields_m(screen) == pytest.approx(ROBOT.forward(HOME)[:3, 3])  # not while it moves
    stand_at(page, screen, REST)
    assert fields_m(screen) == pytest.approx(ROBOT.forward(REST)[:3, 3])
    page.put("X mm", "200")
    stand_at(page, screen, HOME)
    assert fields_m(screen)[0] == pytest.approx(0.2)
    page.press("present position")
    for q in (REST, HOME):
        stand_at(page, screen, q)
        assert fields_m(screen) == pytest.approx(ROBOT.forward(q)[:3, 3])
    page.press("Solve")  # the answer is of these fields: they stay
    stand_at(page, screen, REST)
    assert fields_m(screen) == pytest.approx(ROBOT.forward(HOME)[:3, 3])


def test_after_a_refused_solve_no_answer_is_left(page: FakePage) -> None:
    InverseScreen(page.session)
    page.ask(220, -196, 85)
    page.press("Solve")
    assert page.parts["ways"] and page.next.q is not None
    page.put("X mm", "12,5")
    with pytest.raises(InputError, match="'12,5' is not a number"):
        page.press("Solve")
    assert not page.parts["ways"] and page.next.q is None
    assert "&#x27;12,5&#x27; is not a number" in page.html and not page.is_visible("Row")
    page.put("Least energy is", "least-travel")  # does not bring it back
    assert not page.parts["ways"] and page.next.q is None
    page.put("X mm", "220")
    page.press("Solve")
    assert page.parts["ways"] and page.next.q is not None
    assert np.abs(ROBOT.forward(page.next.q)[:3, 3] - [0.22, -0.196, 0.085]).max() < 1e-9


def test_the_ghost_is_hidden_while_the_fields_are_not_those_of_the_answer(page: FakePage) -> None:
    screen = InverseScreen(page.session)
    page.ask(220, -196, 85)
    page.press("Solve")
    page.put("Row", "3001")
    row = page.next.q
    page.put("X mm", "200")
    page.refresh(screen)
    assert row is not None and page.next.q is None
    page.put("X mm", "220")
    page.refresh(screen)
    assert page.next.q is not None and np.array_equal(page.next.q, row)

"""What a Go button sends is the very configuration that the ghost shows."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.errors import UnreachableError
from armctl.kinematics import CRITERIA
from armctl.protocol import MoveJoints
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.forward.figures import LAST, REFERENCE
from armctl.ui.tabs.forward.screen import ForwardScreen
from armctl.ui.tabs.inverse.screen import InverseScreen

ROBOT = load_robot("uzuner")
HOME, REST = ROBOT.pose("home"), ROBOT.pose("rest")
LEAST, SELECTED = "Go by least energy", "Go by the selected one"


@pytest.fixture
def page(server: GuardedServer) -> FakePage:
    return FakePage(server, ROBOT, HOME)


def sent(page: FakePage) -> np.ndarray:
    """The configuration of the last command, which the ghost showed at that moment."""
    command, shown = page.sent[-1], page.shown_at_sending[-1]
    assert isinstance(command, MoveJoints)
    assert shown is not None and page.next.q is not None
    assert np.array_equal(command.q, shown)
    assert np.array_equal(command.q, page.next.q)
    return command.q


@pytest.mark.parametrize("criterion", CRITERIA)
def test_least_energy_sends_its_ghost_and_solves_once(
    page: FakePage, criterion: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    InverseScreen(page.session)
    page.ask(220, -196, 85)
    page.put("Least energy is", criterion)
    page.press("Solve")
    shown = page.next.q
    monkeypatch.setattr("armctl.ui.tabs.inverse.screen.solve", None)  # nothing is solved again
    page.press(LEAST)
    assert shown is not None and np.array_equal(sent(page), shown)
    assert shown == pytest.approx(ROBOT.inverse([0.22, -0.196, 0.085]).best(criterion, HOME))


def test_least_energy_shows_its_ghost_again_where_a_row_was_shown(page: FakePage) -> None:
    InverseScreen(page.session)
    page.ask(220, -196, 85)
    page.press("Solve")
    best = page.next.q
    page.put("Row", "3001")
    row = page.next.q
    assert best is not None and row is not None and not np.array_equal(row, best)
    page.press(SELECTED)
    assert np.array_equal(sent(page), row)
    page.press(LEAST)
    assert np.array_equal(sent(page), best)


def test_changed_fields_are_solved_and_shown_before_they_are_sent(page: FakePage) -> None:
    InverseScreen(page.session)
    page.ask(220, -196, 85)
    page.press(LEAST)  # nothing was solved before
    first = sent(page)
    page.put("X mm", "200")
    page.press(LEAST)
    assert 1000 * ROBOT.forward(sent(page))[:3, 3] == pytest.approx([200, -196, 85])
    assert not np.array_equal(sent(page), first)


def test_least_travel_is_solved_anew_where_the_arm_has_moved(page: FakePage) -> None:
    screen = InverseScreen(page.session)
    page.put("Least energy is", "least-travel")
    page.ask(150, 150, 200)
    page.press("Solve")
    before = page.next.q
    away = np.radians([-80.0, 30.0, 60.0, 20.0, 0.0])
    page.snapshot.q_command = away
    page.refresh(screen)
    page.press(LEAST)
    expected = ROBOT.inverse([0.15, 0.15, 0.2]).best("least-travel", away)
    assert sent(page) == pytest.approx(expected)
    assert before is not None and not np.array_equal(sent(page), before)


def test_a_point_out_of_reach_is_refused_in_the_words_of_the_result(page: FakePage) -> None:
    InverseScreen(page.session)
    page.ask(900, 0, 100)
    for _ in range(2):  # solved by the button, and then known
        with pytest.raises(UnreachableError, match=re.escape("too far by 572.2 mm")):
            page.press(LEAST)
    with pytest.raises(UnreachableError, match="there is no solution; the reason stands below"):
        page.press(SELECTED)
    assert page.sent == []


def test_forward_sends_its_ghost(page: FakePage) -> None:
    ForwardScreen(page.session)
    page.put("Base °", "12.5")
    asked = HOME + np.radians([12.5, 0, 0, 0, 0])
    assert page.next.q == pytest.approx(asked)
    page.press(REFERENCE)
    assert sent(page) == pytest.approx(asked)
    for joint in ROBOT.joints:
        page.put(f"{joint.title} °", "1")
    page.press(LAST)
    assert sent(page) == pytest.approx(HOME + np.radians(1.0))

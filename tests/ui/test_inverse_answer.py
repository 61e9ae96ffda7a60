"""The list of solutions, the energy curve and the result line."""

from __future__ import annotations

import numpy as np
import pytest

from armctl.kinematics import CRITERIA, Target
from armctl.robot import load_robot
from armctl.ui.tabs.inverse.answer import Answer, answer, answer_html, no_curve, solve
from armctl.ui.tabs.inverse.solution_table import PAGE_ROWS, short_branch
from armctl.ui.widgets.pager import FIRST, LAST, NEXT, PREVIOUS, turned

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


def solved(x: float, y: float, z: float, criterion: str = "least-rotation") -> Answer:
    return solve(ROBOT, Target.of(np.array([x, y, z]) / 1000), criterion, HOME)


def at_home() -> Answer:
    """The home pose asked for by position and pitch: its solutions are isolated."""
    pitch, _ = ROBOT.inverse_kinematics.pitch_and_roll(HOME)
    return solve(ROBOT, Target.of(ROBOT.forward(HOME)[:3, 3], pitch), "least-rotation", HOME)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_every_row_reaches_the_target_and_energies_rise(criterion: str) -> None:
    found = solved(220, -196, 85, criterion)
    table = found.table
    assert len(table) == 3520
    energies = [table.energy[table.order[row - 1]] for row in range(1, len(table) + 1)]
    assert (np.diff(np.nan_to_num(energies, posinf=1e9)) >= 0).all()
    for row in (1, 1760, 3520):
        tip = 1000 * ROBOT.forward(table.q(row))[:3, 3]
        assert tip == pytest.approx([220, -196, 85], abs=1e-9)


def test_pages_show_every_row_once() -> None:
    table = solved(220, -196, 85).table
    assert table.pages == 235
    for page in (0, 234):
        html = table.html(page, None)
        assert html.count("<tr") == 1 + min(PAGE_ROWS, 3520 - page * PAGE_ROWS)
    assert ">3520<" in table.html(234, None)
    assert table.html(0, 3).count("background") == 1
    assert "background" not in table.html(1, 3)


def test_the_last_page_may_be_short_and_an_empty_list_has_one_page() -> None:
    assert solved(900, 0, 100).table.pages == 1
    single = at_home().table
    assert 0 < len(single) < PAGE_ROWS
    assert single.html(0, 1).count("<tr") == 1 + len(single)


def test_the_result_counts_branches_and_says_where_least_energy_goes() -> None:
    html = answer_html(ROBOT, solved(220, -196, 85))
    assert "3520 solutions inside the limits" in html
    assert "front elbow-up: 1760; front elbow-down: 1760" in html
    assert "−42.402, 0.000, −0.678, −48.795, 0.000" in html
    assert "e-1" in html  # of the order of 1e-14 mm


def test_it_says_why_row_1_is_not_quite_the_exact_least() -> None:
    found = solved(124.685, 3.62, 267.54)
    assert found.best is not None
    exact, row_1 = (float(np.abs(np.degrees(q)).sum()) for q in (found.best, found.table.q(1)))
    assert 0.001 < row_1 - exact < 0.05
    html = answer_html(ROBOT, found)
    assert f"energy {exact:.3f}°; error" in html
    assert f"between two rows of the list (row 1: {row_1:.3f}°)" in html


@pytest.mark.parametrize("criterion", ["published", "least-travel", "least-torque"])
def test_where_the_list_itself_is_chosen_from_row_1_is_the_least(criterion: str) -> None:
    found = solved(220, -196, 85, criterion)
    assert found.best is not None
    assert found.table.q(1) == pytest.approx(found.best, abs=0)
    html = answer_html(ROBOT, found)
    assert "between two rows" not in html
    assert f"energy {found.table.energy_text(found.best)}" in html
    assert found.table.energy_of(found.best) == found.table.energy.min()


def test_an_isolated_solution_lies_between_no_rows() -> None:
    assert "between two rows" not in answer_html(ROBOT, at_home())


def test_the_published_criterion_gives_the_printed_row() -> None:
    assert "−42.402, 14.400, −45.909, −1.305" in answer_html(ROBOT, solved(220, -196, 85, "published"))


def test_an_unreachable_point_says_why_and_which_is_nearest() -> None:
    found = solved(900, 0, 100)
    html = answer_html(ROBOT, found)
    assert "No solution" in html and "Too far by 572.2 mm" in html and "nearest reachable point" in html
    assert found.best is None and found.curve is None
    nearest = found.solutions.nearest_m
    assert nearest is not None
    assert solve(ROBOT, Target.of(nearest), "least-rotation", HOME).solutions.success


def test_another_criterion_needs_no_new_solving() -> None:
    first = solved(220, -196, 85)
    again = answer(ROBOT, first.solutions, "least-travel", HOME)
    assert again.solutions is first.solutions
    assert again.best is not None and first.best is not None
    travel = [np.abs((q - HOME) / ROBOT.speed_limits).sum() for q in (again.best, first.best)]
    assert travel[0] <= travel[1]


@pytest.mark.parametrize("criterion", CRITERIA)
def test_the_curve_is_small_and_its_mark_is_its_lowest_point(criterion: str) -> None:
    found = solved(220, -196, 85, criterion)
    curve = found.curve
    assert curve is not None
    assert len(curve.x) <= 1001
    assert (np.diff(curve.x) > 0).all()
    *branches, mark = curve.lines
    assert np.isfinite(mark.y).sum() == 1
    lowest = min(np.nanmin(line.y) for line in branches)
    assert np.nanmin(mark.y) == pytest.approx(lowest, rel=2e-3)
    assert found.best is not None
    at = curve.x[np.isfinite(mark.y)][0]
    assert at == pytest.approx(np.degrees(found.best[1]), abs=0.006)


def test_isolated_solutions_have_no_curve() -> None:
    assert at_home().curve is None
    assert "1 isolated solution, no curve" in no_curve(at_home())
    assert no_curve(solved(900, 0, 100)) == "There is no solution."


def test_branch_names_are_shortened_for_the_list() -> None:
    assert short_branch("front elbow-up tool-in") == "front up in"


@pytest.mark.parametrize(
    ("page", "button", "leads_to"),
    [
        (0, FIRST, 0),
        (0, PREVIOUS, 0),
        (0, NEXT, 1),
        (3, LAST, 9),
        (9, NEXT, 9),
        (5, PREVIOUS, 4),
        (7, FIRST, 0),
    ],
)
def test_page_buttons(page: int, button: str, leads_to: int) -> None:
    assert turned(page, 10, button) == leads_to

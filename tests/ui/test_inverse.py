"""The Inverse tab: list of solutions, energy curve, result line, branches."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.sticks import of_sticks
from tests.ui.page_kit import FakePage

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics import CRITERIA, Target
from armctl.motion.choices import way_refused
from armctl.robot import Robot, load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.next_pose import PoseWriter
from armctl.ui.tabs.inverse.answer import RankedSolutions, answer, short_branch, solve
from armctl.ui.tabs.inverse.answer_html import comparison, count_html, details_html, list_row, notice_html
from armctl.ui.tabs.inverse.branches import branches_html, same_place
from armctl.ui.tabs.inverse.screen import InverseScreen
from armctl.ui.tabs.inverse.solution_list import rows_table
from armctl.ui.widgets.graph import Curves
from armctl.ui.widgets.html import Pager

ROBOT, MICO = load_robot("uzuner"), load_robot("mico")
HOME = ROBOT.pose("home")
TARGETS = range(12) if os.environ.get("ARMCTL_LONG") else (6, 8, 9)
"""of twelve poses: none can be gone to, the least energy can, another one can instead"""


def compared(found: RankedSolutions) -> str:
    """The table of a few rows, and what is told below it, as HTML."""
    text, heads, rows, words = comparison(found)
    return rows_table("some", heads, rows, None, words) + text


def solved(x: float, y: float, z: float, criterion: str = "least-rotation") -> RankedSolutions:
    return solve(ROBOT, Target.of(np.array([x, y, z]) / 1000), criterion, HOME)


def result_html(robot: Robot, found: RankedSolutions) -> str:
    """All that is told of an answer, but for the ways and the list."""
    return count_html(found) + notice_html(robot, found) + details_html(robot, found)


def at_home() -> RankedSolutions:
    """The home pose asked for by position and pitch: its solutions are isolated."""
    pitch, _ = ROBOT.inverse_kinematics.pitch_and_roll(HOME)
    return solve(ROBOT, Target.of(ROBOT.forward(HOME)[:3, 3], pitch), "least-rotation", HOME)


def test_the_list_and_the_result_name_branches_and_energy() -> None:
    found = solved(220, -196, 85)
    first, last = list_row(found, 1), list_row(found, 3520)
    assert (first[0], last[0]) == ("1", "3520") and float(first[-1]) < float(last[-1])
    assert first[6] in ("front up", "front down") and len(first) == 8
    html = result_html(ROBOT, found)
    assert "front elbow-up: 1760; front elbow-down: 1760" in html
    assert "−42.402, 0.000, −0.678, −48.795, 0.000" in html
    assert "error below 0.001 mm" in html


@pytest.mark.parametrize("criterion", CRITERIA)
def test_energies_rise_and_row_1_is_the_least_or_it_is_said_why_not(criterion: str) -> None:
    found = solved(220, -196, 85, criterion)
    assert len(found.solutions) == 3520
    assert (np.diff(np.nan_to_num(found.energy[found.order], posinf=1e9)) >= 0).all()
    for row in (1, 1760, 3520):
        tip = 1000 * ROBOT.forward(found.q(row))[:3, 3]
        assert tip == pytest.approx([220, -196, 85], abs=1e-9)
    assert found.best is not None
    html = result_html(ROBOT, found)
    assert f"energy {found.energy_text(found.best)}; error" in html
    if criterion not in ("least-rotation", "least-travel", "shortest-time"):  # better than the list
        assert np.array_equal(found.q(1), found.best) and "between two rows" not in html
    if criterion == "published":
        assert "−42.402, 14.400, −45.909, −1.305" in html
    found = solved(124.685, 3.62, 267.54)
    assert found.best is not None
    exact, row_1 = (float(np.abs(np.degrees(q)).sum()) for q in (found.best, found.q(1)))
    assert 0.001 < row_1 - exact < 0.05
    assert f"between two rows of the list (row 1: {row_1:.3f}°)" in result_html(ROBOT, found)
    alone = at_home()  # an isolated solution
    assert "between two rows" not in result_html(ROBOT, alone)
    assert short_branch("front elbow-up tool-in") == "front up in"
    assert str(alone.curve).startswith("1 isolated solution; Wrist roll may have any angle, but only turns")


@pytest.mark.parametrize("criterion", ["least-rotation", "least-torque"])
def test_a_few_rows_stand_for_all_and_what_they_save_is_true(criterion: str) -> None:
    found = solved(220, -196, 85, criterion)
    first, *others = found.representatives
    assert first.row == 1 and len({one.row for one in found.representatives}) == len(others) + 1
    names = [name for one in found.representatives for name in one.names]
    criteria = {"rotation", "as published", "travel", "time", "torque"}
    assert criteria | {"of front up", "of front down"} == set(names)
    gravity = found.solutions.arm.energy.gravity
    for one in found.representatives:
        q = found.q(one.row)
        assert one.costs.rotation_deg == pytest.approx(np.degrees(np.abs(q).sum()))
        stall = found.solutions.arm.energy.stall_torque
        assert stall is not None and one.costs.load == pytest.approx(
            100 * np.linalg.norm(gravity.torque(q) / stall)
        )
    said = re.findall(r"Row (\d+) saves (\d+) % ([\w ]+) against row 1\.", compared(found))
    of = {"rotation": "rotation_deg", "time": "time_s", "load": "load"}
    assert said
    for row, percent, what in said:
        best = min(getattr(one.costs, of[what]) for one in found.representatives)
        assert best == next(
            getattr(one.costs, of[what]) for one in found.representatives if one.row == int(row)
        )
        assert int(percent) == round(100 * (1 - best / getattr(first.costs, of[what])))
    curve = found.curve
    assert isinstance(curve, Curves)
    angle = float(curve.x[len(curve.x) // 3])
    row = found.row_at(np.radians(angle))
    assert np.degrees(found.q(row)[1]) == pytest.approx(angle, abs=0.006)


def test_where_the_arm_stands_saves_no_time_and_one_refused_row_is_enough_to_speak_of() -> None:
    found = solve(ROBOT, Target.of(ROBOT.forward(HOME)[:3, 3]), "least-rotation", HOME)
    html = compared(found)
    assert ">0.00<" in html and "saves 100 %" not in html and not found.ways.refuse_some
    robot = load_robot("ur5")
    home = robot.pose("home")
    T = robot.forward(home)
    found = solve(robot, Target.of(T[:3, 3], rotation=T[:3, :3]), "least-rotation", home)
    assert not found.way_refused and ">refused<" in compared(found) and found.ways.refuse_some


def test_rows_that_the_arm_may_not_go_to_are_called_refused_and_recommended_never() -> None:
    robot = load_robot("ur5")
    home, rng = robot.pose("home"), np.random.default_rng(1)
    seen, instead = set[bool](), list[str]()
    for q in rng.uniform(*robot.limits.T, (12, robot.n))[list(TARGETS)]:
        T = robot.forward(q)
        found = solve(robot, Target.of(T[:3, 3], rotation=T[:3, :3]), "least-rotation", home)
        rows, html, said = (
            found.representatives,
            compared(found),
            result_html(robot, found),
        )
        for one in rows:
            refused = bool(way_refused(robot, home, "cubic", found.q(one.row)))
            assert one.refused is refused and one.label.endswith("(refused)") is refused
            seen.add(refused)
        if len(rows) > 1:
            assert html.count(">refused<") == sum(one.refused for one in rows)
        for row in re.findall(r"Row (\d+) saves", html):
            assert not rows[0].refused
            assert not next(one.refused for one in rows if one.row == int(row))
        refused, others = bool(found.way_refused), [one.row for one in rows if not one.refused]
        assert ("The way there is refused: " in said) is ("least energy would go to" in said) is refused
        told = re.findall(r"goes to row (\d+) instead", said)
        assert len(told) <= refused and (told or not others or not refused)
        assert found.best is None or told or found.next is found.best
        for row in map(int, told):  # none before it, and it may be none of the few
            np.testing.assert_array_equal(found.next, found.q(row))
            assert row <= min(others, default=row)
            ways = [bool(way_refused(robot, home, "cubic", found.q(k + 1))) for k in range(min(row, 12))]
            assert ways == [k + 1 != row for k in range(len(ways))]
        instead += told
    assert seen == {True, False} and instead


def test_ways_are_judged_by_the_motion_that_is_sent() -> None:
    """Joint by joint the arm takes another way than all joints together."""
    robot = load_robot("ur5")
    home = robot.pose("home")

    def judged(goal: FloatArray) -> list[bool]:
        return [bool(way_refused(robot, home, profile, goal)) for profile in ("cubic", "normal")]

    # from the first one on whose two ways are judged differently
    goals = np.random.default_rng(0).uniform(*robot.limits.T, (150, robot.n))[59:]
    T = robot.forward(next(goal for goal in goals if len({*judged(goal)}) == 2))
    for profile in ("cubic", "normal"):
        found = solve(robot, Target.of(T[:3, 3], rotation=T[:3, :3]), "least-rotation", home, profile)
        for one in found.verdicts:
            assert one.refused == way_refused(robot, home, profile, one.branch.q)
        for one in found.representatives:
            assert one.refused == bool(way_refused(robot, home, profile, found.q(one.row)))


def test_a_selected_row_whose_way_is_refused_says_so(server: GuardedServer) -> None:
    page = FakePage(server, of_sticks(ROBOT), HOME)
    InverseScreen(page.session)
    page.ask(108.9, -39.6, -25.6)
    page.press("Solve")
    assert "least energy would go to" in page.html and "below the floor" in page.html
    assert "selected row 1: would go to" in page.html and page.html.count("The way there is refused: ") == 2
    page.put("Row", "301")
    assert "selected row 301: would go to" in page.html and page.html.count("The way there is refused: ") == 2
    page.put("Z mm", "100")
    page.press("Solve")
    assert "selected row 1: will go to" in page.html and "is refused: " not in page.html
    page.put("Z mm", "-25.6")
    page.press("Go by least energy")  # solves first; here nothing is refused, as the controller would do
    assert "selected row 1: would go to" in page.html and page.html.count("The way there is refused: ") == 2
    page.put("Row", "301")
    page.press("Go by the selected one")
    assert "selected row 301: would go to" in page.html


def test_what_is_refused_is_told_of_the_pose_at_solving(server: GuardedServer) -> None:
    page = FakePage(server, of_sticks(ROBOT), HOME)
    screen = InverseScreen(page.session)
    page.ask(108.9, -39.6, -25.6)
    page.press("Solve")
    screen.refresh(page.snapshot)
    note = "The arm has moved since: press Solve to judge the ways anew."
    assert note not in page.parts["ways-line"]
    page.snapshot.q_command = HOME + 0.01
    screen.refresh(page.snapshot)
    assert note in page.parts["ways-line"]
    page.press("Solve")
    screen.refresh(page.snapshot)
    assert note not in page.parts["ways-line"]
    page.put("Movement", "Normal movement")
    page.ask(220, -196, 85)
    page.press("Solve")
    assert "will go to" in page.html
    page.snapshot.q_command = HOME
    screen.refresh(page.snapshot)
    assert note not in page.parts["ways-line"]  # nothing was refused


def test_a_chosen_representative_and_a_place_on_the_curve_are_what_is_sent(server: GuardedServer) -> None:
    page = FakePage(server, ROBOT, HOME)
    InverseScreen(page.session)
    page.ask(220, -196, 85)
    page.press("Solve")
    few = next(one for one in solved(220, -196, 85).representatives if "time" in one.names)
    assert f"data-key={few.row} " in page.parts["compared-solutions"]
    page.act(lambda: page.parts.done("solution", str(few.row)))
    shown = page.next.q
    page.press("Go by the selected one")
    assert shown is not None and np.array_equal(page.shown_at_sending[-1], shown)
    page.put("On the curve °", 5.0)
    assert page.next.q is not None and np.degrees(page.next.q[1]) == pytest.approx(5.0, abs=0.006)
    page.press("Back to the least")
    assert page.next.q == pytest.approx(solved(220, -196, 85).q(1))
    curve = solved(220, -196, 85).curve
    assert not isinstance(curve, str)
    page.act(lambda: page.parts.done("curve-at", "", "250"))
    assert page.next.q is not None
    a_quarter = 0.75 * curve.x[0] + 0.25 * curve.x[-1]
    assert np.degrees(page.next.q[1]) == pytest.approx(a_quarter, abs=0.006)
    assert page.reads("On the curve °") == pytest.approx(a_quarter, abs=0.006)


def test_targets_that_are_overtaken_while_they_wait_are_not_solved(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = FakePage(server, ROBOT, HOME)
    InverseScreen(page.session)
    page.ask(220, -196, 85)
    solves: list[Target] = []

    def counted(robot: Robot, target: Target, *others: Any) -> RankedSolutions:
        solves.append(target)
        return solve(robot, target, *others)

    monkeypatch.setattr("armctl.ui.tabs.inverse.screen.solve", counted)
    page.press("Solve", times=9)
    assert len(solves) == 2
    assert page.next.q == pytest.approx(solved(220, -196, 85).q(1))


def test_an_answer_overwrites_no_pose_that_was_written_after_it_was_asked_for(server: GuardedServer) -> None:
    page = FakePage(server, ROBOT, HOME)
    InverseScreen(page.session)
    page.ask(220, -196, 85)
    other, there, out = PoseWriter(page.session, "somebody"), HOME + 0.1, page.work_out

    async def work_out(*given: Any, undo: object = None) -> Any:
        other.show(there)
        return await out(*given, undo=undo)

    page.work_out = work_out  # type: ignore[method-assign]
    with pytest.raises(InputError, match="the next pose was changed while it was solved"):
        page.press("Go by least energy")  # it is not what would be seen to be sent
    assert not page.sent and np.array_equal(page.next.q, there)
    page.press("Solve")
    assert "front elbow-up: 1760" in page.html
    assert page.next.q is not None and np.array_equal(page.next.q, there)
    page.press("Go by least energy")  # this is what was asked for last
    assert page.shown_at_sending[-1] == pytest.approx(solved(220, -196, 85).q(1))


@pytest.mark.parametrize(("name", "unit"), [("uzuner", "% of stall"), ("ar4", "N·m")])
def test_loads_are_shown_in_percent_of_the_stall_torques_or_in_newton_metres(name: str, unit: str) -> None:
    robot = load_robot(name)
    home = robot.pose("home")
    found = solve(robot, Target.of(robot.forward(home)[:3, 3]), "least-torque", home)
    torque, stall = robot.energy.gravity.torque(found.q(1)), robot.energy.stall_torque
    load = np.linalg.norm(torque) if stall is None else 100 * np.linalg.norm(torque / stall)
    assert found.unit == unit
    assert found.energy[found.order[0]] == pytest.approx(load)
    assert list_row(found, 1)[-1] == f"{load:.3f}"
    counted = {"uzuner": "links of 0.7 kg and a payload of 0.15 kg", "ar4": "links of 2.12 kg and"}
    assert f"Torques count {counted[name]}" in result_html(robot, found)
    by_rotation = solve(robot, found.solutions.target, "least-rotation", home)
    assert "Torques count" not in result_html(robot, by_rotation)


def test_torques_are_not_compared_where_no_mass_is_known() -> None:
    bare = replace(ROBOT, gravity=replace(ROBOT.gravity, bodies=()))
    point = Target.of(np.array([0.220, -0.196, 0.085]))
    for robot, told in ((ROBOT, True), (bare, False)):
        found = solve(robot, point, "least-rotation", HOME)
        assert any("torque" in one.names for one in found.representatives) == told
        html = compared(found)
        assert ("load % of stall" in html) == ("Loads count links of 0.7 kg" in html) == told
        assert ("gives no masses of links" in html) != told


def test_least_torque_is_offered_only_where_masses_are_known(server: GuardedServer) -> None:
    bare = replace(ROBOT, gravity=replace(ROBOT.gravity, bodies=()))
    for robot, offered in ((ROBOT, CRITERIA), (bare, CRITERIA[:-1])):
        page = FakePage(server, robot, HOME)
        InverseScreen(page.session)
        assert tuple(page.options("Least energy is")) == offered


def test_an_unreachable_point_says_why_and_which_is_nearest() -> None:
    found = solved(900, 0, 100)
    html = result_html(ROBOT, found)
    assert "No solution" in html and "Too far by 572.2 mm" in html and "nearest reachable point" in html
    assert found.best is None and found.curve == "There is no solution."
    nearest = found.solutions.nearest_m
    assert nearest is not None
    assert solve(ROBOT, Target.of(nearest), "least-rotation", HOME).solutions.success


def test_what_is_below_the_floor_is_said_before_anything_is_pressed() -> None:
    below = result_html(ROBOT, solved(200, 0, -20))
    assert "will go to" not in below and "The point is below the floor" in below
    nearest = result_html(ROBOT, solved(200, 0, -80))
    assert "No solution" in nearest and "The nearest point is below the floor" in nearest
    assert "below the floor" not in result_html(ROBOT, solved(200, 0, 100))


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
    assert isinstance(curve, Curves)
    assert len(curve.x) <= 1001
    assert (np.diff(curve.x) > 0).all()
    (least,) = curve.marks
    lowest = min(np.nanmin(line.y) for line in curve.lines)
    assert lowest * (1 - 2e-3) <= least.y <= lowest + 1e-9
    assert found.best is not None
    assert least.x == pytest.approx(np.degrees(found.best[1]))


def answered(*point_mm: float) -> RankedSolutions:
    return solve(MICO, Target.of(np.array(point_mm) / 1000), "least-rotation", MICO.pose("home"))


def test_the_one_of_least_energy_is_chosen_and_limits_and_the_floor_refuse() -> None:
    found = answered(300, 0, 100)
    assert [one.number for one in found.verdicts] == [1, 2, 3, 4]
    up, down = (one for one in found.verdicts if one.branch.name.startswith("front"))
    assert up.chosen and not up.refused
    assert down.refused.startswith("Shoulder needs 82.14°") and down.label == "2: refused"
    html = branches_html(found)
    assert "2 is refused: Shoulder needs 82.14°" in html
    assert "1 is chosen among the possible ones: the least energy by least-rotation" in html
    low = answered(350, 0, -30)
    assert any("floor" in one.refused for one in low.verdicts if not one.branch.forbidden)


def test_branches_that_look_alike_and_no_branches() -> None:
    found = answered(0, 0, 700)
    groups = [[one.number for one in group] for group in same_place(MICO, found.verdicts)]
    assert groups == [[1, 3], [2, 4]] or groups == [[1, 4], [2, 3]]
    chosen = next(one for one in found.verdicts if one.chosen)
    assert np.degrees(chosen.branch.q[:3]).round(3).tolist() == [0.0, -131.626, -5.532]
    assert "leaves joints free" in branches_html(solved(200, 0, 100))
    assert answered(500, 0, 700).verdicts == ()


def test_that_there_are_no_branches_is_said_with_the_true_reason() -> None:
    def said(name: str, *point: float, pitch: float | None = None, rotation: object = None) -> str:
        robot = load_robot(name)
        target = Target.of(point, pitch, None, None if rotation is None else np.asarray(rotation))
        return branches_html(solve(robot, target, "least-rotation", robot.pose("home")))

    assert "leaves joints free" in said("ur5", 0.3, 0.2, 0.3, pitch=-0.5)
    uarm = load_robot("uarm")
    there = uarm.forward(uarm.pose("home"))[:3, 3]
    assert "No branch meets this target" in said("uarm", *there, pitch=0.3)  # the point can be reached
    back = [[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]
    assert "No branch has this orientation" in said("ur5", 0.85, 0.3, 0.1, rotation=back)


def test_the_nearest_point_is_offered_only_where_it_is_another_one(server: GuardedServer) -> None:
    page = FakePage(server, MICO, MICO.pose("home"))
    InverseScreen(page.session)
    for use_pitch, x_mm, offered in ((True, "300", False), (False, "1000", True), (False, "300", False)):
        page.put("Use pitch", use_pitch)
        page.ask(x_mm, 0, 100)
        page.press("Solve")
        assert page.is_visible("Take nearest point") == offered


def test_the_branch_of_least_energy_is_shown_as_it_is_sent_and_may_be_refused() -> None:
    robot = load_robot("ur5")
    start = np.radians([200.0, -90.0, 90.0, -90.0, -90.0, 300.0])
    T = robot.forward(start + 0.05)
    found = solve(robot, Target.of(T[:3, 3], rotation=T[:3, :3]), "least-travel", start)
    chosen = next(one for one in found.verdicts if one.chosen)
    assert found.best is not None and np.abs(chosen.branch.q - found.best).max() < 1e-6
    assert all(found.energy_of(chosen.branch.q) <= found.energy_of(one.branch.q) for one in found.verdicts)
    T = robot.forward(np.radians([20.0, 30.0, 10.0, -20.0, 50.0, 0.0]))  # below the floor
    found = solve(robot, Target.of(T[:3, 3], rotation=T[:3, :3]), "least-rotation", start)
    least = next(one for one in found.verdicts if one.chosen)
    assert "floor" in least.refused
    assert f"{least.number} has the least energy by least-rotation." in branches_html(found)
    assert "is chosen among the possible ones" not in branches_html(found)


@pytest.mark.parametrize(
    ("row", "button", "leads_to"),
    [(1, "Prev", 0), (1, "Next", 1), (50, "Last", 9), (150, "Next", 9), (80, "Prev", 4), (120, "First", 0)],
)
def test_page_buttons_and_rows(server: GuardedServer, row: int, button: str, leads_to: int) -> None:
    page = FakePage(server, ROBOT, HOME)
    pager = Pager(page.gui, page.on, lambda: None)

    def rows() -> list[str]:
        return re.findall(r"row (\d+)<", pager.html("about it", [], lambda number: [f"row {number}"]))

    pager.reset(150, row)
    page.press("Page", button)
    assert rows() == [str(15 * leads_to + k) for k in range(1, 16)]
    assert pager.row == row
    page.put("Row", "149")
    html = pager.html("about it", [], lambda number: [f"row {number}"])
    assert "page 10 of 10 · about it" in html and html.count("background") == 1
    page.put("Row", "151")
    assert pager.row is None
    pager.reset(3, None)
    assert rows() == ["1", "2", "3"]


def test_a_row_of_the_list_is_selected_by_a_click_and_the_list_is_sorted_by_a_joint(
    server: GuardedServer,
) -> None:
    page = FakePage(server, ROBOT, HOME)
    InverseScreen(page.session)
    page.ask(220, -196, 85)
    page.press("Solve")
    found = solved(220, -196, 85)
    page.act(lambda: page.parts.done("solution", "7"))
    assert page.next.q == pytest.approx(found.q(7)) and "selected row 7" in page.html
    for key in ("0", "3521", "-1", "x"):  # no page of armctl's sends these
        page.act(lambda key=key: page.parts.done("solution", key))
    assert page.next.q == pytest.approx(found.q(7))

    def listed() -> list[int]:
        return [
            int(row) for row in re.findall(r"<tr role=option[^>]* data-key=(\d+)", page.parts["solutions"])
        ]

    assert listed() == [*range(1, 16)]
    page.act(lambda: page.parts.done("sort-solutions", "2"))
    shoulder = found.q(np.arange(1, 3521))[:, 1]
    assert np.all(np.diff(found.q(np.array(listed()))[:, 1]) >= 0)
    assert found.q(listed()[0])[1] == shoulder.min() and "by Shoulder" in page.parts["solutions"]
    page.press("Page", "Last")
    assert found.q(listed()[-1])[1] == shoulder.max()
    page.put("Row", "7")
    assert 7 in listed() and page.next.q == pytest.approx(found.q(7))
    page.act(lambda: page.parts.done("sort-solutions", "0"))
    assert listed() == [*range(1, 16)]

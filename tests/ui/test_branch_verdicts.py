"""Branches beside each other: which is chosen, which is refused, and why."""

from __future__ import annotations

import numpy as np

from armctl.kinematics import Target
from armctl.robot import load_robot
from armctl.ui.tabs.inverse.answer import Answer, Verdict, solve, standing_alike, verdicts_html

MICO = load_robot("mico")


def answered(*point_mm: float, start: str = "home") -> Answer:
    return solve(MICO, Target.of(np.array(point_mm) / 1000), "least-rotation", MICO.pose(start))


def by_name(found: Answer) -> dict[str, Verdict]:
    return {one.branch.name: one for one in found.verdicts}


def test_the_one_of_least_energy_is_chosen_and_limits_are_named() -> None:
    found = answered(300, 0, 100)
    names = by_name(found)
    assert [one.number for one in found.verdicts] == [1, 2, 3, 4]
    assert names["front elbow-up"].chosen and not names["front elbow-up"].refused
    assert names["front elbow-down"].refused.startswith("Shoulder needs 82.14°")
    assert names["front elbow-down"].label == "2: refused"
    html = verdicts_html(MICO, found.verdicts, found.table)
    assert "2 is refused: Shoulder needs 82.14°" in html
    assert "1 is chosen among the possible ones: the least energy by least-rotation" in html


def test_a_branch_inside_the_limits_is_refused_where_the_floor_is_in_the_way() -> None:
    low = answered(350, 0, -30)
    refused = {name: one.refused for name, one in by_name(low).items() if not one.branch.forbidden}
    assert any("floor" in why for why in refused.values()), refused


def test_over_the_base_axis_two_branches_look_alike() -> None:
    found = answered(0, 0, 700)
    groups = [[one.number for one in group] for group in standing_alike(MICO, found.verdicts)]
    assert groups == [[1, 3], [2, 4]] or groups == [[1, 4], [2, 3]]
    chosen = next(one for one in found.verdicts if one.chosen)
    assert np.degrees(chosen.branch.q[:3]).round(3).tolist() == [0.0, -131.626, -5.532]


def test_no_branches_where_a_joint_is_free_or_nothing_reaches() -> None:
    robot = load_robot("uzuner")
    found = solve(robot, Target.of([0.2, 0.0, 0.1]), "least-rotation", robot.pose("home"))
    assert found.verdicts == ()
    assert "a joint is free" in verdicts_html(robot, found.verdicts, found.table)
    assert answered(500, 0, 700).verdicts == ()

"""The study joint by joint, as it is shown."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armctl.motion.analysis import Turning
from armctl.robot import Robot, load_robot
from armctl.ui.tabs.trajectory.study import (
    ShownStudy,
    StudyRequest,
    fastest_words,
    make_study,
    study_html,
    study_picture,
)


def shown(robot: Robot, turning: Turning = "in turn", deg_s: float = 20.0) -> ShownStudy:
    return make_study(robot, StudyRequest(turning, robot.pose("home"), "home", math.radians(deg_s), None))


def test_the_joint_that_moves_the_tip_fastest_is_named_with_its_figure() -> None:
    robot = load_robot("abaas")
    assert fastest_words(robot, shown(robot).study) == (
        "Shoulder moves the tip fastest: 84.4 mm/s; next is Elbow with 83.4 mm/s."
    )
    assert "Shoulder moves the tip fastest: 122.0 mm/s" in fastest_words(
        robot, shown(robot, "all at once").study
    )


def test_the_printed_speed_is_set_right_with_the_arm_s_own_reach() -> None:
    robot = load_robot("abaas")
    html = study_html(robot, shown(robot))
    for part in (
        "355.0 mm at most",
        "20 °/s give 123.9 mm/s",
        "8.32·10³ mm/s",
        "23.8 m",
        "right is 124 mm/s",
    ):
        assert part in html
    assert "8.32·10³" not in study_html(load_robot("mico"), shown(load_robot("mico")))
    assert "of the largest speed" in html


def test_held_joints_and_too_fast_ones_are_named() -> None:
    humanoid, scorbot = load_robot("humanoid"), load_robot("scorbot")
    assert "its limits hold it still: Wrist roll." in study_html(humanoid, shown(humanoid))
    assert "Faster than" not in study_html(scorbot, shown(scorbot))
    html = study_html(scorbot, shown(scorbot, deg_s=50.0))
    assert "Faster than the real arm may turn: Waist (20 °/s), Shoulder (26 °/s), Elbow (26 °/s)." in html


@pytest.mark.parametrize("name", ["uzuner", "abaas", "scorbot", "mico", "humanoid"])
def test_the_plot_has_a_line_a_joint_in_millimetres_a_second(name: str) -> None:
    robot = load_robot(name)
    alone, together = shown(robot), shown(robot, "all at once")
    titles = [joint.title for joint in robot.joints if joint.upper > joint.lower]
    assert [line.name for line in study_picture(robot, alone.study).lines] == titles
    picture = study_picture(robot, together.study)
    assert picture.title == "Tip speed by joint (mm/s)"
    assert [line.name for line in picture.lines] == [*titles, "all together"]
    assert len({line.color for line in picture.lines}) == len(picture.lines)
    assert max(float(np.nanmax(line.y)) for line in picture.lines[:-1]) == pytest.approx(
        1000 * together.study.peaks.max()
    )

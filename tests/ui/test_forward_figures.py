"""The figures of a configuration, and what the two buttons would do."""

from __future__ import annotations

import numpy as np
import pytest

from armctl.errors import InputError
from armctl.kinematics.velocity import position_freedom
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.forward.coupling import LAST, REFERENCE, SHOWN, AngleFields, resulting_pose, results_html
from armctl.ui.widgets.html import fixed, refused
from armctl.ui.widgets.pose_figures import (
    direction_words,
    jacobian_html,
    manipulability_html,
    pose_html,
    tool_speeds_html,
)

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


def test_reference_is_absolute_and_last_position_is_added() -> None:
    asked, present = np.radians([1, 2, 3, 4, 5]), np.radians([10, 20, 30, 40, 50])
    assert np.degrees(resulting_pose(REFERENCE, asked, present)) == pytest.approx([1, 2, 3, 4, 5])
    assert np.degrees(resulting_pose(LAST, asked, present)) == pytest.approx([11, 22, 33, 44, 55])
    assert np.array_equal(resulting_pose(SHOWN[0], asked, present), asked)
    assert np.array_equal(resulting_pose(SHOWN[1], asked, present), present + asked)


def test_results_tell_where_both_buttons_lead_and_what_is_outside(server: GuardedServer) -> None:
    angles = AngleFields(server.gui, ROBOT, np.radians([10, 90, -80, -40, 0]))
    html = results_html(ROBOT, angles, HOME)
    assert "→ reference" in html and "→ last position" in html
    assert "With respect to last position: Shoulder: 180.00° is outside −3.19° … 146.83°" in html
    assert "With respect to reference" not in html
    angles.fill(np.radians([1, 1, 1, 1, 1]))
    assert "Both are inside the joint limits" in results_html(ROBOT, angles, HOME)


def test_results_name_the_field_that_cannot_be_used(server: GuardedServer) -> None:
    angles = AngleFields(server.gui, ROBOT, HOME)
    angles.fields[2].handle.value = "<b>4x"
    html = results_html(ROBOT, angles, HOME)
    assert "Nothing can be sent: Elbow °: &#x27;&lt;b&gt;4x&#x27; is not a number" in html
    assert "→" not in html
    with pytest.raises(InputError):
        angles.radians()


def test_the_zero_pose_in_figures() -> None:
    html = pose_html(ROBOT, np.zeros(5))
    assert "330.00" in html and "3.62" in html and "163.00" in html
    assert "Rz(yaw) · Ry(pitch) · Rx(roll)" in html


def test_the_two_pitches_are_named_apart() -> None:
    html = pose_html(ROBOT, HOME)  # the tool looks 30° down
    assert "Rx (roll)" in html and "Ry (pitch) <b>−60.000°</b> · Rz (yaw) <b>0.000°</b>" in html
    assert "Ry is not the tool pitch: that is −30.000°" in html


def test_the_jacobian_is_shown_in_mm_with_rows_named() -> None:
    html = jacobian_html(ROBOT, np.zeros(5))
    for row in ("vx mm/s", "ωz rad/s", "330.00", "Wrist roll", "√det(Jᵀ J) of all six rows"):
        assert row in html


def test_a_stretched_arm_says_which_way_it_cannot_go() -> None:
    stretched = position_freedom(ROBOT.jacobian(np.zeros(5)))
    html = manipulability_html(stretched, ROBOT.forward(np.zeros(5))[:3, 3])
    assert "Singular" in html and "the tool cannot move out or in, along (" in html
    assert "smallest singular value: <b>0.00</b> mm/rad; largest / smallest: ∞" in html
    bent = position_freedom(ROBOT.jacobian(HOME))
    html = manipulability_html(bent, ROBOT.forward(HOME)[:3, 3])
    assert "Well away from singularities" in html and "moves least" in html
    J = ROBOT.jacobian(HOME)[:3]
    assert f"{1e3 * np.sqrt(np.linalg.det(J @ J.T)):.4f}" in html


@pytest.mark.parametrize(
    ("direction", "tip", "words"),
    [
        ([1, 0, 0], [0.3, 0, 0.1], "out or in"),
        ([-1, 0, 0], [0.3, 0, 0.1], "out or in"),
        ([1, 0, 0], [0, 0.3, 0.1], "left or right"),
        ([0, 0, 1], [0.3, 0.3, 0.1], "up or down"),
        ([0.6, 0, 0.8], [0.3, 0, 0.1], "out and up or in and down"),
        ([-0.6, 0, 0.8], [0.3, 0, 0.1], "out and down or in and up"),
        ([0, 1, 0], [0, 0, 0.7], "along +y or along −y"),
        ([0.1, 0.05, 0.99], [0.3, 0, 0.1], "up or down"),
    ],
)
def test_directions_in_words(direction: list[float], tip: list[float], words: str) -> None:
    unit = np.array(direction) / np.linalg.norm(direction)
    assert direction_words(unit, np.array(tip, dtype=np.float64)) == words


def test_the_tool_speed_of_each_joint_is_listed() -> None:
    """The abaas arm in a pose of its paper: the shoulder is the most effective joint at equal rates."""
    abaas = load_robot("abaas")
    q = abaas.pose("home")
    html = tool_speeds_html(abaas, abaas.jacobian(q))
    for text in ("at 20 °/s", "its limit", "Base", "60.0 °/s", "120.0 °/s"):
        assert text in html
    x, y, _ = 1000 * abaas.forward(q)[:3, 3]
    assert f"{np.radians(20) * np.hypot(x, y):.1f} mm/s" in html
    marked = html[html.index("background") :]
    assert "Shoulder" in marked[: marked.index("</tr>")]
    held = load_robot("humanoid")
    assert "held at 0°" in tool_speeds_html(held, held.jacobian(held.pose("home")))


@pytest.mark.parametrize(
    ("value", "text"), [(-1.25, "−1.2"), (-0.01, "0.0"), (float("nan"), "–"), (float("inf"), "–")]
)
def test_numbers_have_no_negative_zero(value: float, text: str) -> None:
    assert fixed(value, 1) == text


def test_a_refusal_is_escaped() -> None:
    assert "<script>" not in refused("<script>")

"""The figures of a configuration, and what the two buttons would do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from armctl.errors import InputError
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer, guarded_server
from armctl.ui.screens.forward_angles import (
    LAST,
    REFERENCE,
    SHOWN,
    AngleFields,
    resulting_pose,
    results_html,
)
from armctl.ui.widgets.html_bits import fixed, refused
from armctl.ui.widgets.pose_figures import jacobian_html, manipulability, manipulability_html, pose_html

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


@pytest.fixture(scope="module")
def server() -> Iterator[GuardedServer]:
    server = guarded_server(port=0, label="test")
    yield server
    server.stop()


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
    assert "With respect to last position: Shoulder: 180.00° is outside -3.19° … 146.83°" in html
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


def test_the_jacobian_is_shown_in_mm_with_rows_named() -> None:
    html = jacobian_html(ROBOT, np.zeros(5))
    for row in ("vx mm/s", "ωz rad/s", "330.00", "Wrist roll"):
        assert row in html


def test_manipulability_of_a_stretched_arm_is_zero_along_its_own_length() -> None:
    stretched = manipulability(ROBOT.jacobian(np.zeros(5)))
    assert stretched.verdict == "singular"
    assert abs(stretched.blocked[0]) == pytest.approx(1.0, abs=0.02)
    assert "hardly move along" in manipulability_html(stretched)
    bent = manipulability(ROBOT.jacobian(HOME))
    assert bent.verdict == "well away from singularities"
    J = ROBOT.jacobian(HOME)[:3]
    assert bent.measure == pytest.approx(np.sqrt(np.linalg.det(J @ J.T)))
    assert bent.rows == 3


def test_six_joints_count_with_all_rows() -> None:
    figure = manipulability(np.diag([1.0, 1, 1, 2, 2, 2]))
    assert figure.rows == 6
    assert figure.measure == pytest.approx(8.0)
    assert figure.isotropy == pytest.approx(0.5)


def test_a_chain_with_fewer_joints_than_dimensions_is_singular() -> None:
    assert manipulability(np.ones((6, 2))).verdict == "singular"


@pytest.mark.parametrize(
    ("value", "text"), [(-1.25, "−1.2"), (-0.01, "0.0"), (float("nan"), "–"), (float("inf"), "–")]
)
def test_numbers_have_no_negative_zero(value: float, text: str) -> None:
    assert fixed(value, 1) == text


def test_a_refusal_is_escaped() -> None:
    assert "<script>" not in refused("<script>")

"""Joint rates and tool velocity as the Forward screen shows them."""

from __future__ import annotations

import numpy as np
import pytest

from armctl.robot import load_robot
from armctl.ui.tabs.forward.velocity import joint_rates_html, tool_velocity_html

SCORBOT, HUMANOID = load_robot("scorbot"), load_robot("humanoid")
HOME = SCORBOT.pose("home")


def test_the_waist_alone_moves_the_tool_sideways() -> None:
    html = tool_velocity_html(SCORBOT, SCORBOT.jacobian(HOME), np.radians([20.0, 0, 0, 0, 0]))
    x = 1000 * SCORBOT.forward(HOME)[0, 3]
    assert f">{np.radians(20) * x:.1f}<" in html  # mm/s along y
    assert ">20.0<" in html  # °/s about z
    assert "at most" not in html


def test_rates_over_their_limits_are_named() -> None:
    html = tool_velocity_html(SCORBOT, SCORBOT.jacobian(HOME), np.radians([25.0, 0, -40.0, 0, 0]))
    assert "Waist turns at 20.0 °/s at most; Elbow turns at 26.0 °/s at most" in html


def test_a_velocity_within_the_limits_is_met() -> None:
    html = joint_rates_html(SCORBOT, SCORBOT.jacobian(HOME), np.array([0.0, 0.05, 0.0]), keep=False)
    assert "<b>50.0 mm/s</b> of 50.0 mm/s</div>" in html
    rate = np.degrees(0.05 / SCORBOT.forward(HOME)[0, 3])
    assert f"{rate:.2f} °/s" in html
    assert "Out of" not in html


def test_the_joint_that_limits_the_speed_is_named() -> None:
    html = joint_rates_html(SCORBOT, SCORBOT.jacobian(HOME), np.array([0.0, 1.0, 0.0]), keep=False)
    reached = 1000 * np.radians(20) * SCORBOT.forward(HOME)[0, 3]
    assert f"<b>{reached:.1f} mm/s</b> of 1000.0 mm/s; Waist is at its limit, at {reached / 10:.1f} %" in html


def test_a_lost_direction_is_told() -> None:
    """Stretched out at its reach of 604 mm, the arm can go no farther."""
    stretched = np.radians([0.0, 0.0, 0.0, -90.0, 0.0])
    assert SCORBOT.forward(stretched)[0, 3] == pytest.approx(0.604)
    html = joint_rates_html(SCORBOT, SCORBOT.jacobian(stretched), np.array([0.05, 0.0, 0.0]), keep=False)
    assert "Out of the joints&#x27; power here: 50.00 mm/s" in html
    assert "<b>0.0 mm/s</b> of 50.0 mm/s" in html


def test_not_turning_is_more_than_five_joints_can() -> None:
    html = joint_rates_html(SCORBOT, SCORBOT.jacobian(HOME), np.array([0.0, 0.05, 0.0]), keep=True)
    assert "It cannot go without turning" in html
    straight = joint_rates_html(SCORBOT, SCORBOT.jacobian(HOME), np.array([0.03, 0.0, 0.0]), keep=True)
    assert "cannot" not in straight and "Out of" not in straight


def test_a_held_joint_stands_still() -> None:
    q = HUMANOID.pose("home")
    html = joint_rates_html(HUMANOID, HUMANOID.jacobian(q), np.array([0.05, 0.0, 0.0]), keep=False)
    assert "held at 0°" in html and "0.00 °/s" in html

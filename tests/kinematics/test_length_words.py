from __future__ import annotations

import pytest

from armctl import load_robot
from armctl.facts.reasons import in_millimetres


@pytest.mark.parametrize(
    ("metres", "told"),
    [(0.0826, "82.6"), (5e-5, "0.1"), (4.9e-5, "0.049"), (3.2e-6, "0.0032"), (1e-9, "1e-06"), (0.0, "0")],
)
def test_a_small_length_is_not_told_as_none(metres: float, told: str) -> None:
    assert in_millimetres(metres) == told


@pytest.mark.parametrize("name", ["uzuner", "humanoid", "mico"])
def test_a_point_a_hair_out_of_reach_is_not_said_to_be_within(name: str) -> None:
    robot = load_robot(name)
    tool = robot.forward(robot.pose("zero"))[:3, 3]
    shoulder = robot.chain.axes()[0][1]
    far = robot.inverse(shoulder + 3.0 * (tool - shoulder)).nearest_m
    assert far is not None
    said = robot.inverse(
        far + 1e-5 * (far - shoulder) / float(((far - shoulder) ** 2).sum() ** 0.5)
    ).explanation
    assert "by 0.01 mm" in said or "0.01 mm away" in said
    assert "can be reached" not in said

"""Joints of a URDF file whose two limits are the same angle: fixed there, which is said."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from tests.robot.urdf_kit import Step, product, written

from armctl import load_robot
from armctl.errors import RobotFileError

STEPS = (
    Step("waist", "revolute", "base", "body", "0 0 0.1"),
    Step("shoulder", "revolute", "body", "upper", "0.02 0 0.05", axis="0 1 0"),
    Step("twist", "revolute", "upper", "fore", "0 0 0.2", "0.1 0 0.2", axis="0 0 -1"),
    Step("elbow", "revolute", "fore", "lower", "0.01 0 0.05", axis="0 1 0"),
    Step("end", "fixed", "lower", "tool0", "0 0 0.15"),
)


def held(name: str, angle: float) -> tuple[Step, ...]:
    return tuple(
        dataclasses.replace(step, limits=(angle, angle)) if step.joint == name else step for step in STEPS
    )


@pytest.mark.parametrize(("name", "angle"), [("waist", 0.7), ("twist", -0.4), ("elbow", 2.1)])
def test_such_a_joint_stands_at_its_angle(tmp_path: Path, name: str, angle: float) -> None:
    robot = load_robot(written(tmp_path / "arm.urdf", held(name, angle)))
    place = [step.joint for step in STEPS].index(name)
    assert robot.n == 3
    assert name not in robot.joint_names
    assert f"fixed, as both limits are the same: {name} at {math.degrees(angle):.1f}°" in robot.assumed
    for q in np.random.default_rng(5).uniform(-2, 2, (20, 3)):
        expected = product(STEPS, "tool0", np.insert(q, place, angle), {})
        assert np.abs(robot.forward(q) - expected).max() < 1e-14


def test_a_rounded_quarter_turn_is_exact_there_too(tmp_path: Path) -> None:
    robot = load_robot(written(tmp_path / "arm.urdf", held("twist", 1.5708)))
    q = np.array([0.3, -0.5, 0.8])
    assert np.abs(robot.forward(q) - product(STEPS, "tool0", np.insert(q, 2, math.pi / 2), {})).max() < 1e-14
    assert any(text.startswith("exact: 1 angle written as rounded quarter turns") for text in robot.assumed)


def test_what_hangs_on_it_weighs_where_it_stands(tmp_path: Path) -> None:
    """The same torque as with limits a hair apart, the joint at their middle."""
    file = written(tmp_path / "arm.urdf", held("twist", -0.4))
    masses = file.read_text()
    for link in ("fore", "lower"):
        inertial = '<inertial><origin xyz="0.03 0.02 0.1"/><mass value="1"/></inertial>'
        masses = masses.replace(f'<link name="{link}"/>', f'<link name="{link}">{inertial}</link>')
    file.write_text(masses)
    free = tmp_path / "free.urdf"
    free.write_text(masses.replace('lower="-0.4" upper="-0.4"', 'lower="-0.5" upper="-0.3"'))
    robot, other = load_robot(file), load_robot(free)
    assert (robot.n, other.n) == (3, 4)
    for q in np.random.default_rng(6).uniform(-2, 2, (10, 3)):
        torque = other.gravity.torque(np.insert(q, 2, -0.4))
        assert robot.gravity.torque(q) == pytest.approx(np.delete(torque, 2), abs=1e-12)


def test_no_joint_is_left(tmp_path: Path) -> None:
    steps = tuple(dataclasses.replace(step, limits=(0.2, 0.2)) for step in STEPS)
    with pytest.raises(RobotFileError, match="no joint turns between base and tool0"):
        load_robot(written(tmp_path / "arm.urdf", steps))

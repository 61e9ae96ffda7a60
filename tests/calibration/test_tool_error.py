"""Touched points: how far the tool is off, and which parameter is to blame."""

from __future__ import annotations

import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.arms import FIVE
from tests.robot.test_urdf_tool import PROP
from tests.robot.urdf_kit import written
from tests.sticks import of_sticks

from armctl.arrays import FloatArray
from armctl.calibration import ToolError, tool_error
from armctl.calibration.tool_error import parameters_of
from armctl.errors import CalibrationError
from armctl.kinematics import Chain, DHRow
from armctl.robot import Joint, Robot, load_robot

LONG = bool(os.environ.get("ARMCTL_LONG"))
TOUCH = 0.0003
"""deviation of a coordinate of a simulated touch [m]"""
AMOUNTS = {"zero": 3.0, "scale": 5.0, "a": 5.0, "d": 5.0, "base": 5.0}
SEEN = 0.001
"""an error that moves the tool by less than this is lost in the touches' own [m]"""


def random_poses(robot: Robot, rng: np.random.Generator, count: int = 10) -> FloatArray:
    return rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (count, robot.n))


def touched(
    robot: Robot,
    q: FloatArray,
    rng: np.random.Generator,
    noise: float = TOUCH,
    title: str | None = None,
    amount: float = 0.0,
) -> FloatArray:
    """Where the tool truly is when an error is hidden in the parameter of that title."""
    tips = robot.forward(q)[:, :3, 3]
    if title is not None:
        (wrong,) = (one for one in parameters_of(robot) if one.title == title)
        tips = wrong.tips(robot, q, amount)
    return tips + rng.normal(0.0, noise, tips.shape)


def random_arm(rng: np.random.Generator) -> Robot:
    """Six joints with quarter-turn twists and lengths that nobody chose."""
    uzuner = load_robot("uzuner")
    rows = [
        DHRow(
            a_m=float(rng.uniform(0.02, 0.3)),
            alpha_rad=float(rng.choice([-0.5, 0.5]) * np.pi),
            d_m=float(rng.uniform(0.02, 0.3)),
            theta_rad=float(rng.uniform(-1, 1)),
        )
        for _ in range(6)
    ]
    joints = tuple(Joint(f"j{i}", f"J{i}", -1.5, 1.5, 1.0, 1.0, 1.0, None) for i in range(6))
    convention = "standard" if rng.random() < 0.5 else "modified"
    return replace(
        of_sticks(uzuner), name="random", joints=joints, chain=Chain.from_dh(rows, convention),
        poses={"home": np.zeros(6), "rest": np.zeros(6)}, output_map=None,
    )  # fmt: skip


def check_every_parameter(robot: Robot, rng: np.random.Generator) -> tuple[int, int]:
    """Hide an error in one parameter after the other; gives how many were seen, and how many named first."""
    q = random_poses(robot, rng)
    seen = first = 0
    for parameter in parameters_of(robot):
        amount = AMOUNTS[parameter.kind] * float(rng.choice([-1, 1]))
        moved = parameter.tips(robot, q, amount) - robot.forward(q)[:, :3, 3]
        moves = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
        error = tool_error(robot, q, touched(robot, q, rng, title=parameter.title, amount=amount))
        if moves < SEEN:
            continue
        seen += 1
        assert error.blame is not None
        assert parameter.title in (error.blame.title, *error.blame.or_else), (
            f"{parameter.title}: {error.blame}"
        )
        assert error.rms_after_m < 4 * TOUCH < error.rms_m
        if error.blame.title == parameter.title:
            first += 1
            assert error.blame.amount == pytest.approx(amount, rel=0.4)
    return seen, first


@pytest.mark.parametrize("name", FIVE)
def test_the_one_wrong_parameter_is_blamed(name: str) -> None:
    """It is named, alone or among those that look the same with these points."""
    seen, first = check_every_parameter(load_robot(name), np.random.default_rng(5))
    assert seen >= 14 and first >= seen / 2


def test_the_one_wrong_parameter_of_a_random_arm_is_blamed() -> None:
    rng = np.random.default_rng(6)
    for _ in range(2 if LONG else 1):
        seen, first = check_every_parameter(random_arm(rng), rng)
        assert seen >= 20 and first >= 0.8 * seen


def test_an_arm_from_a_urdf_file_has_no_lengths_to_blame_but_zeros(tmp_path: Path) -> None:
    robot, rng = load_robot(written(tmp_path / "arm.urdf", PROP)), np.random.default_rng(9)
    q = random_poses(robot, rng)
    turned = robot.forward(q + np.radians([0, 3, 0, 0, 0]))[:, :3, 3]
    error = tool_error(robot, q, turned)
    assert error.blame is not None
    assert (error.blame.title, error.blame.amount) == ("zero of Shoulder", pytest.approx(3, abs=1e-3))
    (change,) = error.changes
    assert "URDF file, joint shoulder" in change.table
    assert (change.key, change.new) == ("offset_deg", pytest.approx(3, abs=1e-3))


@pytest.mark.parametrize("name", FIVE)
def test_a_good_arm_is_not_blamed(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(8)
    blamed = 0
    for _ in range(10):
        q = random_poses(robot, rng)
        error = tool_error(robot, q, touched(robot, q, rng, noise=0.0005))
        blamed += error.blame is not None
        assert error.changes == () or error.blame is not None
        assert error.rms_m < 0.002
    assert blamed <= 1


def measured(name: str, title: str, amount: float) -> ToolError:
    robot, rng = load_robot(name), np.random.default_rng(10)
    q = random_poses(robot, rng)
    return tool_error(robot, q, touched(robot, q, rng, 0.0, title, amount))


def test_the_suggestion_is_what_the_arm_truly_is() -> None:
    robot, q = load_robot("scorbot"), random_poses(load_robot("scorbot"), np.random.default_rng(10))
    rows = list(robot.chain.rows)
    rows[1] = replace(rows[1], a_m=rows[1].a_m + 0.004)
    error = tool_error(robot, q, Chain.from_dh(rows).forward(q)[:, :3, 3])
    (change,) = error.changes
    assert (change.table, change.key, change.old) == ('dh.rows, row 2 (joint = "shoulder")', "a_mm", 222.0)
    assert change.new == pytest.approx(226.0, abs=1e-6)
    assert error.toml() == '# [dh.rows, row 2 (joint = "shoulder")]\na_mm = 226  # was 222\n'
    assert error.largest_after_m < 1e-8 < error.largest_m


@pytest.mark.parametrize(("kind", "amount"), [("zero", 3.0), ("scale", 4.0)])
@pytest.mark.parametrize(("name", "joint"), [("uzuner", "elbow"), ("scorbot", "elbow")])
def test_a_corrected_map_sends_the_joint_where_it_is_said_to_be(
    name: str, joint: str, kind: str, amount: float
) -> None:
    robot = load_robot(name)
    error = measured(name, f"{kind} of Elbow", amount)
    new = {change.key: change.new for change in error.changes}
    old = {change.key: change.old for change in error.changes}
    assert {change.table for change in error.changes} == {
        f"joints.{joint}.{'servo' if name == 'uzuner' else 'encoder'}"
    }
    outputs = robot.output_map
    assert outputs is not None
    per, zero = np.radians(outputs.per_rad[2]), outputs.zero[2]
    new_per = new.get("us_per_deg", new.get("counts_per_deg", per))
    new_zero = new.get("zero_us", -new["home_deg"] * new_per if "home_deg" in new else zero)
    for said in (-40.0, 0.0, 50.0):
        output = zero + per * said
        truly = said + amount if kind == "zero" else said * (1 + amount / 100)
        assert (output - new_zero) / new_per == pytest.approx(truly, abs=1e-5)
    for key, value in old.items():
        assert value == pytest.approx(
            {"zero_us": zero, "us_per_deg": per, "counts_per_deg": per, "home_deg": -zero / per}[key]
        )


def test_the_zero_of_a_linkage_is_written_into_every_row_that_it_turns() -> None:
    robot = load_robot("uarm")  # has no outputs: its zeros stand in the DH rows
    q = random_poses(robot, np.random.default_rng(12))
    off = q.copy()
    off[:, 1] += np.radians(2.5)
    error = tool_error(robot, q, robot.forward(off)[:, :3, 3])
    assert error.blame is not None and error.blame.title == "zero of Shoulder"
    rows = list(robot.chain.rows)
    for change in error.changes:
        row = int(re.findall(r"row (\d+)", change.table)[0]) - 1
        assert change.key == "theta_deg" and change.old == np.degrees(rows[row].theta_rad)
        rows[row] = replace(rows[row], theta_rad=np.radians(change.new))
    mended = Chain.from_dh(rows, "standard", robot.chain.coupling)
    np.testing.assert_allclose(mended.forward(q), robot.forward(off), rtol=0, atol=1e-7)
    assert error.toml().count("# [dh.rows, row ") == len(error.changes) == 2


def test_parameters_that_these_points_cannot_tell_apart_are_named_together() -> None:
    """Three parallel axes: offsets along them look the same at the tool."""
    error = measured("scorbot", "d_mm of DH row 3 (Elbow)", 5.0)
    assert error.blame is not None
    named = {error.blame.title, *error.blame.or_else}
    assert {f"d_mm of DH row {row}" for row in (2, 3, 4)} <= {title.partition(" (")[0] for title in named}


def test_the_words_give_the_figures() -> None:
    error = measured("scorbot", "zero of Elbow", 3.0)
    first, blame, after = error.words
    assert first == (
        f"tool error of 10 points: RMS {1000 * error.rms_m:.2f} mm, largest {1000 * error.largest_m:.2f} mm"
    )
    assert blame == "most likely cause: zero of Elbow: +3.00 °"
    assert after == "with that corrected: RMS 0.00 mm, largest 0.00 mm"
    robot = load_robot("scorbot")
    q = random_poses(robot, np.random.default_rng(1))
    good = tool_error(robot, q, robot.forward(q)[:, :3, 3])
    assert good.words[1] == "no single number explains the error better than chance"
    assert good.toml() == ""


def test_points_that_tell_nothing_are_refused() -> None:
    robot = load_robot("scorbot")
    q = random_poses(robot, np.random.default_rng(1))
    points = robot.forward(q)[:, :3, 3]
    with pytest.raises(CalibrationError, match="5 points are too few"):
        tool_error(robot, q[:5], points[:5])
    with pytest.raises(CalibrationError, match=r"5 joint angles and x, y, z; got .* \(10, 4\) and \(10, 3\)"):
        tool_error(robot, q[:, :4], points)
    with pytest.raises(CalibrationError, match="within 20 mm"):
        tool_error(robot, q, np.zeros((10, 3)))
    points[3, 1] = np.nan
    with pytest.raises(CalibrationError, match="point 4 holds a value that is not a finite number"):
        tool_error(robot, q, points)


def test_the_suggestion_goes_where_the_number_that_counts_stands() -> None:
    """What the robot file says of a joint that is calibrated is not what the arm goes by."""
    robot = load_robot("uzuner")
    q = random_poses(robot, np.random.default_rng(8))
    truly = q + np.radians([0.0, 0.0, 2.0, 0.0, 0.0])
    told = tool_error(robot, q, robot.forward(truly)[:, :3, 3], ["elbow"])
    (change,) = told.changes
    assert (change.table, change.key) == ("calibration: joints.elbow", "zero")
    assert change.new == pytest.approx(change.old - 20.0, abs=0.01)

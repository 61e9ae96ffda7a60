"""Limits, speeds, efforts and angles as other programs write and accept them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tests.robot.plain_arm import NAMES, write_plain_arm

from armctl import Robot, load_robot
from armctl.errors import MotionRefusedError, RobotFileError
from armctl.kinematics.families.registry import has_closed_form
from armctl.motion.preflight import preflight, require_clear
from armctl.motion.profiles import PointToPoint
from armctl.robot.urdf import changed_side_file


def roll(path: Path, **limit: str) -> Robot:
    """The plain arm with another last joint."""
    return load_robot(write_plain_arm(path / "arm.urdf", {"roll": limit}))


def told(robot: Robot, word: str) -> str:
    """The lines under ``assumed`` that begin so."""
    return "\n".join(text for text in robot.assumed if text.startswith(word))


def degrees(robot: Robot, joint: str = "roll") -> list[float]:
    """Its limits."""
    low, high = np.degrees(robot.limits[robot.joint_names.index(joint)]).tolist()
    return [round(low, 1), round(high, 1)]


# Limits.


@pytest.mark.parametrize(
    ("lower", "upper"),
    [("-inf", "inf"), ("nan", "NaN"), ("-1e16", "1e16"), ("-1000000", "1000000"), ("-31.4", "31.4"),
     ("-62.83", "62.83"), ("-15.708", "15.708"), ("-infinity", "1e9")],
)  # fmt: skip
def test_limits_that_are_none_make_a_joint_continuous(tmp_path: Path, lower: str, upper: str) -> None:
    robot = roll(tmp_path, lower=lower, upper=upper)
    assert degrees(robot) == [-180, 180]
    assert "roll" in told(robot, "limits: ") and "continuous" in told(robot, "limits: ")
    changed_side_file(tmp_path / "arm.armctl.toml", {"joints": [{"name": "roll", "limit_deg": [-300, 300]}]})
    robot = load_robot(tmp_path / "arm.urdf")
    assert degrees(robot) == [-300, 300] and not told(robot, "limits")


@pytest.mark.parametrize(("lower", "upper", "kept"), [("0", "inf", [0, 360]), ("nan", "1", [-302.7, 57.3])])
def test_a_joint_with_one_limit_keeps_to_one_turn(
    tmp_path: Path, lower: str, upper: str, kept: list[float]
) -> None:
    robot = roll(tmp_path, lower=lower, upper=upper)
    assert degrees(robot) == kept and "one turn" in told(robot, "limits: roll")


@pytest.mark.parametrize("seed", range(30))
def test_limits_are_read_as_what_they_are(tmp_path: Path, seed: int) -> None:
    """Radians to two turns; whole numbers up to 720 are likely degrees; beyond, or of whole turns: none."""
    chance = np.random.default_rng(seed)
    size = float(chance.uniform(0.2, 4 * math.pi))
    assert degrees(roll(tmp_path, lower=f"{-size:.6f}", upper=f"{size:.6f}"))[1] == pytest.approx(
        math.degrees(size), abs=0.06
    )
    angle = str(chance.choice([30, 45, 60, 90, 120, 135, 150, 170, 180, 270, 360]))
    with pytest.raises(RobotFileError, match=r"roll.*look like degrees"):
        roll(tmp_path, lower=f"-{angle}", upper=angle)
    turns = int(chance.integers(3, 20)) * 2 * math.pi
    text = f"{turns:.{int(chance.integers(2, 7))}f}"
    assert degrees(roll(tmp_path, lower=f"-{text}", upper=text)) == [-180, 180]
    text = repr(float(chance.choice([1, -1]) * 10 ** chance.uniform(3, 300)).__abs__())
    assert degrees(roll(tmp_path, lower=f"-{text}", upper=text)) == [-180, 180]


def test_rounded_two_turns_are_two_turns(tmp_path: Path) -> None:
    assert degrees(roll(tmp_path, lower="-12.57", upper="12.57")) == [-720, 720]
    with pytest.raises(RobotFileError, match="the lower limit comes first"):
        roll(tmp_path, lower="inf", upper="-inf")


def test_the_limits_of_a_continuous_joint_count(tmp_path: Path) -> None:
    robot = roll(tmp_path, type="continuous", lower="-1.0", upper="1.0")
    assert degrees(robot) == [-57.3, 57.3]
    assert "roll" in told(robot, "limits: ") and "57.3°" in told(robot, "limits: ")
    changed_side_file(tmp_path / "arm.armctl.toml", {"joints": [{"name": "roll", "limit_deg": [-180, 180]}]})
    assert degrees(load_robot(tmp_path / "arm.urdf")) == [-180, 180]


@pytest.mark.parametrize(
    ("lower", "upper"),
    [("0", "0"), ("-3.14", "3.14"), ("-6.28", "6.28"), ("none", ""), ("1", "-1"), ("-inf", "inf"),
     ("-1e9", "0")],
)  # fmt: skip
def test_limits_of_a_continuous_joint_that_limit_nothing_do_not(
    tmp_path: Path, lower: str, upper: str
) -> None:
    robot = roll(tmp_path, type="continuous", lower=lower, upper=upper)
    assert degrees(robot) == [-180, 180] and "roll" in told(robot, "limits of ±180°")


# Speeds and efforts.


@pytest.mark.parametrize("text", ["", " ", "nan", "inf", "-inf", "-1", "-2", "0", "1e16"])
def test_speeds_and_efforts_that_are_none_are_none(tmp_path: Path, text: str) -> None:
    robot = roll(tmp_path, velocity=text, effort=text)
    assert robot.joints[-1].speed == pytest.approx(math.radians(60))
    assert "roll" in told(robot, "a speed of 60°/s")
    assert robot.joints[-1].stall_torque is None or text == "1e16"
    with pytest.raises(RobotFileError, match='velocity="fast": must be a number'):
        roll(tmp_path, velocity="fast")


LEANS = np.array([0, 1.0, 0, 0, 0])


def heavy(path: Path, effort: str = "1") -> Path:
    """An arm of 1 kg links whose file gives a placeholder as effort."""
    return write_plain_arm(path / "arm.urdf", {name: {"effort": effort} for name in NAMES}, mass="1.0")


def test_the_effort_of_a_urdf_file_forbids_no_motion(tmp_path: Path) -> None:
    robot, chance = load_robot(heavy(tmp_path)), np.random.default_rng(4)
    for share in chance.uniform(-0.5, 0.5, (12, robot.n)):
        require_clear(robot, PointToPoint.plan(robot, robot.pose("home"), robot.limits[:, 1] * share))
    findings = preflight(robot, PointToPoint.plan(robot, robot.pose("home"), LEANS))
    warned = [one for one in findings if one.kind == "torque"]
    assert warned and all(one.severity == "warning" for one in warned)
    assert all("effort of 1 N·m" in str(one) and "URDF" in str(one) for one in warned)
    assert all("stall_torque_nm" in str(one) and "side file" in str(one) for one in warned)


def test_a_torque_of_the_side_file_is_meant(tmp_path: Path) -> None:
    file = heavy(tmp_path)
    joints = [{"name": "lift", "stall_torque_nm": 1.0}]
    changed_side_file(tmp_path / "arm.armctl.toml", {"joints": joints})
    robot = load_robot(file)
    with pytest.raises(MotionRefusedError, match=r"Lift.*its stall torque of 1\.00 N·m"):
        require_clear(robot, PointToPoint.plan(robot, robot.pose("home"), LEANS))


# Noise of CAD programs.


def noisy(path: Path, chance: np.random.Generator) -> tuple[Path, float]:
    """The plain arm with noise of up to 0.03° on its axes and origins; and the largest of it [degrees]."""
    size = math.radians(0.03) / math.sqrt(3)
    changed: dict[str, dict[str, str]] = {}
    for name, along in zip(NAMES, ([0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 0, 1]), strict=True):
        axis = np.array(along) + chance.uniform(-size, size, 3)
        rpy = chance.uniform(-size, size, 3)
        changed[name] = {"axis": " ".join(map(str, axis)), "rpy": " ".join(map(str, rpy))}
    return write_plain_arm(path, changed), 0.06


@pytest.mark.parametrize("seed", range(6))
def test_noise_is_named_and_taken_away_where_asked_for(tmp_path: Path, seed: int) -> None:
    chance = np.random.default_rng(seed)
    file, _ = noisy(tmp_path / "arm.urdf", chance)
    robot = load_robot(file)
    line = told(robot, "off a right angle")
    assert not has_closed_form(robot.chain) and all(name in line for name in ("lift", "elbow", "wrist"))
    assert "searched" in line and "exact = true" in line
    most = float(line.rpartition("at most ")[2].removesuffix(" mm"))
    exact = load_robot(f"{file}#exact=yes")
    assert has_closed_form(exact.chain) and not told(exact, "off a right angle")
    assert f"at most {most:g} mm" in told(exact, "exact: ")
    q = chance.uniform(*robot.limits.T, (500, robot.n))
    moved = 1000 * np.linalg.norm((robot.forward(q) - exact.forward(q))[:, :3, 3], axis=1)
    assert 0 < moved.max() <= 1.05 * most
    changed_side_file(tmp_path / "arm.armctl.toml", {"exact": True})
    assert np.array_equal(load_robot(file).forward(q), exact.forward(q))


def test_the_joints_that_are_off_are_named_with_their_angles(tmp_path: Path) -> None:
    axes = {"lift": {"axis": "0.00035 1 -0.00021"}, "elbow": {"axis": "-0.0003 1 0.0004"}}
    line = told(load_robot(write_plain_arm(tmp_path / "arm.urdf", axes)), "off a right angle")
    assert "lift 0.023°, elbow 0.029°." in line


@pytest.mark.parametrize(("text", "size"), [("1.57", "0.046°"), ("1.571", "0.012°"), ("-1.57", "0.046°")])
def test_a_quarter_turn_of_two_decimals_is_named(tmp_path: Path, text: str, size: str) -> None:
    turned = {"lift": {"rpy": f"{text} 0 0", "axis": "0 0 1"}, "elbow": {"xyz": "0 0.12 0", "axis": "0 0 1"}}
    turned["wrist"] = {"xyz": "0 0.12 0", "axis": "0 0 1"}
    turned["roll"] = {"xyz": "0 0.06 0", "axis": "0 1 0", "rpy": "0.0003 0 0"}
    file = write_plain_arm(tmp_path / "arm.urdf", turned)
    line = told(load_robot(file), "off a right angle")
    assert f"lift {size}" in line
    assert has_closed_form(load_robot(f"{file}#exact=yes").chain)


def test_nothing_is_told_of_noise_that_costs_nothing(tmp_path: Path) -> None:
    assert not told(load_robot(write_plain_arm(tmp_path / "arm.urdf")), "off")
    leaning = {"pan": {"rpy": "0.0005 0 0"}}  # all of the arm leans
    assert not told(load_robot(write_plain_arm(tmp_path / "arm.urdf", leaning)), "off")

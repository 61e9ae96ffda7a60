"""A motion over time against plain finite differences, its file, its figure and its limits."""

from __future__ import annotations

import subprocess
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from armctl.motion import PROFILES, ProfileName, plan_joints, plan_line
from armctl.motion.analysis import Derivative, MotionAnalysis, analyse, analysis_csv, near_limits
from armctl.motion.figure import FigureForm, TitledMotion, figure_bytes
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


def motion(
    profile: ProfileName = "quintic", samples: int = 4001, duration: float | None = 4.0
) -> MotionAnalysis:
    return analyse(ROBOT, plan_joints(ROBOT, HOME, np.zeros(5), duration, profile), samples)


@pytest.mark.parametrize("name", ["uzuner", "abaas", "humanoid"])
def test_tool_velocity_acceleration_and_jerk_are_the_derivatives_of_its_position(name: str) -> None:
    robot = load_robot(name)
    low, high = robot.limits.T
    start, end = low + 0.4 * (high - low), low + 0.6 * (high - low)
    found = analyse(robot, plan_joints(robot, start, end, 8.0, "quintic", checked=False), 4001)
    for lower, upper, tolerance in (
        (found.position, found.tool_velocity, 1e-5),
        (found.tool_velocity, found.tool_acceleration, 1e-4),
        (found.tool_acceleration, found.tool_jerk, 1e-3),
        (found.q, found.velocity, 1e-5),
        (found.velocity, found.acceleration, 1e-4),
        (found.acceleration, found.jerk, 1e-3),
    ):
        slope = np.gradient(lower, found.time, axis=0)[2:-2]
        assert np.abs(slope - upper[2:-2]).max() < tolerance * (1 + np.abs(upper).max())


def test_the_jerk_does_not_spike_where_the_acceleration_jumps() -> None:
    # a trapezoid in joint space: no jerk of the joints, and that of the tool comes from the geometry alone
    found = motion("trapezoid", 1501, None)
    assert np.abs(found.jerk).max() == 0.0
    assert np.abs(found.tool_jerk).max() < 100.0


def test_the_pitch_is_that_of_the_approach_axis() -> None:
    found = motion(samples=5)
    axis = ROBOT.forward(found.q)[:, :3, 2]
    assert found.pitch == pytest.approx(np.arcsin(axis[:, 2]), abs=1e-9)
    kept = analyse(ROBOT, plan_line(ROBOT, HOME, ROBOT.forward(HOME)[:3, 3] + np.array([0, 0.05, 0])), 50)
    assert np.degrees(kept.pitch) == pytest.approx(np.degrees(kept.pitch[0]), abs=0.02)
    assert np.linalg.norm(kept.tool_velocity, axis=1) == pytest.approx(kept.tool_speed)


def test_the_file_names_its_units_and_has_a_row_a_sample() -> None:
    found = motion(samples=11)
    head, *rows = analysis_csv(ROBOT, found).splitlines()
    names = head.split(",")
    assert len(rows) == 11 and all(len(row.split(",")) == len(names) == 1 + 4 * 5 + 4 * 3 + 1 for row in rows)
    table = {name: np.array([float(row.split(",")[k]) for row in rows]) for k, name in enumerate(names)}
    assert table["shoulder_deg"] == pytest.approx(np.degrees(found.q[:, 1]), abs=1e-6)
    assert table["wrist_pitch_deg_s3"] == pytest.approx(np.degrees(found.jerk[:, 3]), abs=1e-6)
    assert table["jz_mm_s3"] == pytest.approx(1000 * found.tool_jerk[:, 2], abs=1e-6)
    assert table["tool_pitch_deg"][0] == pytest.approx(-30.0)
    assert {"time_s", "wrist_roll_deg_s2", "x_mm", "vz_mm_s", "ay_mm_s2"} <= set(names)


@pytest.mark.parametrize("quantity", ["velocity", "acceleration"])
def test_the_limits_that_a_motion_meets_are_near(quantity: Derivative) -> None:
    found = near_limits(ROBOT, motion("trapezoid", duration=None), quantity)
    limit = ROBOT.speed_limits if quantity == "velocity" else ROBOT.acceleration_limits
    assert (-float(np.degrees(limit[1])), 1) in {(near.value, near.joint) for near in found}
    assert {near.joint for near in found} < set(range(5))
    assert near_limits(ROBOT, motion(duration=60.0), quantity) == []
    assert len(near_limits(ROBOT, motion(duration=60.0), quantity, every=True)) == 10


def test_a_joint_limit_is_near_where_the_joint_comes_near_it() -> None:
    found = {(round(near.value, 3), near.joint) for near in near_limits(ROBOT, motion(), "position")}
    assert found == {(-3.19, 1), (-84.36, 2)}  # home has the elbow at -80, zero the shoulder at 0
    assert len(near_limits(ROBOT, motion(), "position", every=True)) == 10


@pytest.mark.parametrize("profile", PROFILES)
def test_the_figure_has_its_title_units_and_legend_as_texts(profile: ProfileName) -> None:
    found = motion(profile, 301, None)
    svg = figure_bytes(ROBOT, "svg", TitledMotion(f"home to zero, {profile}", found))
    texts = {
        "".join(node.itertext()) for node in ElementTree.fromstring(svg).iter() if node.tag.endswith("text")
    }
    assert f"{ROBOT.title}: home to zero, {profile}, {found.time[-1]:.3f} s" in texts
    for what, unit in (("tool", "mm"), ("joint", "°")):
        assert {f"{what} position ({unit})", f"{what} jerk ({unit}/s³)"} <= texts
    assert {"time (s)", "x", "y", "z", *(joint.title for joint in ROBOT.joints)} <= texts


def test_a_dollar_sign_in_a_name_is_no_formula() -> None:
    svg = figure_bytes(ROBOT, "svg", TitledMotion("program $\\frac$", motion(samples=11))).decode()
    assert "program $\\frac$" in svg


def test_limits_are_dashed_lines_of_the_figure() -> None:
    svg = figure_bytes(ROBOT, "svg", TitledMotion("fast", motion("trapezoid", 301, None)))
    slow = figure_bytes(ROBOT, "svg", TitledMotion("slow", motion("trapezoid", 301, 60.0)))
    assert svg.count(b"stroke-dasharray") > slow.count(b"stroke-dasharray") > 0


def test_the_motion_to_compare_with_is_dotted_and_named() -> None:
    shown = TitledMotion("quintic", motion("quintic", 101, 4.0))
    beside = TitledMotion("slow & $mooth", motion("cubic", 101, 6.0))
    alone = figure_bytes(ROBOT, "svg", shown)
    both = figure_bytes(ROBOT, "svg", shown, beside)
    texts = ["".join(node.itertext()) for node in ElementTree.fromstring(both).iter()]
    assert any("A (dotted): slow & $mooth, 6.000 s" in text for text in texts)
    assert any("quintic, 4.000 s" in text for text in texts)
    lines = [figure.count(b"stroke-dasharray") for figure in (alone, both)]
    assert lines[1] - lines[0] == 4 * (3 + ROBOT.n)


@pytest.mark.parametrize(("form", "magic"), [("png", b"\x89PNG\r\n"), ("svg", b"<?xml")])
def test_a_motion_that_goes_nowhere_has_a_figure_too(form: FigureForm, magic: bytes) -> None:
    still = analyse(ROBOT, plan_joints(ROBOT, HOME, HOME), 2)
    assert figure_bytes(ROBOT, form, TitledMotion("nowhere", still)).startswith(magic)


def test_matplotlib_is_imported_when_a_figure_is_drawn_not_before() -> None:
    code = "import sys, armctl.ui, armctl.motion.figure; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == 0

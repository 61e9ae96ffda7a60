"""A motion over time against plain finite differences, its file, its figure and its limits."""

from __future__ import annotations

import math
import subprocess
import sys
from typing import cast
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.long import LONG

from armctl.errors import InputError, MotionRefusedError
from armctl.kinematics.workspace import longest_levers
from armctl.motion import PROFILES, ProfileName, plan_joints, plan_line
from armctl.motion.analysis import (
    Derivative,
    MotionAnalysis,
    Turning,
    analyse,
    analysis_csv,
    near_limits,
    study_csv,
    study_joints,
)
from armctl.motion.figure import FigureForm, TitledMotion, figure_bytes, figure_file
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


@pytest.mark.parametrize("profile", PROFILES if LONG else ("quintic", "s-curve"))
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


# the tip's speed joint by joint

SPEED = math.radians(20)
NAMES = ("uzuner", "abaas", "scorbot", "mico", "humanoid")
BOTH: tuple[Turning, ...] = ("in turn", "all at once")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("turning", BOTH)
def test_the_curves_are_the_derivatives_of_the_tip_s_position(name: str, turning: Turning) -> None:
    robot = load_robot(name)
    study = study_joints(robot, robot.pose("home"), turning, SPEED)
    assert study.mismatch < 1e-7
    moving, h = list(study.moving), 1e-5
    q = np.tile(robot.pose("home"), (len(study.time), 1))
    if turning == "all at once":
        q[:, moving] = study.angle
    for column, joint in enumerate(moving):
        turns = study.tip_speed[:, column] > 0.0  # else it has come to its limit
        at, step = q[turns], h * np.eye(robot.n)[joint]
        at[:, joint] = study.angle[turns, column]
        way = robot.forward(at + step)[:, :3, 3] - robot.forward(at - step)[:, :3, 3]
        expected = SPEED * np.linalg.norm(way, axis=1) / (2 * h)
        assert study.tip_speed[turns, column] == pytest.approx(expected, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_all_at_once_the_total_is_the_slope_of_the_way_of_the_tip(name: str) -> None:
    robot = load_robot(name)
    start = robot.pose("home")
    study = study_joints(robot, start, "all at once", SPEED, 0.5)
    q = np.tile(start, (len(study.time), 1))
    q[:, list(study.moving)] = study.angle
    way = np.linalg.norm(np.diff(robot.forward(q)[:, :3, 3], axis=0), axis=1)
    assert study.total is not None
    middles = 0.5 * (study.total[1:] + study.total[:-1])
    slopes = way / np.diff(study.time)
    running = (np.abs(np.diff(study.angle, axis=0)) > 0).all(axis=1)  # no joint has come to its limit
    assert running.sum() > 50
    assert slopes[running] == pytest.approx(middles[running], rel=1e-4)


def test_alone_a_joint_moves_the_tip_at_a_level_speed_until_its_limit() -> None:
    robot = load_robot("abaas")
    study = study_joints(robot, robot.pose("home"), "in turn", SPEED)
    shoulder = study.moving.index(1)
    curve = study.tip_speed[:, shoulder]
    turns = ~np.isnan(curve)
    lever = np.linalg.norm(robot.forward(robot.pose("home"))[:3, 3] - [0, 0, 0.105])
    assert curve[turns] == pytest.approx(SPEED * lever, rel=1e-9)
    # from 115° the lower limit is farther than the upper one: 115° at 20 °/s
    assert study.time[turns].max() == pytest.approx(115 / 20, abs=0.02)
    assert np.degrees(study.angle[turns, shoulder]).min() == pytest.approx(0, abs=0.4)
    assert study.time[-1] == pytest.approx(170 / 20)  # the elbow has the longest way, from -80° to 90°


def test_the_shoulder_of_the_abaas_arm_moves_the_tip_fastest_and_the_printed_speed_cannot_be() -> None:
    robot = load_robot("abaas")
    for pose in ("home", "rest", "zero"):
        for turning in BOTH:
            study = study_joints(robot, robot.pose(pose), turning, SPEED)
            folded = (pose, turning) == ("rest", "in turn")  # the tip is nearer to the shoulder there
            assert robot.joint_names[study.moving[int(study.peaks.argmax())]] == (
                "elbow" if folded else "shoulder"
            )
            assert study.peaks.max() < 0.1240
    most = SPEED * longest_levers(robot.chain, robot.limits).max()
    assert 1000 * most == pytest.approx(123.9, abs=0.05)
    assert most < 8.32 / 60  # the paper prints 8.32·10³ mm/s


def test_what_cannot_be_studied_is_refused() -> None:
    robot = load_robot("mico")
    home = robot.pose("home")
    for speed in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match="joint speed must be a finite number above zero"):
            study_joints(robot, home, "in turn", speed)
    with pytest.raises(InputError, match="duration must be"):
        study_joints(robot, home, "in turn", 1.0, 0.0)
    with pytest.raises(MotionRefusedError, match="Shoulder"):
        study_joints(robot, [0, 2, 0, 0], "in turn", 1.0)


def test_the_curves_are_exported_with_units() -> None:
    robot = load_robot("humanoid")
    for turning, columns in (("in turn", 9), ("all at once", 10)):
        study = study_joints(robot, robot.pose("home"), turning, SPEED, 1.5)  # type: ignore[arg-type]
        assert (study.moving, study.held, study.time[-1]) == ((0, 1, 2, 3), (4,), 1.5)
        head, *rows = study_csv(robot, study).splitlines()
        names = head.split(",")
        assert len(names) == columns and len(rows) == len(study.time)
        assert {"time_s", "elbow_deg", "tip_by_elbow_mm_s"} <= set(names)
        first = dict(zip(names, rows[0].split(","), strict=True))
        assert float(first["elbow_deg"]) == pytest.approx(40)
        assert float(first["tip_by_elbow_mm_s"]) == pytest.approx(1000 * SPEED * 0.29, abs=1e-3)


def test_a_process_of_its_own_draws_the_same_figure() -> None:
    shown = TitledMotion("fast", motion("trapezoid", 301, None))
    figure = figure_file(ROBOT, "png", shown)
    assert figure == figure_bytes(ROBOT, "png", shown)
    with pytest.raises(RuntimeError, match=r"(?s)the figure was not drawn: .*gif"):
        figure_file(ROBOT, cast("FigureForm", "gif!"), shown)

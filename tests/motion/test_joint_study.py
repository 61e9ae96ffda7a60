"""The tip's speed joint by joint: the analytic curves, their ends, and what the abaas paper finds."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armctl.errors import InputError, MotionRefusedError
from armctl.kinematics.workspace import longest_levers
from armctl.motion.joint_study import Turning, study_csv, study_joints
from armctl.robot import load_robot

SPEED = math.radians(20)
NAMES = ("uzuner", "abaas", "scorbot", "mico", "humanoid")
BOTH: tuple[Turning, ...] = ("in turn", "all at once")


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("turning", BOTH)
def test_the_curves_are_the_derivatives_of_the_tip_s_position(name: str, turning: Turning) -> None:
    robot = load_robot(name)
    start = robot.pose("home")
    study = study_joints(robot, start, turning, SPEED)
    assert study.mismatch < 1e-7
    h = 1e-5
    for k in range(0, len(study.time), 37):
        for column, joint in enumerate(study.moving):
            q = np.array(start)
            if turning == "all at once":
                q[list(study.moving)] = study.angle[k]
            if math.isnan(study.tip_speed[k, column]):
                continue
            q[joint] = study.angle[k, column]
            if study.tip_speed[k, column] == 0.0:
                continue
            ahead, behind = q.copy(), q.copy()
            ahead[joint] += h
            behind[joint] -= h
            step = robot.forward(ahead)[:3, 3] - robot.forward(behind)[:3, 3]
            expected = SPEED * np.linalg.norm(step) / (2 * h)
            assert study.tip_speed[k, column] == pytest.approx(expected, rel=1e-6, abs=1e-9)


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


@pytest.mark.parametrize("name", NAMES)
def test_no_joint_is_faster_than_its_longest_lever_allows(name: str) -> None:
    robot = load_robot(name)
    most = SPEED * longest_levers(robot.chain, robot.limits)
    for turning in BOTH:
        study = study_joints(robot, robot.pose("home"), turning, SPEED)
        assert (study.peaks <= most[list(study.moving)] * (1 + 1e-9) + 1e-12).all()


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
            assert robot.joint_names[study.fastest] == ("elbow" if folded else "shoulder")
            assert study.peaks.max() < 0.1240
    most = SPEED * longest_levers(robot.chain, robot.limits).max()
    assert 1000 * most == pytest.approx(123.9, abs=0.05)
    assert most < 8.32 / 60  # the paper prints 8.32·10³ mm/s


def test_a_held_joint_is_left_out() -> None:
    robot = load_robot("humanoid")
    study = study_joints(robot, robot.pose("home"), "in turn", SPEED)
    assert (study.moving, study.held) == ((0, 1, 2, 3), (4,))
    assert study.tip_speed.shape == (len(study.time), 4)


def test_the_duration_cuts_the_study_off() -> None:
    robot = load_robot("mico")
    study = study_joints(robot, robot.pose("home"), "all at once", SPEED, 1.5)
    assert study.time[-1] == 1.5
    assert np.ptp(study.angle, axis=0) == pytest.approx(np.full(4, 1.5 * SPEED))


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
        study = study_joints(robot, robot.pose("home"), turning, SPEED)  # type: ignore[arg-type]
        head, *rows = study_csv(robot, study).splitlines()
        names = head.split(",")
        assert len(names) == columns and len(rows) == len(study.time)
        assert {"time_s", "elbow_deg", "tip_by_elbow_mm_s"} <= set(names)
        first = dict(zip(names, rows[0].split(","), strict=True))
        assert float(first["elbow_deg"]) == pytest.approx(40)
        assert float(first["tip_by_elbow_mm_s"]) == pytest.approx(1000 * SPEED * 0.29, abs=1e-3)

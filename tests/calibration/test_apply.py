"""A robot as it was calibrated: pulses, limits, poses, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.arms import FIVE
from tests.calibration.kit import HiddenJoint

from armctl.calibration import (
    Calibration,
    CalibrationStore,
    JointCalibration,
    JointDeflection,
    calibrated,
    check_pose,
    fit_joint,
    narrowed,
    own_calibration,
    safe_outputs,
)
from armctl.errors import CalibrationError
from armctl.robot import Robot, load_robot

UZUNER = load_robot("uzuner")
ELBOW = UZUNER.joint_names.index("elbow")


def of(robot: Robot, gripper: tuple[float, float] | None = None, **joints: JointCalibration) -> Calibration:
    assert robot.output_map is not None
    return Calibration(robot.name, "1", robot.output_map.unit, joints, gripper)


def elbow(zero: float, per_deg: float, low: float, high: float) -> JointCalibration:
    return JointCalibration(zero, math.degrees(per_deg), low, high)


def test_pulses_are_those_of_the_calibration_and_the_others_stay() -> None:
    robot = calibrated(UZUNER, of(UZUNER, (1100.0, 1850.0), elbow=elbow(1520.0, -9.0, 600.0, 2400.0)))
    assert robot.output_map is not None and UZUNER.output_map is not None
    q = np.radians([10.0, 20.0, 30.0, 40.0, 5.0])
    expected = UZUNER.output_map.outputs(q) | {2: 1520.0 - 9.0 * 30.0}
    assert robot.output_map.outputs(q) == pytest.approx(expected)
    assert robot.output_map.angles(robot.output_map.outputs(q)) == pytest.approx(q)
    assert robot.output_map.gripper_output(0.0) == {5: 1100.0}
    assert robot.output_map.gripper_output(1.0) == {5: 1850.0}
    assert UZUNER.output_map.outputs(q)[2] == pytest.approx(1446.45 + 300.0), "the robot itself changed"


@pytest.mark.parametrize("name", FIVE)
def test_the_robots_own_numbers_change_nothing(name: str) -> None:
    robot = load_robot(name)
    own = of(robot, **{joint: own_calibration(robot, joint) for joint in robot.joint_names})
    assert narrowed(robot, own) == ()
    same = calibrated(robot, own)
    np.testing.assert_array_equal(same.limits, robot.limits)
    for pose in robot.poses:
        np.testing.assert_array_equal(same.pose(pose), robot.pose(pose))


def test_limits_move_in_to_what_the_safe_outputs_allow_and_poses_with_them() -> None:
    measured = of(UZUNER, elbow=elbow(1500.0, 10.0, 800.0, 2300.0))
    robot = calibrated(UZUNER, measured)
    assert np.degrees(robot.limits[ELBOW]) == pytest.approx([-70.0, 80.0])
    np.testing.assert_array_equal(np.delete(robot.limits, ELBOW, 0), np.delete(UZUNER.limits, ELBOW, 0))
    assert np.degrees(robot.pose("home")) == pytest.approx([0, 90, -70, -40, 0])
    robot.check_limits(robot.pose("rest"))
    limit, home, rest = narrowed(UZUNER, measured)
    assert limit == (
        "Elbow: -70.00° … 80.00° instead of -84.36° … 95.07°, because the safe outputs end at 800.0 and "
        "2300.0 µs"
    )
    assert home == "pose home moves in: Elbow -70.00° (was -80.00°)"
    assert rest.startswith("pose rest moves in")


@given(
    st.floats(1300, 1700),
    st.floats(7, 13).flatmap(lambda size: st.sampled_from([size, -size])),
    st.floats(600, 1200),
    st.floats(1800, 2400),
)
def test_inside_its_limits_a_calibrated_joint_never_leaves_its_safe_outputs(
    zero: float, per_deg: float, low: float, high: float
) -> None:
    robot = calibrated(UZUNER, of(UZUNER, elbow=elbow(zero, per_deg, low, high)))
    assert robot.output_map is not None
    for end in robot.limits.T:
        assert low - 1e-6 <= robot.output_map.outputs(end)[2] <= high + 1e-6
    assert (robot.limits[:, 0] >= UZUNER.limits[:, 0]).all()
    assert (robot.limits[:, 1] <= UZUNER.limits[:, 1]).all()


def test_no_servo_is_ever_sent_beyond_its_range_in_the_robot_file() -> None:
    """Whoever types 300 … 2900 µs would break a horn: the file's range holds, and moves the limits in."""
    wide = of(UZUNER, elbow=elbow(1446.45, 12.0, 300.0, 2900.0))
    robot = calibrated(UZUNER, wide)
    assert robot.output_map is not None
    assert (robot.output_map.low[ELBOW], robot.output_map.high[ELBOW]) == (602.0, 2398.0)
    for end in robot.limits.T:
        assert 601.8 <= robot.output_map.outputs(end)[2] <= 2398.2
    cut, *_ = narrowed(UZUNER, wide)
    assert cut == "Elbow: of the safe outputs 300.0 … 2900.0 µs the robot file allows 602.0 … 2398.0"


def test_an_encoder_board_is_told_no_wider_soft_limits_than_the_joint_has() -> None:
    robot = load_robot("scorbot")
    own = own_calibration(robot, "shoulder")
    wide = of(robot, shoulder=JointCalibration(own.zero, own.per_rad, -99999.0, 99999.0))
    arm = calibrated(robot, wide)
    assert arm.output_map is not None
    assert (arm.output_map.low[1], arm.output_map.high[1]) == pytest.approx((own.low, own.high))
    assert len(narrowed(robot, wide)) == 1


def test_what_is_not_kept_yet_is_refused_without_advice_to_forget_what_is() -> None:
    for wrong, says in (
        (
            of(load_robot("scorbot"), shoulder=elbow(0.0, 113.0, 5000.0, 9000.0)),
            "Shoulder: .* nothing is left",
        ),
        (of(load_robot("scorbot"), shoulder=elbow(6813.0, 113.0, -5000.0, -100.0)), "homing ends at"),
    ):
        with pytest.raises(CalibrationError, match=says) as refusal:
            narrowed(load_robot(wrong.robot), wrong)
        assert "forget" not in str(refusal.value)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (msgspec.structs.replace(of(UZUNER), unit="counts"), "it is in counts, and the robot file .* in µs"),
        (of(UZUNER, knee=elbow(1500, 10, 600, 2400)), "has no joint 'knee'"),
        (of(UZUNER, elbow=elbow(1500, 10, 2400, 600)), "the smallest safe output comes first"),
        (of(UZUNER, elbow=elbow(1000, 10, 2000, 2300)), "put it at 100.0° … 130.0°, .* nothing is left"),
        (of(UZUNER, elbow=elbow(1500, 10, 2500, 2600)), "2500.0 … 2600.0 µs lie outside of 602.0 … 2398.0"),
        (of(UZUNER, (10.0, 1900.0)), "gripper: 10 … 1900 µs; the board takes 64 … 4080 µs"),
        (of(UZUNER, elbow=elbow(math.nan, 10, 600, 2400)), "elbow.zero: nan is no number"),
        (of(UZUNER, (1500.0, 1500.0)), "closed and open are both 1500"),
    ],
)
def test_one_that_does_not_fit_says_why_and_how_to_set_it_aside(wrong: Calibration, says: str) -> None:
    with pytest.raises(CalibrationError, match=f"{says}.*armctl calibrate forget uzuner --board 1"):
        calibrated(UZUNER, wrong)


def test_a_light_arm_may_be_soft_by_any_number_while_it_sags_little(tmp_path: Path) -> None:
    arm, store = load_robot("mearm"), CalibrationStore(tmp_path)
    heaviest = float(replace(arm.gravity, payload_kg=0.0).heaviest(arm.limits)[2])

    def soft(sag_deg: float) -> Calibration:
        way = JointDeflection(compliance=math.radians(sag_deg) / heaviest)
        return msgspec.structs.replace(of(arm), deflection={arm.joint_names[2]: way})

    store.save(soft(6.0))  # more than 130° a N·m
    kept = store.load(arm.name, "1")
    assert kept is not None
    deflection = calibrated(arm, kept).outputs.deflection
    assert deflection is not None and deflection.link[2] * heaviest == pytest.approx(math.radians(6.0))
    with pytest.raises(CalibrationError, match=r"sags by 12\.0°; more than 10° is broken, not soft"):
        calibrated(arm, soft(12.0))


def test_another_robots_calibration_and_a_gripper_that_is_not_there_are_refused() -> None:
    for use in (calibrated, narrowed):
        with pytest.raises(CalibrationError, match="this calibration is of uzuner, not of abaas"):
            use(load_robot("abaas"), of(UZUNER))
    humanoid = load_robot("humanoid")
    with pytest.raises(CalibrationError, match=r"it sets a gripper, and .* has none"):
        calibrated(humanoid, of(humanoid, (1000.0, 2000.0)))


def test_an_encoder_arms_counts_and_home_come_from_the_same_marks() -> None:
    robot = load_robot("scorbot")
    own = own_calibration(robot, "shoulder")
    hidden = HiddenJoint(own.zero + 340.0, math.radians(own.per_rad) * 1.03)
    fit = fit_joint(hidden.marks(np.array([-110.0, -60.0, -20.0, 20.0])), "counts")
    low, high = safe_outputs(robot, "shoulder", fit)
    measured = of(robot, shoulder=JointCalibration(fit.zero, fit.per_rad, low, high))
    arm = calibrated(robot, measured)
    assert narrowed(robot, measured) == ()
    assert math.degrees(arm.first_pose[1]) == pytest.approx(-hidden.zero / hidden.per_deg)
    assert arm.output_map is not None
    assert arm.output_map.outputs(arm.limits[:, 0])[1] == pytest.approx(low)


def test_homing_may_not_end_outside_of_the_limits() -> None:
    robot = load_robot("scorbot")
    own = own_calibration(robot, "shoulder")
    moved = JointCalibration(own.zero - 100 * math.radians(own.per_rad), own.per_rad, -30000.0, 30000.0)
    with pytest.raises(CalibrationError, match=r"Shoulder: homing ends at 40.00°, outside of its limits"):
        calibrated(robot, of(robot, shoulder=moved))


@pytest.mark.parametrize("name", FIVE)
def test_the_pose_to_look_at_is_right_angled_inside_and_clear(name: str) -> None:
    robot = load_robot(name)
    pose = check_pose(robot)
    assert pose.title == "right angles"
    np.testing.assert_allclose(np.degrees(pose.q) / 90, np.round(np.degrees(pose.q) / 90), atol=1e-9)
    robot.check_limits(pose.q)
    assert robot.frames(pose.q)[1:, 2, 3].min() > robot.floor_z
    x, y, z = 1000 * robot.forward(pose.q)[:3, 3]
    assert pose.words[-1] == f"the tool at x {x:.1f}, y {y:.1f}, z {z:.1f} mm from the base"
    assert len(pose.words) == robot.n + 1


def test_where_no_right_angles_are_left_it_is_home() -> None:
    robot = calibrated(UZUNER, of(UZUNER, elbow=elbow(1500.0, 10.0, 700.0, 1400.0)))
    pose = check_pose(robot)
    assert pose.title == "home"
    np.testing.assert_array_equal(pose.q, robot.pose("home"))

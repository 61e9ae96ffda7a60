"""An arm that gives way: what it is told so that it stands where it is wanted, and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armctl.arrays import FloatArray
from armctl.calibration import (
    Calibration,
    JointDeflection,
    LengthChange,
    calibrated,
    decode_calibration,
    encode_calibration,
)
from armctl.errors import CalibrationError
from armctl.kinematics import Body, Chain, DHRow, GravityModel
from armctl.robot import Deflection, Robot, load_robot
from armctl.robot.record import robot_of, robot_record

SO101 = load_robot("so101")
SOFT = Calibration(
    "so101", "1", "steps", {},
    deflection={
        "shoulder_lift": JointDeflection(np.radians(2.0), np.radians(1.0), np.radians(1.0)),
        "elbow_flex": JointDeflection(np.radians(3.0)),
    },
    lengths=(LengthChange(2, "a", 0.001),),
)  # fmt: skip


def soft() -> Robot:
    assert SO101.output_map is not None
    return calibrated(SO101, replace_unit(SOFT, SO101.output_map.unit))


def replace_unit(calibration: Calibration, unit: str) -> Calibration:
    return Calibration(
        calibration.robot, calibration.board, unit, {}, deflection=calibration.deflection,
        lengths=calibration.lengths,
    )  # fmt: skip


def poses(count: int = 50) -> FloatArray:
    return np.random.default_rng(2).uniform(SO101.limits[:, 0], SO101.limits[:, 1], (count, SO101.n))


def test_what_is_told_is_ahead_by_what_gravity_bends_and_comes_back_as_it_was_wanted() -> None:
    robot, rigid = soft(), SO101.output_map
    assert robot.output_map is not None and rigid is not None
    gravity = replace(SO101.gravity, payload_kg=0.0, chain=robot.chain)
    for q in poses():
        told = robot.output_map.outputs(q)
        ahead = (np.array(list(told.values())) - rigid.zero) / rigid.per_rad - q
        torque = gravity.torque(q[None])[0]
        np.testing.assert_allclose(ahead[2], np.radians(3.0) * torque[2], rtol=0, atol=1e-9)
        lean = ahead[1] - np.radians(3.0) * torque[1]
        assert abs(lean) <= np.radians(0.5) + 1e-9 and lean * torque[1] >= 0
        np.testing.assert_allclose(ahead[[0, 3, 4]], 0.0, atol=1e-12)
        np.testing.assert_allclose(robot.output_map.angles(told), q, rtol=0, atol=1e-5)


def test_what_encoders_read_has_the_sag_of_the_servo_in_it_already() -> None:
    robot, rigid = soft(), SO101.output_map
    assert robot.output_map is not None and rigid is not None
    for q in poses(10):
        setpoint = robot.output_map.outputs(q)
        torque = replace(SO101.gravity, payload_kg=0.0, chain=robot.chain).torque(q)
        drop = np.radians(1.0) * torque[1] * rigid.per_rad[1]
        read = setpoint | {rigid.channels[1]: setpoint[rigid.channels[1]] - drop}
        np.testing.assert_allclose(robot.output_map.angles(read, measured=True), q, rtol=0, atol=1e-5)


def test_what_is_told_changes_smoothly() -> None:
    robot = soft()
    assert robot.output_map is not None and robot.output_map.deflection is not None
    way = np.linspace(SO101.limits[:, 0], SO101.limits[:, 1], 4001)
    bends = np.array([robot.output_map.deflection.setpoint(q) - q for q in way])
    assert np.abs(np.diff(bends, axis=0)).max() < 0.4 * np.abs(np.diff(way, axis=0)).max()


def test_an_angle_that_is_not_known_leaves_the_others_as_they_were_told() -> None:
    robot, rigid = soft(), SO101.output_map
    assert robot.output_map is not None and rigid is not None
    told = rigid.outputs(SO101.pose("home"))
    one = dict[int, float | None](told) | {rigid.channels[4]: None}
    np.testing.assert_allclose(robot.output_map.angles(one)[:4], SO101.pose("home")[:4], atol=1e-12)


@pytest.mark.parametrize("seed", range(40))
def test_angles_of_random_arms_with_much_play_come_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    twists = rng.choice([0.0, 0.0, np.pi / 2, -np.pi / 2], n)
    twists[0] = np.pi / 2
    rows = [
        DHRow(a_m=float(rng.uniform(0, 0.3)), alpha_rad=float(twist), d_m=float(rng.uniform(0, 0.1)))
        for twist in twists
    ]
    bodies = [Body(i, float(rng.uniform(0, 1)), (float(rng.uniform(-0.1, 0.1)), 0.0, 0.02)) for i in range(n)]
    gravity = GravityModel(Chain.from_dh(rows), tuple(bodies), float(rng.uniform(0, 0.5)))
    limits = np.radians(rng.uniform([-180, 20], [-20, 180], (n, 2)))
    heaviest = gravity.heaviest(limits)
    link, drive = np.radians(rng.uniform(0, 3, (2, n))) / np.maximum(heaviest, 0.1 * heaviest.max())
    play = np.radians(rng.uniform(0, 10, n))
    soft = replace(Deflection.of(gravity, heaviest), link=link, drive=drive, play=play).invertible(limits)
    for q in rng.uniform(*limits.T, (60, n)):
        np.testing.assert_allclose(soft.angles(soft.setpoint(q), measured=False), q, rtol=0, atol=3e-5)
        np.testing.assert_allclose(soft.angles(soft.shaft(q), measured=True), q, rtol=0, atol=3e-5)


def test_an_arm_that_was_calibrated_with_ten_degrees_of_play_reads_back_what_it_was_told() -> None:
    assert SO101.output_map is not None
    play = {name: JointDeflection(play=np.radians(10.0)) for name in SO101.joint_names}
    robot = calibrated(SO101, Calibration("so101", "1", SO101.output_map.unit, {}, deflection=play))
    assert robot.output_map is not None
    for q in poses(300):
        np.testing.assert_allclose(robot.output_map.angles(robot.output_map.outputs(q)), q, rtol=0, atol=3e-5)


@pytest.mark.parametrize("name", ["so101", "uzuner", "al5d", "mearm", "widowx250s"])
def test_little_play_leans_as_it_always_did(name: str) -> None:
    robot = load_robot(name)
    rigid = Deflection.of(robot.gravity, robot.gravity.heaviest(robot.limits))
    assert replace(rigid, play=np.full(robot.n, np.radians(2.0))).invertible(robot.limits).friction == (
        rigid.friction
    )


def test_torques_of_one_pose_are_those_of_many() -> None:
    for name in ("so101", "uzuner", "mearm", "parol6"):
        robot = load_robot(name)
        q = np.random.default_rng(1).uniform(robot.limits[:, 0], robot.limits[:, 1], (20, robot.n))
        many = robot.gravity.torque(q)
        np.testing.assert_allclose([robot.gravity.torque(one) for one in q], many, rtol=0, atol=1e-12)


def test_a_robot_that_gives_way_crosses_to_another_process() -> None:
    robot = soft()
    again = robot_of(robot_record(robot))
    assert again.output_map == robot.output_map and again.chain == robot.chain
    assert robot.chain.rows[2].a_m == pytest.approx(0.117)


def test_its_calibration_is_kept_and_files_without_it_are_read_as_before() -> None:
    again = decode_calibration(encode_calibration(SOFT))
    assert again.lengths == (LengthChange(2, "a", pytest.approx(0.001)),)
    assert again.deflection["elbow_flex"].compliance == pytest.approx(np.radians(3.0))
    assert not again.empty
    text = 'format = 1\nrobot = "so101"\nboard = "1"\nunit = "steps"\nmade = ""\n'
    old = decode_calibration(text)
    assert old.empty and old.deflection == {} and old.lengths == ()
    assert "deflection" not in encode_calibration(old)


@pytest.mark.parametrize(
    ("change", "fact"),
    [
        ({"deflection": {"elbow_flex": JointDeflection(np.radians(80.0))}}, "Elbow flex sags by"),
        ({"deflection": {"wing": JointDeflection(0.01)}}, "no joint 'wing'"),
        ({"lengths": (LengthChange(9, "a", 0.001),)}, "DH row 10"),
    ],
)
def test_what_makes_no_sense_is_refused(change: dict[str, object], fact: str) -> None:
    assert SO101.output_map is not None
    with pytest.raises(CalibrationError, match=fact):
        calibrated(SO101, Calibration("so101", "1", SO101.output_map.unit, {}, **change))  # pyright: ignore[reportArgumentType]

"""Fitting a joint's marks: hidden numbers come back, wrong marks are named, hopeless ones refused."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.calibration.kit import HiddenJoint, with_wrong
from tests.long import examples

from armctl.calibration import (
    LEAST_MARKS,
    JointCalibration,
    Mark,
    differences,
    fit_joint,
    own_calibration,
    safe_outputs,
)
from armctl.errors import CalibrationError
from armctl.facts.servos import ServoSeam
from armctl.robot import load_robot

hidden_joints = st.builds(
    HiddenJoint,
    zero=st.floats(-20000, 20000),
    per_deg=st.floats(0.5, 200).flatmap(lambda size: st.sampled_from([size, -size])),
)


@given(hidden_joints, st.integers(3, 12), st.floats(20, 300), st.floats(-100, 100), st.randoms())
def test_without_noise_the_hidden_numbers_come_back(
    hidden: HiddenJoint, count: int, span: float, middle: float, random: object
) -> None:
    angles = middle + np.linspace(-span / 2, span / 2, count)
    marks = hidden.marks(angles)
    random.shuffle(marks)  # type: ignore[attr-defined]
    fit = fit_joint(marks)
    assert fit.per_rad == pytest.approx(math.degrees(hidden.per_deg), rel=1e-9)
    assert fit.zero == pytest.approx(hidden.zero, rel=1e-9, abs=1e-7)
    assert fit.suspect is None and fit.advice is None
    assert fit.rms_rad < 1e-9


@settings(max_examples=examples(200), derandomize=True)
@given(hidden_joints, st.integers(5, 12), st.floats(0.05, 0.6), st.integers(0, 2**32))
def test_noise_moves_the_line_no_further_than_it_must(
    hidden: HiddenJoint, count: int, noise: float, seed: int
) -> None:
    """Of n readings with the deviation s the line's own is s·sqrt(1/n + lever²): six of that are kept."""
    angles = np.linspace(-70, 70, count)
    fit = fit_joint(hidden.marks(angles, noise, np.random.default_rng(seed)))
    spread = math.sqrt(float(np.sum(angles**2)))
    for true in (-70.0, 0.0, 35.0, 70.0):
        told = math.degrees(fit.angle(hidden.zero + hidden.per_deg * true))
        assert abs(told - true) < 6 * noise * math.sqrt(1 / count + (true / spread) ** 2)
    scale = fit.per_rad / math.degrees(hidden.per_deg) - 1
    assert abs(scale) < 6 * math.radians(noise) / math.radians(spread) * 1.1


@pytest.mark.parametrize("count", [4, 5, 6, 9, 15])
@pytest.mark.parametrize("by_deg", [12.0, -12.0, 40.0])
def test_a_wrong_mark_is_named_wherever_it_is(count: int, by_deg: float) -> None:
    rng = np.random.default_rng(count)
    hidden, angles = HiddenJoint(), np.linspace(-65, 75, count)
    for index in range(count):
        fit = fit_joint(with_wrong(hidden.marks(angles, 0.2, rng), index, by_deg))
        assert fit.suspect == index
        assert math.degrees(fit.residuals_rad[index]) == pytest.approx(by_deg, abs=1.5)
        assert fit.advice is not None and f"mark {index + 1} does not fit" in fit.advice
        expected = math.degrees(fit.angle(hidden.zero + hidden.per_deg * angles[index]))
        assert f"it should be {expected:.1f}°" in fit.advice
        assert math.degrees(fit.per_rad / hidden.per_deg) == pytest.approx((180 / math.pi) ** 2, rel=0.03)


def test_good_marks_are_hardly_ever_blamed_and_wrong_ones_hardly_ever_mistaken() -> None:
    rng = np.random.default_rng(3)
    seen: Counter[str] = Counter()
    for trial in range(600):
        count = 4 + trial % 8
        marks = HiddenJoint().marks(np.linspace(-70, 70, count), 0.5, rng)
        seen["blamed"] += fit_joint(marks).suspect is not None
        index = int(rng.integers(count))
        fit = fit_joint(with_wrong(marks, index, 15.0))
        seen["named"] += fit.suspect == index
        seen["mistaken"] += fit.suspect not in (None, index)
    assert seen["blamed"] <= 6 and seen["mistaken"] <= 3
    assert seen["named"] >= 585


@pytest.mark.parametrize(
    ("pairs", "says"),
    [
        ([], "0 marks are too few"),
        ([(1000, 0), (2000, 90)], f"2 marks are too few: {LEAST_MARKS} are needed"),
        ([(1500, 0), (1500, 30), (1500, 60)], "all marks are at one place, 1500.0 µs"),
        ([(1000, 0), (1001, 0), (2000, 90)], "the marks are at 2 places only"),
        ([(1000, 0), (1500, 4), (2000, 8)], "spread over 8.0° only"),
        ([(1000, 0), (1500, 5), (2000, 9.999)], "spread over 9.999° only: .* over 10° at least"),
        ([(1000, 0), (1500, math.nan), (2000, 80)], "mark 2 is no pair of finite numbers"),
        ([(1000, 0), (math.inf, 40), (2000, 80)], "mark 2 is no pair of finite numbers"),
        (
            [(1000, 0), (1500, 50), (2000, 10)],
            r"mark 2 \(1500.0 µs, 50.0°\) and mark 3 .* turns back",
        ),
        ([(1000, 0), (1300, 50), (1600, -10), (2000, 70), (2300, 5)], "the angle does not go one way"),
    ],
)
def test_marks_that_give_no_line_are_refused_in_words(pairs: list[tuple[float, float]], says: str) -> None:
    with pytest.raises(CalibrationError, match=says):
        fit_joint([Mark(output, math.radians(angle)) for output, angle in pairs])


@pytest.mark.parametrize(
    ("marks", "suspect", "says"),
    [
        (with_wrong(HiddenJoint().marks(np.array([-60.0, 0.0, 60.0])), 2, 15.0), None, "3 marks cannot tell"),
        (
            with_wrong(HiddenJoint().marks(np.array([-60.0, -30.0, 0.0, 30.0, 60.0])), 1, 60.0),
            1,
            "it should be -30.0° (is its sign wrong?)",
        ),
        # every reading is off: none stands out
        ([Mark(800 + 100 * i, math.radians(10 * i + (4, -4)[i % 2])) for i in range(12)], None, "scatter"),
    ],
)
def test_advice_on_marks_that_do_not_fit(marks: list[Mark], suspect: int | None, says: str) -> None:
    fit = fit_joint(marks)
    assert fit.suspect == suspect
    assert fit.advice is not None and says in fit.advice


def test_differences_are_told_against_the_robot_file() -> None:
    robot = load_robot("uzuner")
    own = own_calibration(robot, "elbow")
    per_deg = math.radians(own.per_rad)
    turned = fit_joint(HiddenJoint(own.zero, -per_deg).marks(np.array([-60.0, 0.0, 30.0, 60.0])))
    assert differences(robot, "elbow", turned)[0] == "Elbow turns the other way than uzuner says"
    same = fit_joint(HiddenJoint(own.zero, per_deg).marks(np.array([-60.0, 0.0, 30.0, 60.0])))
    assert differences(robot, "elbow", same) == ()
    other = fit_joint(HiddenJoint(own.zero - 50, per_deg * 1.04).marks(np.array([-60.0, 0.0, 60.0])))
    scale, offset = differences(robot, "elbow", other)
    assert scale == "Elbow needs 4.0% more µs a degree"
    assert offset == "Elbow stands at 0.0° where uzuner says -5.0° (+5.0°)"
    with pytest.raises(CalibrationError, match="has no joint 'knee'; it has base, shoulder"):
        differences(robot, "knee", same)


def test_safe_outputs_hold_the_limits_and_stay_inside_the_servos_range() -> None:
    robot = load_robot("uzuner")
    own, joint = own_calibration(robot, "elbow"), robot.joints[2]
    inside = fit_joint(HiddenJoint(own.zero, 8.0).marks(np.array([-60.0, 0.0, 60.0])))
    assert safe_outputs(robot, "elbow", inside) == pytest.approx(
        [inside.zero + inside.per_rad * limit for limit in (joint.lower, joint.upper)]
    )
    beyond = fit_joint(HiddenJoint(own.zero, -14.0).marks(np.array([-60.0, 0.0, 60.0])))
    assert safe_outputs(robot, "elbow", beyond) == (own.low, own.high)
    far = fit_joint(HiddenJoint(9000.0, 10.0).marks(np.array([-60.0, 0.0, 60.0])))
    with pytest.raises(CalibrationError, match=r"need outputs of 8156 … 9951 µs, .* 602 … 2398"):
        safe_outputs(robot, "elbow", far)


def test_safe_outputs_set_by_hand_stay_when_a_joint_is_measured_anew() -> None:
    robot = load_robot("uzuner")
    fit = fit_joint(HiddenJoint(1470.0, 9.5).marks(np.array([-60.0, 0.0, 60.0])))
    low, high = safe_outputs(robot, "elbow", fit)
    before = JointCalibration(1440.0, math.degrees(9.8), 900.0, 1440.0 + 9.8 * 95.07)
    assert safe_outputs(robot, "elbow", fit, before) == (900.0, high), "only the lower end was set by hand"
    wide = JointCalibration(1440.0, math.degrees(9.8), 600.0, 2400.0)
    assert safe_outputs(robot, "elbow", fit, wide) == (low, high)
    gone = JointCalibration(1440.0, math.degrees(9.8), 602.0, 640.0)
    far = fit_joint(HiddenJoint(1520.0, 9.0).marks(np.array([-60.0, 0.0, 60.0])))
    with pytest.raises(CalibrationError, match="Elbow: the safe outputs that were set by hand do not reach"):
        safe_outputs(robot, "elbow", far, gone)


def test_an_encoder_that_is_measured_anew_keeps_its_joints_whole_range() -> None:
    """Its counts follow its scale: the old ones would take from the joint."""
    robot = load_robot("scorbot")
    own = own_calibration(robot, "waist")
    coarser = fit_joint(HiddenJoint(0.0, math.radians(own.per_rad) * 1.1).marks(np.array([-90.0, 0.0, 90.0])))
    assert safe_outputs(robot, "waist", coarser, own) == pytest.approx((1.1 * own.low, 1.1 * own.high))


@pytest.mark.parametrize("middle", [0.0, 4090.0, 2048.0])
def test_a_joint_whose_range_crosses_the_seam_of_its_servo_is_refused_with_what_to_do(middle: float) -> None:
    """A wrist that is sent from 4000 to 100 steps spins by a turn the other way."""
    angles = np.radians([-100.0, -60.0, -10.0, 30.0, 95.0])
    outputs = (middle + angles * 4096 / math.tau) % 4096
    marks = [Mark(*pair) for pair in zip(outputs.tolist(), angles.tolist(), strict=True)]
    if middle == 2048.0:
        assert fit_joint(marks, "steps", 4096.0).zero == pytest.approx(2048.0)
        return
    with pytest.raises(CalibrationError, match="crosses the end of its servo's turn") as refused:
        fit_joint(marks, "steps", 4096.0)
    reason = refused.value.reason
    assert isinstance(reason, ServoSeam) and (reason.low < 1200 and reason.high > 2900)


def test_two_clusters_of_marks_on_either_side_of_a_wide_range_are_no_seam() -> None:
    angles = np.radians([-110.0, -100.0, 100.0, 112.0])
    marks = [Mark(2048 + float(angle) * 4096 / math.tau, float(angle)) for angle in angles]
    assert fit_joint(marks, "steps", 4096.0).zero == pytest.approx(2048.0)

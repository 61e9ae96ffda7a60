"""Touched points in the base frame: how far the tool is off, what is to blame, what to write where."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.arms import FIVE
from tests.robot.test_urdf_tool import PROP
from tests.robot.urdf_kit import written

from armctl.arrays import FloatArray
from armctl.calibration import (
    Calibration,
    Touches,
    TouchFit,
    calibrated,
    changes,
    corrected,
    fit_touches,
    own_map,
    suggestion,
)
from armctl.errors import CalibrationError
from armctl.facts.causes import GoodAlready, LengthOff, ZeroOff
from armctl.kinematics import Chain
from armctl.robot import Robot, load_robot


def random_poses(robot: Robot, rng: np.random.Generator, count: int = 10) -> FloatArray:
    return rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (count, robot.n))


def longer(robot: Robot, row: int, key: str, by_m: float) -> Chain:
    """Its chain with a length of a row (from 0) that is not as the file says."""
    rows = list(robot.chain.rows)
    rows[row] = replace(rows[row], **{f"{key}_m": getattr(rows[row], f"{key}_m") + by_m})
    return Chain.from_dh(
        rows, "modified" if robot.chain.convention == "modified" else "standard", robot.chain.coupling
    )


def fitted(robot: Robot, q: FloatArray, truth: FloatArray) -> TouchFit:
    """What is said of points (k, 3) where the tool truly is, or of poses (k, 4, 4) of it."""
    points = truth if truth.ndim == 2 else truth[:, :3, 3]
    return fit_touches(robot, Touches.checked(robot, q, points))


def test_an_arm_from_a_urdf_file_has_no_lengths_to_blame_but_zeros(tmp_path: Path) -> None:
    robot, rng = load_robot(written(tmp_path / "arm.urdf", PROP)), np.random.default_rng(9)
    q = random_poses(robot, rng)
    fit = fitted(robot, q, robot.forward(q + np.radians([0, 3, 0, 0, 0])))
    (cause,) = fit.causes
    assert isinstance(cause, ZeroOff)
    assert (cause.part, cause.off) == ("Shoulder", pytest.approx(np.radians(3), rel=0.01))
    (change,) = changes(fit)
    assert "URDF file, joint shoulder" in change.table
    assert (change.key, change.new) == ("offset_deg", pytest.approx(3, abs=0.02))


@pytest.mark.parametrize("name", FIVE)
def test_a_good_arm_is_not_blamed(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(8)
    blamed = 0
    for _ in range(4):
        q = random_poses(robot, rng)
        points = robot.forward(q)[:, :3, 3]
        fit = fitted(robot, q, points + rng.normal(0.0, 0.0005, points.shape))
        blamed += fit.correct
        assert changes(fit) == () or fit.correct
        assert fit.before.rms < 0.002
        assert fit.correct or isinstance(fit.verdict, GoodAlready)
    assert blamed == 0


def test_the_suggestion_is_what_the_arm_truly_is() -> None:
    robot, q = load_robot("scorbot"), random_poses(load_robot("scorbot"), np.random.default_rng(10))
    fit = fitted(robot, q, longer(robot, 1, "a", 0.004).forward(q))
    (change,) = changes(fit)
    assert (change.table, change.key, change.old) == ('dh.rows, row 2 (joint = "shoulder")', "a_mm", 222.0)
    assert change.new == pytest.approx(226.0, abs=0.05)
    assert suggestion((change,)).startswith('# [dh.rows, row 2 (joint = "shoulder")]\na_mm = 22')
    assert fit.after.largest < 0.0005 < fit.before.largest


@pytest.mark.parametrize(("kind", "amount"), [("zero", 3.0), ("scale", 4.0)])
@pytest.mark.parametrize("name", ["uzuner", "scorbot"])
def test_a_corrected_map_sends_the_joint_where_it_is_said_to_be(name: str, kind: str, amount: float) -> None:
    robot = load_robot(name)
    q = random_poses(robot, np.random.default_rng(10), 14)
    truly = q.copy()
    truly[:, 2] += np.radians(amount) if kind == "zero" else amount / 100 * q[:, 2]
    fit = fitted(robot, q, robot.forward(truly))
    better = calibrated(robot, corrected(fit, Calibration(name, "1", own_map(robot).unit, {})))
    told = own_map(robot).outputs(q[0])
    np.testing.assert_allclose(own_map(better).angles(told), truly[0], rtol=0, atol=np.radians(0.1))
    found = {change.key: change for change in changes(fit)}
    assert {change.table for change in found.values()} == {
        f"joints.elbow.{'servo' if name == 'uzuner' else 'encoder'}"
    }


def test_the_zero_of_a_linkage_is_written_into_every_row_that_it_turns() -> None:
    robot = load_robot("uarm")  # has no outputs: its zeros stand in the DH rows
    q = random_poses(robot, np.random.default_rng(12))
    off = q.copy()
    off[:, 1] += np.radians(2.5)
    fit = fitted(robot, q, robot.forward(off))
    (cause,) = fit.causes
    assert isinstance(cause, ZeroOff) and cause.part == "Shoulder"
    rows = list(robot.chain.rows)
    for change in (found := changes(fit)):
        row = int(re.findall(r"row (\d+)", change.table)[0]) - 1
        assert change.key == "theta_deg" and change.old == pytest.approx(np.degrees(rows[row].theta_rad))
        rows[row] = replace(rows[row], theta_rad=np.radians(change.new))
    mended = Chain.from_dh(rows, "standard", robot.chain.coupling)
    np.testing.assert_allclose(mended.forward(q), robot.forward(off), rtol=0, atol=1e-3)
    assert suggestion(found).count("# [dh.rows, row ") == len(found) == 2
    with pytest.raises(CalibrationError, match="neither servos nor encoders"):
        corrected(fit, Calibration("uarm", "1", "µs", {}))


def test_numbers_that_these_points_cannot_tell_apart_are_named_together() -> None:
    """Three parallel axes: offsets along them look the same at the tool."""
    robot = load_robot("scorbot")
    q = random_poses(robot, np.random.default_rng(10))
    fit = fitted(robot, q, longer(robot, 2, "d", 0.005).forward(q))
    named = {(one.key, one.row) for one in (*fit.causes, *fit.or_else) if isinstance(one, LengthOff)}
    assert {("d", row) for row in (2, 3, 4)} <= named


def test_the_words_give_the_figures() -> None:
    robot = load_robot("scorbot")
    q = random_poses(robot, np.random.default_rng(10))
    off = q + np.radians([0, 0, 3, 0, 0])
    fit = fitted(robot, q, robot.forward(off))
    first, blame, *_ = fit.words("en")
    assert f"RMS {1000 * fit.before.rms:.2f} mm, largest {1000 * fit.before.largest:.2f} mm" in first
    assert blame.startswith("Elbow: zero off by +3.0°")
    assert fit.words("tr")[1].startswith("Elbow: sıfırı +3.0° kaymış")


def test_points_that_tell_nothing_are_refused() -> None:
    robot = load_robot("scorbot")
    q = random_poses(robot, np.random.default_rng(1))
    points = robot.forward(q)[:, :3, 3]
    with pytest.raises(CalibrationError, match="5 points are too few"):
        fitted(robot, q[:5], points[:5])
    with pytest.raises(CalibrationError, match=r"5 joint angles and x, y, z; got .* \(10, 4\) and \(10, 3\)"):
        fitted(robot, q[:, :4], points)
    with pytest.raises(CalibrationError, match="within 20 mm"):
        fitted(robot, q, np.zeros((10, 3)))
    points[3, 1] = np.nan
    with pytest.raises(CalibrationError, match="point 4 holds a value that is not a finite number"):
        fitted(robot, q, points)


def test_the_suggestion_goes_where_the_number_that_counts_stands() -> None:
    """What the robot file says of a joint that is calibrated is not what the arm goes by."""
    robot = load_robot("uzuner")
    q = random_poses(robot, np.random.default_rng(8))
    truly = q + np.radians([0.0, 0.0, 2.0, 0.0, 0.0])
    (change,) = changes(fitted(robot, q, robot.forward(truly)), ["elbow"])
    assert (change.table, change.key) == ("calibration: joints.elbow", "zero")
    assert change.new == pytest.approx(change.old - 20.0, abs=0.3)

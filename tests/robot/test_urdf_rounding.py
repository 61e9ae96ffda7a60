"""Right angles that exporters round are taken as exact, and the robot says so."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.robot.urdf_kit import ROUNDED, Step, product, written

from armctl import Robot, load_robot
from armctl.robot.urdf.tree import exact_angle, exact_axis, exact_rotation

HOBBY = (
    Step("pan", "revolute", "base", "l1", "0 0 0.05", "2.77556e-17 0 -3.1416"),
    Step("lift", "revolute", "l1", "l2", "0 0 0.04", "1.5708 0 0", limits=(0, 3)),
    Step("elbow", "revolute", "l2", "l3", "0.105 0 0", "0 -9.38083e-08 0"),
    Step("wrist", "revolute", "l3", "l4", "0.1 0 0", "0 0 1.57079", limits=(-1, 1.8)),
    Step("roll", "revolute", "l4", "l5", "0 -0.03 0", "1.5708 3.14159 0"),
    Step("end", "fixed", "l5", "tool0", "0 0 -0.09", "3.14159 0 0"),
)
"""yaw, three parallel pitch joints and roll, with the roundings of three exporters"""
QUARTER = math.pi / 2


@pytest.fixture(name="hobby")
def _hobby(tmp_path: Path) -> Robot:
    return load_robot(written(tmp_path / "hobby.urdf", HOBBY))


@pytest.mark.parametrize(
    ("text", "quarters"),
    [
        ("1.5708", 1), ("-1.5708", -1), ("+1.5708", 1), ("1.5707", 1), ("1.57079", 1), ("1.570796", 1),
        ("1.57079632679", 1), ("1.5707963267948966", 1), ("15.708e-1", 1), ("1.5707958", 1),
        ("3.1416", 2), ("3.1415", 2), ("-3.14159", -2), ("3.14158", 2), ("3.141592653589793", 2),
        ("4.7124", 3), ("-4.71238", -3), ("6.2832", 4), ("6.28318530718", 4),
        ("0", 0), ("-9.38083e-08", 0), ("9.9e-7", 0), ("-0.0", 0),
    ],
)  # fmt: skip
def test_rounded_quarter_turns(text: str, quarters: int) -> None:
    assert exact_angle(text) == quarters * QUARTER


@pytest.mark.parametrize(
    "text",
    ["1.57", "1.571", "3.14", "3.142", "4.71", "1.5700", "1.5710", "1.5709", "3.1400", "3.1420", "1.57081",
     "0.0001", "1.1e-6", "-2e-6", "1.5707975", "0.7854", "7.8540", "22.0000", "1e3", "0.3"],
)  # fmt: skip
def test_angles_that_are_meant(text: str) -> None:
    assert exact_angle(text) == float(text)


def test_a_rotation_tells_what_was_rounded() -> None:
    rotation, rounding = exact_rotation(["-1.5708", "1e-9", "0.4"])
    x, y = math.cos(0.4), math.sin(0.4)
    assert rotation == pytest.approx(np.array([[x, 0, -y], [y, 0, x], [0, -1, 0]]), abs=1e-15)
    assert (rounding.quarters, rounding.zeros) == (("1.5708",), 1)
    assert rounding.shift == pytest.approx(math.hypot(1.5708 - QUARTER, 1e-9), rel=1e-4)
    assert exact_rotation(["0.1", "1.5707963267948966", "0"])[1].shift == 0.0


def test_a_leaning_axis() -> None:
    leaning = np.array([3e-7, -0.8, 0.6])
    axis, rounding = exact_axis(leaning / np.linalg.norm(leaning))
    assert axis.tolist() == pytest.approx([0, -0.8, 0.6], abs=1e-15)
    assert axis[0] == 0.0
    assert (rounding.quarters, rounding.zeros) == ((), 1)
    assert rounding.shift == pytest.approx(2 * 3e-7, rel=1e-6)
    meant = np.array([1.2e-6, 0.0, 1.0])
    assert exact_axis(meant)[0] is meant


def test_forward_kinematics_are_those_that_were_meant(hobby: Robot) -> None:
    for q in np.random.default_rng(0).uniform(hobby.limits[:, 0], hobby.limits[:, 1], (50, 5)):
        assert np.abs(hobby.forward(q) - product(HOBBY, "tool0", q, ROUNDED)).max() < 1e-14


def test_the_closed_form_finds_straight_down(hobby: Robot) -> None:
    """Of the file as written, no configuration points the tool straight down."""
    assert hobby.inverse_kinematics.family.startswith("yaw")
    rng, answered = np.random.default_rng(1), 0
    for _ in range(10):
        q = rng.uniform([-2, 0.5, -1.5, 0, -2], [2, 1.5, -0.5, 0, 2])
        level, quarter = (
            product(HOBBY, "tool0", [*q[:3], wrist, q[4]], ROUNDED)[2, 2] for wrist in (0, QUARTER)
        )
        q[3] = math.remainder(math.atan2(quarter, level) + math.pi, 2 * math.pi)
        T = product(HOBBY, "tool0", q, ROUNDED)
        assert T[2, 2] == pytest.approx(-1, abs=1e-14)
        inside = bool((hobby.limits[:, 0] <= q).all() and (q <= hobby.limits[:, 1]).all())
        found = hobby.inverse(T[:3, 3], pitch=-QUARTER, roll=float(q[4]))
        assert (np.abs(found.q - q).max(axis=1).min(initial=1.0) < 1e-7) == inside
        answered += inside
    assert answered >= 3


def test_the_robot_says_what_is_taken_as_exact(hobby: Robot) -> None:
    said = next(text for text in hobby.assumed if text.startswith("exact"))
    assert said.startswith(
        "exact: 6 angles written as rounded quarter turns (1.57079, 1.5708, 3.14159, 3.1416) and "
        "2 numbers below 1e-6 written for zero; the tool moves by at most 0.00"
    )
    most = re.search(r"at most ([\d.e-]+) mm", said)
    assert most is not None
    moved = [
        np.linalg.norm((product(HOBBY, "tool0", q, {}) - hobby.forward(q))[:3, 3]) * 1000
        for q in np.random.default_rng(2).uniform(hobby.limits[:, 0], hobby.limits[:, 1], (500, 5))
    ]
    assert 0.3 * float(most[1]) < max(moved) <= float(most[1]) * 1.05  # printed with two digits


def test_an_exact_file_says_nothing(tmp_path: Path) -> None:
    steps = [replace(step, rpy="1.5707963267948966 2.77556e-17 0.3") for step in HOBBY]
    robot = load_robot(written(tmp_path / "exact.urdf", steps))
    assert not [text for text in robot.assumed if text.startswith("exact")]

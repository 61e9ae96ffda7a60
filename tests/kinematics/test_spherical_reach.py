"""Refusals of a spherical shoulder: why, with numbers; the nearest reachable point against brute force."""

from __future__ import annotations

import math
import os

import numpy as np
import pytest
from tests.kinematics.kit import FloatArray, least_distance, random_q
from tests.kinematics.spherical_kit import (
    HUMANOID,
    HUMANOID_LIMITS,
    STEP,
    TITLES,
    random_arm,
    spherical_solver,
)

from armctl.kinematics import Chain, DHRow, Solutions, Target

IK = spherical_solver(HUMANOID, HUMANOID_LIMITS, TITLES)


def refusal(x: float, y: float, z: float, **asked: float) -> str:
    angles = {name: math.radians(value) for name, value in asked.items()}
    solutions = IK.solve(Target.of(np.array([x, y, z]) / 1000, **angles), STEP)
    assert not solutions.success
    assert solutions.nearest_q is not None
    return str(solutions.reason)


def test_why_a_position_cannot_be() -> None:
    assert refusal(1000, 0, 0) == (
        "too far by 360.0 mm: the target would be 1000.0 mm from the shoulder, the arm reaches 640.0 mm"
    )
    assert refusal(0, 0, -20) == (
        "inside the dead zone, too near by 40.0 mm: the target would be 20.0 mm from the shoulder, "
        "the arm folds no closer than 60.0 mm"
    )
    needs = math.degrees(math.acos((0.4**2 - 0.35**2 - 0.29**2) / (2 * 0.35 * 0.29)))
    limits = "within the links' reach, but joint limits forbid it: "
    # bent the other way, a shoulder joint would have to leave its limits as well
    assert refusal(0, 0, -400) == f"{limits}Elbow needs -{needs:.2f}°, its limits are 0.00° … 90.00°"
    assert refusal(-400, -300, 100) == (
        f"{limits}at the least, Shoulder turn needs 182.76°, its limits are 0.00° … 180.00°"
    )


def test_a_pitch_out_of_reach_says_what_is_possible() -> None:
    solutions = IK.solve(Target.of([0.15, -0.10, -0.59], pitch=1.0), STEP)
    said = str(solutions.reason)
    assert "that pitch is impossible here" in said
    assert solutions.nearest_q is not None
    assert np.linalg.norm(HUMANOID.forward(solutions.nearest_q)[:3, 3] - solutions.target.position) < 1e-9
    nearest, _ = IK.pitch_and_roll(solutions.nearest_q)
    assert nearest is not None
    assert f"the nearest to it is {math.degrees(nearest):.2f}°" in said
    held = IK.solve(Target.of(solutions.target.position, pitch=nearest - 1e-6), STEP)
    assert held.success


def test_no_swept_posture_has_a_nearer_pitch() -> None:
    rng = np.random.default_rng(101)
    refused = 0
    for _ in range(80):
        chain, limits = random_arm(rng)
        ik = spherical_solver(chain, limits)
        position = chain.forward(random_q(rng, limits))[:3, 3]
        pitch = float(rng.uniform(-1.5, 1.5))
        solutions = ik.solve(Target.of(position, pitch=pitch), STEP)
        if solutions.success:
            continue
        refused += 1
        assert solutions.nearest_q is not None
        swept = ik.solve(Target.of(position), STEP).q
        pitches = np.arcsin(np.clip(chain.forward(swept)[:, 2, 2], -1, 1))
        nearest, _ = ik.pitch_and_roll(solutions.nearest_q)
        assert nearest is not None
        assert abs(nearest - pitch) <= np.abs(pitches - pitch).min() + 1e-6
    assert refused > 30


def test_rolls_that_cannot_be() -> None:
    said = refusal(150, -100, -590, roll=20)
    assert said == "Wrist roll needs 20.00°, its limits are 0.00° … 0.00°"
    four = Chain.from_dh([*HUMANOID.rows[:4], DHRow(0.0, 0.0, 0.29, joint=False)], "standard")
    solutions = spherical_solver(four, HUMANOID_LIMITS[:4]).solve(
        Target.of([0.15, -0.10, -0.59], roll=0.1), STEP
    )
    assert solutions.reason == "this arm has no joint that rolls the tool"


def far_away(solutions: Solutions, limits: FloatArray) -> float:
    """Distance of the nearest point, which is inside the limits."""
    assert solutions.nearest_q is not None
    assert solutions.nearest_m is not None
    assert ((solutions.nearest_q >= limits[:, 0]) & (solutions.nearest_q <= limits[:, 1])).all()
    return float(np.linalg.norm(solutions.nearest_m - solutions.target.position))


@pytest.mark.slow
def test_the_nearest_point_is_the_nearest_and_is_reached() -> None:
    rng = np.random.default_rng(102)
    refused, count = 0, 20 if os.environ.get("ARMCTL_LONG") else 7
    for _ in range(count):
        chain, limits = random_arm(rng)
        ik = spherical_solver(chain, limits)
        for size in (0.1, 0.3, 0.6, 1.0):
            position = np.array(ik.geometry.centre) + size * rng.uniform(-1, 1, 3)
            solutions = ik.solve(Target.of(position), STEP)
            if solutions.success:
                continue
            refused += 1
            brute = least_distance(lambda q: chain.forward(q)[..., :3, 3], limits, position, rng, 4000)  # noqa: B023
            assert far_away(solutions, limits) <= brute + 1e-7
            assert solutions.nearest_m is not None
            assert ik.solve(Target.of(solutions.nearest_m), STEP).success
    assert refused > 2 * count


def test_a_pitch_that_the_roll_would_change_is_refused_for_the_roll_it_stands_at() -> None:
    """A fixed bend behind the roll joint; without it the roll says nothing about the pitch."""
    bent = Chain.from_dh([*HUMANOID.rows, DHRow(0.0, math.radians(40), 0.0, joint=False)], "standard")
    limits = HUMANOID_LIMITS.copy()
    limits[4] = np.radians([20.0, 90.0])
    for chain, says in ((bent, " with Wrist roll at 20.00°, the nearest"), (HUMANOID, "°, the nearest")):
        ik = spherical_solver(chain, limits, TITLES)
        tip = chain.forward(np.radians([10.0, -30.0, 40.0, 50.0, 20.0]))[:3, 3]
        refused = ik.solve(Target.of(tip, pitch=math.radians(89.0)), STEP)
        assert says in str(refused.reason)
        assert ("Wrist roll" in str(refused.reason)) == (chain is bent)

"""What is written for speed gives what the plain way gives: cosines, one pose."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.naive_sweep import UZUNER
from tests.kinematics.kit import FloatArray, chain_of, random_planar_arm, random_q, solver_of

from armctl import load_robot
from armctl.kinematics import DEFAULT_STEP, Chain, Target
from armctl.kinematics.yaw_pitch_roll import solver


def test_swept_solutions_are_exact_on_every_grid_value() -> None:
    robot = load_robot("uzuner")
    rng = np.random.default_rng(92)
    for position in UZUNER.tip(random_q(rng, UZUNER.limits, 150)):
        solutions = robot.inverse(position)
        assert solutions.residual_m.max() < 1e-12


def one_pose_arms() -> list[tuple[Chain, FloatArray]]:
    rng = np.random.default_rng(93)
    out = [(robot.chain, robot.limits) for robot in map(load_robot, ("uzuner", "abaas", "scorbot"))]
    for i in range(40):
        arm = random_planar_arm(rng)
        chain = chain_of(arm, "standard" if i % 2 else "modified", roll=i % 4 != 0, rng=rng)
        out.append((chain, arm.limits if chain.n == 4 else np.vstack([arm.limits, [[-2.0, 2.5]]])))
    return out


def test_the_written_out_closed_form_lists_what_the_general_one_lists(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Same postures, same branches, same order; upright and backward tools and the links in line too."""
    rng = np.random.default_rng(95)
    for chain, limits in one_pose_arms():
        quick = solver_of(chain, limits)
        with monkeypatch.context() as patched:
            patched.setattr(solver, "pose_function", lambda *_: None)
            general = solver_of(chain, limits)
        for i in range(30):
            q = random_q(rng, limits)
            if i < 4:
                q[2] = np.clip(0.0, *limits[2])
            pitch, roll = quick.pitch_and_roll(q)
            if pitch is None:
                continue
            pitch = (pitch, pitch, math.pi / 2, -math.pi / 2, math.pi - pitch)[i % 5]
            target = Target.of(chain.forward(q)[:3, 3], pitch, (roll, None)[i % 2])
            one, other = quick.solve(target, DEFAULT_STEP), general.solve(target, DEFAULT_STEP)
            assert one.branch.tolist() == other.branch.tolist()
            assert one.reason == other.reason
            if len(one):
                assert np.abs(one.q - other.q).max() < 1e-9

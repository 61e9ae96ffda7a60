"""What is written for speed gives what the plain way gives: cosines, one pose."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.naive_sweep import UZUNER
from tests.kinematics.kit import FloatArray, chain_of, plain_forward, random_planar_arm, random_q, solver_of

from armctl import load_robot
from armctl.errors import InputError
from armctl.kinematics import DEFAULT_STEP, Chain, Target, YawPitchRollSolver
from armctl.kinematics.cos_sin import LARGEST_ANGLE, SCRATCH, by_table, by_tangent
from armctl.kinematics.yaw_pitch_roll.closed_form import PoseBranches


@pytest.mark.parametrize("way", [by_table, by_tangent])
def test_cosines_and_sines_of_arrays(way: object) -> None:
    rng = np.random.default_rng(91)
    for reach, error in ((7.0, 2e-15), (LARGEST_ANGLE, 1e-13)):
        angle = rng.uniform(-reach, reach, (3, 40_000))
        angle[0, :2000] = np.arange(-1000, 1000) * (math.pi / 2) % (2 * reach) - reach
        angle[1, :2001] = math.pi + np.arange(-1000, 1001) * 1e-12  # half turns, and next to them
        angle[1, 2001:4002] = np.nextafter(-math.pi, np.arange(-1000, 1001))
        cos, sin = np.empty_like(angle), np.empty_like(angle)
        way(angle, cos, sin, np.empty((SCRATCH, *angle.shape)))  # type: ignore[operator]
        assert np.abs(cos - np.cos(angle)).max() < error
        assert np.abs(sin - np.sin(angle)).max() < error


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


def test_one_pose_in_plain_floats_lists_what_solve_lists() -> None:
    rng = np.random.default_rng(94)
    listed = 0
    for chain, limits in one_pose_arms():
        ik = solver_of(chain, limits)
        assert isinstance(ik, YawPitchRollSolver)
        for _ in range(20):
            q = random_q(rng, limits)
            pitch, roll = ik.pitch_and_roll(q)
            if pitch is None:
                continue
            x, y, z = chain.forward(q)[:3, 3].tolist()
            found = ik.postures(x, y, z, pitch, roll)
            solutions = ik.solve(Target.of([x, y, z], pitch, roll), 1.0)
            assert found == list(map(tuple, solutions.q.tolist()))
            assert np.abs(np.array(found) - q).max(axis=1).min() < 1e-6
            for one in found:
                T = plain_forward(chain, np.array(one))
                assert np.abs(T[:3, 3] - [x, y, z]).max() < 1e-9
                assert ((np.array(one) >= limits[:, 0]) & (np.array(one) <= limits[:, 1])).all()
            listed += len(found)
    assert listed > 1000


def test_the_written_out_closed_form_lists_what_the_general_one_lists(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Same postures, same branches, same order; upright and backward tools and the links in line too."""
    rng = np.random.default_rng(95)
    for chain, limits in one_pose_arms():
        quick = solver_of(chain, limits)
        with monkeypatch.context() as patched:
            patched.setattr(PoseBranches, "serves", staticmethod(lambda *_: False))
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


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(5))
def test_one_pose_refuses_what_is_not_finite(place: int, bad: float) -> None:
    ik = load_robot("abaas").inverse_kinematics
    assert isinstance(ik, YawPitchRollSolver)
    values = [0.1, -0.2, 0.2, 0.3, 0.4]
    values[place] = bad
    with pytest.raises(InputError, match="finite"):
        ik.postures(*values)

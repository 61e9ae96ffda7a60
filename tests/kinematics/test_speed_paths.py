"""What is written for speed gives what the plain way gives: chains, cosines, one pose."""

from __future__ import annotations

import math

import numpy as np
import pytest
from benchmarks.naive_sweep import UZUNER
from tests.kinematics.kit import FloatArray, chain_of, plain_forward, random_planar_arm, random_q, solver_of

from armctl import load_robot
from armctl.errors import InputError
from armctl.kinematics import DEFAULT_STEP, DHChain, DHRow, Target, YawPitchRollSolver
from armctl.kinematics.compiled import ONE, ChainProgram, StraightLine, Value, jacobian_kernel, pose_kernel
from armctl.kinematics.cos_sin import LARGEST_ANGLE, SCRATCH, by_table, by_tangent
from armctl.kinematics.yaw_pitch_roll.closed_form import PoseBranches

TWISTS = (0.0, math.pi / 2, -math.pi / 2, math.pi, 0.7, -2.1)


def random_chain(rng: np.random.Generator, joints: int) -> DHChain:
    """Parallel, crossing and skew axes, turned-over ones, and fixed rows between."""
    rows: list[DHRow] = []
    while sum(row.joint for row in rows) < joints:
        a, d = rng.choice([0.0, 1.0], 2) * rng.uniform(-0.5, 0.5, 2)
        alpha, theta = float(rng.choice(TWISTS)), float(rng.choice([0.0, math.pi / 2, -math.pi, 0.4]))
        rows.append(DHRow(float(a), alpha, float(d), theta, joint=bool(rng.random() < 0.75)))
    return DHChain(rows, "standard" if rng.random() < 0.5 else "modified")


def plain_many(chain: DHChain, q: FloatArray) -> FloatArray:
    """(k, 4, 4) of (k, n): one 4 x 4 product after the other, for all configurations at a time."""
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    for segment, angle in zip(chain.segments, q.T, strict=True):
        turn = np.tile(np.eye(4), (len(q), 1, 1))
        turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
        turn[:, 1, 0] = np.sin(angle)
        turn[:, 0, 1] = -turn[:, 1, 0]
        T = T @ segment @ turn
    return T @ chain.tail


def plain_jacobian(chain: DHChain, q: FloatArray, h: float = 1e-5) -> FloatArray:
    J = np.zeros((6, chain.n))
    R = plain_forward(chain, q)[:3, :3]
    for k, step in enumerate(h * np.eye(chain.n)):
        D = (plain_forward(chain, q + step) - plain_forward(chain, q - step)) / (2 * h)
        spin = D[:3, :3] @ R.T
        J[:, k] = [*D[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
    return J


@pytest.mark.parametrize("joints", [1, 3, 5, 7])
def test_compiled_chains_are_the_plain_products(joints: int) -> None:
    rng = np.random.default_rng(90 + joints)
    for _ in range(12):
        chain = random_chain(rng, joints)
        q = rng.uniform(-7, 7, (10_000, joints))
        q[:50] = np.round(q[:50] / (math.pi / 2)) * (math.pi / 2)  # half turns, where a half tangent is huge
        expected = plain_many(chain, q)
        assert np.abs(expected[7] - plain_forward(chain, q[7])).max() < 1e-12
        assert np.abs(chain.forward(q) - expected).max() < 1e-12
        J = chain.jacobian(q)
        for i in range(0, 200, 5):
            assert np.abs(chain.forward(q[i]) - expected[i]).max() < 1e-12
            assert np.abs(chain.jacobian(q[i]) - J[i]).max() < 1e-12
            assert np.abs(J[i] - plain_jacobian(chain, q[i])).max() < 1e-6


def test_the_generated_source_folds_what_is_fixed() -> None:
    """The roll of uzuner moves neither its tip nor any column of the Jacobian; the rest takes few steps."""
    chain = load_robot("uzuner").chain
    program = ChainProgram(chain.segments, chain.tail)
    pose, jacobian = pose_kernel(program), jacobian_kernel(program)
    assert pose.angles == 5
    assert jacobian.angles == 4
    assert "0.101 * c3" in pose.source  # two links and a fixed row as one constant
    assert len(pose.source.splitlines()) < 90
    T = np.empty((4, 4))
    assert pose.one(T, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert np.abs(T - plain_forward(chain, np.zeros(5))).max() < 1e-15
    assert not pose.one(T, 0.0, 0.0, math.nan, 0.0, 0.0)


def test_straight_lines_fold_constants_and_share_what_is_equal() -> None:
    line = StraightLine()
    a, b = Value(1.0, "a"), Value(1.0, "b")
    assert line.product(a, Value(0.0)) == Value(0.0)
    assert line.total(a, a.times(-1.0)) == Value(0.0)
    assert line.total(a, a) == Value(2.0, "a")
    assert line.product(b.times(2.0), a).name == line.product(a, b).name
    twice = line.total(line.product(a, b), ONE)
    statements, results = line.as_floats([twice, twice.times(-3.0)])
    assert eval(results[1], {}, {"a": 2.0, "b": 5.0} | _run(statements, a=2.0, b=5.0)) == -33.0
    code = line.as_arrays([("x", twice.times(-3.0))])
    names = {"a": np.array([2.0]), "b": np.array([5.0]), "x": np.zeros(1)}
    names |= {f"r{i}": np.empty(1) for i in range(code.registers)}
    names |= {f"k{i}": np.array(k) for i, k in enumerate(code.constants)}
    exec("\n".join(code.lines), {"multiply": np.multiply, "add": np.add, "subtract": np.subtract}, names)
    assert names["x"][0] == -33.0


def _run(statements: list[str], **values: float) -> dict[str, float]:
    exec("\n".join(statements), {}, values)
    return values


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


def test_a_batch_names_the_row_that_is_not_finite() -> None:
    chain = load_robot("uzuner").chain
    q = np.zeros((20_000, 5))
    q[17_003, 2] = math.nan
    for method in (chain.forward, chain.jacobian):
        with pytest.raises(InputError, match=r"finite numbers, got \[0.0, 0.0, nan, 0.0, 0.0\] in row 17003"):
            method(q)
    q[17_003, 2] = 1e9  # huge is not wrong
    assert np.abs(chain.forward(q)[17_003] - plain_forward(chain, q[17_003])).max() < 1e-12


def test_an_array_given_is_never_written_to_and_the_result_is_the_callers_own() -> None:
    chain = load_robot("uzuner").chain
    q = np.full((3, 5), 0.3)
    for value in (q, q[0]):
        before, T = value.copy(), chain.forward(value)
        T[...] = 7.0
        chain.checked(value)[...] = 7.0
        assert np.array_equal(value, before)
        assert np.abs(chain.forward(value)).max() < 7.0


def test_swept_solutions_are_exact_on_every_grid_value() -> None:
    robot = load_robot("uzuner")
    rng = np.random.default_rng(92)
    for position in UZUNER.tip(random_q(rng, UZUNER.limits, 150)):
        solutions = robot.inverse(position)
        assert solutions.residual_m.max() < 1e-12


def one_pose_arms() -> list[tuple[DHChain, FloatArray]]:
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

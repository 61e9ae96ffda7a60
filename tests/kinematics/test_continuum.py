"""What a list does not hold is told: continua of solutions, and nothing where solutions are isolated."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from tests.kinematics.kit import chain_of, planar_arms, random_planar_arm, random_q, rotation_about, solver_of
from tests.kinematics.six_joints import GENERAL, THREE_PARALLEL, beside_a_wrist
from tests.kinematics.test_offset_roll import so101

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.facts.targets import MayTurn
from armctl.kinematics import Chain, Target
from armctl.kinematics.angles import all_images

STEP = math.radians(2.0)


def test_a_straight_elbow_leaves_the_upper_arm_free() -> None:
    """At a pitch the forearm may roll: the list holds some of it. A rotation leaves nothing free."""
    arm = load_robot("humanoid")
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = rng.uniform(*arm.limits.T)
        q[3] = 0.0
        T = arm.forward(q)
        pitch, _ = arm.inverse_kinematics.pitch_and_roll(q)
        found = arm.inverse(T[:3, 3], pitch)
        assert not found.complete
        assert found.incomplete_reason is not None
        assert "Shoulder pitch may turn together while the tool stays" in found.incomplete_reason
        for one in found.q:  # and so it is: turned about its own axis the arm still points there
            assert one[3] == pytest.approx(0.0, abs=1e-6)
        assert arm.inverse(T[:3, 3], rotation=T[:3, :3]).complete
        assert arm.inverse(T[:3, 3], step=STEP).complete  # the swept joint is that continuum


@pytest.mark.parametrize(("name", "joint", "height"), [("scorbot", "Waist", 0.45), ("abaas", "Base", 0.3)])
def test_a_target_on_the_base_axis_leaves_the_base_free(name: str, joint: str, height: float) -> None:
    arm = load_robot(name)
    found = arm.inverse([0.0, 0.0, height], step=STEP)
    q = found.q[len(found) // 2]
    T = arm.forward(q)
    pitch, _ = arm.inverse_kinematics.pitch_and_roll(q)
    for on_axis in (found, arm.inverse([0.0, 0.0, height], pitch)):
        assert on_axis.incomplete == MayTurn((joint,))
        assert on_axis.incomplete_reason == (
            f"{joint} may turn while the tool stays: of a continuum some are listed"
        )
    assert arm.inverse([0.0, 0.0, height], rotation=T[:3, :3]).complete
    start = q + np.array([0.3, 0.0, 0.0, 0.0, 0.1])
    assert found.best("least-travel", start)[0] == start[0]  # the base need not move


def test_random_targets_have_isolated_solutions() -> None:
    rng = np.random.default_rng(8)
    arms = [*planar_arms(3, 4), so101(), (load_robot("humanoid").chain, load_robot("humanoid").limits)]
    for chain, limits in arms:
        ik = solver_of(chain, limits)
        for q in random_q(rng, limits, 6):
            T = chain.forward(q)
            pitch, roll = ik.pitch_and_roll(q)
            for target in (Target.of(T[:3, 3], pitch, roll), Target.of(T[:3, 3], rotation=T[:3, :3])):
                found = ik.solve(target, STEP)
                assert found.complete, found.incomplete_reason


def test_stretched_and_folded_arms_are_isolated() -> None:
    arm = load_robot("scorbot")
    q = np.radians([20.0, 30.0, 0.0, 0.0, 10.0])
    T = arm.forward(q)
    pitch, roll = arm.inverse_kinematics.pitch_and_roll(q)
    found = arm.inverse(T[:3, 3], pitch, roll)
    assert found.complete and len(found) > 0
    nothing = arm.inverse([2.0, 0.0, 0.0])
    assert nothing.complete and len(nothing) == 0


def test_all_images_are_inside_the_limits_and_bounded() -> None:
    rng = np.random.default_rng(5)
    turn = 2.0 * math.pi
    limits = np.array([[-turn, turn], [-0.5, 1.0], [0.0, 1.5 * turn], [-turn, turn]])
    q = rng.uniform(-4.0, 4.0, (40, 4))
    q[0] = 0.0
    found = all_images(q, limits)
    assert ((found.q >= limits[:, 0]) & (found.q <= limits[:, 1])).all()
    assert np.abs(np.exp(1j * found.q) - np.exp(1j * q[found.source])).max() < 1e-14
    turns = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 4), axis=-1).reshape(-1, 4)
    for i, one in enumerate(q):
        every = one + turn * turns
        count = ((every >= limits[:, 0] - 1e-9) & (every <= limits[:, 1] + 1e-9)).all(axis=1).sum()
        assert (found.source == i).sum() == count
    start = np.array([6.0, 0.5, 9.0, -6.0])
    few = all_images(q, limits, start, most=200)
    assert len(few.q) <= 200
    assert len(few.q) + few.left_out == len(found.q)
    for i in set(few.source.tolist()):  # the nearest to the start is among them
        nearest = np.abs(found.q[found.source == i] - start).sum(axis=1).min()
        assert np.abs(few.q[few.source == i] - start).sum(axis=1).min() <= nearest + 1e-12
    assert len(all_images(np.empty((0, 4)), limits, start).q) == 0
    exact = all_images(q, limits, most=len(found.q))  # none is left out that there is room for
    assert exact.left_out == 0 and len(exact.q) == len(found.q)
    wide = all_images(np.zeros((1, 1)), np.array([[-1e6, 1e6]]))
    assert len(wide.q) == 33
    assert wide.left_out > 300_000


def test_an_arm_stretched_straight_up_is_a_continuum() -> None:
    """Two directions move nothing at first; along one of all their sums the arm may go on."""
    robot = load_robot(Path(__file__).with_name("stretched.urdf"))
    for q in random_q(np.random.default_rng(0), robot.limits, 5):
        q[[1, 2, 4]] = math.pi
        T = robot.forward(q)
        found = robot.inverse(T[:3, 3], rotation=T[:3, :3])
        assert found.success and not found.complete
        told = found.incomplete_reason or ""
        assert "may turn together" in told or "only the sum of their angles counts" in told


def nearly_one_of_a_family(rng: np.random.Generator) -> Chain:
    """An arm whose tool is beside, or one of whose axes is turned or shifted, by 1e-12 to 1e-5 m or rad."""
    six = [arm.chain for arm in (*THREE_PARALLEL.values(), *GENERAL.values(), beside_a_wrist(0.0))]
    if rng.random() < 0.5:
        chain = chain_of(random_planar_arm(rng), "standard", roll=rng.random() < 0.6, rng=rng)
    else:
        chain = six[rng.integers(len(six))]
    size, what = 10 ** rng.uniform(-12, -5), rng.integers(3)
    segments, tail = [one.copy() for one in chain.segments], chain.tail.copy()
    joint = rng.integers(1, len(segments))
    if what == 0:
        tail[:3, 3] += tail[:3, :3] @ (size * np.array([0.6, 0.8, 0.0]))
    elif what == 1:
        segments[joint][:3, :3] @= rotation_about(rng.normal(size=3), size)
    else:
        segments[joint][:3, 3] += size * rng.normal(size=3)
    return Chain(segments, tail)


def at_limits(rng: np.random.Generator, n: int) -> tuple[FloatArray, FloatArray]:
    """Limits (n, 2), many of them half a turn, and a configuration (n,) with joints at them [rad]."""
    middle, half = rng.uniform(-1.0, 1.0, n), rng.uniform(0.6, 3.1, n)
    limits = np.stack([middle - half, middle + half], axis=1)
    limits[rng.random(n) < 0.4] = -math.pi, math.pi
    q = rng.uniform(*limits.T)
    at = np.flatnonzero(rng.random(n) < 0.5)
    q[at] = limits[at, rng.integers(0, 2, len(at))]
    return limits, q


def test_what_rounding_takes_beyond_a_limit_is_not_called_complete() -> None:
    """The configuration that made the pose is listed at all its images, or the list is said to lack some."""
    lacking = 0
    for seed in range(60):
        rng = np.random.default_rng([4, seed])
        chain = nearly_one_of_a_family(rng)
        limits, q = at_limits(rng, chain.n)
        T = chain.forward(q)
        found = solver_of(chain, limits).solve(Target.of(T[:3, 3], rotation=T[:3, :3]), STEP)
        turned = [
            [
                a
                for a in (angle - 2.0 * math.pi, angle, angle + 2.0 * math.pi)
                if low - 1e-12 <= a <= high + 1e-12
            ]
            for angle, (low, high) in zip(q, limits, strict=True)
        ]
        for image in itertools.product(*turned):
            away = np.abs(found.q - image).max(axis=1).min(initial=math.inf)
            assert away < 2e-5 or not found.complete, (seed, image)
            lacking += away >= 2e-5
    assert lacking


@pytest.mark.parametrize("name", ["uzuner", "humanoid", "parol6", "ur5", "uarm"])
def test_exact_limits_of_exact_arms_are_complete(name: str) -> None:
    """A joint at its limit is no doubt where nothing else is."""
    arm = load_robot(name)
    rng = np.random.default_rng(9)
    for joint in range(min(arm.n, 3)):
        q = 0.5 * rng.uniform(*arm.limits.T) + 0.25 * arm.limits.sum(axis=1)
        q[joint] = arm.limits[joint, joint % 2]
        if not arm.chain.keeps_turns(q):
            continue
        T = arm.forward(q)
        found = arm.inverse(T[:3, 3], rotation=T[:3, :3])
        assert found.success and found.complete, found.incomplete_reason

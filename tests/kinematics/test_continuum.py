"""What a list does not hold is told: continua of solutions, and nothing where solutions are isolated."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.kinematics.kit import planar_arms, random_q, solver_of
from tests.kinematics.test_offset_roll import so101

from armctl import load_robot
from armctl.kinematics import Target
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

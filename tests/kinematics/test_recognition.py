"""Which chains are of the family *yaw + parallel pitch joints (+ roll)*, and which are not."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.kinematics.kit import chain_of, random_planar_arm, solver_of

from armctl import load_robot
from armctl.kinematics import Chain, DHRow, Target
from armctl.kinematics.families.spherical_shoulder.geometry import recognise_spherical
from armctl.kinematics.families.yaw_pitch_roll.geometry import recognise

RIGHT = math.pi / 2


def chain(*rows: tuple[float, float, float, float], convention: str = "standard") -> Chain:
    """Rows of (a, alpha, d, theta), all of them joints."""
    return Chain.from_dh([DHRow(a, alpha, d, theta) for a, alpha, d, theta in rows], convention)  # type: ignore[arg-type]


def test_uzuner_reduces_to_what_the_paper_says() -> None:
    geometry = recognise(load_robot("uzuner").chain)
    assert geometry is not None
    assert geometry.lateral == pytest.approx(0.00362, abs=1e-15)
    assert geometry.lengths == pytest.approx((0.125, 0.104, 0.101))
    assert geometry.shoulder == pytest.approx(0.163j)
    assert geometry.pitch_joints == (1, 2, 3)
    assert geometry.roll_joint == 4


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("roll", [True, False])
def test_random_arms_are_measured_rightly(convention: str, roll: bool) -> None:
    """Also with the yaw axis pointing down, the pitch axes either way, and offsets in every joint."""
    rng = np.random.default_rng(61)
    for _ in range(60):
        arm = random_planar_arm(rng)
        geometry = recognise(chain_of(arm, convention, roll=roll, rng=rng))
        assert geometry is not None
        assert geometry.lengths == pytest.approx(arm.lengths)
        assert (geometry.roll_joint is not None) == roll
        # forward may be taken the other way round; then left, and the senses, turn with it
        side = 1 if geometry.frame[0, 0] > 0 else -1
        assert geometry.lateral == pytest.approx(side * arm.lateral, abs=1e-12)
        assert geometry.shoulder.real == pytest.approx(side * arm.shoulder_r, abs=1e-12)
        assert tuple(side * s for s in geometry.signs) == arm.signs
        assert geometry.yaw_sign == arm.yaw_sign


@pytest.mark.parametrize("first", [(0.2, 0.0, 0.3, math.radians(40)), (0.0, math.pi, 0.0, 0.0)])
def test_a_fixed_row_ahead_moves_and_turns_the_whole_arm(first: tuple[float, float, float, float]) -> None:
    """Away from the origin, or hung from the ceiling."""
    inner = load_robot("uzuner")
    moved = Chain.from_dh([DHRow(*first, joint=False), *inner.chain.rows], "modified")
    ik = solver_of(moved, inner.limits)
    q = np.radians([20, 60, -40, -50, 10.0])
    T = moved.forward(q)
    pitch, roll = ik.pitch_and_roll(q)  # upside down a wrist that bends down points up
    assert pitch == pytest.approx(math.radians(30 if first[1] else -30))
    for target in (Target.of(T[:3, 3], pitch, roll), Target.of(T[:3, 3], rotation=T[:3, :3])):
        solutions = ik.solve(target, 0.01)
        assert np.abs(solutions.q - q).max(axis=1).min() < 1e-9
        assert solutions.residual_m.max() < 1e-12


def test_two_pitch_joints_belong() -> None:
    geometry = recognise(chain((0, -RIGHT, 0.3, 0), (0.3, 0, 0, 0), (0.3, 0, 0, 0)))
    assert geometry is not None
    assert geometry.pitch_joints == (1, 2)
    assert geometry.roll_joint is None


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(chain((0.1, 0, 0.1, 0), (0.1, 0, 0, 0), (0.1, 0, 0, 0)), id="all parallel"),
        pytest.param(chain((0, RIGHT, 0.1, 0), (0.1, 0, 0, 0)), id="one pitch joint"),
        pytest.param(chain((0, RIGHT, 0.1, 0), *[(0.1, 0.0, 0.0, 0.0)] * 4), id="four pitch joints"),
        pytest.param(chain((0, 1.0, 0.1, 0), (0.1, 0, 0, 0), (0.1, 0, 0, 0)), id="yaw axis not across"),
        pytest.param(chain((0, RIGHT, 0.1, 0), (0.1, 0, 0, 0), (0, 0, 0, 0)), id="a link of no length"),
        pytest.param(
            chain((0, RIGHT, 0.1, 0), (0.1, 0, 0, 0), (0.1, RIGHT, 0, 0), (0, RIGHT, 0.1, 0), (0, 0, 0.1, 0)),
            id="two joints behind the pitch joints",
        ),
        pytest.param(
            chain(
                (0, RIGHT, 0, RIGHT),
                (0, -RIGHT, 0, RIGHT),
                (0, 0, -0.35, 0),
                (0, -RIGHT, 0, RIGHT),
                (0, 0, 0.29, 0),
            ),
            id="shoulder axes that do not meet",
        ),
        pytest.param(chain((0.1, 0, 0, 0)), id="a single joint"),
    ],
)
def test_what_does_not_belong_is_solved_numerically(other: Chain) -> None:
    """And says that its list may be incomplete."""
    assert recognise(other) is None
    assert recognise_spherical(other) is None
    limits = np.radians([[-90.0, 90.0]] * other.n)
    solver = solver_of(other, limits)
    q = np.random.default_rng(8).uniform(*limits.T)
    solutions = solver.solve(Target.of(other.forward(q)[:3, 3]), 0.01)
    assert solver.family == "numeric"
    assert solutions.success and not solutions.complete
    assert solutions.residual_m.max() < 1e-9

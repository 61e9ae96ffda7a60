"""Sweeps in steps so fine that panels do the work: what they interpolate is what each value would be."""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable

import numpy as np
import pytest
from benchmarks.naive_sweep import UZUNER, PlanarArm
from tests.kinematics.kit import FloatArray, chain_of, random_planar_arm, random_q, solver_of
from tests.kinematics.test_sweep import STEP, assert_same, in_order, swept, wide_arm

from armctl import load_robot
from armctl.kinematics import YawPitchRollSolver
from armctl.kinematics.yaw_pitch_roll.free_joint import (
    ANCHOR,
    NODES,
    PANEL,
    Panels,
    SweepTriangle,
    node_positions,
)
from armctl.kinematics.yaw_pitch_roll.geometry import recognise

FINE = math.radians(0.02)


def slopes_over_anchor(
    function: Callable[[FloatArray], FloatArray], slope: Callable[[FloatArray], FloatArray], panels: int
) -> FloatArray:
    """(1, NODES + 1, panels) of a function of the grid index."""
    at = node_positions(panels * PANEL - 30)
    assert at.shape == (NODES + 1, panels)
    assert np.array_equal(at[NODES] % PANEL, np.full(panels, ANCHOR))
    return np.concatenate([slope(at[:NODES]), function(at[NODES:])])[None]


def test_panels_give_smooth_functions_and_say_where_they_cannot() -> None:
    panels = Panels.of(1e-4)
    assert panels is not None
    grid = np.arange(5.0 * PANEL)

    def smooth(i: FloatArray) -> FloatArray:
        return np.arctan2(1.0 + 1e-4 * i, 2.0 - 2e-4 * i)

    def smooth_slope(i: FloatArray) -> FloatArray:
        x, y = 2.0 - 2e-4 * i, 1.0 + 1e-4 * i
        return (x + 2.0 * y) / (x * x + y * y)

    def ended(i: FloatArray) -> FloatArray:
        return np.arccos(np.minimum(1.0, 1e-4 * (i + 9533)))  # reaches 1 at 467

    def ended_slope(i: FloatArray) -> FloatArray:
        return -1.0 / np.sqrt(np.maximum(1e-60, 1.0 - (1e-4 * (i + 9533)) ** 2))

    good = slopes_over_anchor(smooth, smooth_slope, 5)
    assert np.abs(panels.integrated(good) - smooth(grid)).max() < 1e-14
    assert panels.unresolved(good[:, :NODES]) == []
    bad = slopes_over_anchor(ended, ended_slope, 5)
    rough = panels.unresolved(np.concatenate([good, bad])[:, :NODES])
    kept = np.ones(len(grid), dtype=bool)
    for begin, end in rough:
        kept[begin * PANEL : end * PANEL] = False
    assert not kept[467]
    assert kept[: 2 * PANEL].all()
    assert np.abs(panels.integrated(bad)[0] - ended(grid))[kept].max() < 1e-13


def test_panels_are_for_fine_grids_alone() -> None:
    assert Panels.of(FINE) is not None
    assert Panels.of(math.radians(0.5)) is None


def test_many_panels_at_once_are_what_each_is_alone() -> None:
    panels = Panels.of(STEP)
    assert panels is not None
    slopes = np.random.default_rng(1).normal(size=(3, NODES + 1, 300))
    together = panels.integrated(slopes).reshape(3, 300, PANEL)
    for k in (0, 119, 120, 299):
        alone = panels.integrated(slopes[:, :, k : k + 1])
        assert np.abs(together[:, k] - alone).max() < 1e-12


def test_the_triangle_is_the_arms_and_its_slopes_are_its_own() -> None:
    rng = np.random.default_rng(2)
    checked = 0
    for _ in range(40):
        arm = random_planar_arm(rng)
        geometry = recognise(chain_of(arm, "modified"))
        assert geometry is not None
        l2, l3, l4 = geometry.lengths
        middle = float(rng.uniform(-1.0, 1.0))
        triangle = SweepTriangle(geometry, middle)
        t2, t3, t4 = rng.uniform(-math.pi, math.pi), rng.uniform(-1.0, 1.0), rng.uniform(0.3, 2.8)
        target = sum(
            length * cmath.exp(1j * angle) for length, angle in ((l2, t2), (l3, t2 + t3), (l4, t2 + t3 + t4))
        )

        direction, inner, bend = triangle.angles(target, target * l2 * np.exp(-1j * np.array([t2])))[:, 0]
        assert abs(direction - middle) <= math.pi
        assert abs(bend - t4) < 1e-9
        plane = geometry.plane_angle(1, direction)
        assert abs(math.remainder(plane - inner - t3, 2 * math.pi)) < 1e-9
        out = np.empty((3, 1))
        triangle.slopes(target, target * l2 * np.exp(-1j * np.array([t2])), out)
        before, after = triangle.angles(
            target, target * l2 * np.exp(-1j * np.array([t2 - 1e-6, t2 + 1e-6]))
        ).T
        if abs(after[0] - before[0]) < 1.0:  # the direction does not jump here
            assert np.abs(out[:, 0] - (after - before) / 2e-6).max() < 1e-5 * (1 + np.abs(out).max())
            checked += 1
    assert checked > 30


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_random_arms_list_what_the_full_fine_grid_lists(convention: str) -> None:
    rng = np.random.default_rng(3 if convention == "standard" else 4)
    counts: list[int] = []
    for _ in range(25):
        arm = random_planar_arm(rng)
        ik = solver_of(chain_of(arm, convention, rng=rng), arm.limits)
        counts += [assert_same(ik, arm, arm.tip(random_q(rng, arm.limits)), FINE) for _ in range(2)]
    assert sum(counts) > 10**5


def test_joints_that_turn_round_list_on_a_fine_grid_what_they_list_on_a_coarse_one() -> None:
    """Every 25th value is on both; there the directions pass every angle, and equal links fold."""
    rng = np.random.default_rng(5)
    listed = 0
    for i in range(24):
        lengths = (0.15, 0.1, 0.1) if i % 3 == 0 else tuple(rng.uniform(0.03, 0.3, 3).tolist())
        arm, ik, limits = wide_arm(rng, lengths)
        position = arm.tip(random_q(rng, limits))
        fine, coarse = swept(ik, position, FINE), swept(ik, position, 25 * FINE)
        on_both = np.abs(fine[:, 1] / (25 * FINE) - np.rint(fine[:, 1] / (25 * FINE))) < 1e-6
        assert on_both.sum() == len(coarse)
        assert np.abs(in_order(fine[on_both]) - in_order(coarse)).max() < 1e-9
        assert (fine >= limits[:, 0]).all()
        assert (fine <= limits[:, 1]).all()
        listed += len(fine)
    assert listed > 10**5


def test_a_joint_that_only_touches_its_limit_stays_inside() -> None:
    """The first link points at the target, so the last joint turns back at its limit, between grid values."""
    ik = load_robot("uzuner").inverse_kinematics
    assert isinstance(ik, YawPitchRollSolver)
    l2, l3, l4 = ik.geometry.lengths
    shoulder = ik.geometry.shoulder
    rng = np.random.default_rng(6)
    listed = 0
    for _ in range(40):
        limit = float(rng.choice(UZUNER.limits[3]))
        beyond = abs(l3 + l4 * cmath.exp(1j * limit))
        target = shoulder + (l2 + beyond) * cmath.exp(1j * rng.uniform(0.6, 2.0))
        azimuth = float(rng.uniform(-0.5, 0.5))
        position = np.array([target.real * math.cos(azimuth), target.real * math.sin(azimuth), target.imag])
        listed += assert_same(ik, UZUNER, position, STEP)
    assert listed > 10**4


def test_a_joint_that_stays_on_its_limit_stays_inside() -> None:
    """The target on the first pitch axis: the last joint keeps one angle all the way, here its limit."""
    rng = np.random.default_rng(7)
    for _ in range(10):
        l2, l3, l4 = 0.12, 0.1, float(rng.uniform(0.06, 0.1))
        bend = math.acos((l2 * l2 - l3 * l3 - l4 * l4) / (2 * l3 * l4))
        limits = np.array([[-2.0, 2.0], [-0.5, 2.0], [-3.0, 3.0], [-bend, bend]])
        arm = PlanarArm(0.0, 0.05, 0.1, (l2, l3, l4), limits)
        ik = solver_of(chain_of(arm, "standard"), limits)
        azimuth = float(rng.uniform(-1.0, 1.0))
        position = np.array([0.05 * math.cos(azimuth), 0.05 * math.sin(azimuth), 0.1])
        listed = swept(ik, position, FINE)
        assert len(listed) > 10**4
        assert np.abs(np.abs(listed[:, 3]) - bend).max() < 1e-9
        assert (np.abs(listed[:, 3]) <= bend).all()

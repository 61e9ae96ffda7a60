"""The section of the workspace: its boundary encloses all that is reached and nothing that is not."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.kinematics.kit import chain_of, random_planar_arm, random_q

from armctl.arrays import FloatArray
from armctl.kinematics import Chain
from armctl.kinematics.families.yaw_pitch_roll.geometry import recognise
from armctl.kinematics.families.yaw_pitch_roll.section import PlanarSection, boundary_arcs, joined, reaches
from armctl.kinematics.subproblems import ToolPlane
from armctl.kinematics.workspace import (
    SampledSection,
    cell_outline,
    enclosed_area,
    smoothed,
)
from armctl.robot import load_robot

PLANAR = ("uzuner", "abaas", "scorbot", "mico")


def crossings(points: FloatArray, lines: tuple[FloatArray, ...]) -> NDArray[np.int64]:
    """How often a ray to the right from each point (k, 2) crosses closed lines."""
    count = np.zeros(len(points), dtype=np.int64)
    for line in lines:
        (x0, y0), (x1, y1) = line[:-1].T[:, None], line[1:].T[:, None]
        x, y = points.T[..., None]
        between = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            count += (between & (x < x0 + (y - y0) / (y1 - y0) * (x1 - x0))).sum(axis=1)
    return count


def off_the_lines(points: FloatArray, lines: tuple[FloatArray, ...]) -> FloatArray:
    """(k,) distance of each point from the nearest of some lines."""
    start = np.concatenate([line[:-1] for line in lines])
    along = np.concatenate([np.diff(line, axis=0) for line in lines])
    squared = np.maximum((along * along).sum(axis=1), 1e-30)
    u = np.clip(((points[:, None] - start) * along).sum(axis=2) / squared, 0.0, 1.0)
    return np.linalg.norm(points[:, None] - start - u[..., None] * along, axis=2).min(axis=1)


def in_plane(chain: Chain, q: FloatArray) -> FloatArray:
    """Tips (k, 2) as (r, z), each seen in its own tool plane."""
    geometry = recognise(chain)
    assert geometry is not None
    local = (chain.forward(q)[:, :3, 3] - geometry.origin) @ geometry.frame
    flat = (local[:, 0] + 1j * local[:, 1]) * np.exp(-1j * geometry.yaw_sign * q[:, 0])
    assert np.abs(flat.imag - geometry.lateral).max() < 1e-12
    return np.column_stack([flat.real, local[:, 2]])


def enclosed(chain: Chain, limits: FloatArray, q: FloatArray) -> tuple[ToolPlane, tuple[FloatArray, ...]]:
    """Geometry and closed boundary lines, once the tips at ``q`` (k, n) are known to lie inside."""
    geometry = recognise(chain)
    assert geometry is not None
    lines = tuple(np.column_stack([z.real, z.imag]) for z in joined(boundary_arcs(geometry, limits), 1e-6))
    assert all(np.array_equal(line[0], line[-1]) for line in lines)
    tips = in_plane(chain, q)
    outside = tips[crossings(tips, lines) % 2 == 0]
    assert len(outside) == 0 or off_the_lines(outside, lines).max() < 2e-6  # between arc and chord
    assert reaches(geometry, limits, tips[:, 0] + 1j * tips[:, 1]).all()
    return geometry, lines


@pytest.mark.parametrize("name", PLANAR)
def test_the_boundary_encloses_every_sampled_point(name: str) -> None:
    robot = load_robot(name)
    enclosed(robot.chain, robot.limits, random_q(np.random.default_rng(7), robot.limits, 3000))


@pytest.mark.parametrize("name", PLANAR)
def test_a_millimetre_outside_nothing_is_reached_and_a_millimetre_inside_all_is(name: str) -> None:
    robot = load_robot(name)
    geometry = recognise(robot.chain)
    assert geometry is not None
    section = PlanarSection(geometry, robot.limits)
    q = robot.pose("home")
    T = section.plane(q)

    def solved(point: complex) -> bool:
        """By the inverse kinematics, with the base where it is: over the back does not count."""
        target = T @ np.array([point.real, 0.0, point.imag, 1.0])
        found = robot.inverse(target[:3], step=0.001).q
        turned = np.abs(np.angle(np.exp(1j * (found[:, 0] - q[0]))))
        on_the_axis = abs(point.real) < 1e-6  # there the base may stand anyhow
        return bool((turned < 1e-6).any() or (on_the_axis and len(found) > 0))

    tried = 0
    for arc in boundary_arcs(geometry, robot.limits):
        out = (arc.at(0.5) - arc.centre) / arc.radius
        for side in (1, -1):
            beside = arc.at(0.5) + 1e-3 * side * out
            if reaches(geometry, robot.limits, np.array([arc.at(0.5) + 1e-7 * side * out]))[0]:
                assert solved(arc.at(0.5) + 1e-7 * side * out)
            elif not reaches(geometry, robot.limits, np.array([beside]))[0]:
                tried += 1
                assert not solved(beside)
    assert tried > 5


def test_random_arms_are_enclosed_and_their_reach_is_that_of_brute_force() -> None:
    rng = np.random.default_rng(11)
    for _ in range(25):
        arm = random_planar_arm(rng)
        chain = chain_of(arm, "standard")
        geometry, lines = enclosed(chain, arm.limits, random_q(rng, arm.limits, 400))
        # anywhere else the two rules must agree, too
        anywhere = rng.uniform(-0.9, 0.9, (400, 2)) + np.array([arm.shoulder_r, arm.shoulder_z])
        differ = reaches(geometry, arm.limits, anywhere[:, 0] + 1j * anywhere[:, 1]) != (
            crossings(anywhere, lines) % 2 == 1
        )
        assert not differ.any() or off_the_lines(anywhere[differ], lines).max() < 2e-6


@pytest.mark.parametrize("name", (*PLANAR, "humanoid"))
def test_the_tip_lies_in_the_plane_of_the_section_and_inside_it(name: str) -> None:
    robot = load_robot(name)
    section = robot.inverse_kinematics.section()
    assert section.exact is (name != "humanoid")
    for q in random_q(np.random.default_rng(3), robot.limits, 12):
        T = section.plane(q)
        assert T[:3, :3].T @ T[:3, :3] == pytest.approx(np.eye(3), abs=1e-12)
        tip = np.linalg.solve(T, robot.forward(q)[:, 3])
        assert tip[1] == pytest.approx(0.0, abs=1e-12)
        inside = crossings(tip[None, [0, 2]], section.outline(q))[0] % 2 == 1
        near = min(np.abs(line - tip[[0, 2]]).max(axis=1).min() for line in section.outline(q))
        assert inside or near < 0.02  # of a cell; the exact ones are tested above


def test_the_sampled_section_of_a_planar_arm_is_the_exact_one_within_a_cell() -> None:
    robot = load_robot("abaas")
    q = robot.pose("home")
    sampled, exact = SampledSection(robot.chain, robot.limits), robot.inverse_kinematics.section()
    # half of the exact section is in front of the base axis and half behind, as with the sampled one
    # whose base may turn half round; the tip is in front in both
    for line in sampled.outline(q):
        middles = 0.5 * (line[:-1] + line[1:])
        inside = crossings(middles, exact.outline(q)) % 2 == 1
        mirrored = crossings(middles * [-1, 1], exact.outline(q)) % 2 == 1
        near = off_the_lines(middles, tuple(o * s for o in exact.outline(q) for s in ([1, 1], [-1, 1])))
        assert (inside | mirrored | (near < 2 * sampled.cell_m)).all()


def test_the_outline_of_cells_has_holes_and_islands() -> None:
    ring = [(x + 0.5, y + 0.5) for x in range(5) for y in range(5) if (x, y) != (2, 2)]
    lines = cell_outline(np.array([*ring, (8.5, -3.5)]), 1.0)
    assert sorted(len(line) for line in lines) == [5, 5, 21]
    assert sorted(enclosed_area(line) for line in lines) == [-1.0, 1.0, 25.0]
    inside = crossings(np.array([[0.5, 0.4], [2.5, 2.4], [8.5, -3.6], [7.0, 0.3]]), lines) % 2
    assert inside.tolist() == [1, 0, 1, 0]
    assert cell_outline(np.empty((0, 2)), 1.0) == ()


def test_smoothing_takes_the_steps_out_and_keeps_the_place() -> None:
    angle = np.linspace(0, 2 * np.pi, 20_000)
    radius = np.sqrt(np.random.default_rng(1).random(20_000))
    (steps, *_) = cell_outline((radius * [np.cos(angle), np.sin(angle)]).T, 0.05)
    smooth = smoothed(steps)
    assert np.array_equal(smooth[0], smooth[-1])
    assert np.abs(np.linalg.norm(smooth, axis=1) - 1.0).max() < 0.05
    turns = np.diff(smooth, axis=0)
    cosine = (turns[1:] * turns[:-1]).sum(axis=1) / np.prod(
        np.linalg.norm([turns[1:], turns[:-1]], axis=2), axis=0
    )
    assert cosine.min() > 0.7  # where the cells turn by a right angle
    assert enclosed_area(smooth) == pytest.approx(np.pi, rel=0.06)

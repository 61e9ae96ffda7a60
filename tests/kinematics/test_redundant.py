"""Arms of seven joints: one is swept, the six others are closed form."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from tests.kinematics.kit import plain_forward, random_q, solver_of

from armctl import load_robot
from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.kinematics import Chain, DHRow, Target
from armctl.kinematics.angles import rotation_angle
from armctl.kinematics.families.numeric.descent import rotation_vectors
from armctl.kinematics.families.redundant.locked import LockedArm, LockedSolutions
from armctl.kinematics.families.redundant.solver import RedundantSolver, _repeated
from armctl.kinematics.samples import DEFAULT_STEP
from armctl.kinematics.solutions import Solutions

Arm = tuple[Chain, FloatArray]
HALF, QUARTER = math.pi, math.pi / 2
LONG = os.environ.get("ARMCTL_LONG") == "1"
STEP = math.radians(1.0)


def arm_of(rows: list[tuple[float, float, float]], convention: str, *limits_deg: float) -> Arm:
    """Rows of a, alpha, d [mm]; the limits are symmetric."""
    chain = Chain.from_dh([DHRow(a / 1000, alpha, d / 1000) for a, alpha, d in rows], convention)  # type: ignore[arg-type]
    return chain, np.radians([(-limit, limit) for limit in limits_deg])


PANDA = arm_of(
    [
        (0, 0, 333), (0, -QUARTER, 0), (0, QUARTER, 316), (82.5, QUARTER, 0),
        (-82.5, -QUARTER, 384), (0, QUARTER, 0), (88, QUARTER, 107),
    ], "modified", 166, 101, 166, 176, 166, 176, 166,
)  # fmt: skip
PANDA[1][3], PANDA[1][5] = (-3.0718, -0.0698), (-0.0175, 3.7525)
IIWA = arm_of(  # spherical shoulder, elbow and wrist in line
    [
        (0, -QUARTER, 340), (0, QUARTER, 0), (0, QUARTER, 400), (0, -QUARTER, 0),
        (0, -QUARTER, 400), (0, QUARTER, 0), (0, 0, 126),
    ], "standard", 170, 120, 170, 120, 170, 120, 175,
)  # fmt: skip
XARM7 = arm_of(
    [
        (0, 0, 267), (0, -QUARTER, 0), (0, QUARTER, 293), (52.5, QUARTER, 0),
        (77.5, QUARTER, 342.5), (0, QUARTER, 0), (76, -QUARTER, 97),
    ], "modified", 360, 120, 360, 225, 360, 180, 360,
)  # fmt: skip
GEN3 = arm_of(  # shoulder axes that do not all meet
    [
        (0, QUARTER, -284.8), (0, QUARTER, -11.8), (0, QUARTER, -420.8), (0, QUARTER, -12.8),
        (0, QUARTER, -314.3), (0, QUARTER, 0), (0, HALF, -167.4),
    ], "standard", 179, 128, 179, 147, 179, 120, 179,
)  # fmt: skip
WAM = arm_of(  # an elbow beside its links
    [
        (0, -QUARTER, 0), (0, QUARTER, 0), (45, -QUARTER, 550), (-45, QUARTER, 0),
        (0, -QUARTER, 300), (0, QUARTER, 0), (0, 0, 60),
    ], "standard", 150, 113, 157, 170, 270, 90, 172,
)  # fmt: skip
ARMS = {"panda": PANDA, "iiwa": IIWA, "xarm7": XARM7, "gen3": GEN3, "wam": WAM}


def random_arm(seed: int) -> Arm:
    """Random twists and links; a wrist at one end, and two axes that meet beside the other end's joint."""
    rng = np.random.default_rng(seed)
    a, alpha, d = rng.uniform(-0.3, 0.3, 7), rng.uniform(0.3, 2.8, 7), rng.uniform(-0.4, 0.4, 7)
    a[[1, 4, 5]] = d[5] = 0.0  # axis k and k + 1 are a[k] apart; those of 4, 5 and 6 meet where d[5] is 0 too
    rows = [DHRow(*row, theta_rad=rng.uniform(-3, 3)) for row in zip(a, alpha, d, strict=True)]
    if seed % 2:  # from the tool to the base
        turned = [DHRow(r.a_m, r.alpha_rad, r.d_m, r.theta_rad) for r in rows[::-1]]
        chain = Chain.from_dh(turned, "modified")
    else:
        chain = Chain.from_dh(rows)
    low = rng.uniform(-3.0, -1.0, 7)
    return chain, np.stack([low, low + rng.uniform(2.0, 5.5, 7)], axis=1)


def solver(arm: Arm) -> RedundantSolver:
    found = solver_of(*arm)
    assert isinstance(found, RedundantSolver)
    return found


def pose_of(chain: Chain, q: FloatArray) -> Target:
    T = plain_forward(chain, q)
    return Target.of(T[:3, 3], rotation=T[:3, :3])


def assert_sound(found: Solutions, arm: Arm) -> None:
    """Every row inside the limits and exact by the plain product, none twice, all on the continuum."""
    chain, limits = arm
    assert found.success
    q = found.q
    assert ((q >= limits[:, 0]) & (q <= limits[:, 1])).all()
    assert found.residual_m.max() < 1e-9 and found.residual_rad.max() < 1e-8
    for one in q[:: max(1, len(q) // 3)]:
        T = plain_forward(chain, one)
        assert np.linalg.norm(T[:3, 3] - found.target.position) < 1e-9
        assert rotation_angle(T[:3, :3].T @ found.target.rotation) < 1e-8
    assert len(np.unique(np.round(q, 6), axis=0)) == len(q)


def nearest(found: Solutions, q: FloatArray) -> float:
    return float(np.abs(found.q - q).max(axis=1).min())


@pytest.mark.parametrize("name", ARMS)
def test_the_configuration_that_made_a_pose_is_on_its_list(name: str) -> None:
    """Where the arm stands there, exactly; else the nearest row is as near as the step allows."""
    arm = ARMS[name]
    inverse, chain, limits = solver(arm), *arm
    for i, q in enumerate(random_q(np.random.default_rng(7), limits, 300 if LONG else 4)):
        target = pose_of(chain, q)
        found = inverse.solve(target, STEP, q)
        assert nearest(found, q) < 1e-7
        assert found.best("least-travel", q) == pytest.approx(q, abs=1e-7)
        if i % 3 == 0:
            assert_sound(found, arm)
        # a run of solutions may be shorter than a step, then it takes a finer one
        steps = (STEP, 0.1 * STEP, 0.01 * STEP)
        assert any(nearest(inverse.solve(target, step), q) < 8 * step for step in steps)


@pytest.mark.parametrize("seed", range(40 if LONG else 4))
def test_random_arms_with_a_wrist_at_either_end(seed: int) -> None:
    arm = random_arm(seed)
    inverse, chain, limits = solver(arm), *arm
    for q in random_q(np.random.default_rng(seed), limits, 8):
        found = inverse.solve(pose_of(chain, q), STEP, q)
        assert nearest(found, q) < 1e-6
    assert_sound(found, arm)


def searched(arm: Arm, target: Target, joint: int, angle: float, rng: np.random.Generator) -> FloatArray:
    """(k, 7) solutions with one joint at an angle, by Newton steps from random starts, without the limits."""
    chain, _ = arm
    free = np.delete(np.arange(7), joint)
    q = rng.uniform(-HALF, HALF, (400, 7))
    q[:, joint] = angle
    assert target.rotation is not None
    for _ in range(60):
        T, J = chain.forward(q), chain.jacobian(q)[:, :, free]
        off = np.concatenate(
            [T[:, :3, 3] - target.position, rotation_vectors(T[:, :3, :3] @ target.rotation.T)], axis=1
        )
        Jt = np.swapaxes(J, 1, 2)
        size = np.minimum(1.0, np.linalg.norm(off, axis=1))[:, None, None]
        step = np.linalg.solve(Jt @ J + 1e-3 * size**2 * np.eye(6), Jt @ off[:, :, None])[:, :, 0]
        q[:, free] -= step
    met = q[np.linalg.norm(off, axis=1) < 1e-10]
    met = np.mod(met + HALF, 2 * HALF) - HALF
    kept: list[FloatArray] = []
    for one in met:
        if not any(np.abs(np.exp(1j * one) - np.exp(1j * other)).max() < 1e-5 for other in kept):
            kept.append(one)
    return np.array(kept).reshape(-1, 7)


@pytest.mark.parametrize("name", ARMS)
def test_all_branches_of_a_locked_joint_are_found_by_search_too(name: str) -> None:
    """Without limits, so that every branch is there: as many as 400 Newton searches find, and the same."""
    chain, limits = ARMS[name]
    whole = np.tile([-HALF, HALF], (7, 1))
    locked = LockedArm.of(chain)
    assert locked is not None
    rng = np.random.default_rng(3)
    for q in random_q(rng, limits, 20 if LONG else 1):
        target = pose_of(chain, q)
        T = plain_forward(chain, q)
        listed = locked.solve(T, q[[locked.joint]], whole).q
        found = searched((chain, limits), target, locked.joint, float(q[locked.joint]), rng)
        assert len(listed) == len(found)
        for one in found:
            assert np.abs(np.exp(1j * listed) - np.exp(1j * one)).max(axis=1).min() < 1e-6


@pytest.mark.parametrize("name", ARMS)
def test_one_branch_of_each_angle_is_the_same_one_among_all(name: str) -> None:
    chain, limits = ARMS[name]
    locked = LockedArm.of(chain)
    assert locked is not None
    rng, met = np.random.default_rng(4), 0
    for q in random_q(rng, limits, 20):
        T, angles = plain_forward(chain, q), rng.uniform(*limits[locked.joint], 300)
        only = rng.integers(len(LockedArm.branch_names), size=300)
        every, one = locked.solve(T, angles, limits), locked.solve(T, angles, limits, only)
        own = np.flatnonzero(every.branch == only[every.row])
        own = own[np.argsort(every.row[own])]
        assert np.array_equal(one.row, every.row[own]) and np.array_equal(one.branch, only[one.row])
        assert np.abs(one.q - every.q[own]).max(initial=0.0) < 1e-12
        met += len(own)
    assert met > 100


AT_THE_END_OF_A_RUN = {
    "panda": [
        [-0.1189, 1.6166, -1.0588, -1.8647, -2.8919, 1.5666, 0.7616],
        [-0.5499, -1.5037, 2.0747, -0.5837, -2.0872, 1.9697, -1.4014],
    ],
    "iiwa": [[2.5811, 1.7747, -1.0245, 2.0477, -1.8534, 1.354, -2.0937]],
}
"""where the least rotation or travel is, at a limit of another joint than the free one"""


@pytest.mark.parametrize("name", ["panda", "iiwa"])
def test_the_least_rotation_is_exact_over_the_continuum(name: str) -> None:
    """Never above a fine list, and stationary: a coarse list leads to the same."""
    arm = ARMS[name]
    inverse, chain, limits = solver(arm), *arm
    chosen = np.array(AT_THE_END_OF_A_RUN[name])
    for q in [*chosen, *random_q(np.random.default_rng(5), limits, 20 if LONG else 3)]:
        target = pose_of(chain, q)
        coarse, fine = inverse.solve(target, STEP), inverse.solve(target, math.radians(0.05))
        best = coarse.best("least-rotation")
        least = np.abs(best).sum()
        assert least <= np.abs(fine.q).sum(axis=1).min() + 1e-7
        assert least == pytest.approx(np.abs(fine.best("least-rotation")).sum(), abs=1e-7)
        T = plain_forward(chain, best)
        assert np.linalg.norm(T[:3, 3] - target.position) < 1e-9
        assert ((best >= limits[:, 0]) & (best <= limits[:, 1])).all()
        start = q + 0.3 * np.sin(np.arange(7.0))
        travel = [np.abs(one - start).sum() for one in (coarse.best("least-travel", start), *fine.q)]
        assert travel[0] <= min(travel[1:]) + 1e-7  # where a run ends rounding takes the last digits


@pytest.mark.parametrize("name", ["panda", "iiwa"])
def test_the_shortest_time_is_that_of_a_fine_list_at_least(name: str) -> None:
    arm = ARMS[name]
    inverse, chain, limits = solver(arm), *arm
    for q in random_q(np.random.default_rng(6), limits, 20 if LONG else 2):
        target, start = pose_of(chain, q), np.clip(q + 0.4 * np.cos(np.arange(7.0)), *limits.T)
        fine = inverse.solve(target, math.radians(0.05))
        times = fine.energies("shortest-time", start)
        for step in (STEP, DEFAULT_STEP):
            found = inverse.solve(target, step)
            best = found.best("shortest-time", start)
            way = np.abs(best - start)  # all speeds and accelerations are 1
            time = np.maximum(1.5 * way, np.sqrt(6.0 * way)).max()
            assert time <= times.min() + 1e-7
            T = plain_forward(chain, best)
            assert np.linalg.norm(T[:3, 3] - target.position) < 1e-9


def tight(seed: int) -> Arm:
    """A random arm with little room for each joint."""
    chain, limits = random_arm(seed)
    rng = np.random.default_rng([seed, 1])
    middle, half = rng.uniform(*limits.T), rng.uniform(0.5, 1.6, 7)
    return chain, np.stack(
        [np.maximum(middle - half, limits[:, 0]), np.minimum(middle + half, limits[:, 1])], 1
    )


def test_tight_limits_cost_no_more_than_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is on the list lies within 2 mrad of a row, the list is short, and the work is bounded."""
    robot = load_robot(Path(__file__).with_name("tight_wrist.urdf"))
    solved: list[int] = []
    plain = LockedArm.solve

    def counted(
        self: LockedArm,
        pose: FloatArray,
        angles: FloatArray,
        limits: FloatArray,
        only: NDArray[np.intp] | None = None,
    ) -> LockedSolutions:
        solved.append(len(angles) * (len(LockedArm.branch_names) if only is None else 1))
        return plain(self, pose, angles, limits, only)

    monkeypatch.setattr(LockedArm, "solve", counted)
    cases: list[tuple[Arm, FloatArray]] = []
    for arm, seed, count in (
        ((robot.chain, robot.limits), 1, 8),
        *((tight(seed), seed, 3) for seed in range(30 if LONG else 4)),
    ):
        cases += [(arm, q) for q in random_q(np.random.default_rng(seed), arm[1], count)]
    for arm, q in cases:
        solved.clear()
        T = arm[0].forward(q)
        found = solver(arm).solve(Target.of(T[:3, 3], rotation=T[:3, :3]), DEFAULT_STEP)
        assert nearest(found, q) < 2e-3
        assert len(found) < 5000
        assert sum(solved) < 130_000


def test_where_the_sweep_finds_nothing_the_search_leads_to_the_list() -> None:
    """Almost folded, this arm has the pose only within 0.4° of one angle of the free joint."""
    chain = WAM[0]
    q = np.array([-1.1794, -1.8491, -1.3851, -2.8413, 2.9282, -1.1867, 2.8457])
    found = solver(WAM).solve(pose_of(chain, q), STEP)
    assert found.free_joint == 0
    assert_sound(found, WAM)
    assert np.abs(np.exp(1j * found.q) - np.exp(1j * q)).max(axis=1).min() < 20 * STEP


def test_what_is_swept_is_told() -> None:
    inverse = solver(PANDA)
    q = np.array([0.1, -0.4, 0.2, -2.0, 0.3, 1.8, 0.5])
    found = inverse.solve(pose_of(PANDA[0], q), STEP)
    assert found.free_joint == 6 and solver(IIWA).solve(pose_of(IIWA[0], q / 2), STEP).free_joint == 0
    assert not found.complete and "in steps of 1° of Joint 7" in (found.incomplete_reason or "")
    assert len(found.branch_names) == 8 and set(found.branch) <= set(found.branch_names)
    assert inverse.is_swept(found.target) and inverse.is_swept(Target.of(found.target.position))
    for joint in range(7):  # along a branch all joints turn smoothly, but where it ends
        one = found.q[found.branch == found.branch[0]]
        assert np.median(np.abs(np.diff(one[:, joint]))) < 10 * STEP


def test_whole_turns_are_listed_where_the_limits_allow_them() -> None:
    inverse, (chain, limits) = solver(XARM7), XARM7
    q = np.array([0.3, -0.4, 0.2, 1.2, 0.3, 0.8, 0.5])
    found = inverse.solve(pose_of(chain, q), math.radians(10), q)
    for shift in (0, 2, 4, 6):
        for turns in (-1.0, 1.0):
            other = q.copy()
            other[shift] += turns * 2 * HALF
            if limits[shift, 0] <= other[shift] <= limits[shift, 1]:
                assert nearest(found, other) < 1e-7
    start = q + np.array([2 * HALF, 0, 0, 0, 0, 0, 0])
    start[0] = min(start[0], limits[0, 1])
    assert found.best("least-travel", q) == pytest.approx(q, abs=1e-7)
    fine = inverse.solve(pose_of(chain, q), math.radians(0.03), q)
    assert "more differ by whole turns" in (fine.incomplete_reason or "")


def test_a_short_run_beyond_the_turn_that_is_swept_is_listed_once() -> None:
    chain = XARM7[0]
    for q in (
        [3.56, 1.2111, 3.8166, -1.383, 0.4967, -2.3311, 6.2023],
        [6.2651, 0.3117, 2.7785, -1.4567, 5.5327, -2.4423, -3.1846],
    ):
        found = solver(XARM7).solve(pose_of(chain, np.array(q)), math.radians(2))
        assert not cKDTree(found.q).query_pairs(0.5e-6, p=np.inf)


@pytest.mark.parametrize(
    ("name", "q"),
    [
        ("iiwa", [0.0] * 7),
        ("iiwa", [0.3, 0.5, 0.2, 0.0, 0.1, 0.4, 0.2]),  # elbow straight
        ("iiwa", [0.3, 0.0, 0.2, 0.8, 0.1, 0.4, 0.2]),  # two shoulder axes in line
        ("iiwa", [0.3, 0.5, 0.2, 0.8, 0.1, 0.0, 0.2]),  # two wrist axes in line
        ("panda", [0.1, 0.0, 0.2, -1.0, 0.3, 1.5, 0.4]),
        ("panda", PANDA[1][:, 0]),  # every joint at a limit
        ("panda", PANDA[1][:, 1]),
        ("gen3", [0.0] * 7),
        ("xarm7", [0.0] * 7),
    ],
)
def test_where_the_arm_stands_is_listed_in_singular_poses_and_at_limits(name: str, q: list[float]) -> None:
    arm, there = ARMS[name], np.array(q)
    inverse, target = solver(arm), pose_of(arm[0], there)
    found = inverse.solve(target, STEP, there)
    assert nearest(found, there) < 1e-6
    assert_sound(found, arm)
    assert found.best("least-travel", there) == pytest.approx(there, abs=1e-6)
    assert_sound(inverse.solve(target, STEP), arm)


@pytest.mark.parametrize("name", ARMS)
def test_a_pose_of_several_joints_at_their_limits_is_on_the_list(name: str) -> None:
    """The run of solutions there may be one angle of the free joint, far from those of the sweep."""
    arm = ARMS[name]
    inverse, (chain, limits) = solver(arm), arm
    rng = np.random.default_rng(11)
    count, listed = (300 if LONG else 6), 0
    for q in random_q(rng, limits, count):
        at = rng.choice(np.delete(np.arange(7), inverse.solve(pose_of(chain, q), STEP).free_joint), 3, False)
        q[at] = limits[at, rng.integers(0, 2, 3)]
        found = inverse.solve(pose_of(chain, q), STEP)
        assert_sound(found, arm)
        away = np.abs(np.exp(1j * found.q) - np.exp(1j * q)).max(axis=1)  # whole turns not counted
        listed += bool(away.min() < 20 * STEP)
    assert listed >= 0.9 * count


def test_a_held_joint_leaves_one_solution() -> None:
    q = np.array([0.1, -0.4, 0.2, -2.0, 0.3, 1.8, 0.3])
    for joint in (2, 6):
        limits = PANDA[1].copy()
        limits[joint] = q[joint]
        found = solver((PANDA[0], limits)).solve(pose_of(PANDA[0], q), STEP, q)
        assert nearest(found, q) < 1e-6 and len(found) < 9


def test_a_position_alone_is_searched_for_and_a_pose_out_of_reach_is_approached() -> None:
    inverse, (chain, _) = solver(PANDA), PANDA
    T = plain_forward(chain, np.array([0.1, -0.4, 0.2, -2.0, 0.3, 1.8, 0.5]))
    found = inverse.solve(Target.of(T[:3, 3]), STEP)
    assert found.success and found.free_joint is None and found.residual_m.max() < 1e-9
    far = inverse.solve(Target.of([2.0, 0.0, 0.5], rotation=np.eye(3)), STEP)
    assert not far.success and "too far" in (far.reason or "")
    edge = inverse.solve(Target.of([0.0, 0.0, 1.1], rotation=T[:3, :3]), STEP)
    if edge.success:
        assert edge.residual_m.max() < 1e-9
    with pytest.raises(InputError, match="step"):
        inverse.solve(pose_of(chain, np.zeros(7)), 0.0)


@pytest.mark.parametrize(("shift", "closed"), [(0.0, True), (5e-12, True), (5e-10, False), (9e-10, False)])
def test_axes_that_miss_a_common_point_by_more_than_rounding_are_searched(shift: float, closed: bool) -> None:
    """Rows of a closed form miss the pose by as much as the axes miss each other."""
    rows = list(PANDA[0].rows)
    rows[5] = replace(rows[5], a_m=rows[5].a_m + shift)
    chain = Chain.from_dh(rows, "modified")
    q = np.array([0.1, -0.4, 0.2, -2.0, 0.3, 1.8, 0.5])
    inverse = solver_of(chain, PANDA[1])
    assert isinstance(inverse, RedundantSolver) == closed
    found = inverse.solve(pose_of(chain, q), STEP)
    assert len(found) > (200 if closed else 20)
    assert found.residual_m.max() <= 1e-10


def test_other_arms_of_seven_joints_are_not_of_the_family() -> None:
    rng = np.random.default_rng(1)
    rows = [DHRow(*rng.uniform(0.1, 0.9, 3)) for _ in range(7)]
    assert LockedArm.of(Chain.from_dh(rows)) is None
    assert LockedArm.of(Chain.from_dh(rows[:6])) is None


def test_the_same_solution_is_found_though_others_look_like_it() -> None:
    """Between it and its likeness, in the order in which they are compared, stand quite different ones."""
    rng = np.random.default_rng(2)
    one = rng.uniform(-3, 3, 7)
    others = rng.uniform(-3, 3, (30, 7))
    low, high = sorted(place_of(np.array([one, one + 3e-7])).tolist())
    between = []
    for other in others:  # its first joint is turned until it has a place between those two
        angles = np.linspace(-math.pi, math.pi, 100_001)
        rows = np.tile(other, (len(angles), 1))
        rows[:, 0] = angles
        places = place_of(rows)
        at = np.flatnonzero(np.diff(np.sign(places - 0.5 * (low + high))))
        for k in at[:1].tolist():
            share = (0.5 * (low + high) - places[k]) / (places[k + 1] - places[k])
            rows[k, 0] += share * (angles[k + 1] - angles[k])
            between.append(rows[k])
    q = np.vstack([one, *between[:3], one + 3e-7, one + 2 * math.pi * np.eye(7)[0]])
    assert len(q) == 6
    assert np.count_nonzero(_repeated(q)) == 2 and not _repeated(q)[1:4].any()


def place_of(q: FloatArray) -> FloatArray:
    weights = np.sqrt(np.arange(2.0, 9.0))
    return np.cos(q) @ weights + np.sin(q) @ weights[::-1]

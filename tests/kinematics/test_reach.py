"""Refusals: why, with numbers; and the nearest reachable point against brute force."""

from __future__ import annotations

import itertools
import math
import os
import re
from collections.abc import Callable

import numpy as np
import pytest
from benchmarks.naive_sweep import UZUNER, PlanarArm
from tests.kinematics.kit import FloatArray, chain_of, least_distance, random_planar_arm, random_q, solver_of

from armctl import load_robot
from armctl.errors import UnreachableError
from armctl.facts import Several, say
from armctl.facts.targets import NearestPoint, OutOfReach
from armctl.kinematics import Chain, DHRow, InverseKinematics, Target
from armctl.kinematics.explanations import angle_needed

STEP = math.radians(0.5)


@pytest.mark.parametrize(
    ("point", "asked", "says"),
    [
        (
            (300, 0, 600),
            {},
            ["too far by 200.0 mm", "530.1 mm from the shoulder", "the arm reaches 330.0 mm"],
        ),
        ((0, 0, 300), {}, ["3.62 mm cylinder", "0.00 mm from the axis"]),
        (
            (-300, 0, 100),
            {},
            [
                "Base needs 179.31°, its limits are -102.80° … 107.26°",
                "Shoulder needs 163.69°, its limits are -3.19° … 146.83°",
            ],
        ),
        ((250, 0, 10), {"pitch": 45.0}, ["too far by 57.8 mm", "with the tool at that pitch"]),
        ((200, 0, 100), {"pitch": -30.0}, ["at that pitch, but joint limits forbid it"]),
        ((200, 0, 100), {"roll": 90.0}, ["Wrist roll needs 90.00°, its limits are -47.64° … 47.32°"]),
    ],
)
def test_a_refusal_says_why_with_numbers(
    point: tuple[float, float, float], asked: dict[str, float], says: list[str]
) -> None:
    radians = {name: math.radians(value) for name, value in asked.items()}
    solutions = load_robot("uzuner").inverse(np.array(point) / 1000, **radians)
    assert not solutions.success
    assert len(solutions) == 0
    assert all(fact in str(solutions.reason) for fact in says)


def test_where_only_the_roll_is_impossible_the_point_is_said_to_be_within_reach() -> None:
    robot = load_robot("uzuner")
    solutions = robot.inverse([0.2, 0.0, 0.1], roll=math.radians(200))
    assert not solutions.success
    assert solutions.explanation.endswith("; the point itself can be reached")
    assert solutions.nearest_m == pytest.approx([0.2, 0.0, 0.1], abs=1e-9)
    assert solutions.nearest_q is not None
    assert solutions.nearest_q[4] == robot.limits[4, 0]  # 200° is -160°


def test_the_dead_zone() -> None:
    arm = PlanarArm(0.0, 0.0, 0.1, (0.3, 0.05, 0.05), np.radians([[-170.0, 170.0]] * 4))
    solutions = solver_of(chain_of(arm, "standard"), arm.limits).solve(Target.of([0.05, 0.0, 0.1]), STEP)
    assert "too near by 150.0 mm" in str(solutions.reason)
    assert "folds no closer than 200.0 mm" in str(solutions.reason)


Tip = Callable[[FloatArray], FloatArray]


LONG = bool(os.environ.get("ARMCTL_LONG"))


def cases(rng: np.random.Generator, count: int) -> list[tuple[PlanarArm, InverseKinematics, Chain]]:
    robot = load_robot("uzuner")
    out = [(UZUNER, robot.inverse_kinematics, robot.chain)] * (count // 4)
    while len(out) < count:
        arm = random_planar_arm(rng)
        chain = chain_of(arm, "standard")
        out.append((arm, solver_of(chain, arm.limits), chain))
    return out


@pytest.mark.slow
def test_the_nearest_point_is_the_nearest() -> None:
    rng = np.random.default_rng(41)
    refused = 0
    count = 45 if LONG else 8
    for arm, ik, chain in cases(rng, count):
        for _ in range(5):
            size = sum(arm.lengths) + 0.1
            position = rng.uniform(-size, size, 3) * rng.choice([0.1, 0.4, 1.0, 2.0])
            position[2] += arm.shoulder_z
            solutions = ik.solve(Target.of(position), STEP)
            if solutions.success:
                continue
            refused += 1
            assert solutions.nearest_q is not None
            assert solutions.nearest_m is not None
            q = solutions.nearest_q[:4]
            assert ((q >= arm.limits[:, 0]) & (q <= arm.limits[:, 1])).all()
            assert np.abs(chain.forward(solutions.nearest_q)[:3, 3] - solutions.nearest_m).max() == 0.0
            nearest = float(np.linalg.norm(solutions.nearest_m - position))
            assert nearest <= least_distance(arm.tip, arm.limits, position, rng, 3000) + 1e-6
            assert ik.solve(Target.of(solutions.nearest_m), STEP).success
    assert refused >= 120 * count / 45


def at_pitch(arm: PlanarArm, heading: float) -> tuple[Tip, FloatArray]:
    """The tip by base, shoulder and elbow with the last link's heading held, and their limits."""
    s, o = np.array(arm.signs), np.array(arm.offsets)

    def tip(v: FloatArray) -> FloatArray:
        t = v[..., 1:3] * s[:2] + o[:2]
        last = s[2] * (heading - t.sum(axis=-1) - o[2])
        return arm.tip(np.concatenate([v, last[..., None]], axis=-1))

    return tip, arm.limits[:3]


def test_the_nearest_point_with_the_pitch_kept() -> None:
    """By sampling alone: the wrist's own limit is a constraint between the other two joints."""
    rng = np.random.default_rng(42)
    kept, count = 0, 60 if LONG else 10
    for _ in range(count):
        arm = random_planar_arm(rng)
        chain = chain_of(arm, "modified", roll=True)
        limits = np.vstack([arm.limits, [[-2.0, 2.0]]])
        ik = solver_of(chain, limits)
        pitch = float(rng.uniform(-1.4, 1.4))
        position = rng.uniform(-0.6, 0.6, 3)
        solutions = ik.solve(Target.of(position, pitch=pitch), STEP)
        if solutions.success or solutions.nearest_q is None or solutions.nearest_m is None:
            continue
        reached, _ = ik.pitch_and_roll(solutions.nearest_q)
        samples: list[FloatArray] = []
        for heading in (pitch, math.pi - pitch):
            tip, three = at_pitch(arm, heading)
            v = random_q(rng, three, 60_000)
            last = arm.signs[2] * (
                heading - (v[:, 1:] * arm.signs[:2] + arm.offsets[:2]).sum(axis=1) - arm.offsets[2]
            )
            middle = arm.limits[3].mean()
            last = last - 2 * math.pi * np.rint((last - middle) / (2 * math.pi))
            samples.append(tip(v)[(last >= arm.limits[3, 0]) & (last <= arm.limits[3, 1])])
        tips = np.concatenate(samples)
        if not len(tips):
            continue
        kept += 1
        assert reached == pytest.approx(pitch, abs=1e-9)
        distance = float(np.linalg.norm(solutions.nearest_m - position))
        sampled = float(np.linalg.norm(tips - position, axis=1).min())
        assert distance <= sampled + 1e-9
        assert distance >= sampled - 0.03  # 60,000 samples are a coarse net, but not a wrong one
        assert ik.solve(Target.of(solutions.nearest_m, pitch=pitch), STEP).success
    assert kept >= count / 2


def test_two_pitch_joints_whose_limits_forbid_the_pitch_that_the_links_give() -> None:
    """The joint that would have to leave its limits is named; the pitch itself is possible."""
    robot = load_robot("mico")
    forbidden = [branch for branch in robot.branches([0.3, 0.0, 0.1]) if branch.forbidden]
    assert forbidden
    for branch in forbidden:
        pitch, _ = robot.inverse_kinematics.pitch_and_roll(branch.q)
        solutions = robot.inverse([0.3, 0.0, 0.1], pitch=pitch)
        if solutions.success:
            continue  # another branch has the same pitch inside the limits
        assert "impossible" not in str(solutions.reason)
        assert "Shoulder needs" in str(solutions.reason)


def test_a_joint_at_its_limit_is_not_blamed() -> None:
    """The least excess leaves other joints at their limits, but for the last digits of a search."""
    uzuner = load_robot("uzuner").inverse([0.04242160388733107, -0.024733999878656432, 0.20818660758888938])
    humanoid = load_robot("humanoid").inverse(
        [-0.03170100820513222, 0.5132632123685765, -0.10304934813541569]
    )
    for solutions in (uzuner, humanoid):
        assert solutions.reason is not None
        for needed, low, high in re.findall(
            r"needs (\S+)°, its limits are (\S+)° … (\S+)°", solutions.reason
        ):
            assert not float(low) <= float(needed) <= float(high)


def test_an_excess_in_the_last_digits_is_said_with_as_many() -> None:
    limits = np.radians([-10.0, 20.0])
    assert (
        say(angle_needed("Elbow", limits, math.radians(20.00012)))
        == "Elbow needs 20.0001°, its limits are -10.0000° … 20.0000°"
    )
    said = say(angle_needed("Elbow", limits, math.radians(21.0)))
    assert said == "Elbow needs 21.00°, its limits are -10.00° … 20.00°"


@pytest.mark.parametrize("azimuth", [-170.0, -60.0, 0.0, 45.0, 120.0])
def test_of_two_ways_to_the_nearest_point_the_least_turned_one_is_told(azimuth: float) -> None:
    robot = load_robot("mico")  # its base turns right round, so over the back it reaches the same point
    turn = math.radians(azimuth)
    found = robot.inverse([0.5 * math.cos(turn), 0.5 * math.sin(turn), 0.7])
    assert found.nearest_q is not None and found.nearest_m is not None
    facing = np.radians([azimuth, -40.331257, -90.0, 0.0])
    back = np.radians([azimuth - math.copysign(180.0, azimuth), -180.0 + 40.331257, -90.0, 0.0])
    np.testing.assert_allclose(robot.forward(back)[:3, 3], found.nearest_m, atol=1e-8)
    least = min((facing, back), key=lambda q: float(np.abs(q).sum()))
    np.testing.assert_allclose(found.nearest_q, least, atol=1e-7)


def test_the_nearest_point_beside_the_base_axis() -> None:
    """The tip may lean to either side of the axis: one minimum each, and one of them is the nearest."""
    solutions = load_robot("scorbot").inverse(np.array([20.95, -3.95, 943.22]) / 1000)
    assert solutions.explanation.startswith("too far by 39.2 mm")
    assert solutions.explanation.endswith("39.2 mm away")


def test_a_refusal_is_data_and_is_said_in_the_language_of_its_reader(monkeypatch: pytest.MonkeyPatch) -> None:
    solutions = load_robot("uzuner").inverse([0.3, 0.0, 0.6])
    with pytest.raises(UnreachableError) as refused:
        solutions.best()
    assert str(refused.value) == solutions.explanation
    match refused.value.reason:
        case Several((OutOfReach(far=True, miss_m=miss, length_m=length), NearestPoint(away_m=away))):
            assert (miss, length, away) == pytest.approx((0.2, 0.33, 0.2), abs=5e-5)
        case other:
            raise AssertionError(other)
    monkeypatch.setenv("LC_ALL", "tr_TR.UTF-8")
    assert str(refused.value).startswith(
        "200.0 mm fazla uzak: hedef Shoulder ekleminden 530.1 mm uzakta olurdu"
    )


@pytest.mark.parametrize("links_mm", [(150, 40), (200, 60)])
def test_beside_the_base_axis_and_ahead_of_it_the_miss_is_the_way_in_space(links_mm: tuple[int, int]) -> None:
    """Compared with all yaws and the two circles about the shoulder, point by point."""
    upper, fore = links_mm
    rows = [DHRow(0.05, math.pi / 2, 0.1), DHRow(upper / 1000, 0.0, 0.08), DHRow(fore / 1000, 0.0, 0.0)]
    chain = Chain.from_dh(rows)
    solver = solver_of(chain, np.tile([-math.pi, math.pi], (3, 1)))
    around = np.array(list(itertools.product(np.linspace(-math.pi, math.pi, 361), repeat=2)))
    ends = {
        which: chain.forward(np.column_stack([around, np.full(len(around), bend)]))[:, :3, 3]
        for which, bend in (("far", 0.0), ("near", math.pi))
    }
    rng, seen = np.random.default_rng(4), set()
    for _ in range(60):
        point = rng.uniform(-1, 1, 3) * rng.choice([0.15, 0.6]) + [0.0, 0.0, 0.1]
        said = solver.solve(Target.of(point), 0.01).explanation or ""
        found = re.search(r"too (far|near) by ([\d.]+) mm", said)
        if found is None:
            continue
        seen.add(found[1])
        least = 1000 * np.linalg.norm(ends[found[1]] - point, axis=1).min()
        assert least - 0.5 <= float(found[2]) <= least + 0.05, said  # the grid is 1° coarse
    assert seen == {"far", "near"}


def test_beside_the_base_axis_with_a_pitch_the_miss_is_the_way_to_the_nearest_point() -> None:
    """Compared with all yaws and the circles about the shoulder, the hand at that pitch either way."""
    rows = [DHRow(0.05, math.pi / 2, 0.1), DHRow(0.2, 0.0, 0.08), DHRow(0.05, 0.0, 0.0)]
    chain = Chain.from_dh([*rows, DHRow(0.0, math.pi / 2, 0.0, math.pi / 2), DHRow(0.0, 0.0, 0.07)])
    solver = solver_of(chain, np.tile([-math.pi, math.pi], (5, 1)))
    yaws, turns = (
        np.linspace(-math.pi, math.pi, 721)[:, None],
        np.linspace(-math.pi, math.pi, 721)[None],
    )
    rng, seen = np.random.default_rng(5), set()
    for _ in range(150):
        point = rng.uniform(-1, 1, 3) * rng.choice([0.1, 0.6]) + [0.0, 0.0, 0.1]
        pitch = float(rng.uniform(-1.5, 1.5))
        solutions = solver.solve(Target.of(point, pitch), 0.01)
        found = re.search(r"too (far|near) by ([\d.]+) mm: from the .* at that pitch", solutions.reason or "")
        if found is None:
            continue
        seen.add(found[1])
        least = math.inf
        for length, angle in itertools.product((0.25, 0.15), (pitch, math.pi - pitch)):
            tip = 0.05 + 0.1j + length * np.exp(1j * turns) + 0.07 * np.exp(1j * angle)
            space = (tip.real + 1j * -0.08) * np.exp(1j * yaws)
            away = np.abs(space - complex(point[0], point[1])) ** 2 + (tip.imag - point[2]) ** 2
            least = min(least, 1000 * math.sqrt(away.min()))
        assert least - 1.0 <= float(found[2]) <= least + 0.05, solutions.reason
    assert seen == {"far", "near"}


def test_a_base_that_would_turn_for_nothing_is_not_named() -> None:
    """The shoulder is on the base axis: the arm misses by the same length whichever way it faces."""
    robot = load_robot("braccio")
    said = robot.inverse([-0.3, -0.5, 0.3]).explanation
    assert said.startswith("too far by") and "Base needs" not in said

"""Paden-Kahan subproblems and the extended ones: all angles, least squares and continua, by brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.kinematics.kit import rotation_about

from armctl.arrays import FloatArray
from armctl.kinematics.subproblems import (
    Answer,
    angle_about,
    circle,
    roots,
    subproblem_1,
    subproblem_2,
    subproblem_3,
    subproblem_4,
    subproblem_5,
    subproblem_6,
    two_turns,
)

TIMES = 60
GRID = np.linspace(-math.pi, math.pi, 721)


def unit(rng: np.random.Generator) -> FloatArray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def has(answer: Answer, *angles: float) -> bool:
    return any(
        max(abs(math.remainder(x - y, math.tau)) for x, y in zip(found, angles, strict=True)) < 1e-6
        for found in answer.angles
    )


def test_1_turns_one_vector_onto_another() -> None:
    rng = np.random.default_rng(1)
    for _ in range(TIMES):
        k, p, x = unit(rng), rng.normal(size=3), rng.uniform(-3, 3)
        assert has(subproblem_1(k, p, rotation_about(k, x) @ p), x)
        q = rng.normal(size=3)
        ((best,),), exact, free = subproblem_1(k, p, q)
        least = min(np.linalg.norm(rotation_about(k, one) @ p - q) for one in GRID[::8])
        assert not exact and not free
        assert np.linalg.norm(rotation_about(k, best) @ p - q) <= least + 1e-12
        assert float(angle_about(k, p, q)) == pytest.approx(best, abs=1e-12)
    assert subproblem_1(k, 2.0 * k, 2.0 * k) == Answer(((0.0,),), True, (0,))
    assert subproblem_1(k, 2.0 * k, k) == Answer(((0.0,),), False, (0,))


def test_2_brings_two_vectors_together() -> None:
    rng = np.random.default_rng(2)
    for _ in range(TIMES):
        k1, k2, p = unit(rng), unit(rng), rng.normal(size=3)
        x, y = rng.uniform(-3, 3, 2)
        q = rotation_about(k2, -y) @ rotation_about(k1, x) @ p
        answer = subproblem_2(k1, k2, p, q)
        assert answer.exact and has(answer, x, y) and len(answer.angles) == 2
        q = rng.normal(size=3)
        answer = subproblem_2(k1, k2, p, q)
        ends = np.array([rotation_about(k2, one) @ q for one in GRID[::16]])
        least = min(np.linalg.norm(ends - rotation_about(k1, one) @ p, axis=1).min() for one in GRID[::16])
        for first, second in answer.angles:
            missed = np.linalg.norm(rotation_about(k1, first) @ p - rotation_about(k2, second) @ q)
            assert missed <= least + 1e-9 and not answer.exact
    x, y, z = np.eye(3)
    assert subproblem_2(x, z, 2.0 * x, 2.0 * y).free == (0,)
    assert has(subproblem_2(x, z, 2.0 * x, 2.0 * y), 0.0, -math.pi / 2)
    assert subproblem_2(x, z, -2.0 * z, 2.0 * z).free == (1,)
    assert subproblem_2(z, z, x, y).free == (0, 1)
    assert subproblem_2(z, z, x, y).exact and not subproblem_2(z, -z, x, y + z).exact


def test_3_and_4_have_two_angles_or_the_one_that_misses_least() -> None:
    rng = np.random.default_rng(3)
    for _ in range(TIMES):
        k, p, q, x = unit(rng), rng.normal(size=3), rng.normal(size=3), rng.uniform(-3, 3)
        answer = subproblem_3(k, p, q, float(np.linalg.norm(rotation_about(k, x) @ p - q)))
        assert answer.exact and has(answer, x) and len(answer.angles) == 2
        far = subproblem_3(k, p, q, 9.0)
        distance = max(np.linalg.norm(rotation_about(k, one) @ p - q) for one in GRID)
        assert not far.exact and len(far.angles) == 1
        assert np.linalg.norm(rotation_about(k, far.angles[0][0]) @ p - q) >= distance - 1e-9
        answer = subproblem_4(k, p, q, float(q @ rotation_about(k, x) @ p))
        assert answer.exact and has(answer, x) and len(answer.angles) == 2
        many = roots(circle(k, p, q), float(q @ rotation_about(k, x) @ p), 1e-12)
        assert sorted(angle for (angle,) in answer.angles) == pytest.approx(
            sorted(math.remainder(angle, math.tau) for angle in many.tolist()), abs=1e-9
        )
        assert not subproblem_4(k, p, q, -9.0 * float(np.linalg.norm(p) * np.linalg.norm(q))).exact
    assert subproblem_3(k, k, q, float(np.linalg.norm(k - q))) == Answer(((0.0,),), True, (0,))
    assert subproblem_4(k, p, k, float(k @ p)) == Answer(((0.0,),), True, (0,))


def test_5_finds_every_triple() -> None:
    rng = np.random.default_rng(5)
    counts: list[int] = []
    for times in range(TIMES):
        k1, k2, k3 = unit(rng), unit(rng), unit(rng)
        p0, p1, p2, p3 = rng.normal(size=(4, 3))
        x, y, z = rng.uniform(-3, 3, 3)
        if times % 3 == 0:
            k3 = k2  # only θ1 is in the first condition
        p0 = rotation_about(k2, y) @ (p2 + rotation_about(k3, z) @ p3) - rotation_about(k1, x) @ p1
        answer = subproblem_5(k1, k2, k3, p0, p1, p2, p3)
        assert answer.exact and not answer.free and has(answer, x, y, z)
        for one, two, three in answer.angles:
            right = rotation_about(k2, two) @ (p2 + rotation_about(k3, three) @ p3)
            assert np.abs(p0 + rotation_about(k1, one) @ p1 - right).max() < 1e-9
        counts.append(len(answer.angles))
    assert set(counts) == {2, 4}
    missed = subproblem_5(k1, k2, k3, 9.0 * p0, p1, p2, p3)
    assert not missed.exact and len(missed.angles) == 1
    # a first vector on its axis, and a second one: the joints in between may be anywhere
    x, y, z = np.eye(3)
    assert subproblem_5(z, x, y, 0.0 * x, z, 0.0 * x, z).free == (0,)
    assert 1 in subproblem_5(z, x, y, x, x, 2.0 * x, 0.0 * x).free


def test_6_finds_every_pair() -> None:
    rng = np.random.default_rng(6)
    for times in range(TIMES):
        k, h = [unit(rng) for _ in range(4)], rng.normal(size=(4, 3))
        p = rng.normal(size=(4, 3))
        if times % 3 == 0:
            p[2] = k[2]  # the second condition has only the second angle
        x, y = rng.uniform(-3, 3, 2)
        parts = [float(h[i] @ rotation_about(k[i], (x, y)[i % 2]) @ p[i]) for i in range(4)]
        answer = subproblem_6(k, p, h, parts[0] + parts[1], parts[2] + parts[3])
        assert answer.exact and has(answer, x, y)
        assert len(answer.angles) in (2, 4)
    assert not subproblem_6(k, p, h, 99.0, 0.0).exact


def test_two_turns_say_what_may_be_anywhere() -> None:
    turn = ((1.0, 0.0), (0.0, 1.0))
    none = ((0.0, 0.0), (0.0, 0.0))
    answer = two_turns(none, turn, (0.6, 0.8))
    assert answer.exact and answer.free == (0,) and has(answer, 0.0, math.atan2(0.8, 0.6))
    assert two_turns(turn, none, (0.6, 0.8)).free == (1,)
    assert not two_turns(none, turn, (0.6, 0.9)).exact
    # equal circles: one angle hangs on the other
    back = ((-1.0, 0.0), (0.0, -1.0))
    answer = two_turns(turn, back, (0.0, 0.0))
    assert answer.exact and answer.free == (0, 1)
    assert answer.angles[0][0] == pytest.approx(answer.angles[0][1], abs=1e-9)
    # circles that touch: a double root
    answer = two_turns(turn, back, (2.0, 0.0))
    assert answer.exact and len(answer.angles) == 1
    assert has(answer, 0.0, math.pi)


@pytest.mark.parametrize("off", [1e-12, 1e-9, 1e-6, 1e-3])
def test_two_turns_that_nearly_split_lose_no_pair(off: float) -> None:
    rng = np.random.default_rng(7)
    for _ in range(TIMES // 2):
        a, c, d = rng.normal(size=(3, 2))
        A = np.array([a, off * rng.normal(size=2)])
        B = np.array([off * c, d])
        x, y = rng.uniform(-3, 3, 2)
        value = A @ [math.cos(x), math.sin(x)] + B @ [math.cos(y), math.sin(y)]
        answer = two_turns(A.tolist(), B.tolist(), tuple(value.tolist()))
        assert answer.exact and has(answer, x, y)
        if (
            off < 1e-4
            and min(abs(math.sin(x - math.atan2(a[1], a[0]))), abs(math.sin(y - math.atan2(d[1], d[0]))))
            > 0.1
        ):
            assert len(answer.angles) == 4

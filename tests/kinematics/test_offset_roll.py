"""Roll joints with the tool beside their axis: random arms, and two that people own."""

from __future__ import annotations

import math
import os
from collections.abc import Callable

import numpy as np
import pytest
from tests.kinematics.kit import FloatArray, solver_of

from armctl import load_robot
from armctl.kinematics import Chain, InverseKinematics, Solutions, Target

LONG = bool(os.environ.get("ARMCTL_LONG"))
ARMS = 300 if LONG else 20
STEP = math.radians(2.0)
FAMILY = "yaw, parallel pitch joints, roll beside the tool"


def shift(x: float, y: float, z: float) -> FloatArray:
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def looking(z: FloatArray, spin: float) -> FloatArray:
    """(4, 4) a frame with its z axis along a vector, turned about it by ``spin``."""
    z = z / np.linalg.norm(z)
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    y = np.cross(z, x)
    T = np.eye(4)
    c, s = math.cos(spin), math.sin(spin)
    T[:3, :3] = np.column_stack([c * x + s * y, c * y - s * x, z])
    return T


def random_arm(rng: np.random.Generator, pitches: int) -> tuple[Chain, FloatArray]:
    """Base, links, senses, offsets, tool and limits at random; one joint of some may turn twice."""

    def sense() -> float:
        return float(rng.choice([-1, 1]))

    def step(length: float) -> FloatArray:
        angle = rng.uniform(-math.pi, math.pi)
        aside = float(rng.choice([0.0, rng.uniform(-0.05, 0.05)]))
        return shift(length * math.cos(angle), aside, length * math.sin(angle))

    base = (
        looking(rng.normal(size=3), 1.0) @ shift(*rng.uniform(-0.3, 0.3, 3))
        if rng.random() < 0.4
        else np.eye(4)
    )
    origins = [base, shift(rng.choice([0.0, 0.05]), 0.0, rng.uniform(-0.1, 0.3))]
    origins += [step(rng.uniform(0.05, 0.3)) for _ in range(pitches - 1)] + [step(rng.uniform(0.0, 0.1))]
    lean = rng.uniform(-math.pi, math.pi)
    roll = np.array([math.cos(lean), 0.0, math.sin(lean)])
    axes = [np.array([0.0, 0.0, sense()]), *(np.array([0.0, sense(), 0.0]) for _ in range(pitches)), roll]
    beside = np.cross(roll, [0.0, 1.0, 0.0]) * rng.uniform(0.005, 0.03) + [0.0, rng.uniform(-0.03, 0.03), 0.0]
    tip = roll * rng.uniform(0.06, 0.2) + beside
    n = pitches + 2
    low = -rng.uniform(20, 190, n)
    high = np.minimum(rng.uniform(20, 190, n), low + 350)
    if rng.random() < 0.1:
        k = rng.integers(n)
        low[k], high[k] = -400.0, 400.0
    tool = shift(*tip) @ looking(sense() * roll, rng.uniform(-3.0, 3.0))
    return Chain.from_joints(origins, axes, tool), np.radians(np.stack([low, high], axis=1))


def random_q(rng: np.random.Generator, limits: FloatArray) -> FloatArray:
    """Inside the limits, on one of them in one case of three, the joints that are swept on the grid."""
    q = rng.uniform(*limits.T)
    if rng.random() < 0.3:
        joint = rng.integers(len(q))
        q[joint] = limits[joint, rng.integers(2)]
    for joint in (1, len(q) - 1):
        first, last = math.ceil(limits[joint, 0] / STEP), math.floor(limits[joint, 1] / STEP)
        q[joint] = STEP * np.clip(round(q[joint] / STEP), first, last)
    return q


def assert_sound(found: Solutions, limits: FloatArray, q: FloatArray | None) -> None:
    """On the target, inside the limits, each once, and the generating configuration among them."""
    assert found.success, found.reason
    assert found.residual_m.max() < 1e-9
    assert found.residual_rad.max() < 1e-9
    assert ((found.q >= limits[:, 0]) & (found.q <= limits[:, 1])).all()
    some = found.q[:300]
    assert (np.abs(some[:, None] - some).max(axis=2) + np.eye(len(some))).min() > 1e-8
    if q is not None:
        assert np.abs(found.q - q).max(axis=1).min() < 1e-7


@pytest.mark.parametrize("pitches", [2, 3])
def test_every_configuration_of_random_arms_is_listed(pitches: int) -> None:
    rng = np.random.default_rng(7)
    for _ in range(ARMS):
        chain, limits = random_arm(rng, pitches)
        ik = solver_of(chain, limits)
        assert ik.family == FAMILY
        q = random_q(rng, limits)
        T = chain.forward(q)
        point, (pitch, roll) = T[:3, 3], ik.pitch_and_roll(q)
        assert roll == q[-1]
        isolated = ik.solve(Target.of(point, pitch, roll), STEP)
        assert_sound(isolated, limits, q)
        assert isolated.free_joint is None
        for one in isolated.q:
            turned, rolled = ik.pitch_and_roll(one)
            assert turned == pytest.approx(pitch, abs=1e-6 if pitches == 2 else 1e-9)
            assert rolled is not None
            assert math.remainder(rolled - roll, math.tau) == pytest.approx(0.0, abs=1e-12)
        assert_sound(ik.solve(Target.of(point, roll=roll), STEP), limits, q)
        assert_sound(ik.solve(Target.of(point, pitch), STEP), limits, q)
        assert_sound(ik.solve(Target.of(point, rotation=T[:3, :3]), STEP), limits, q)
        alone = ik.solve(Target.of(point), STEP)
        assert_sound(alone, limits, q if pitches == 2 else None)
        assert alone.complete == (pitches == 2)


def plain_least(ik: InverseKinematics, target: Target, cost: FloatArray, start: FloatArray) -> float:
    """Least Σ cost · |θ - start| of lists with an ever finer grid of the roll, solved one roll at a time."""
    low, high = ik.limits[-1].tolist()
    best, centre, reach = math.inf, 0.5 * (low + high), 0.5 * (high - low)
    for count in (181, 41, 41):
        for roll in np.clip(np.linspace(centre - reach, centre + reach, count), low, high).tolist():
            found = ik.solve(target._replace(roll=roll), math.radians(0.05))
            if found.success:
                least = float((np.abs(found.q - start) @ cost).min())
                if least < best:
                    best, centre = least, roll
        reach *= 2.5 / count
    return best


def test_the_least_of_a_swept_roll_is_never_beaten() -> None:
    rng = np.random.default_rng(17)
    for i in range(12 if LONG else 3):
        chain, limits = random_arm(rng, 2 + i % 2)
        ik = solver_of(chain, limits)
        q, start = random_q(rng, limits), rng.uniform(*limits.T)
        pitch = ik.pitch_and_roll(q)[0] if i % 2 else None
        target = Target.of(chain.forward(q)[:3, 3], pitch)
        found = ik.solve(target, STEP)
        least, ones = found.best("least-rotation"), np.ones(chain.n)
        travel = found.best("least-travel", start)
        for best, begin in ((least, np.zeros(chain.n)), (travel, start)):
            brute = plain_least(ik, target, ones, begin)
            assert np.abs(best - begin).sum() <= brute + 1e-9
            assert np.linalg.norm(chain.forward(best)[:3, 3] - target.position) < 1e-9
            if pitch is not None:
                assert ik.pitch_and_roll(best)[0] == pytest.approx(pitch, abs=1e-9)
        assert found.best("least-travel", q) == pytest.approx(q, abs=1e-7)


def test_position_alone_leaves_roll_and_pitch_free() -> None:
    chain, limits = so101()
    ik = solver_of(chain, limits, ("Pan", "Lift", "Elbow", "Wrist", "Roll"))
    rng = np.random.default_rng(4)
    for _ in range(12 if LONG else 3):
        q = rng.uniform(*limits.T)
        target = Target.of(chain.forward(q)[:3, 3])
        found = ik.solve(target, STEP)
        assert found.incomplete_reason is not None
        assert "Roll is free, too: listed is what there is with it at" in found.incomplete_reason
        assert found.best("least-travel", q) == pytest.approx(q, abs=1e-7)
        start = rng.uniform(*limits.T)
        brute = min(
            float(np.abs(one.q - start).sum(axis=1).min())
            for roll in np.linspace(*limits[-1], 91).tolist()
            if (one := ik.solve(target._replace(roll=roll), math.radians(0.2))).success
        )
        best = found.best("least-travel", start)
        assert np.abs(best - start).sum() <= brute + 1e-6
        assert np.linalg.norm(chain.forward(best)[:3, 3] - target.position) < 1e-9


# SO-101 with its official tool frame: joint origins of so101_new_calib.urdf (TheRobotStudio/SO-ARM100) with
# quarter turns taken as exact, and the gripper frame of the current file: its z axis is along the roll axis.


def so101() -> tuple[Chain, FloatArray]:
    half = 0.5 * math.pi

    def frame(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> FloatArray:
        turns = np.eye(3)
        for axis, angle in ((2, yaw), (1, pitch), (0, roll)):
            c, s = round(math.cos(angle), 12), round(math.sin(angle), 12)
            one = np.eye(3)
            i, j = [(1, 2), (2, 0), (0, 1)][axis]
            one[i, i], one[i, j], one[j, i], one[j, j] = c, -s, s, c
            turns = turns @ one
        T = shift(x, y, z)
        T[:3, :3] = turns
        return T

    origins = [
        frame(0.0388353, 0.0, 0.0624, math.pi, 0.0, -math.pi),
        frame(-0.0303992, -0.0182778, -0.0542, -half, -half, 0.0),
        frame(-0.11257, -0.028, 0.0, 0.0, 0.0, half),
        frame(-0.1349, 0.0052, 0.0, 0.0, 0.0, -half),
        frame(0.0, -0.0611, 0.0181, half, 0.0, math.pi),
    ]
    limits = [
        (-1.91986, 1.91986),
        (-1.74533, 1.74533),
        (-1.69, 1.69),
        (-1.65806, 1.65806),
        (-2.74385, 2.84121),
    ]
    tool = frame(-0.0079, -0.000218121, -0.0981274, 0.0, math.pi, 0.0)
    return Chain.from_joints(origins, [np.array([0.0, 0.0, 1.0])] * 5, tool), np.array(limits)


def omx() -> tuple[Chain, FloatArray]:
    """The build of ROBOTIS OMX-F: the finger tips 16 mm beside the roll axis, joints of two turns."""
    y, z, x = np.eye(3)[1], np.eye(3)[2], np.eye(3)[0]
    origins = [shift(-0.01, 0, 0.034), shift(0, 0, 0.0635), shift(0.0415, 0, 0.11315), shift(0.162, 0, 0)]
    origins.append(shift(0.0287, 0, 0))
    chain = Chain.from_joints(origins, [z, y, y, y, x], shift(0.09193, -0.0016, 0.016) @ looking(x, 0.0))
    return chain, np.array([[-math.tau, math.tau]] * 5)


@pytest.mark.parametrize(("arm", "count"), [(so101, 1000), (omx, 60)])
def test_poses_of_arms_that_people_own(arm: Callable[[], tuple[Chain, FloatArray]], count: int) -> None:
    chain, limits = arm()
    ik = solver_of(chain, limits)
    assert ik.family == FAMILY
    rng = np.random.default_rng(1)
    for i in range(100 * count if LONG else count):
        q = random_q(rng, limits) if i % 2 else rng.uniform(*limits.T)
        T = chain.forward(q)
        target = Target.of(T[:3, 3], *ik.pitch_and_roll(q))
        if i % 5 == 0:
            target = Target.of(T[:3, 3], rotation=T[:3, :3])
        found = ik.solve(target, STEP)
        assert found.residual_m.max() < 1e-9
        assert found.residual_rad.max() < 1e-9
        assert np.abs(found.q - q).max(axis=1).min() < 1e-7
        if i % 100 == 0:
            assert_sound(found, limits, q)


def test_a_refusal_names_the_roll_and_the_nearest_point_is_not_beaten() -> None:
    chain, limits = so101()
    ik = solver_of(chain, limits, ("Pan", "Lift", "Elbow", "Wrist", "Roll"))
    rng = np.random.default_rng(3)
    tips = chain.forward(rng.uniform(*limits.T, (100_000, 5)))[:, :3, 3]
    for point in ([0.6, 0.1, 0.2], [-0.5, 0.0, 0.1], [0.0, 0.1, 0.7]):
        found = ik.solve(Target.of(point), STEP)
        assert not found.success
        assert found.nearest_q is not None and found.nearest_m is not None and found.reason is not None
        roll = f"{math.degrees(found.nearest_q[-1]) + 0.0:.2f}°"
        assert found.reason.startswith(f"with Roll at {roll}, where it comes nearest: ")
        away = np.linalg.norm(found.nearest_m - point)
        assert away <= np.linalg.norm(tips - point, axis=1).min() + 1e-9
    beyond = ik.solve(Target.of([0.25, 0.0, 0.1], roll=math.radians(175)), STEP)
    assert beyond.reason == "Roll needs 175.00°, its limits are -157.21° … 162.79°"


def test_orientations_upright_askew_and_out_of_reach() -> None:
    chain, limits = so101()
    ik = solver_of(chain, limits)
    q = np.radians([20.0, -10.0, 30.0, 0.0, 40.0])
    q[3] = np.radians(-90.0) - (ik.pitch_and_roll(q)[0] or 0.0)
    rises: list[float] = []
    for wrist in (q[3], -q[3]):  # one of them points straight down or up
        q[3] = wrist
        T = chain.forward(q)
        rises.append(abs(T[2, 2]))
        assert_sound(ik.solve(Target.of(T[:3, 3], rotation=T[:3, :3]), STEP), limits, q)
    assert max(rises) > 1.0 - 1e-12
    askew = T[:3, :3] @ looking(np.array([0.1, 0.2, 1.0]), 0.3)[:3, :3]
    near = ik.solve(Target.of(T[:3, 3], rotation=askew), STEP)
    assert near.residual_m.max() < 1e-9 < 0.01 < near.residual_rad.max()
    assert near.incomplete_reason is not None and near.incomplete_reason.startswith("found by search")
    assert not ik.solve(Target.of([0.9, 0.0, 0.2], rotation=askew), STEP).success
    across = Chain(chain.segments, chain.tail @ looking(np.array([1.0, 0.0, 0.0]), 0.0))
    aside = solver_of(across, limits)
    assert aside.family == FAMILY
    assert aside.pitch_and_roll(q) == (None, q[-1])
    refused = aside.solve(Target.of(T[:3, 3], pitch=0.1), STEP)
    assert (
        refused.reason == "this arm's tool does not keep to its vertical plane, so it has no pitch to ask for"
    )
    turned = across.forward(q)
    assert_sound(aside.solve(Target.of(turned[:3, 3], rotation=turned[:3, :3]), STEP), limits, q)


def test_the_nearest_point_beside_the_base_axis_is_looked_for_on_all_sides() -> None:
    target = np.array([-0.02825689655399012, 0.00929019523411901, 0.7426287834309142])
    found = load_robot("so101").inverse(target)
    assert found.nearest_m is not None
    assert np.linalg.norm(found.nearest_m - target) < 0.2221  # leaning to the other side: 0.22325

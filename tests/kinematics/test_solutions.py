"""Answers are values: pickled, copied and compared, whatever family gave them."""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable

import numpy as np
import pytest
from tests.arms import BENCH_URDF
from tests.kinematics.six_joints import GENERAL, solver_of
from tests.robot.panda_kit import panda

from armctl.arrays import FloatArray
from armctl.kinematics import InverseKinematics, Solutions, Target
from armctl.kinematics.families.registry import FAMILIES, Branch
from armctl.kinematics.solutions import BatchSolutions
from armctl.kinematics.velocity import Freedom, position_freedom
from armctl.robot import load_robot

STEP = np.radians(2.0)
SHIPPED = ("uzuner", "mico", "so101", "humanoid", "uarm", "ar4", "ur5")
CASES = (
    *(("uzuner", kind) for kind in ("position", "pitch", "rotation")),
    *((name, "position") for name in ("mico", "so101", "humanoid", "uarm", "bench")),
    *((name, "rotation") for name in ("so101", "humanoid", "ar4", "ur5", "panda", "general")),
)
COPIED: tuple[Callable[[Solutions], Solutions], ...] = (
    lambda one: pickle.loads(pickle.dumps(one)),
    copy.copy,
    copy.deepcopy,
)


@pytest.fixture(scope="module")
def solvers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, InverseKinematics]:
    """One solver of each family at least."""
    bench = tmp_path_factory.mktemp("bench") / "bench.urdf"
    bench.write_text(BENCH_URDF, encoding="utf-8")
    found = {name: load_robot(name).inverse_kinematics for name in SHIPPED}
    found["bench"] = load_robot(bench).inverse_kinematics
    found["panda"] = panda().inverse_kinematics
    found["general"] = solver_of(next(iter(GENERAL.values())), None)
    assert {type(one) for one in found.values()} == set(FAMILIES)
    return found


def solved(solver: InverseKinematics, share: FloatArray, kind: str, far: float) -> Solutions:
    """An answer to the tool pose at a share of each joint's range, or ``far`` times as far away."""
    q = solver.limits[:, 0] + share * np.ptp(solver.limits, axis=1)
    T = solver.chain.forward(q)
    pitch, roll = solver.pitch_and_roll(q)
    point = far * T[:3, 3]
    match kind:
        case "rotation" if type(solver).family != "yaw, two pitch joints, level hand":
            target = Target.of(point, rotation=T[:3, :3])
        case "pitch":
            target = Target.of(point, pitch, roll)
        case _:
            target = Target.of(point)
    return solver.solve(target, STEP, q)


def read_only(solutions: Solutions) -> bool:
    """Whether nobody can write into the arrays of an answer."""
    arm = solutions.arm
    arrays = [solutions.q, solutions.branch_index, solutions.nearest_q, solutions.target.rotation, arm.limits]
    arrays += [*arm.chain.segments, arm.energy.speed_limits]
    return not any(array.flags.writeable for array in arrays if array is not None)


@pytest.mark.parametrize(("name", "kind"), CASES)
def test_an_answer_is_pickled_copied_and_compared(
    name: str, kind: str, solvers: dict[str, InverseKinematics]
) -> None:
    solver, rng = solvers[name], np.random.default_rng(3)
    for far in (1.0, 30.0):
        share = rng.uniform(0.1, 0.9, solver.chain.n)
        answer = solved(solver, share, kind, far)
        for copied in COPIED:
            other = copied(answer)
            assert other == answer
            assert hash(other) == hash(answer)
            assert len({other, answer}) == 1
            assert copied is copy.copy or read_only(other)  # that one shares what it was given
            assert repr(other) == repr(answer)
            assert other.reason == answer.reason
        # whoever asks again gets the same answer
        assert solved(solver, share, kind, far) == answer
        assert solved(solver, share, kind, 0.97 * far) != answer
        if answer.success:
            fewer = Solutions(answer.arm, answer.target, answer.q[:-1], answer.branch_index[:-1])
            assert fewer != answer


@pytest.mark.parametrize("name", [*SHIPPED, "panda"])
def test_a_pickled_answer_chooses_the_same(name: str, solvers: dict[str, InverseKinematics]) -> None:
    """The exact optimum is no row of the list, so a pickle has to bring along how it is found."""
    solver, rng = solvers[name], np.random.default_rng(4)
    start, share = solver.limits.mean(axis=1), rng.uniform(0.3, 0.7, solver.chain.n)
    answer = solved(solver, share, "rotation" if name == "panda" else "position", 1.0)
    other = pickle.loads(pickle.dumps(answer))
    for criterion in ("least-rotation", "least-travel", "shortest-time"):
        assert np.array_equal(other.best(criterion, start), answer.best(criterion, start))


def test_answers_say_in_a_line_what_they_are() -> None:
    robot = load_robot("uzuner")
    assert repr(robot) == "Robot('uzuner', 5 joints)"
    swept = robot.inverse((0.2, 0.1, 0.1))
    assert repr(swept) == f"Solutions({len(swept)} configurations, Shoulder swept)"
    assert repr(robot.inverse((2.0, 0.0, 0.0))).startswith("Solutions(too far by ")
    batch = robot.inverse_batch([[0.2, 0.0, 0.1], [2.0, 0.0, 0.0]], pitch=0.0)
    assert repr(batch) == f"BatchSolutions({batch.count[0]} configurations of 2 poses, 8 branches)"
    for value in (robot.chain, robot.inverse_kinematics):
        assert "object at" not in repr(value)


def test_batches_branches_and_what_else_holds_arrays_compare_by_them() -> None:
    robot = load_robot("ur5")
    rotations = np.stack([np.eye(3)] * 2)
    points = [[0.3, 0.2, 0.3], [0.3, 0.1, 0.3]]
    q = robot.limits.mean(axis=1)

    def values() -> list[BatchSolutions | Branch | Freedom]:
        batch = robot.inverse_batch(points, rotation=rotations)
        return [batch, *robot.branches(points[0], rotation=np.eye(3)), position_freedom(robot.jacobian(q))]

    for one, again in zip(values(), values(), strict=True):
        assert one == again
        assert hash(one) == hash(again)
        assert pickle.loads(pickle.dumps(one)) == one
    moved: FloatArray = np.array(points) + 0.001
    assert robot.inverse_batch(moved, rotation=rotations) != values()[0]

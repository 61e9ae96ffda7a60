"""Numbers of another unit, poses and quaternions: what ``inverse`` takes, and what it asks about."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError
from armctl.kinematics import Target, quaternion_wxyz, rotation_of
from armctl.robot import Robot, load_robot, shipped_robots

ASKS = "a wrong unit?"


def reached(robot: Robot, seed: int) -> tuple[FloatArray, FloatArray]:
    """A configuration with its tool away from the base, and the pose of this tool."""
    rng = np.random.default_rng(seed)
    while True:
        q = rng.uniform(*robot.limits.T)
        T = robot.forward(q)
        if np.linalg.norm(T[:3, 3]) > 0.3 * robot.chain.length:
            return q, T


@pytest.mark.parametrize("name", shipped_robots())
def test_millimetres_for_metres_and_the_reverse_are_asked_about(name: str) -> None:
    robot = load_robot(name)
    point = reached(robot, 5)[1][:3, 3]
    far, near = robot.inverse(1000.0 * point), robot.inverse(1e-3 * point)
    assert not far.success
    # where the tool comes into the base frame itself, nothing is wrong with a point there
    for answer in (far, near) if not near.success else (far,):
        assert answer.explanation.count(ASKS) == 1
        assert (answer.reason or "").count(ASKS) == 1
    turned = robot.inverse(1000.0 * point, rotation=np.eye(3))
    assert turned.explanation.count(ASKS) == 1


@pytest.mark.parametrize("times", [1.1, 2.0, 5.0, 15.0])
def test_a_point_that_is_only_too_far_is_not_doubted(times: float) -> None:
    for robot in map(load_robot, ("uzuner", "ur5", "so101")):
        answer = robot.inverse([times * robot.chain.length, 0.0, 0.0])
        assert not answer.success
        assert ASKS not in answer.explanation
    assert ASKS not in load_robot("uzuner").inverse([0.0, 0.0, 0.0]).explanation


def test_degrees_for_radians_are_asked_about() -> None:
    robot = load_robot("uzuner")
    with pytest.raises(InputError, match=r"got -90 rad, which is -5156.62°; a wrong unit\?"):
        robot.inverse([0.2, 0.0, 0.1], pitch=-90)
    assert ASKS in robot.inverse([0.2, 0.0, 0.1], roll=90).explanation
    with pytest.raises(InputError, match=r"roll, pitch and yaw .* got 180 rad.*a wrong unit\?"):
        rotation_of(rpy=(180, 0, 90))
    with pytest.raises(MotionRefusedError, match=r"5156.62° is outside .*a wrong unit\?"):
        robot.check_limits([10.0, 90.0, -80.0, -40.0, 0.0])
    # a joint a turn too far is no other unit, whoever asks for it
    with pytest.raises(MotionRefusedError, match=r"400.00° is outside [^?]*$"):
        robot.check_limits(np.radians([10.0, 400.0, -80.0, -40.0, 0.0]))
    with pytest.raises(InputError, match=r"which is 400°$"):
        robot.inverse([0.2, 0.0, 0.1], pitch=math.radians(400.0))


@pytest.mark.parametrize("name", ["ur5", "ar4", "uzuner", "so101"])
def test_a_pose_a_rotation_and_a_quaternion_are_the_same_target(name: str) -> None:
    robot = load_robot(name)
    T = reached(robot, 6)[1]
    point, rotation = T[:3, 3], T[:3, :3]
    wanted = robot.inverse(point, rotation=rotation)
    assert robot.inverse(T) == wanted
    assert robot.inverse(T.tolist()) == wanted
    for length in (1.0, -2.5):
        turned = robot.inverse(point, quaternion_wxyz=length * quaternion_wxyz(rotation))
        np.testing.assert_allclose(turned.best(), wanted.best(), atol=1e-9)
    assert len(robot.branches(T)) == len(robot.branches(point, rotation=rotation))


def test_what_leaves_open_which_pose_is_meant_is_refused() -> None:
    T = load_robot("ur5").forward([0.1, -1.0, 1.0, -1.0, -1.0, 0.3])
    point, rotation, quaternion = T[:3, 3], T[:3, :3], quaternion_wxyz(T[:3, :3])
    for arguments, says in (
        ({"rotation": rotation}, "leave pitch, roll, rotation and quaternion out"),
        ({"quaternion_wxyz": quaternion}, "leave pitch, roll, rotation and quaternion out"),
        ({"pitch": 0.0}, "leave pitch, roll, rotation and quaternion out"),
    ):
        with pytest.raises(InputError, match=says):
            Target.of(T, **arguments)
    with pytest.raises(InputError, match="quaternion_wxyz, with w first"):
        Target.of(point, rotation=quaternion)
    with pytest.raises(InputError, match="give the transpose"):
        Target.of(T.T)
    with pytest.raises(InputError, match="the last row of a pose"):
        Target.of(np.ones((4, 4)))
    with pytest.raises(InputError, match="right-handed"):
        Target.of(np.diag([1.0, 1.0, -1.0, 1.0]))
    with pytest.raises(InputError, match="not as both"):
        Target.of(point, rotation=rotation, quaternion_wxyz=quaternion)
    with pytest.raises(InputError, match="not both"):
        Target.of(point, 0.1, quaternion_wxyz=quaternion)
    with pytest.raises(InputError, match=r"shape \(4,\)"):
        Target.of(point, quaternion_wxyz=[1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="must be finite"):
        Target.of(np.vstack([np.full((3, 4), math.nan), T[3]]))

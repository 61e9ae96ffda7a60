"""Arms that orient their tool: jog and live target keep its orientation, and jog turns it about any axis."""

from __future__ import annotations

import numpy as np
import pytest
from tests.robot.panda_kit import panda
from tests.runtime.kit import TICK, Rig, assert_accelerations_keep_limits, make_rig
from tests.runtime.test_jog import deviation, hold, tools

from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.kinematics.angles import rotation_angle
from armctl.kinematics.families.numeric.descent import rotation_vectors
from armctl.protocol import FollowTarget, JogTool
from armctl.robot import Robot, load_robot

ARMS = {"six": load_robot("ur5"), "seven": panda()}


@pytest.fixture(params=ARMS)
def rig(request: pytest.FixtureRequest) -> Rig:
    robot: Robot = ARMS[request.param]
    return make_rig(robot=robot).enable(robot.pose("home"))


def test_the_orientation_stays_on_a_line(rig: Rig) -> None:
    start = rig.robot.forward(rig.now.q_command)
    hold(rig, JogTool(np.array([0.0, 0.05, 0.0])), 1.5)
    rig.run(0.4)
    poses = tools(rig)
    assert poses[-1, 1, 3] - start[1, 3] > 0.05
    assert deviation(poses[:, :3, 3], start[:3, 3], np.array([0.0, 1.0, 0.0])) < 1e-4
    assert rotation_angle(np.swapaxes(poses[:, :3, :3], 1, 2) @ start[:3, :3]).max() < 1e-4
    assert_accelerations_keep_limits(rig)


@pytest.mark.parametrize("frame", ["base", "tool"])
@pytest.mark.parametrize("axis", range(3))
def test_it_turns_about_an_axis_in_its_place(rig: Rig, frame: str, axis: int) -> None:
    start = rig.robot.forward(rig.now.q_command)
    rate = np.radians(20) * np.eye(3)[axis]
    hold(rig, JogTool(np.zeros(3), frame="tool" if frame == "tool" else "base", angular=rate), 1.0)
    rig.run(0.4)
    poses = tools(rig)
    assert np.linalg.norm(poses[:, :3, 3] - start[:3, 3], axis=1).max() < 1e-4
    about = start[:3, axis] if frame == "tool" else np.eye(3)[axis]
    turned = rotation_vectors(poses[:, :3, :3] @ start[:3, :3].T)
    assert np.degrees(turned[-1] @ about) > 10
    assert np.abs(turned - (turned @ about)[:, None] * about).max() < 1e-3
    assert_accelerations_keep_limits(rig)


def test_pitch_and_roll_turn_it_too(rig: Rig) -> None:
    start = rig.robot.forward(rig.now.q_command)
    hold(rig, JogTool(np.zeros(3), roll_rate=np.radians(20)), 0.8)
    rig.run(0.4)
    end = rig.robot.forward(rig.now.q_command)
    assert end[:3, 2] == pytest.approx(start[:3, 2], abs=1e-3)
    assert np.degrees(rotation_angle(end[:3, :3].T @ start[:3, :3])) > 8


def test_an_arm_that_cannot_turn_so_says_it() -> None:
    robot = load_robot("uzuner")
    rig = make_rig(robot=robot).enable(robot.pose("home"))
    spin = JogTool(np.zeros(3), angular=np.array([0.1, 0.0, 0.0]))
    rig.refuses(spin, "uzuner cannot turn about any axis", InputError)
    rig.do(JogTool(np.array([0.01, 0.0, 0.0]), angular=np.zeros(3))).accepted.result(0)
    for wrong in (np.array([0.1, 0.0]), np.array([0.1, np.nan, 0.0])):
        with pytest.raises(InputError, match="three axes"):
            rig.do(JogTool(np.zeros(3), angular=wrong)).accepted.result(0)


def test_a_live_target_is_followed_without_turning_the_tool(rig: Rig) -> None:
    start = rig.robot.forward(rig.now.q_command)
    goal = start[:3, 3] + np.array([-0.02, 0.05, 0.03])
    for _ in range(round(2.0 / TICK)):
        rig.do(FollowTarget(Target.of(goal))).accepted.result(0)
    end = rig.robot.forward(rig.now.q_command)
    assert end[:3, 3] == pytest.approx(goal, abs=1e-6)
    assert rotation_angle(end[:3, :3].T @ start[:3, :3]) < 1e-6
    assert rig.now.warnings == ()
    assert_accelerations_keep_limits(rig)


def test_where_the_orientation_cannot_be_kept_it_is_said() -> None:
    robot = ARMS["six"]
    rig = make_rig(robot=robot).enable(robot.pose("home"))
    start = robot.forward(rig.now.q_command)
    out = start[:2, 3] / np.linalg.norm(start[:2, 3])
    goal = np.array([*0.8 * out, 0.45])  # within the links' reach, but not with the tool pointing so
    said: set[str] = set()
    for _ in range(round(0.4 / TICK)):
        rig.do(FollowTarget(Target.of(goal))).accepted.result(0)
        said |= set(rig.now.warnings)
    assert said == {"live target: the tool cannot keep its orientation there"}

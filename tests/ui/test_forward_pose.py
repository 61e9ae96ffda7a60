"""The pose fields of the Forward screen, and the joint angles that follow them."""

from __future__ import annotations

import numpy as np
import pytest

from armctl.errors import InputError
from armctl.kinematics import Target
from armctl.robot import Robot, load_robot, shipped_robots
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.forward.coupling import AngleFields, PoseFields, coupled_joints, limits_text

ROBOTS = tuple(load_robot(name) for name in shipped_robots())
UZUNER, MICO, HUMANOID = (load_robot(name) for name in ("uzuner", "mico", "humanoid"))


def fields(server: GuardedServer, robot: Robot) -> PoseFields:
    return PoseFields(server.gui, robot, robot.pose("home"))


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_the_fields_show_the_tool_pose_and_ask_for_it(server: GuardedServer, robot: Robot) -> None:
    home = robot.pose("home")
    pose = fields(server, robot)
    tip = 1000 * robot.forward(home)[:3, 3]
    assert [float(field.text) for field in pose.xyz] == pytest.approx(tip, abs=1e-3)
    found = coupled_joints(robot, pose.target(pose.xyz[0]), home)
    assert found.q is not None and found.why_not == ""
    np.testing.assert_allclose(robot.forward(found.q)[:3, 3], tip / 1000, atol=1e-9)
    np.testing.assert_allclose(found.q, home, atol=1e-6)


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_a_small_step_of_the_tool_is_a_small_step_of_the_joints(robot: Robot) -> None:
    """Of all solutions the nearest is taken: no joint jumps to another branch."""
    solver, q = robot.inverse_kinematics, robot.pose("home")
    pitch, roll = solver.pitch_and_roll(q)
    asked = None if robot.name in ("mico", "humanoid") else pitch
    for _ in range(10):
        point = robot.forward(q)[:3, 3] + [0.0, 0.002, 0.001]
        found = coupled_joints(robot, Target.of(point, asked, roll), q)
        assert found.q is not None
        assert np.abs(found.q - q).max() < np.radians(4)
        np.testing.assert_allclose(robot.forward(found.q)[:3, 3], point, atol=1e-9)
        q = found.q


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_the_pose_that_is_shown_comes_back_whether_the_pitch_is_held_or_not(robot: Robot) -> None:
    rng = np.random.default_rng(3)
    for q in rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (20, robot.n)):
        _, roll = robot.inverse_kinematics.pitch_and_roll(q)
        found = coupled_joints(robot, Target.of(robot.forward(q)[:3, 3], None, roll), q)
        assert found.q is not None
        np.testing.assert_allclose(found.q, q, atol=1e-6)


def test_which_fields_there_are(server: GuardedServer) -> None:
    assert [field.label for field in fields(server, UZUNER).fields] == [
        "X mm", "Y mm", "Z mm", "Pitch °", "Roll °",
    ]  # fmt: skip
    mico = fields(server, MICO)  # two pitch joints: the position decides the pitch
    assert [field.label for field in mico.fields] == ["X mm", "Y mm", "Z mm", "Roll °"]
    assert mico.target(mico.xyz[0]).pitch is None
    assert mico.pitch.visible and mico.pitch.handle.disabled and not mico.hold.visible
    mico.fill_pitch(np.zeros(4))  # the tool hangs straight down
    assert mico.pitch.value == pytest.approx(-90.0)
    humanoid = fields(server, HUMANOID)  # its wrist roll is held
    assert [field.label for field in humanoid.fields] == ["X mm", "Y mm", "Z mm", "Pitch °"]
    assert humanoid.target(humanoid.xyz[0]).roll is None


def test_the_pitch_is_asked_for_while_it_is_held_or_typed(server: GuardedServer) -> None:
    pose = fields(server, HUMANOID)
    assert not pose.hold.value
    assert pose.target(pose.xyz[0]).pitch is None
    assert pose.target(pose.pitch).pitch is not None
    pose.hold.value = True
    assert pose.target(pose.xyz[0]).pitch is not None
    assert fields(server, UZUNER).hold.value


def test_a_pose_out_of_reach_says_why_and_what_is_nearest() -> None:
    found = coupled_joints(UZUNER, Target.of([0.3, 0.0, 0.6], -0.5, 0.0), UZUNER.pose("home"))
    assert found.q is None and found.nearest_q is not None
    assert "too far by" in found.why_not and "nearest reachable point is (" in found.why_not
    UZUNER.check_limits(found.nearest_q)


def test_a_half_typed_pose_asks_for_nothing(server: GuardedServer) -> None:
    pose = fields(server, UZUNER)
    pose.xyz[1].handle.value = "-"
    with pytest.raises(InputError, match="Y mm: '-' is not a number"):
        pose.target(pose.xyz[1])


def test_a_joint_that_is_held_cannot_be_typed(server: GuardedServer) -> None:
    angles = AngleFields(server.gui, HUMANOID, HUMANOID.pose("home"))
    assert [field.handle.disabled for field in angles.fields] == [False, False, False, False, True]
    assert limits_text(HUMANOID, 4) == "Wrist roll: held at 0°"

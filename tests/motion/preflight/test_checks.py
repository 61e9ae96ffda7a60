"""Self-collision, obstacles, singularity and torque: each can fail and can pass."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from armctl.arrays import FloatArray
from armctl.errors import InputError, MotionRefusedError
from armctl.motion import JoinedTrajectory, arc, line
from armctl.motion.preflight import Finding, not_checked, preflight, require_clear
from armctl.motion.profiles import PointToPoint
from armctl.robot import Robot, load_robot, shipped_robots
from armctl.robot.parts import Obstacle

UZUNER, SCORBOT, MICO = load_robot("uzuner"), load_robot("scorbot"), load_robot("mico")
HOME = UZUNER.pose("home")


def of_kind(kind: str, robot: Robot, *poses_deg: tuple[float, ...], **more: object) -> list[Finding]:
    """Findings of one kind on the way from pose to pose."""
    poses = np.radians(poses_deg)
    parts = [PointToPoint.plan(robot, a, b) for a, b in pairwise(poses)]
    found = preflight(robot, JoinedTrajectory(parts), **more)  # type: ignore[arg-type]
    return [finding for finding in found if finding.kind == kind]


# --- self-collision


def test_folding_into_the_base_is_refused_with_both_parts_named() -> None:
    (finding,) = of_kind("self-collision", SCORBOT, (0, -60, 95, -80, 0), (0, 30, 130, -30, 0))
    assert finding.severity == "error"
    assert finding.part in ("the gripper", "the link behind elbow")
    assert "mm inside the base" in finding.what and "the base" in finding.mend
    assert 0 < finding.time


def test_a_touch_in_passing_is_found_though_both_ends_are_clear() -> None:
    folded = (0, 33, 108, -12, 0)
    assert of_kind("self-collision", SCORBOT, (0, -60, 95, -80, 0), folded, (0, -60, 95, -80, 0))


def test_an_arm_that_touches_may_come_free_but_not_go_deeper() -> None:
    inside, deeper, free = (0, 30, 115, -12, 0), (0, 33, 120, -12, 0), (0, -60, 95, -80, 0)
    assert of_kind("self-collision", SCORBOT, free, inside)
    assert of_kind("self-collision", SCORBOT, inside, free) == []
    assert of_kind("self-collision", SCORBOT, inside, deeper)


@pytest.mark.parametrize("name", shipped_robots())
def test_the_ways_between_home_and_rest_are_clear(name: str) -> None:
    robot = load_robot(name)
    there = PointToPoint.plan(robot, robot.pose("home"), robot.pose("rest"))
    assert [str(f) for f in preflight(robot, there) if f.severity == "error"] == []


@pytest.mark.parametrize("points_m", [arc(), line()], ids=["arc", "line"])
def test_the_published_ways_are_clear(points_m: FloatArray) -> None:
    q = np.array([UZUNER.inverse(p).best("published") for p in points_m])
    parts = [PointToPoint.plan(UZUNER, a, b) for a, b in pairwise(q)]
    assert [str(f) for f in preflight(UZUNER, JoinedTrajectory(parts), tool_path=True)] == []


# --- obstacles

WALL = Obstacle("the wall", np.array([0.2, -0.5, 0.0]), np.array([0.3, 0.5, 0.6]))
WALLED = replace(UZUNER, obstacles=(WALL,))


def test_a_wall_in_the_way_is_named() -> None:
    found = of_kind("obstacle", WALLED, (0, 120, -80, -40, 0), (0, 40, -20, 0, 0))
    (finding,) = found
    assert finding.severity == "error"
    assert "mm inside the wall" in finding.what and "the wall" in finding.mend
    assert of_kind("obstacle", UZUNER, (0, 120, -80, -40, 0), (0, 40, -20, 0, 0)) == []
    assert of_kind("obstacle", WALLED, (0, 120, -80, -40, 0), (20, 120, -80, -40, 0)) == []


@pytest.mark.parametrize("angle_deg", [-51.3, -33.9, -22.1, -8.7, 4.4, 17.6, 28.2, 41.7])
def test_a_thin_post_is_found_between_samples(angle_deg: float) -> None:
    # the gripper, 13 mm wide, sweeps past a post of 2 mm; samples are up to 30 mm apart
    q = (10, -10, 0, 0)
    x, y, z = UZUNER.forward(np.radians([angle_deg, *q]))[:3, 3]
    low, high = np.array([x - 0.001, y - 0.001, z - 0.05]), np.array([x + 0.001, y + 0.001, z + 0.05])
    robot = replace(UZUNER, obstacles=(Obstacle("the post", low, high),))
    assert of_kind("obstacle", robot, (-90, *q), (90, *q))
    assert of_kind("obstacle", robot, (-90, *q), (angle_deg - 5, *q)) == []
    assert of_kind("obstacle", robot, (90, *q), (angle_deg + 5, *q)) == []


def test_out_of_an_obstacle_the_arm_may_go_but_not_in_deeper() -> None:
    inside, deeper, out = (0, 40, -20, 0, 0), (0, 30, -10, 0, 0), (0, 120, -80, -40, 0)
    assert of_kind("obstacle", WALLED, inside, out) == []
    assert of_kind("obstacle", WALLED, inside, deeper)


def test_a_table_under_the_arm_does_not_stop_the_column_from_turning() -> None:
    table = Obstacle("the table", np.array([-0.5, -0.5, -0.02]), np.array([0.5, 0.5, 0.0]))
    robot = replace(UZUNER, obstacles=(table,))
    assert of_kind("obstacle", robot, (-60, 90, -80, -40, 0), (60, 90, -80, -40, 0)) == []
    down = np.degrees(UZUNER.inverse([0.2, 0.0, -0.01]).best("least-rotation"))
    (finding,) = of_kind("obstacle", robot, (0, 90, -80, -40, 0), tuple(down))
    assert finding.part == "the gripper"
    touching = np.degrees(UZUNER.inverse([0.2, 0.0, 0.0], pitch=-np.pi / 2).best("least-rotation"))
    assert of_kind("obstacle", robot, (0, 90, -80, -40, 0), tuple(touching)) == []  # picking from it


# --- singularity


def test_a_joint_motion_that_ends_stretched_is_warned_of() -> None:
    (finding,) = preflight(UZUNER, PointToPoint.plan(UZUNER, HOME, np.zeros(5)))
    assert (finding.kind, finding.severity) == ("singularity", "warning")
    assert "at a singularity" in finding.what
    require_clear(UZUNER, PointToPoint.plan(UZUNER, HOME, np.zeros(5)))


def test_a_joint_motion_may_pass_a_singularity() -> None:
    assert of_kind("singularity", UZUNER, (0, 20, 40, 30, 0), (0, 20, -40, -30, 0)) == []


def test_a_path_of_the_tool_through_the_lost_direction_is_refused() -> None:
    # stretched upright at the middle: the tool comes out along the arm, stands for an instant, goes back in
    through = [(0, 120, -40, -20, 0), (0, 90, 0, 0, 0), (0, 60, 40, 20, 0)]
    (finding,) = of_kind("singularity", UZUNER, *through, tool_path=True)
    assert finding.severity == "error"
    assert "lead the path past there" in finding.mend


def test_a_path_of_the_tool_that_does_not_need_what_is_lost_is_warned_of() -> None:
    # stretched all the way, only the base turns: sideways is free
    (finding,) = of_kind("singularity", UZUNER, (-40, 0, 0, 0, 0), (40, 0, 0, 0, 0), tool_path=True)
    assert finding.severity == "warning"


def test_isotropy_is_that_of_the_singular_values() -> None:
    rng = np.random.default_rng(9)
    for q in rng.uniform(UZUNER.limits[:, 0], UZUNER.limits[:, 1], (60, 5)):
        sizes = np.linalg.svd(UZUNER.jacobian(q)[:3], compute_uv=False)
        found = [f for f in preflight(UZUNER, PointToPoint.lasting(q, q, 0.0)) if f.kind == "singularity"]
        assert bool(found) == bool(sizes[2] / sizes[0] < 0.05)
        if found:
            assert f"{100 * sizes[2] / sizes[0]:.1f} %" in found[0].what


def test_of_an_arm_that_is_always_singular_nothing_is_said() -> None:
    flat = replace(
        UZUNER,
        joints=tuple(
            replace(joint, lower=0.0, upper=0.0) if joint.name in ("base", "wrist_roll") else joint
            for joint in UZUNER.joints
        ),
    )
    assert of_kind("singularity", flat, (0, 90, -80, -40, 0), (0, 0, 0, 0, 0)) == []


# --- torque


def test_a_payload_that_is_too_heavy_is_refused_and_one_that_warms_is_told() -> None:
    ways = (0, 90, -80, -40, 0), (0, 5, 5, 5, 0)
    assert of_kind("torque", UZUNER, *ways) == []
    warm = of_kind("torque", UZUNER, *ways, payload_kg=0.4)
    assert {f.severity for f in warm} == {"warning"}
    assert "Shoulder" in {f.part for f in warm}
    heavy = [f for f in of_kind("torque", UZUNER, *ways, payload_kg=1.0) if f.severity == "error"]
    assert "Shoulder" in {f.part for f in heavy}
    q = np.radians(ways[1])
    torque = abs(float(replace(UZUNER.gravity, payload_kg=1.0).torque(q)[1]))
    (shoulder,) = [f for f in heavy if f.part == "Shoulder"]
    assert shoulder.what.startswith(f"gravity asks for {torque:.2f} N·m, {100 * torque / 2.941995:.0f} %")
    with pytest.raises(MotionRefusedError, match="stall torque"):
        require_clear(UZUNER, PointToPoint.plan(UZUNER, HOME, q), 1.0)


def test_an_overloaded_arm_may_be_brought_in() -> None:
    out, in_, farther = (0, 30, 0, 0, 0), (0, 90, -80, -40, 0), (0, 0, 0, 0, 0)
    errors = [f for f in of_kind("torque", UZUNER, out, in_, payload_kg=1.2) if f.severity == "error"]
    assert errors == []
    assert any(f.severity == "error" for f in of_kind("torque", UZUNER, out, farther, payload_kg=1.2))


@pytest.mark.parametrize("payload", [-0.1, float("nan"), float("inf")])
def test_a_payload_that_cannot_be(payload: float) -> None:
    with pytest.raises(InputError, match="payload"):
        preflight(UZUNER, PointToPoint.plan(UZUNER, HOME, HOME), payload)


def test_what_is_not_known_is_said_and_not_invented() -> None:
    assert not_checked(UZUNER) == ()
    assert "no stall torque of any joint" in not_checked(MICO)[0]
    assert of_kind("torque", MICO, (0, -100, 30, 0), (0, 0, 0, 0), payload_kg=50.0) == []
    bare = replace(UZUNER, gravity=replace(UZUNER.gravity, bodies=()))
    assert "no masses" in not_checked(bare)[0]

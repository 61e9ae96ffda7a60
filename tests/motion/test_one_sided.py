"""Motions that come to their end from one side: where the links truly stand behind their play."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armctl.arrays import FloatArray
from armctl.errors import MotionRefusedError
from armctl.facts import NoRoomToTurn
from armctl.facts.words import say
from armctl.kinematics import Target
from armctl.motion import PiecewisePolynomial, Trajectory, plan_choice, plan_joints, preflight
from armctl.motion.blend import Leg, blend
from armctl.motion.one_sided import OneSided, commanded_end
from armctl.program import MoveStep, PointStep
from armctl.robot import Deflection, Robot, load_robot

UZUNER = load_robot("uzuner")
PLAY = np.radians([1.5, 0.0, 0.0, 0.0, 2.0])
"""of joints that gravity never holds at one side"""


def loose(robot: Robot = UZUNER) -> Robot:
    """An arm whose play is known."""
    rigid = Deflection.of(robot.gravity, robot.gravity.heaviest(robot.limits))
    return replace(robot, output_map=replace(robot.outputs, deflection=replace(rigid, play=PLAY)))


def links_after(robot: Robot, motion: Trajectory, leaning: FloatArray) -> FloatArray:
    """Where links (n,) [rad] come to stand: pushed along by shafts with play, else where they are.

    Shafts stand ahead of what is commanded as the arm's map has it. ``leaning``: -1 … 1, where they begin.
    """
    deflection = robot.outputs.deflection
    assert deflection is not None
    times = np.linspace(0.0, motion.duration, 400)
    shafts = deflection.setpoint(motion.sample(times).q)
    links = shafts[0] - 0.5 * deflection.play * leaning
    for shaft in shafts:
        links = np.clip(links, shaft - 0.5 * deflection.play, shaft + 0.5 * deflection.play)
    return links


def middling(robot: Robot, rng: np.random.Generator) -> FloatArray:
    low, high = robot.limits.T
    return rng.uniform(low + 0.2 * (high - low), high - 0.2 * (high - low))


@pytest.mark.parametrize("profile", ["end-plus", "end-minus"])
def test_links_stand_where_they_are_wanted_from_wherever_they_come(profile: OneSided) -> None:
    robot, rng = loose(), np.random.default_rng(3)
    scatter: dict[str, list[FloatArray]] = {"cubic": [], profile: []}
    for _ in range(20):
        start, end = middling(robot, rng), middling(robot, rng)
        for law, missed in scatter.items():
            motion = plan_joints(robot, start, end, profile=law, checked=False)  # type: ignore[arg-type]
            missed.append(links_after(robot, motion, rng.uniform(-1.0, 1.0, robot.n)) - end)
    base_and_roll = [0, 4]
    worst = {law: np.abs(missed).max(axis=0)[base_and_roll] for law, missed in scatter.items()}
    assert (worst["cubic"] > 0.4 * PLAY[base_and_roll]).all()
    assert (worst[profile] < 0.01 * PLAY[base_and_roll]).all()


@pytest.mark.parametrize("name", ["so101", "parol6", "al5d"])
def test_where_play_is_not_known_each_joint_that_carries_nothing_ends_in_one_sense(name: str) -> None:
    robot, rng = load_robot(name), np.random.default_rng(4)
    turned = 0
    for _ in range(15):
        start, end = middling(robot, rng), middling(robot, rng)
        motion = plan_joints(robot, start, end, profile="end-plus", checked=False)
        np.testing.assert_array_equal(motion.end, end)
        assert np.abs(motion.sample([0.0, motion.duration]).velocity).max() < 1e-9
        behind = end - motion.sample(np.linspace(0.0, motion.duration, 1000)).q
        torque = np.abs(robot.gravity.torque(end)) / robot.gravity.heaviest(robot.limits).max()
        for j in np.flatnonzero(torque < 0.02).tolist():
            above = np.flatnonzero(behind[:, j] < -1e-6)
            last = behind[above[-1] + 1 if len(above) else 0 :, j]
            assert last.max() > 0.99 * np.radians(1.0), "the last that it does is to turn up"
            turned += bool(start[j] > end[j])
    assert turned > 5  # they would have ended in the other sense


def test_a_motion_that_comes_from_that_side_anyhow_goes_straight() -> None:
    start = UZUNER.pose("home")
    end = start + np.radians([10.0, 5.0, 5.0, 5.0, 5.0])
    up, cubic = (plan_joints(UZUNER, start, end, profile=law) for law in ("end-plus", "cubic"))
    assert up.duration == pytest.approx(cubic.duration)
    down = plan_joints(UZUNER, start, end, profile="end-minus")
    assert down.duration > cubic.duration
    highest = down.sample(np.linspace(0, down.duration, 300)).q[:, 0].max()
    assert highest == pytest.approx(end[0] + np.radians(2.0), abs=1e-4)
    longer = plan_joints(UZUNER, start, end, 5.0, "end-minus")
    assert longer.duration == pytest.approx(5.0)


def test_without_room_behind_the_pose_it_is_refused_by_the_joint() -> None:
    end = UZUNER.pose("home")
    end[0] = UZUNER.limits[0, 0] + np.radians(0.4)
    with pytest.raises(MotionRefusedError) as refused:
        plan_joints(UZUNER, UZUNER.pose("home"), end, profile="end-plus")
    reason = refused.value.reason
    assert isinstance(reason, NoRoomToTurn)
    assert (reason.part, reason.room) == ("Base", pytest.approx(np.radians(0.4)))
    assert "0.4° from its limit" in say(reason) and "1.0° are needed" in say(reason)
    plan_joints(UZUNER, UZUNER.pose("home"), end, profile="end-minus")


def test_the_way_past_the_end_is_checked_as_it_is_driven() -> None:
    """An obstacle beside the end, in which the tool would turn round."""
    end = UZUNER.pose("home")
    start = end + np.radians([20.0, 0.0, 0.0, 0.0, 0.0])
    beyond = plan_joints(UZUNER, start, end, profile="end-plus")
    assert not preflight(UZUNER, beyond)
    turns = beyond.sample(np.linspace(0, beyond.duration, 300)).q[:, 0].min()
    near = replace(UZUNER, joints=(replace(UZUNER.joints[0], lower=end[0] - 0.02), *UZUNER.joints[1:]))
    assert turns == pytest.approx(end[0] - np.radians(2.0), abs=1e-4)
    kept = plan_joints(near, start, end, profile="end-plus")  # as much room as there is
    assert kept.sample(np.linspace(0, kept.duration, 300)).q[:, 0].min() > end[0] - 0.0201
    assert preflight(near, beyond)  # what leaves the limits behind the end is found


def test_steps_and_targets_come_from_one_side_as_well() -> None:
    robot, start = loose(), UZUNER.pose("home")
    point = robot.forward(start + np.radians([-20.0, 5.0, 5.0, 0.0, 0.0]))[:3, 3]
    x, y, z = (1000 * point).tolist()
    step = PointStep(x_mm=x, y_mm=y, z_mm=z, profile="end-plus")
    planned = step.plan(robot, start)
    asked = plan_choice(robot, start, Target.of(point), "least-rotation", None, "end-plus")[0]
    assert planned.duration == pytest.approx(asked.duration)
    np.testing.assert_allclose(planned.end, asked.end)
    links = links_after(robot, planned, np.zeros(5))
    np.testing.assert_allclose(robot.forward(links)[:3, 3], point, atol=2e-4)
    pose = MoveStep(joints_deg=tuple(robot.shown(links).tolist()), profile="end-plus")
    np.testing.assert_allclose(pose.end(robot), commanded_end(robot, links, "end-plus"), atol=1e-6)
    again = pose.plan(robot, pose.end(robot))  # it stands there, and nobody knows how it came
    assert again.duration > 0.2 and pose.leg(robot, pose.end(robot)) is not None
    before = PiecewisePolynomial([0.0, 1.0], np.stack([start, again.end - start + 0.3])[None])
    legs = [Leg(before, 0.02), pose.leg(robot, before(1.0))]
    blended = blend(robot, [leg for leg in legs if leg is not None]).trajectories
    assert len(blended) == 2  # a corner of a path is passed at rest
    for part in blended:
        assert (part.peaks.acceleration < 1.001 * robot.acceleration_limits).all()
    np.testing.assert_allclose(blended[-1].end, again.end, atol=1e-9)
    assert "end-plus" in pose.describe() and "profile='end-plus'" in pose.script()

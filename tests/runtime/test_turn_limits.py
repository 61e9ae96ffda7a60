"""The angle between two links of a palletiser: led up to its limit, and taken over at it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.runtime.kit import Rig, assert_accelerations_keep_limits, make_rig

from armctl.arrays import FloatArray
from armctl.errors import EnableError
from armctl.facts import State
from armctl.kinematics import Target
from armctl.protocol import Connect, Enable, FollowTarget, Jog, JogTool
from armctl.robot import Robot, load_robot

MEARM = load_robot("mearm")
(LIMIT,) = MEARM.chain.turn_limits
LOW, HIGH = MEARM.limits.T
HOME = MEARM.pose("home")
SEEDS = [(6.0, (3, 10, 42, 56, 158)), (2.0, (3, 101, 162, 182)), (1.0, (3, 112)), (0.4, (142, 154))]
"""shares of the elbow's acceleration, and jogs and targets that come near the limit with them"""


def with_elbow_acceleration(share: float) -> Robot:
    elbow = MEARM.joints[2]
    quick = replace(elbow, acceleration=share * elbow.acceleration)
    return replace(MEARM, joints=(*MEARM.joints[:2], quick))


def led(robot: Robot, seed: int) -> Rig:
    """After four jogs or live targets, drawn by ``seed``, from near the limit; not one may be refused."""
    rng = np.random.default_rng(seed)
    q = HOME
    while not -0.6 < robot.chain.turn_excess(q)[0] < -0.02:
        q = LOW + (HIGH - LOW) * rng.random(3)
    rig = make_rig(robot=robot).enable(q)
    kind = seed % 4
    for _ in range(4):
        if kind == 3:
            somewhere = robot.forward(LOW + (HIGH - LOW) * rng.random(3))[:3, 3]
            command = FollowTarget(Target.of(somewhere))
        elif kind == 2:
            command = JogTool(rng.uniform(-0.25, 0.25, 3), frame="base")
        else:
            command = Jog(np.append(0.0, rng.uniform(-1.0, 1.0, 2)))
        for _ in range(int(rng.integers(5, 25))):
            rig.do(command).accepted.result(0)
            if rig.now.state is State.FAULT:
                return rig
    rig.run(0.6)
    return rig


@pytest.mark.parametrize(("share", "seeds"), SEEDS)
def test_jogs_and_live_targets_stop_at_the_angle_between_links(share: float, seeds: tuple[int, ...]) -> None:
    robot = with_elbow_acceleration(share)
    rooms = list[float]()
    for seed in seeds:
        rig = led(robot, seed)
        assert rig.now.state is not State.FAULT, f"seed {seed}: {rig.now.cause}"
        assert_accelerations_keep_limits(rig)
        q = np.array([snapshot.q_command for snapshot in rig.history])
        rooms.append(float(-robot.chain.turn_excess(q).max()))
    assert -1e-9 <= min(rooms) < np.radians(0.5)


def on_the_limit(rng: np.random.Generator) -> FloatArray:
    """A pose whose angle between the links is at one of its limits; now and then a joint is, too."""
    while True:
        q = LOW + (HIGH - LOW) * rng.random(3)
        if rng.random() < 0.3:
            q[1] = rng.choice([LOW[1], HIGH[1]])
        q[2] = q[1] + rng.choice([LIMIT.lower, LIMIT.upper])
        if LOW[2] <= q[2] <= HIGH[2]:
            return q


def connected(q: np.ndarray, noise: np.ndarray) -> Rig:
    rig = make_rig(robot=MEARM)
    assert MEARM.output_map is not None
    pulses = MEARM.output_map.outputs(q)
    rig.driver.positions.update({c: value + d for (c, value), d in zip(pulses.items(), noise, strict=True)})
    rig.do(Connect("sim")).finished.result(0)
    return rig


def test_an_arm_that_stands_at_the_angle_between_links_is_taken_over() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        q = on_the_limit(rng)
        rig = connected(q, rng.choice([-0.125, 0.125], 3))
        rig.finishes(Enable())
        taken = rig.now.q_command
        assert np.abs(taken - q).max() < np.radians(0.1)
        assert MEARM.chain.keeps_turns(taken)
        assert ((taken >= LOW) & (taken <= HIGH)).all()


def test_an_arm_clearly_beyond_the_angle_between_links_is_not_taken_over() -> None:
    q = np.array([0.0, np.radians(60.0), np.radians(60.0) + LIMIT.upper])
    rig = connected(q + np.radians([0.0, 0.0, 1.0]), np.zeros(3))
    rig.refuses(Enable(), f"{LIMIT.name}: .*release it", EnableError)
    assert rig.driver.writes == []

"""Torque comes on where the arm stands, or not at all: random power-ups, in simulated time."""

from __future__ import annotations

import os

import numpy as np
import pytest
from tests.hardware.bus_kit import BusBench, Moments

from armctl.errors import EnableError
from armctl.robot import load_robot

RUNS = 10_000 if os.environ.get("ARMCTL_LONG") else 500
PARTS = 5  # which several processes work on
ROBOT = load_robot("so101")
STEPS_PER_DEG = 4096 / 360
STIFFNESS = 14.0 * 1.91 / 2.94  # N·m/rad of the simulated servo, see simulated.py


class PowerUp:
    """One random power-up of an SO-101."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.bench = bench = BusBench(ROBOT)
        low, high = bench.robot.limits.T
        bench.stand(rng.uniform(low, high))
        self.hand = bench.bus.plant.joints[int(rng.integers(5))]
        self.speed = float(rng.choice([0.0, rng.uniform(-60.0, 60.0)]))
        self.missing = int(rng.integers(1, 7)) if rng.random() < 0.1 else None
        self.odd: int | None = None
        for servo in bench.bus.servos:  # what an earlier program left
            servo.put("goal_position", int(rng.integers(0, 4096)))
            if rng.random() < 0.2:
                servo.put("goal_position", servo.get("present_position"))
                servo.written(40, b"\1")
            servo.put("torque_limit", int(rng.integers(0, 1001)))
            servo.put("acceleration", int(rng.integers(0, 255)))
            servo.put("goal_speed", int(rng.integers(0, 3000)))
        if rng.random() < 0.3:
            servo = bench.bus.servo(int(rng.integers(1, 7)))
            self.odd = servo.id
            match int(rng.integers(4)):
                case 0:
                    servo.put("mode", int(rng.integers(1, 4)))
                case 1:
                    servo.put("phase", 12 | 1 << 4)
                case 2:  # limits that leave the pose out
                    place = servo.get("present_position")
                    servo.put("lowest", min(4050, place + 140))
                    servo.put("highest", 4095)
                case 3:
                    servo.put("highest", 0)
        if self.missing is not None:
            bench.bus.servo(self.missing).silent_s = np.inf

    def begin(self) -> EnableError | None:
        """Connect and enable; what refused it."""
        bench = self.bench
        with bench.held():
            self.hand.hand = np.deg2rad(self.speed)
            bench.open()
            self.moments = Moments(bench.bus)
            refused = bench.enable()
        assert refused is None or isinstance(refused, EnableError)
        return refused


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
def test_torque_comes_on_where_the_arm_stands_or_is_refused_with_the_servo_named(part: int):
    worst_still = worst_moved = 0.0
    refused = 0
    for seed in range(part, RUNS, PARTS):
        up = PowerUp(seed)
        refusal = up.begin()
        jump = max((steps for _, steps in up.moments.jumps), default=0.0)
        if up.speed == 0.0:
            worst_still = max(worst_still, jump)
        else:
            worst_moved = max(worst_moved, jump)
        if refusal is not None:
            refused += 1
            assert refusal.channel is not None, (seed, str(refusal))
            assert f"servo {refusal.channel}" in str(refusal), seed
            limp = [one for one in up.bench.bus.servos if one.id != up.missing]
            came_on = {servo for servo, _ in up.moments.jumps}
            assert not any(one.driven for one in limp if one.id in came_on), (seed, str(refusal))
            continue
        assert up.missing is None and up.odd is None, seed
        settled(up, seed)
    assert 0.05 < refused * PARTS / RUNS < 0.6
    assert worst_still <= 1.0
    assert worst_moved <= 3.0


def settled(up: PowerUp, seed: int) -> None:
    """Nobody holds the arm any more: it sags by what its load explains, and goes nowhere else."""
    bench = up.bench
    before = {one.id: one.shaft for one in bench.bus.servos}
    bench.ticks(25)
    for one in bench.bus.servos:
        sag = (abs(one.joint.gravity) + one.joint.friction) / STIFFNESS
        most = 3.0 + abs(up.speed) + np.rad2deg(sag) * STEPS_PER_DEG * 1.3  # what a hand moved swings on
        assert abs(one.shaft - before[one.id]) <= most, (seed, one.id)

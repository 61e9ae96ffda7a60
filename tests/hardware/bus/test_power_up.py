"""Torque comes on where the arm stands, or not at all: random power-ups of both makes, in simulated time."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from tests.hardware.bus_kit import BusBench, Moments

from armctl.errors import EnableError
from armctl.hardware.bus.simulated import BusServo
from armctl.hardware.dynamixel.simulated import FACTORY, SimulatedX
from armctl.robot import load_robot

LONG = bool(os.environ.get("ARMCTL_LONG"))
PARTS = 5  # which several processes work on


def feetech_leaves(rng: np.random.Generator, servo: BusServo) -> None:
    """What an earlier program may have left in a servo that is limp, or holds where it stands."""
    servo.put("goal_position", int(rng.integers(0, 4096)))
    if rng.random() < 0.2:
        servo.put("goal_position", servo.get("present_position"))
        servo.written(40, b"\1")
    servo.put("torque_limit", int(rng.integers(0, 1001)))
    servo.put("acceleration", int(rng.integers(0, 255)))
    servo.put("goal_speed", int(rng.integers(0, 3000)))


def feetech_spoils(rng: np.random.Generator, servo: BusServo) -> None:
    """An EEPROM with which torque would be a danger."""
    match int(rng.integers(4)):
        case 0:
            servo.put("mode", int(rng.integers(1, 4)))
        case 1:
            servo.put("phase", 12 | 1 << 4)
        case 2:  # limits that leave the pose out
            servo.put("lowest", min(4050, servo.get("present_position") + 140))
            servo.put("highest", 4095)
        case _:
            servo.put("highest", 0)


def dynamixel_leaves(rng: np.random.Generator, servo: BusServo) -> None:
    """The same of one that keeps its goal while it is limp, and whose watchdog may have tripped."""
    assert isinstance(servo, SimulatedX)
    if rng.random() < 0.2:
        servo.put("goal_position", servo.get("present_position"))
        servo.written(servo.table["torque"].address, b"\1")
        if rng.random() < 0.3:
            servo.put("bus_watchdog", -1)
    else:
        servo.put("goal_position", int(rng.integers(0, 4096)))
    servo.put("goal_pwm", int(rng.integers(0, 886)))
    servo.put("profile_velocity", int(rng.integers(0, 300)))
    servo.put("profile_acceleration", int(rng.integers(0, 300)))
    servo.put("status_return_level", int(rng.choice([0, 1, 2])))


def dynamixel_spoils(rng: np.random.Generator, servo: BusServo) -> None:
    """The same; a servo whose hardware error has cut its torque is among them."""
    assert isinstance(servo, SimulatedX)
    place = servo.get("present_position")
    match int(rng.integers(4)):
        case 0:
            servo.put("operating_mode", int(rng.choice([0, 1, 4, 16])))
        case 1 if place + 140 < 4095:
            servo.put("min_position_limit", place + 140)
            servo.put("max_position_limit", 4095)
        case 1 | 2:
            servo.put("max_position_limit", max(0, place - 140))
        case _:
            servo.fail(1 << 5)


@dataclass(frozen=True)
class Kind:
    """An arm, and what its servos' make leaves to be found."""

    leaves: Callable[[np.random.Generator, BusServo], None]
    spoils: Callable[[np.random.Generator, BusServo], None]
    runs: int
    gain: float  # share of the stall torque for one step between goal and shaft

    def sag_steps(self, servo: BusServo) -> float:
        """By how much its load explains that it hangs."""
        joint = servo.joint
        return (abs(joint.gravity) + joint.friction) / (joint.stall * self.gain)


FEETECH_GAIN = 14.0 / 2.94 / (4096 / (2 * np.pi))  # N·m/rad at P = 32 of an STS3215 of 2.94 N·m
DYNAMIXEL_GAIN = 800 / 128 / FACTORY["pwm_limit"]
KINDS = {
    "so101": Kind(feetech_leaves, feetech_spoils, 10_000 if LONG else 250, FEETECH_GAIN),
    "open_manipulator_x": Kind(dynamixel_leaves, dynamixel_spoils, 10_000 if LONG else 200, DYNAMIXEL_GAIN),
    # Two motors lift its shoulder.
    "widowx250s": Kind(dynamixel_leaves, dynamixel_spoils, 2_000 if LONG else 50, DYNAMIXEL_GAIN),
}


class PowerUp:
    """One random power-up."""

    def __init__(self, name: str, seed: int) -> None:
        rng, self.kind = np.random.default_rng(seed), KINDS[name]
        self.bench = bench = BusBench(ROBOTS[name])
        low, high = bench.robot.limits.T
        bench.stand(rng.uniform(low, high))
        joints, servos = len(bench.robot.joint_names), bench.bus.servos
        self.hand = bench.bus.plant.joints[int(rng.integers(joints))]
        self.speed = float(rng.choice([0.0, rng.uniform(-60.0, 60.0)]))
        self.missing = servos[int(rng.integers(len(servos)))] if rng.random() < 0.1 else None
        for servo in servos:
            self.kind.leaves(rng, servo)
        self.odd: BusServo | None = None
        if rng.random() < 0.3:
            self.odd = servos[int(rng.integers(len(servos)))]
            self.kind.spoils(rng, self.odd)
        if self.missing is not None:
            self.missing.silent_s = np.inf

    def begin(self) -> EnableError | None:
        """Connect and enable, while a hand turns one joint and others hold the rest; what refused it."""
        bench = self.bench
        with bench.held():
            self.hand.hand = np.deg2rad(self.speed)
            bench.open()
            self.moments = Moments(bench.bus)
            refused = bench.enable()
        assert refused is None or isinstance(refused, EnableError)
        return refused


ROBOTS = {name: load_robot(name) for name in KINDS}


@pytest.mark.slow
@pytest.mark.parametrize("part", range(PARTS))
@pytest.mark.parametrize("name", KINDS)
def test_torque_comes_on_where_the_arm_stands_or_is_refused_with_the_servo_named(name: str, part: int):
    worst_still = worst_moved = 0.0
    refused, runs = 0, KINDS[name].runs
    for seed in range(part, runs, PARTS):
        up = PowerUp(name, seed)
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
            came_on = {servo for servo, _ in up.moments.jumps}
            reached = [one for one in up.bench.bus.servos if one is not up.missing and one.id in came_on]
            assert not any(one.driven for one in reached), (seed, str(refusal))
            continue
        assert up.missing is None and up.odd is None, seed
        settled(up, seed)
    assert 0 < refused < runs // PARTS  # both happen
    assert worst_still <= 1.0
    assert worst_moved <= 3.0


def settled(up: PowerUp, seed: int) -> None:
    """Nobody holds the arm any more: it sags by what its load explains, and goes nowhere else."""
    bench = up.bench
    before = {one.id: one.shaft for one in bench.bus.servos}
    for one in bench.bus.servos:  # a hand that goes on turning one leads it away from where torque came on
        if one.joint is up.hand and up.speed:
            before[one.id] = float(one.get("goal_position"))
    bench.ticks(25)
    for one in bench.bus.servos:
        # What a hand moved swings on.
        most = 3.0 + abs(up.speed) + 1.3 * up.kind.sag_steps(one)
        assert abs(one.shaft - before[one.id]) <= most, (seed, one.id)

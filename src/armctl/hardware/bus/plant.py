"""The arm behind a simulated servo bus: inertia, gravity, friction, end stops, hands, heat and the supply.

Joints are simulated each by itself, in angles of the joint: gravity couples them, their accelerations do not.
It is for rehearsal and for tests of drivers, not for the design of an arm.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import field, replace
from typing import Protocol

import numpy as np

from armctl.arrays import FloatArray
from armctl.hardware.driver import ChannelSettings
from armctl.kinematics.energy import STANDARD_GRAVITY
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot

STEP_S = 0.002
"""of the simulation"""
GRAVITY_EVERY = 5
"""steps from one look at gravity to the next: it changes with the pose, which is slow"""
_LONGEST_S = 2.0
"""a pause of the host that is longer is cut short: what stands, stands"""
_ROTOR, _LINK_SHARE = 0.004, 0.3
"""inertia [kg·m²] of a motor at its output shaft; the share of mass times lever² that a link has of it"""
_FREE_INERTIA = 0.004
_BEYOND_RAD = math.radians(0.2)
"""how far behind its limits a joint has its hard stop"""
DEFAULT_STALL_NM = 1.9


class Drive(Protocol):
    """A motor on a joint, as a servo controls it."""

    def torque(self, angle: float, speed: float) -> float:
        """What it does at the output shaft [N·m], at an angle [rad] and a speed [rad/s] of its joint."""
        ...


@dataclass
class PlantJoint:
    """A joint of the simulated arm."""

    angle: float = 0.0
    """[rad]"""
    speed: float = 0.0
    """[rad/s]"""
    low: float = -math.pi
    """hard stops [rad]"""
    high: float = math.pi
    inertia: float = _FREE_INERTIA
    """[kg·m²]"""
    friction: float = 0.1
    """[N·m]"""
    stall: float = DEFAULT_STALL_NM
    """torque of its motor at a standstill, in all [N·m]"""
    play: float = 0.0
    """by which the link may stand away from the shaft [rad], either way"""
    gravity: float = 0.0
    """[N·m], against positive angles; worked out from the pose"""
    lies_at: float | None = None
    """where it comes to lie, as on a stand, when it falls [rad]"""
    hand: float | None = None
    """[rad/s] at which somebody's hand turns it, whatever its motor does; None: nobody does"""
    blocked: bool = False
    """whether something holds it where it is"""
    motor: float = 0.0
    """what its motors do now [N·m]"""
    drives: list[Drive] = field(default_factory=list[Drive])

    @property
    def link_angle(self) -> float:
        """Where the link is: gravity leans it against one side of the play [rad]."""
        return self.angle if self.gravity == 0.0 else self.angle - math.copysign(self.play, self.gravity)

    def step(self, dt: float) -> None:
        """Let ``dt`` [s] pass."""
        motor = self.motor = sum(drive.torque(self.angle, self.speed) for drive in self.drives)
        if self.blocked:
            self.speed = 0.0
        elif self.hand is not None:
            self.speed = self.hand
        else:
            torque = motor - self.gravity
            if self.speed == 0.0 and abs(torque) <= self.friction:
                return
            moved = self.speed + dt * torque / self.inertia
            brake = dt * self.friction / self.inertia
            self.speed = math.copysign(max(0.0, abs(moved) - brake), moved)
            pushed_down = -math.copysign(motor, motor * self.gravity)
            if pushed_down <= self.friction and self._lies_down(self.angle + dt * self.speed):
                self.speed = 0.0
        angle = self.angle + dt * self.speed
        self.angle = min(self.high, max(self.low, angle))
        if self.angle != angle:
            self.speed = 0.0

    def _lies_down(self, angle: float) -> bool:
        """Whether it would fall past what it lies on, on the way from where it is to ``angle`` [rad]."""
        place = self.lies_at
        if place is None:
            return False
        falls = (angle - self.angle) * self.gravity < 0.0
        return falls and (self.angle - place) * (angle - place) <= 0.0


class ArmPlant:
    """All joints of an arm, its gripper last, and the time that passes for them."""

    def __init__(
        self, joints: Sequence[PlantJoint], gravity: Callable[[FloatArray], FloatArray] | None = None
    ) -> None:
        """``gravity``: angles (n,) [rad] of the first n joints -> torque (n,) [N·m]; None: there is none."""
        self.joints = tuple(joints)
        self._gravity = gravity
        self._now: float | None = None
        self._count = 0
        self._still = False
        self.began: list[Callable[[float], None]] = []
        """called before each step with its length [s]: the electronics of the servos"""

    def advance(self, now: float) -> None:
        """Let time pass up to ``now`` [s]."""
        if self._now is None:
            self._now = now
        self._now = max(self._now, now - _LONGEST_S)
        if self._still and now > self._now and all(joint.hand is None for joint in self.joints):
            for begin in self.began:  # nothing turns, and nobody drives: only heat goes
                begin(now - self._now)
            self._now = now
        while now - self._now >= STEP_S:
            self._now += STEP_S
            self._step()

    def _step(self) -> None:
        if self._gravity is not None and self._count % GRAVITY_EVERY == 0:
            self.weigh()
        self._count += 1
        for begin in self.began:
            begin(STEP_S)
        before = [joint.angle for joint in self.joints]
        for joint in self.joints:
            joint.step(STEP_S)
        self._still = before == [joint.angle for joint in self.joints] and not any(
            joint.speed or joint.motor for joint in self.joints
        )

    def wake(self) -> None:
        """Something may have changed: step by step from here on."""
        self._still = False

    def weigh(self) -> None:
        """Work gravity out anew."""
        if self._gravity is None:
            return
        torque = self._gravity(np.array([joint.link_angle for joint in self.joints]))
        for joint, one in zip(self.joints, torque.tolist(), strict=False):
            joint.gravity = one


def plant_of(robot: Robot | None, channels: Sequence[ChannelSettings]) -> ArmPlant:
    """The arm of a robot at its rest pose; without a robot, a free joint for each channel.

    A joint for each of the robot's, in radians, and one more for the gripper, whose angle is its opening
    (0 ... 1); without a robot the angle is in radians of the servo from the middle of its turn.
    """
    if robot is None:
        return ArmPlant([PlantJoint() for _ in channels])
    n = robot.n
    model = replace(robot.gravity, payload_kg=0.0)  # it carries nothing

    def gravity(angles: FloatArray) -> FloatArray:
        return model.torque(angles[:n])

    rng = np.random.default_rng(1)
    low, high = robot.limits.T
    heaviest = np.abs(model.torque(rng.uniform(low, high, (200, n)))).max(axis=0)
    reach = max(0.1, float(np.linalg.norm(robot.forward(robot.first_pose)[:3, 3])))
    joints: list[PlantJoint] = []
    for i, joint in enumerate(robot.joints):
        stall = joint.stall_torque or DEFAULT_STALL_NM
        inertia = _ROTOR + _LINK_SHARE * float(heaviest[i]) / STANDARD_GRAVITY * reach
        joints.append(
            PlantJoint(
                float(robot.first_pose[i]),
                lies_at=float(robot.first_pose[i]),
                low=float(low[i]) - _BEYOND_RAD,
                high=float(high[i]) + _BEYOND_RAD,
                inertia=inertia,
                friction=0.08 * stall,
                stall=stall,
            )
        )
    if robot.outputs.gripper_channel is not None:
        joints.append(PlantJoint(0.0, low=-0.02, high=1.02))
    plant = ArmPlant(joints, gravity)
    plant.weigh()
    return plant

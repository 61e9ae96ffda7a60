"""The tool pitch as rows of equations: what must hold of the joint angles along a path, with derivatives.

Pitch is the elevation of the tool's z axis above the horizontal. Each kind of row says the same in a form
that is smooth where the arm works: for arms with parallel pitch joints as the angle in the arm's own vertical
plane, which is linear in the joint angles and has no trouble straight up and down; for all others as the
height of the axis's tip, and straight up or down as its two horizontal parts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError
from armctl.kinematics import YawPitchRollSolver
from armctl.kinematics.numeric.motion import crossed
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
_UPRIGHT = 1e-6
"""how near to upright a tool points neither outward nor back at the base axis, nor anywhere else [rad]"""


class PitchRows(Protocol):
    """One or two equations ``value(q) = wanted(s)``. Immutable."""

    @property
    def count(self) -> int:
        """How many equations."""
        ...

    def wanted(self, s: float) -> FloatArray:
        """(3, count) right side, its first and its second derivative over ``s`` [m]."""
        ...

    def value(self, q: FloatArray, pose: FloatArray) -> FloatArray:
        """(count,) left side at ``q`` (n,) with the tool pose (4, 4)."""
        ...

    def tilt(self, q: FloatArray, poses: FloatArray, s: FloatArray) -> FloatArray:
        """(k,) how far the pitch is off at ``s`` (k,), with ``q`` (k, n) and tool poses (k, 4, 4) [rad]."""
        ...

    def rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(count, n) its derivative by the joint angles."""
        ...

    def turned(self, pose: FloatArray, jacobian: FloatArray, rates: FloatArray) -> FloatArray:
        """(count, n) derivative of ``rows`` along joint rates (n,)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PlanePitch:
    """The angle of the tool in the arm's vertical plane: a sum of joint angles."""

    senses: FloatArray
    """(n,) what a joint adds to the sum a radian: ±1 or 0"""
    curve: PiecewisePolynomial
    """what the sum shall be over the way [m], one coordinate [rad]"""
    is_wish: bool = True
    """False: the curve is only a means to get along, and need not be kept exactly"""
    count: int = 1

    def wanted(self, s: float) -> FloatArray:
        """(3, 1)."""
        return self.curve.derivatives(s, 2)

    def value(self, q: FloatArray, pose: FloatArray) -> FloatArray:
        """(1,)."""
        return np.array([self.senses @ q])

    def tilt(self, q: FloatArray, poses: FloatArray, s: FloatArray) -> FloatArray:
        """(k,)."""
        return np.abs(q @ self.senses - self.curve(s)[:, 0]) if self.is_wish else np.zeros(len(q))

    def rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(1, n)."""
        return self.senses[None]

    def turned(self, pose: FloatArray, jacobian: FloatArray, rates: FloatArray) -> FloatArray:
        """(1, n), nothing."""
        return np.zeros((1, len(self.senses)))


@dataclass(frozen=True, slots=True, eq=False)
class AxisPitch:
    """Parts of the tool's z axis: its height, the sine of the pitch; or, upright, the two other ones."""

    parts: tuple[int, ...]
    """(2,) for the height, (0, 1) for upright"""
    start: float
    """pitch at the start of the path [rad]"""
    rate: float
    """how much it grows a metre [rad/m]"""

    @property
    def count(self) -> int:
        """1, or 2 for upright."""
        return len(self.parts)

    def wanted(self, s: float) -> FloatArray:
        """(3, count)."""
        if self.count == 2:
            return np.zeros((3, 2))
        angle = self.start + self.rate * s
        sine, cosine = math.sin(angle), math.cos(angle)
        return np.array([[sine], [cosine * self.rate], [-sine * self.rate**2]])

    def value(self, q: FloatArray, pose: FloatArray) -> FloatArray:
        """(count,)."""
        return pose[list(self.parts), 2]

    def tilt(self, q: FloatArray, poses: FloatArray, s: FloatArray) -> FloatArray:
        """(k,)."""
        x, y, z = poses[:, :3, 2].T
        return np.abs(np.arctan2(z, np.hypot(x, y)) - (self.start + self.rate * s))

    def rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(count, n)."""
        return _swung(pose, jacobian)[list(self.parts)]

    def turned(self, pose: FloatArray, jacobian: FloatArray, rates: FloatArray) -> FloatArray:
        """(count, n)."""
        return carried(_swung(pose, jacobian), jacobian[3:], rates)[list(self.parts)]


def _swung(pose: FloatArray, jacobian: FloatArray) -> FloatArray:
    """(3, n) derivatives of the tool's z axis by the joint angles."""
    return crossed(jacobian[None, 3:], pose[None, :3, 2:3])[0]


def carried(columns: FloatArray, axes: FloatArray, rates: FloatArray) -> FloatArray:
    """How the derivatives of a vector carried by the tool change while the joints turn.

    Joint i turns whatever joint j behind it does to the vector: ∂²v/∂q_i∂q_j = z_i x ∂v/∂q_j for i ≤ j.

    Args:
        columns: (3, n) derivatives ∂v/∂q of the vector by the joint angles.
        axes: (3, n) joint axes.
        rates: (n,) joint rates.

    Returns:
        (3, n) derivative of ``columns`` along the rates.
    """
    turning, turned = np.empty((2, *axes.shape)), np.empty((2, *axes.shape))
    np.add.accumulate(axes * rates, axis=1, out=turning[0])
    turned[0], turning[1] = columns, axes
    moved = np.add.accumulate(columns * rates, axis=1)
    np.subtract(moved[:, -1:], moved, out=turned[1])
    before, behind = crossed(turning, turned)
    return before + behind


def elevations(robot: Robot, poses: FloatArray) -> FloatArray:
    """Elevation of the tool's z axis above the arm's horizontal [rad]: poses (k, 4, 4) to (k,)."""
    solver = robot.inverse_kinematics
    axis = poses[:, :3, 2]
    if isinstance(solver, YawPitchRollSolver):
        axis = axis @ solver.geometry.frame
    return np.arctan2(axis[:, 2], np.hypot(axis[:, 0], axis[:, 1]))


def plane_senses(geometry: YawPitchRoll, n: int) -> FloatArray:
    """(n,) what each joint adds to the angle of the tool in the arm's plane: ±1 or 0."""
    senses = np.zeros(n)
    senses[list(geometry.pitch_joints)] = geometry.signs
    return senses


def pitch_rows(robot: Robot, q: FloatArray, length: float, end: float | None) -> PitchRows:
    """The rows that keep the pitch as it is at ``q`` (n,), or lead it evenly to ``end`` [rad].

    Raises:
        InputError: an end beyond ±90° for an arm that has no vertical plane of its own.
    """
    solver = robot.inverse_kinematics
    if isinstance(solver, YawPitchRollSolver):
        geometry = solver.geometry
        senses = plane_senses(geometry, robot.n)
        angle = sum(geometry.plane_angle(k, float(q[joint])) for k, joint in enumerate(geometry.pitch_joints))
        angle += geometry.tool_angle or 0.0
        forward = reaches_forward(geometry, q, robot.forward(q)[:3, 3])
        turn = 0.0 if end is None else _plane_turn(angle, end, outward=0.0 if forward else math.pi)
        return PlanePitch(
            senses, PiecewisePolynomial([0.0, length], [[[float(senses @ q)], [turn / length]]])
        )
    if end is not None and abs(end) > math.pi / 2:
        raise InputError(f"a tool pitch lies within ±90°, got {math.degrees(end):.2f}°")
    start = float(elevations(robot, robot.forward(q)[None])[0])
    if end is None and abs(start) > math.pi / 2 - _UPRIGHT:
        return AxisPitch((0, 1), start, 0.0)
    return AxisPitch((2,), start, 0.0 if end is None else (end - start) / length)


def _plane_turn(angle: float, end: float, outward: float) -> float:
    """How far the tool turns in the arm's plane from its angle to an end pitch [rad].

    A pitch within ±90° is met outward and back at the base axis: the tool stays on the side on which it is;
    one that stands upright turns outward. Beyond ±90° the angle is taken as it is, in the arm's own plane.
    """
    if abs(end) <= math.pi / 2:
        ahead = math.cos(angle)
        if abs(ahead) < _UPRIGHT:
            ahead = math.cos(outward)
        end = end if ahead > 0.0 else math.pi - end
    return math.remainder(end - angle, 2.0 * math.pi)


def reaches_forward(geometry: YawPitchRoll, q: FloatArray, tool: FloatArray) -> bool:
    """Whether the tool point (3,) lies in front of the arm, not over its back."""
    x, y, _ = geometry.local(tool)
    turn = geometry.yaw_sign * float(q[0])
    return x * math.cos(turn) + y * math.sin(turn) >= 0.0

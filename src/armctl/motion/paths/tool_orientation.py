"""The tool pitch along a path: kept, led to an end, or chosen inside limits; and the whole orientation.

Pitch is the elevation of the tool's z axis above the horizontal. It enters the equations of a path as one or
two rows ``value(q) = wanted(s)``: for arms with parallel pitch joints the angle in the arm's own vertical
plane, linear in the joint angles; for others the height of the axis's tip, or upright its horizontal parts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.facts.angles import DEGREE, in_degrees
from armctl.kinematics.angles import LIMIT_TOLERANCE, central_images, rotation_angle
from armctl.kinematics.families.numeric.descent import crossed, rotation_vectors
from armctl.kinematics.families.yaw_pitch_roll.geometry import bend_sense
from armctl.kinematics.subproblems import ToolPlane
from armctl.lazy_dataclass import dataclass
from armctl.motion.paths.tool_curve import ToolCurve
from armctl.motion.polynomial import PiecewisePolynomial, cubic_spline
from armctl.robot import Robot

_UPRIGHT = 1e-6
"""how near to upright a tool points neither outward nor back at the base axis, nor anywhere else [rad]"""


@dataclass(frozen=True, slots=True, eq=False)
class PlanePitch:
    """The angle of the tool in the arm's vertical plane: a sum of joint angles. One row."""

    senses: FloatArray
    """(n,) what a joint adds to the sum a radian: ±1 or 0"""
    curve: PiecewisePolynomial
    """what the sum shall be over the way [m], one coordinate [rad]"""
    is_wish: bool = True
    """False: the curve is only a means to get along, and need not be kept exactly"""
    offset: float = 0.0
    """what the sum lacks of the tool's angle above the horizontal [rad]"""
    count: ClassVar[int] = 1

    def elevation(self, s: float) -> float:
        """The elevation of the tool's z axis that is asked for at ``s`` [m], within ±90° [rad]."""
        angle = float(self.curve(s)[0]) + self.offset
        return math.atan2(math.sin(angle), abs(math.cos(angle)))

    def missing(self, q: FloatArray, pose: FloatArray, s: float) -> FloatArray:
        """(count,) right side less left side at ``s`` [m], at ``q`` (n,) with the tool pose (4, 4)."""
        return self.curve(s) - self.senses @ q

    def rates(self, s: float) -> FloatArray:
        """(2, count) first and second derivative of the right side over the way."""
        return self.curve.derivatives(s, 2)[1:]

    def tilt(self, q: FloatArray, poses: FloatArray, s: FloatArray) -> FloatArray:
        """(k,) how far the pitch is off at ``s`` (k,), with ``q`` (k, n) and tool poses (k, 4, 4) [rad]."""
        return np.abs(q @ self.senses - self.curve(s)[:, 0]) if self.is_wish else np.zeros(len(q))

    def rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(count, n) derivative of ``value`` by the joint angles."""
        return self.senses[None]

    def turned(self, pose: FloatArray, jacobian: FloatArray, rates: FloatArray) -> FloatArray:
        """(count, m) derivative of ``rows`` along the rates (m,) of links, of which ``jacobian`` is."""
        return np.zeros((1, len(rates)))


@dataclass(frozen=True, slots=True, eq=False)
class AxisPitch:
    """As ``PlanePitch`` for parts of the tool's z axis: its height, the pitch's sine; upright, the others."""

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

    def elevation(self, s: float) -> float:
        """[rad]."""
        return self.start + self.rate * s

    def missing(self, q: FloatArray, pose: FloatArray, s: float) -> FloatArray:
        """(count,)."""
        wanted = 0.0 if self.count == 2 else math.sin(self.start + self.rate * s)
        return wanted - pose[list(self.parts), 2]

    def rates(self, s: float) -> FloatArray:
        """(2, count)."""
        if self.count == 2:
            return np.zeros((2, 2))
        angle = self.start + self.rate * s
        return np.array([[math.cos(angle) * self.rate], [-math.sin(angle) * self.rate**2]])

    def tilt(self, q: FloatArray, poses: FloatArray, s: FloatArray) -> FloatArray:
        """(k,) [rad]."""
        x, y, z = poses[:, :3, 2].T
        return np.abs(np.arctan2(z, np.hypot(x, y)) - (self.start + self.rate * s))

    def rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(count, n)."""
        return _swung(pose, jacobian)[list(self.parts)]

    def turned(self, pose: FloatArray, jacobian: FloatArray, rates: FloatArray) -> FloatArray:
        """(count, m)."""
        return carried(_swung(pose, jacobian), jacobian[3:], rates)[list(self.parts)]


PitchRows = PlanePitch | AxisPitch


def _swung(pose: FloatArray, jacobian: FloatArray) -> FloatArray:
    """(3, n) derivatives of the tool's z axis by the joint angles."""
    return crossed(jacobian[None, 3:], pose[None, :3, 2:3])[0]


def carried(columns: FloatArray, axes: FloatArray, rates: FloatArray) -> FloatArray:
    """(3, m) derivative along links' rates (m,) of derivatives ``columns`` (3, m) of a vector on the tool.

    With the links' axes z (3, m): ∂²v/∂q_i∂q_j = z_i x ∂v/∂q_j for i ≤ j.
    """
    turning, turned = np.empty((2, 2, *axes.shape))
    np.add.accumulate(axes * rates, axis=1, out=turning[0])
    turned[0], turning[1] = columns, axes
    moved = np.add.accumulate(columns * rates, axis=1)
    np.subtract(moved[:, -1:], moved, out=turned[1])
    before, behind = crossed(turning, turned)
    return before + behind


def elevations(robot: Robot, poses: FloatArray) -> FloatArray:
    """(k,) elevation of the tool's z axis above the arm's horizontal [rad], for tool poses (k, 4, 4)."""
    plane, axis = robot.inverse_kinematics.plane, poses[:, :3, 2]
    if plane is not None:
        axis = axis @ plane.frame
    return np.arctan2(axis[:, 2], np.hypot(axis[:, 0], axis[:, 1]))


def _plane_senses(geometry: ToolPlane, n: int) -> FloatArray:
    """(n,) ``PlanePitch.senses``."""
    senses = np.zeros(n)
    senses[list(geometry.pitch_joints)] = geometry.signs
    return senses


def pitch_rows(robot: Robot, q: FloatArray, length: float, end: float | None) -> PitchRows:
    """The rows that keep the pitch of ``q`` (n,), or lead it evenly to ``end`` [rad] over ``length`` [m]."""
    geometry = robot.inverse_kinematics.plane
    if geometry is not None:
        senses = _plane_senses(geometry, robot.n)
        angle = sum(geometry.plane_angle(k, float(q[joint])) for k, joint in enumerate(geometry.pitch_joints))
        angle += geometry.tool_angle or 0.0
        forward = _reaches_forward(geometry, q, robot.forward(q)[:3, 3])
        turn = 0.0 if end is None else _plane_turn(angle, end, outward=0.0 if forward else math.pi)
        curve = PiecewisePolynomial([0.0, length], [[[float(senses @ q)], [turn / length]]])
        return PlanePitch(senses, curve, offset=angle - float(senses @ q))
    if end is not None and abs(end) > math.pi / 2:
        raise InputError(f"a tool pitch lies within ±90°, got {in_degrees(end)}")
    start = float(elevations(robot, robot.forward(q)[None])[0])
    if end is None and abs(start) > math.pi / 2 - _UPRIGHT:
        return AxisPitch((0, 1), start, 0.0)
    return AxisPitch((2,), start, 0.0 if end is None else (end - start) / length)


def _plane_turn(angle: float, end: float, outward: float) -> float:
    """How far the tool turns in the arm's plane from its angle to an end pitch [rad]."""
    # within ±90° it stays outward or back at the base axis; one that stands upright turns outward
    if abs(end) <= math.pi / 2:
        ahead = math.cos(angle) if abs(math.cos(angle)) >= _UPRIGHT else math.cos(outward)
        end = end if ahead > 0.0 else math.pi - end
    return math.remainder(end - angle, 2.0 * math.pi)


def _reaches_forward(geometry: ToolPlane, q: FloatArray, tool: FloatArray) -> bool:
    """Whether the tool point (3,) lies in front of the arm, not over its back."""
    x, y, _ = geometry.local_of(*tool.tolist())
    turn = geometry.yaw_sign * float(q[0])
    return x * math.cos(turn) + y * math.sin(turn) >= 0.0


# A free tool pitch that leads three parallel pitch joints along a curve inside their limits: over a grid of
# places on the curve and angles of the tool, on the arm's branch, dynamic programming finds the way of least
# joint motion inside the limits, and a smoothing spline makes it a pitch to be led along.

_PLACES = 49
_ANGLES = 360
_REACH = 12
"""by how many angles of the grid the tool may turn from one place to the next"""
_SHIFTS = np.arange(-_REACH, _REACH + 1)
_MARGIN = 5.0 * DEGREE
"""how near to a limit a place begins to cost more [rad]"""
_CLOSE = 0.03
"""what a place on a limit costs, in squared radians of joint motion"""
_BENT, _STRAIGHT = 0.98, 0.9995
"""cosines of the elbow from which a place costs more, and at which it is too nearly straight or folded"""
_SMOOTHINGS = (30.0, 3.0, 0.3)
"""tried in this order: how much a smooth way counts against a near one"""


def led_pitches(robot: Robot, geometry: ToolPlane, q: FloatArray, curve: ToolCurve) -> Iterator[PlanePitch]:
    """Pitches that lead round the limits along a curve that begins at ``q`` (n,), the smoothest first."""
    grid = PitchGrid(geometry, robot.limits, q, curve)
    speeds = robot.speed_limits[1:4]
    way = grid.way((speeds.max() / speeds) ** 2)
    senses = _plane_senses(geometry, robot.n)
    second = np.diff(np.eye(len(way)), 2, axis=0)
    for smoothing in _SMOOTHINGS:
        rows = np.eye(len(way)) + smoothing * second.T @ second
        values = np.zeros(len(way))  # the first one is given
        values[1:] = np.linalg.solve(rows[1:, 1:], way[1:])
        pitch = cubic_spline(grid.places, (float(senses @ q) + values)[:, None])
        yield PlanePitch(senses, pitch, is_wish=False)


class PitchGrid:
    """Three pitch joints on the branch of ``q`` (n,) [rad], at places of a curve and tool angles."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray, q: FloatArray, curve: ToolCurve) -> None:
        places = np.linspace(0.0, curve.length, _PLACES)
        turns = 2.0 * math.pi * np.arange(_ANGLES) / _ANGLES
        forward, left, up = ((curve.positions(places) - geometry.origin) @ geometry.frame).T
        r = np.sqrt(np.maximum(forward**2 + left**2 - geometry.lateral**2, 0.0))
        if not _reaches_forward(geometry, q, curve.positions(0.0)):
            r = -r
        at_start = [geometry.plane_angle(k, float(q[1 + k])) for k in range(3)]
        last = sum(at_start) + turns
        first_length, second_length, third_length = geometry.lengths
        wrist = (r + 1j * up - geometry.shoulder)[:, None] - third_length * np.exp(1j * last)
        cosine = np.abs(wrist) ** 2 - first_length**2 - second_length**2
        cosine /= 2.0 * first_length * second_length
        bend = bend_sense(at_start[1]) * np.arccos(np.clip(cosine, -1.0, 1.0))
        first = np.angle(wrist) - np.angle(first_length + second_length * np.exp(1j * bend))
        plane = np.stack([first, bend, last - first - bend], axis=1)
        signs, offsets = np.array(geometry.signs)[:, None], np.array(geometry.offsets)[:, None]
        low, high = limits[1:4].T[..., None]
        angles = central_images(signs * (plane - offsets), low, high)
        room = np.minimum(angles - low, high - angles)
        toll = _CLOSE * (np.maximum(1.0 - room / _MARGIN, 0.0) ** 2).sum(axis=1)
        toll += _CLOSE * (np.maximum(np.abs(cosine) - _BENT, 0.0) / (_STRAIGHT - _BENT)) ** 2
        toll[(room.min(axis=1) < -LIMIT_TOLERANCE) | (np.abs(cosine) > _STRAIGHT)] = np.inf
        self.places, self.turns, self.q, self.toll = places, turns, angles, toll
        """(m,) [m]; (a,) angle of the tool from that at the start, a whole turn in even steps; (m, 3, a)
        pitch joints, any number where the links do not reach; (m, a) what a place costs, infinite where
        they do not and outside the limits"""

    def way(self, weights: FloatArray) -> FloatArray:
        """(m,) angle of the tool at each place, from that at the start [rad], for the least joint motion.

        ``weights`` (3,) are those of the squared motion of the pitch joints. Where nothing leads on, the
        angle stays what it was.
        """
        count = len(self.turns)
        weighted = self.q * np.sqrt(weights)[:, None]
        # for each shift and angle, the angle that lies the shift away
        around = (np.arange(count) + _SHIFTS[:, None]) % count
        cost = np.where(np.arange(count) == 0, 0.0, np.inf)
        choices: list[NDArray[np.intp]] = []
        for here, ahead, toll in zip(weighted[:-1], weighted[1:], self.toll[1:], strict=True):
            open_ = np.flatnonzero(np.isfinite(toll))  # mostly few: the limits close the rest
            near = around.take(open_, axis=1)
            moved = ahead.take(open_, axis=1)[:, None] - here.take(near, axis=1)
            moved *= moved
            total = moved.sum(axis=0)
            total += cost.take(near)
            best, reached = np.zeros(count, dtype=np.intp), np.full(count, np.inf)
            best[open_] = total.argmin(axis=0)
            reached[open_] = total.min(axis=0) + toll[open_]
            if not np.isfinite(reached).any():
                break
            cost = reached
            choices.append(best)
        at = int(cost.argmin())
        steps = np.zeros(len(self.places), dtype=np.intp)
        for i in range(len(choices), 0, -1):
            shift = int(_SHIFTS[choices[i - 1][at]])
            steps[i] = -shift
            at = (at + shift) % count
        return np.cumsum(steps) * self.turns[1]


# The tool's whole orientation along a path: kept, or turned evenly to another about one axis (slerp).
#
# It enters the equations of a path as three rows: the angular velocity ``Σ z_i q_i'`` of the tool over the
# way. Together with its point these are six equations. Six joints have one way to meet them, and seven a
# continuum. Fewer joints meet them only where the equations happen to agree: yaw, pitch joints and roll
# along a line in the arm's own vertical plane, or with the tool upright, where the roll joint turns
# against the base.


@dataclass(frozen=True, slots=True, eq=False)
class ToolRotation:
    """An orientation that turns at one rate about one axis. Three rows."""

    start: FloatArray
    """(3, 3) ``R_base_tool`` where the path begins"""
    rate: FloatArray
    """(3,) rotation vector a metre of the way, base frame [rad/m]; zeros: it is kept"""
    count: ClassVar[int] = 3
    _sine: FloatArray = field(init=False)
    _rise: FloatArray = field(init=False)
    """(3, 3) each: Rodrigues' formula, times ``start``"""
    _angle: float = field(init=False)
    """turn a metre [rad/m]"""

    def __post_init__(self) -> None:
        angle = float(np.linalg.norm(self.rate))
        x, y, z = (self.rate / angle if angle else self.rate).tolist()
        across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        object.__setattr__(self, "_angle", angle)
        object.__setattr__(self, "_sine", across @ self.start)
        object.__setattr__(self, "_rise", across @ across @ self.start)

    @classmethod
    def between(cls, start: FloatArray, end: FloatArray | None, length: float) -> ToolRotation:
        """From ``start`` (3, 3) the shorter way to ``end`` over ``length`` [m]; None: kept.

        Of half a turn, either way is the shorter; one of them is taken.
        """
        if end is None:
            return cls(start, np.zeros(3))
        return cls(start, rotation_vectors((end @ start.T)[None])[0] / length)

    def at(self, s: float | FloatArray) -> FloatArray:
        """The rotation ``R_base_tool`` (..., 3, 3) that is asked for at ``s`` (...) [m]."""
        angle = self._angle * np.asarray(s, dtype=np.float64)[..., None, None]
        return self.start + np.sin(angle) * self._sine + 2.0 * np.sin(0.5 * angle) ** 2 * self._rise

    def missing(self, q: FloatArray, pose: FloatArray, s: float) -> FloatArray:
        """(count,) turn from the tool pose (4, 4) to that asked for at ``s``, base frame: axis times sine."""
        if self._angle:
            angle = self._angle * s
            wanted = self.start + math.sin(angle) * self._sine + 2.0 * math.sin(0.5 * angle) ** 2 * self._rise
        else:
            wanted = self.start
        (_, b, c), (d, _, f), (g, h, _) = (wanted @ pose[:3, :3].T).tolist()
        return np.array([0.5 * (h - f), 0.5 * (c - g), 0.5 * (d - b)])

    def rates(self, s: float) -> FloatArray:
        """(2, count) angular velocity over the way that is asked for, and its derivative."""
        return np.array([self.rate, np.zeros(3)])

    def tilt(self, q: FloatArray, poses: FloatArray, s: FloatArray) -> FloatArray:
        """(k,) by what angle tool poses (k, 4, 4) are off at ``s`` (k,) [rad]."""
        wanted = self.at(s).swapaxes(1, 2) if self._angle else self.start.T
        return rotation_angle(poses[:, :3, :3] @ wanted)

    def rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(count, n) the angular velocity of the tool for each joint's rate."""
        return jacobian[3:]

    def turned(self, pose: FloatArray, jacobian: FloatArray, rates: FloatArray) -> FloatArray:
        """(count, m) derivative of ``rows`` along links' rates (m,): axes turn with the links before them."""
        axes = jacobian[3:]
        return crossed(np.add.accumulate(axes * rates, axis=1)[None], axes[None])[0]


TurnRows = PitchRows | ToolRotation
"""what is asked of the tool's pitch, or of its orientation, on the way"""

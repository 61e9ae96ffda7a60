"""What the joints must do while the tool follows a curve: equations in the joint angles, and their solution.

With the rows ``c(q) = w(s)`` (the tool point on the curve, the pitch where it is held), A = ∂c/∂q over the
joints that move freely and h the joints that are led (the roll joint, and what the limits hold):

    A q' = w' - A_h h'          A q'' = w'' - Ȧ (q', h')

Where there are as many rows as joints these are solved; where there are fewer, q' is the least motion,
weighted by the joints' speeds, that serves: the least of ½ q'ᵀ W q' + gᵀ q', where g, if asked for, pushes
away from the joint limits. q'' is then the exact derivative of that q' along the path, so that a polynomial
through q, q', q'' at its knots is smooth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from armctl.errors import InputError
from armctl.kinematics import Chain
from armctl.kinematics.numeric.goals import crossed
from armctl.kinematics.tool_plane import ToolPlane
from armctl.motion.paths.tool_curve import ToolCurve
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

# The tool pitch as rows of equations: what must hold of the joint angles along a path, with derivatives.
#
# Pitch is the elevation of the tool's z axis above the horizontal. Each kind of row says the same in a form
# that is smooth where the arm works: for arms with parallel pitch joints as the angle in the arm's own
# vertical plane, which is linear in the joint angles and has no trouble straight up and down; for all others
# as the height of the axis's tip, and straight up or down as its two horizontal parts.

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
    plane, axis = robot.inverse_kinematics.plane, poses[:, :3, 2]
    if plane is not None:
        axis = axis @ plane.frame
    return np.arctan2(axis[:, 2], np.hypot(axis[:, 0], axis[:, 1]))


def plane_senses(geometry: ToolPlane, n: int) -> FloatArray:
    """(n,) what each joint adds to the angle of the tool in the arm's plane: ±1 or 0."""
    senses = np.zeros(n)
    senses[list(geometry.pitch_joints)] = geometry.signs
    return senses


def pitch_rows(robot: Robot, q: FloatArray, length: float, end: float | None) -> PitchRows:
    """The rows that keep the pitch as it is at ``q`` (n,), or lead it evenly to ``end`` [rad].

    Raises:
        InputError: an end beyond ±90° for an arm that has no vertical plane of its own.
    """
    geometry = robot.inverse_kinematics.plane
    if geometry is not None:
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


def reaches_forward(geometry: ToolPlane, q: FloatArray, tool: FloatArray) -> bool:
    """Whether the tool point (3,) lies in front of the arm, not over its back."""
    x, y, _ = geometry.local_of(*tool.tolist())
    turn = geometry.yaw_sign * float(q[0])
    return x * math.cos(turn) + y * math.sin(turn) >= 0.0


_RANK = 1e-9
"""singular values below this share of the largest count as none"""
_WELL = 1e6
"""rows whose inverse is smaller than this, for entries of 1, are solved without their singular values"""
_CONSISTENT = 1e-6
"""how much of the way may be left undone where a direction is lost, and still count as done (share)"""
_CONVERGED = 1e-10
"""a correction this small leaves less than a hundredth of itself to do [rad]"""
_SLOW = 0.01
"""a correction that is a larger share of the one before calls for a new inverse"""
_TOO_FAR = 1.0
"""a correction this large leads to some other place, not to the next one [rad]"""
_CORRECTIONS = 8


@dataclass(frozen=True, slots=True, eq=False)
class Knot:
    """One place of the path, with exact derivatives over the way."""

    s: float
    """[m]"""
    q: FloatArray
    """(n,) [rad]"""
    slope: FloatArray
    """(n,) dq/ds [rad/m]"""
    bend: FloatArray
    """(n,) d²q/ds² [rad/m²]"""


@dataclass(frozen=True, slots=True, eq=False)
class Repulsion:
    """A push away from the joint limits, smooth and bounded."""

    limits: FloatArray
    """(n, 2) [rad]"""
    margin: FloatArray
    """(n,) how far from a limit it begins [rad]"""
    strength: float
    """how fast it would drive a joint that stands on its limit [rad/m]; 0: not at all"""

    def push(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) the push as dq/ds [rad/m], positive near the upper limit, and its derivative by q."""
        if self.strength == 0.0:
            return np.zeros(len(q)), np.zeros(len(q))
        low = np.maximum(1.0 - (q - self.limits[:, 0]) / self.margin, 0.0)
        high = np.maximum(1.0 - (self.limits[:, 1] - q) / self.margin, 0.0)
        change = 3.0 * self.strength * (low**2 + high**2) / self.margin
        return self.strength * (high**3 - low**3), change


@dataclass(frozen=True, slots=True, eq=False)
class ToolTask:
    """The equations of one path. Immutable."""

    chain: Chain
    curve: ToolCurve
    moving: NDArray[np.intp]
    """(f,) the joints that are solved for"""
    led_start: FloatArray
    """(n,) angles of the other joints at the start [rad]; 0 for those that are solved for"""
    led_rate: FloatArray
    """(n,) how fast they go [rad/m]"""
    pitch: PitchRows | None
    speeds: FloatArray
    """(n,) the joints' largest speeds: the weights of the least motion [rad/s]"""
    repulsion: Repulsion

    @property
    def rows(self) -> int:
        """How many equations."""
        return 3 + (0 if self.pitch is None else self.pitch.count)

    @property
    def redundant(self) -> bool:
        """Whether there are more joints than equations."""
        return self.rows < len(self.moving)

    def corrected(self, q: FloatArray, s: float) -> FloatArray | None:
        """The configuration next to ``q`` (n,) that meets the equations at ``s`` [m]; None: not found."""
        led = self.led_start + self.led_rate * s
        led[self.moving] = q[self.moving]
        q = led
        wanted = self.curve.positions(s)
        if self.pitch is not None:
            wanted = np.append(wanted, self.pitch.wanted(s)[0])
        speeds, inverse, before, size = self.speeds[self.moving], None, np.inf, np.inf
        for _ in range(_CORRECTIONS):
            pose = self.chain.forward(q)
            if inverse is None or size > _SLOW * before:
                inverse = _Inverse.of(self._scaled(self._jacobian_rows(pose, self.chain.jacobian(q))))
                if inverse is None:
                    return None
            before = size
            step = speeds * inverse.solve(wanted - self._values(q, pose))
            size = float(np.abs(step).max())
            if not size < _TOO_FAR:
                return None
            q[self.moving] += step
            if size < _CONVERGED:
                return q
        return None

    def knot(self, q: FloatArray, s: float) -> Knot | None:
        """The derivatives at a configuration that meets the equations; None where the rates are infinite."""
        pose, jacobian = self.chain.forward(q), self.chain.jacobian(q)
        A, move = self._jacobian_rows(pose, jacobian), self.moving
        inverse = _Inverse.of(self._scaled(A))
        if inverse is None:
            return None
        _, first, second = self.curve.derivatives(s)
        if self.pitch is not None:
            _, pitch_first, pitch_second = self.pitch.wanted(s)
            first, second = np.append(first, pitch_first), np.append(second, pitch_second)
        first = first - A @ self.led_rate
        speed = self.speeds[move]
        slope, bend = self.led_rate.copy(), np.zeros(len(q))
        if not self.redundant:
            slope[move] = speed * inverse.solve(first)
            if not inverse.meets(slope[move] / speed, first):
                return None
            turned = self._turned_rows(pose, jacobian, slope)
            bend[move] = speed * inverse.solve(second - turned @ slope)
            return Knot(s, q, slope, bend)
        push, push_change = self.repulsion.push(q)
        push, push_change = push[move] / speed**2, push_change[move] / speed**2  # as the gradient g
        multiplier = inverse.multipliers(first + A[:, move] @ (speed**2 * push))
        slope[move] = speed * (inverse.solve(first) - inverse.null(speed * push))
        if not inverse.meets(slope[move] / speed, first):
            return None
        turned = self._turned_rows(pose, jacobian, slope)
        change = turned[:, move].T @ multiplier - push_change * slope[move]
        bend[move] = speed * (inverse.solve(second - turned @ slope) + inverse.null(speed * change))
        return Knot(s, q, slope, bend)

    def _values(self, q: FloatArray, pose: FloatArray) -> FloatArray:
        point = pose[:3, 3]
        return point if self.pitch is None else np.append(point, self.pitch.value(q, pose))

    def _jacobian_rows(self, pose: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(m, n)."""
        if self.pitch is None:
            return jacobian[:3]
        return np.concatenate([jacobian[:3], self.pitch.rows(pose, jacobian)])

    def _turned_rows(self, pose: FloatArray, jacobian: FloatArray, rates: FloatArray) -> FloatArray:
        """(m, n) derivative of the rows along joint rates."""
        rows = carried(jacobian[:3], jacobian[3:], rates)
        return rows if self.pitch is None else np.append(rows, self.pitch.turned(pose, jacobian, rates), 0)

    def _scaled(self, rows: FloatArray) -> FloatArray:
        """The columns of the joints solved for, in units of their speeds."""
        return rows[:, self.moving] * self.speeds[self.moving]


@dataclass(frozen=True, slots=True, eq=False)
class _Inverse:
    """The pseudo-inverse of some rows; lost directions are left out."""

    rows: FloatArray
    """(m, f)"""
    least: FloatArray
    """(f, m) gives the least solution"""
    whole: bool
    """no direction is lost"""

    @classmethod
    def of(cls, rows: FloatArray) -> _Inverse | None:
        """None where the rows are not finite or all zero."""
        if not math.isfinite(_largest(rows)):
            return None
        # most poses: good enough for the normal equations, twice as quick as the singular values
        square = rows.shape[0] == rows.shape[1]
        matrix: FloatArray = rows if square else rows @ rows.T
        inverse = _inverted(matrix)
        if inverse is not None and _largest(matrix) * _largest(inverse) < _WELL:
            least: FloatArray = inverse if square else rows.T @ inverse
            return cls(rows, least, whole=True)
        u, sizes, vt = np.linalg.svd(rows, full_matrices=False)
        rank = int(np.count_nonzero(sizes > _RANK * sizes[0]))
        if not rank:
            return None
        return cls(rows, (vt[:rank].T / sizes[:rank]) @ u[:, :rank].T, whole=rank == len(rows))

    def solve(self, right: FloatArray) -> FloatArray:
        """The least solution."""
        return self.least @ right

    def multipliers(self, right: FloatArray) -> FloatArray:
        """Solution of ``rows rowsᵀ x = right``."""
        return self.least.T @ (self.least @ right)

    def null(self, vector: FloatArray) -> FloatArray:
        """The part of a vector that the rows do not see."""
        return vector - self.least @ (self.rows @ vector)

    def meets(self, solution: FloatArray, right: FloatArray) -> bool:
        """Whether a solution does what is asked for, in lost directions too."""
        if self.whole:
            return True
        missed = float(np.abs(self.rows @ solution - right).max())
        return missed <= _CONSISTENT * max(1.0, float(np.abs(right).max()))


def _inverted(matrix: FloatArray) -> FloatArray | None:
    """None where elimination meets a zero; ``numpy.linalg.inv`` takes nearly twice as long."""
    dgesv = cast("Callable[..., tuple[object, object, FloatArray, int]]", lapack.dgesv)  # pyright: ignore
    _, _, inverse, info = dgesv(matrix, np.eye(len(matrix)))
    return None if info else inverse


def _largest(matrix: FloatArray) -> float:
    """Largest entry without its sign; not a number where one is none."""
    return cast("Callable[..., float]", lapack.dlange)("M", matrix)  # pyright: ignore

"""Recognising arms of the build *yaw + parallel pitch joints (+ roll)*, and their planar geometry.

All that the solvers need is read off the joint axes at the zero pose, so the DH convention, the signs
of alpha and fixed rows make no difference. ``ToolPlane`` says what it is.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import images, into_limits, rest_angle, wrap
from armctl.kinematics.chain import Chain
from armctl.kinematics.tool_plane import ToolPlane

_ALIGNED = 1e-9
"""how far from parallel or perpendicular axes may be (sine of the angle) and offsets from zero [m]"""


def recognise(chain: Chain) -> ToolPlane | None:
    """The arm's planar geometry, or None when it is not of this build.

    Needed: a first joint; two or three joints parallel to each other and perpendicular to it; at most
    one more joint, perpendicular to those and with the tool point on its axis; no link of length zero.
    """
    points, axes = chain.axes()
    tool = chain.forward(np.zeros(chain.n))
    pitch_count = _count_parallel(axes)
    if pitch_count not in (2, 3) or chain.n - 1 - pitch_count not in (0, 1):
        return None
    roll_joint = chain.n - 1 if chain.n == 2 + pitch_count else None
    tip, approach = tool[:3, 3], tool[:3, 2]
    if roll_joint is not None:
        lever = np.cross(tip - points[roll_joint], axes[roll_joint])
        if abs(axes[roll_joint] @ axes[1]) > _ALIGNED or np.linalg.norm(lever) > _ALIGNED:
            return None
    up = axes[0] if axes[0][2] >= -_ALIGNED else -axes[0]
    frame = _plane_frame(up, axes[1], points[1], points[2], tip)
    left = frame[:, 1]
    joints = [_planar(frame, points[0], p) for p in (*points[1 : 1 + pitch_count], tip)]
    links = [b - a for a, b in itertools.pairwise(joints)]
    if min(map(abs, links)) < _ALIGNED:
        return None
    phases = [cmath.phase(link) for link in links]
    along = frame.T @ approach
    # a roll joint that does not turn about the approach axis swings it out of the plane
    swung = 0.0 if roll_joint is None else float(np.linalg.norm(np.cross(axes[roll_joint], approach)))
    in_plane = abs(along[1]) < _ALIGNED and swung < _ALIGNED
    return ToolPlane(
        origin=points[0],
        frame=frame,
        yaw_sign=1 if axes[0] @ up > 0 else -1,
        lateral=_clean(float(left @ (tip - points[0]))),
        shoulder=complex(_clean(joints[0].real), joints[0].imag),
        lengths=tuple(map(abs, links)),
        signs=tuple(-1 if axes[1 + k] @ left > 0 else 1 for k in range(pitch_count)),
        offsets=tuple(
            _clean(wrap(phase - before)) for phase, before in zip(phases, [0.0, *phases[:-1]], strict=True)
        ),
        tool_angle=_clean(wrap(math.atan2(along[2], along[0]) - phases[-1])) if in_plane else None,
        roll_joint=roll_joint,
    )


def _count_parallel(axes: FloatArray) -> int:
    """How many joints after the first are parallel to the second, which must stand across the first."""
    if len(axes) < 3 or abs(axes[0] @ axes[1]) > _ALIGNED:
        return 0
    count = 1
    while 1 + count < len(axes) and np.linalg.norm(np.cross(axes[1 + count], axes[1])) < _ALIGNED:
        count += 1
    return count


def _plane_frame(
    up: FloatArray, pitch: FloatArray, first: FloatArray, second: FloatArray, tip: FloatArray
) -> FloatArray:
    """Forward, left, up; forward is where the tool (else the first link) points with all joints at zero."""
    left = pitch - (pitch @ up) * up
    left /= np.linalg.norm(left)
    forward = np.cross(left, up)
    for reach in (tip - first, second - first):
        if abs(reach @ forward) > 1e-6:
            if reach @ forward < 0:
                left, forward = -left, -forward
            break
    return np.column_stack([forward, left, up])


def _planar(frame: FloatArray, origin: FloatArray, point: FloatArray) -> complex:
    local = frame.T @ (point - origin)
    return complex(float(local[0]), float(local[2]))


def _clean(value: float) -> float:
    """Exactly zero where only rounding is left: offsets of 1e-17 m would cost a branch for nothing."""
    return 0.0 if abs(value) < 1e-14 else value


# The base angle: which way the tool's vertical plane can face so that it passes through the target.

AXIS_TOLERANCE = 1e-10
"""How far inside the cylinder about the base axis a target may lie by rounding [m]."""
_TOUCHING = 1e-15
"""How far outside it a target still lies on it [m]. The forward coordinate is a square root there: rounding
of 1e-17 m would put a joint that stands on its limit 1e-9 rad outside."""


class BaseBranch(NamedTuple):
    """One way for the base to face."""

    front: bool
    """True: the target lies in front of the arm; False: the arm reaches over its back"""
    angle: float
    """θ1 [rad]"""
    r: float
    """forward coordinate of the target in the tool plane [m], negative at the back"""


def is_on_axis(geometry: ToolPlane, x: float, y: float) -> bool:
    """True when any base angle serves: the target and the tool plane both lie on the base axis."""
    return abs(geometry.lateral) <= AXIS_TOLERANCE and math.hypot(x, y) <= AXIS_TOLERANCE


def base_branches(
    geometry: ToolPlane, x: float, y: float, limits: tuple[float, float] | None
) -> list[BaseBranch]:
    """Solve ``x + i y = exp(i s1 θ1) (r + i d)``.

    Args:
        geometry: the arm.
        x: target, forward of the base axis [m].
        y: target, left of the base axis [m].
        limits: of θ1 [rad]; None: any angle, one each way.

    Returns:
        The front branch before the back branch; none when the target lies closer to the base axis than
        the tool plane does. Where any angle serves, the one inside the limits that is nearest to zero is
        given, and its opposite.
    """
    d = geometry.lateral
    rho, aside = math.hypot(x, y), abs(d)
    gap = rho - aside
    if gap <= AXIS_TOLERANCE:
        if gap < -AXIS_TOLERANCE:
            return []
        if is_on_axis(geometry, x, y):
            straight = 0.0 if limits is None else rest_angle(*limits)
            return axis_branches((straight, straight + math.pi), limits)
    r = math.sqrt(gap * (rho + aside)) if gap > _TOUCHING else 0.0
    azimuth, lean, sign = math.atan2(y, x), math.atan2(d, r) if d else 0.0, geometry.yaw_sign
    branches: list[BaseBranch] = []
    for angle in _inside(sign * (azimuth - lean), limits):
        branches.append(BaseBranch(True, angle, r))
    for angle in _inside(sign * (azimuth + lean - math.pi), limits) if r else ():  # else it is the same one
        branches.append(BaseBranch(False, angle, -r))
    return branches


def axis_branches(turns: Sequence[float], limits: tuple[float, float] | None) -> list[BaseBranch]:
    """Branches for a target on the base axis, at the angles wanted [rad]: the first in front, others not."""
    return [BaseBranch(i == 0, angle, 0.0) for i, turn in enumerate(turns) for angle in _inside(turn, limits)]


def _inside(turn: float, limits: tuple[float, float] | None) -> list[float]:
    if limits is None:
        return [wrap(turn)]
    low, high = limits
    return images(turn, low, high)


def base_angles(
    geometry: ToolPlane, x: FloatArray, y: FloatArray, limits: tuple[float, float]
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """``base_branches`` of many targets: the image inside the limits that is nearest to zero.

    Args:
        geometry: the arm.
        x: (k,) targets, forward of the base axis [m].
        y: (k,) targets, left of the base axis [m].
        limits: of θ1 [rad].

    Returns:
        θ1 [rad] in front and at the back (2, k); forward coordinates in the tool plane [m] (2, k); and
        where there is such a branch (2, k).
    """
    d = geometry.lateral
    square = x * x + y * y - d * d
    r = np.sqrt(np.where(square > 2.0 * _TOUCHING * abs(d), square, 0.0))
    azimuth = np.arctan2(y, x)
    aside = np.arctan2(d, r) if d else 0.0
    yaw = np.stack([azimuth - aside, azimuth + aside - math.pi])
    if geometry.yaw_sign < 0:
        np.negative(yaw, out=yaw)
    on_axis = np.flatnonzero(r <= AXIS_TOLERANCE)
    if abs(d) <= AXIS_TOLERANCE and len(on_axis):
        yaw[0, on_axis] = rest_angle(*limits)
        yaw[1, on_axis] = yaw[0, on_axis] + math.pi
    inside = into_limits(yaw, *limits)
    if d:  # closer to the axis than the tool plane; or both branches the same one
        inside &= square >= -2.0 * AXIS_TOLERANCE * abs(d)
        inside[1] &= r > 0.0
    return yaw, np.stack([r, -r]), inside


# Where the tool points in the vertical plane: what a pitch above the horizontal asks for.


@dataclass(frozen=True, slots=True)
class PlanePose:
    """Tool direction in the vertical plane and roll."""

    tool_angle: float | None
    """plane angle of the approach axis above forward [rad]; None: whatever the position gives"""
    roll: float
    """angle of the roll joint [rad]; 0 where there is none"""


def pitch_poses(pitch: float | None, roll: float) -> list[PlanePose]:
    """Plane angles that hold the tool at a pitch above the horizontal.

    A pitch within ±90° is met by a tool that points away from the base axis and by one that points back
    at it. Beyond ±90° the angle is taken as it is, in the arm's own plane: the tool points back.
    """
    if pitch is None:
        return [PlanePose(None, roll)]
    if abs(pitch) > math.pi / 2:
        return [PlanePose(pitch, roll)]
    return [PlanePose(pitch, roll), PlanePose(math.pi - pitch, roll)]


# Names of the branches of *yaw + parallel pitch joints (+ roll)*.

BRANCHES = tuple(
    f"{base} elbow-{elbow}{tool}"
    for base, elbow, tool in itertools.product(("front", "back"), ("up", "down"), ("", " tool-in"))
)
"""Index: 4 · back + 2 · elbow down + tool pointing back at the base axis."""
LEVEL = 1e-9
"""how near to upright a tool points neither outward nor back at the base axis (cosine)"""


def bend_sense(angle: float) -> int:
    """+1 or -1: the side to which a plane angle [rad] bends."""
    return 1 if wrap(angle) >= 0 else -1


def branch_index(front: bool, bend: int, tool_in: bool = False) -> int:
    """Index into ``BRANCHES``.

    A positive bend leaves the elbow below the line to the target in front, above it at the back.
    """
    elbow_up = (bend < 0) == front
    return 4 * (not front) + 2 * (not elbow_up) + tool_in


def tool_points_in(branch: BaseBranch, pose: PlanePose) -> bool:
    """True when the tool points back at the base axis."""
    if pose.tool_angle is None:
        return False
    outward = math.cos(pose.tool_angle) if branch.front else -math.cos(pose.tool_angle)
    return outward < -LEVEL

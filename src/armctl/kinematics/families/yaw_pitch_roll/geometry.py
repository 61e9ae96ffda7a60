"""Recognising arms of the build *yaw + parallel pitch joints (+ roll)*, and their planar geometry.

All that the solvers need is read off the joint axes at the zero pose, so the DH convention, the signs
of alpha and fixed rows make no difference. ``ToolPlane`` says what it is.
"""

from __future__ import annotations

import cmath
import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import images, into_limits, rest_angle, wrap
from armctl.kinematics.chain import Chain
from armctl.kinematics.subproblems import ToolPlane

_ALIGNED = 1e-9
"""how far from parallel or perpendicular axes may be (sine of the angle) and offsets from zero [m]"""


def recognise(chain: Chain) -> ToolPlane | None:
    """The arm's planar geometry, or None when it is not of this build.

    Needed: a first joint; two or three parallel joints perpendicular to it; at most one more, perpendicular
    to those and with the tool point on its axis; no link of length zero.
    """
    points, axes = chain.axes()
    tool = chain.forward(np.zeros(chain.n))
    tip, approach = tool[:3, 3], tool[:3, 2]
    if len(axes) < 3 or abs(axes[0] @ axes[1]) > _ALIGNED:
        return None
    across = [np.linalg.norm(np.cross(axis, axes[1])) >= _ALIGNED for axis in axes[1:]]
    count = (*across, True).index(True)
    if count not in (2, 3) or chain.n - 1 - count not in (0, 1):
        return None
    roll_joint = chain.n - 1 if chain.n == 2 + count else None
    swung = 0.0
    if roll_joint is not None:
        roll = axes[roll_joint]
        if abs(roll @ axes[1]) > _ALIGNED or np.linalg.norm(np.cross(tip - points[-1], roll)) > _ALIGNED:
            return None
        swung = float(np.linalg.norm(np.cross(roll, approach)))
    up = axes[0] if axes[0][2] >= -_ALIGNED else -axes[0]
    left = axes[1] - (axes[1] @ up) * up
    left /= np.linalg.norm(left)
    forward = np.cross(left, up)
    # forward is where the tool (else the first link) points with all joints at zero
    ahead = next((a for p in (tip, points[2]) if abs(a := (p - points[1]) @ forward) > 1e-6), 1.0)
    if ahead < 0:
        left, forward = -left, -forward
    frame = np.column_stack([forward, left, up])
    local = (np.array([*points[1 : 1 + count], tip]) - points[0]) @ frame
    joints = [complex(x, z) for x, _, z in local.tolist()]
    links = [b - a for a, b in itertools.pairwise(joints)]
    if min(map(abs, links)) < _ALIGNED:
        return None
    phases = [0.0, *map(cmath.phase, links)]
    along = frame.T @ approach
    in_plane = abs(along[1]) < _ALIGNED and swung < _ALIGNED
    return ToolPlane(
        origin=points[0],
        frame=frame,
        yaw_sign=1 if axes[0] @ up > 0 else -1,
        lateral=_clean(float(left @ (tip - points[0]))),
        shoulder=complex(_clean(joints[0].real), joints[0].imag),
        lengths=tuple(map(abs, links)),
        signs=tuple(-1 if axis @ left > 0 else 1 for axis in axes[1 : 1 + count]),
        offsets=tuple(_clean(wrap(phase - before)) for before, phase in itertools.pairwise(phases)),
        tool_angle=_clean(wrap(math.atan2(along[2], along[0]) - phases[-1])) if in_plane else None,
        roll_joint=roll_joint,
    )


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
    """Solve ``x + i y = exp(i s1 θ1) (r + i d)`` for a target x forward, y left of the base axis [m].

    Inside the limits of θ1 [rad], or (None) at any angle, one each way; front branches first. None closer to
    the axis than the tool plane. Where any angle serves, the one nearest to zero is given, and its opposite.
    """
    d = geometry.lateral
    rho, aside = math.hypot(x, y), abs(d)
    gap = rho - aside
    if gap < -AXIS_TOLERANCE:
        return []
    on_axis = gap <= AXIS_TOLERANCE and is_on_axis(geometry, x, y)
    if on_axis:
        r, front = 0.0, 0.0 if limits is None else rest_angle(*limits)
        back = front + math.pi
    else:
        r = math.sqrt(gap * (rho + aside)) if gap > _TOUCHING else 0.0
        azimuth, lean, sign = math.atan2(y, x), math.atan2(d, r) if d else 0.0, geometry.yaw_sign
        front, back = sign * (azimuth - lean), sign * (azimuth + lean - math.pi)
    found: list[BaseBranch] = []
    for angle in [wrap(front)] if limits is None else images(front, *limits):
        found.append(BaseBranch(True, angle, r))
    if r or on_axis:  # else it is the same one
        for angle in [wrap(back)] if limits is None else images(back, *limits):
            found.append(BaseBranch(False, angle, -r))
    return found


def base_angles(
    geometry: ToolPlane,
    x: FloatArray,
    y: FloatArray,
    limits: tuple[float, float],
    lateral: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """``base_branches`` of targets x, y (k,): the image inside the limits that is nearest to zero.

    ``lateral`` (k,) are offsets of the tool plane instead of the geometry's [m]. The answer:
    θ1 [rad] in front and at the back (2, k); forward coordinates in the tool plane [m] (2, k); and where
    there is such a branch (2, k).
    """
    d = geometry.lateral if lateral is None else lateral
    aside_of_axis = lateral is not None or geometry.lateral != 0.0
    square = x * x + y * y - d * d
    r = np.sqrt(np.where(square > 2.0 * _TOUCHING * abs(d), square, 0.0))
    azimuth = np.arctan2(y, x)
    aside = np.arctan2(d, r) if aside_of_axis else 0.0
    yaw = np.stack([azimuth - aside, azimuth + aside - math.pi])
    if geometry.yaw_sign < 0:
        np.negative(yaw, out=yaw)
    on_axis = np.flatnonzero((r <= AXIS_TOLERANCE) & (abs(d) <= AXIS_TOLERANCE))
    if len(on_axis):
        yaw[0, on_axis] = rest_angle(*limits)
        yaw[1, on_axis] = yaw[0, on_axis] + math.pi
    inside = into_limits(yaw, *limits)
    if aside_of_axis:  # closer to the axis than the tool plane; or both branches the same one
        inside &= square >= -2.0 * AXIS_TOLERANCE * abs(d)
        inside[1] &= r > 0.0
    return yaw, np.stack([r, -r]), inside


def tool_angles(pitch: float | None) -> list[float | None]:
    """Plane angles of the approach axis [rad] that hold the tool at a pitch above the horizontal [rad].

    A pitch within ±90° is met by a tool that points outward and by one that points back at the base axis,
    beyond ±90° by the latter only. Without a pitch: None, whatever the position gives.
    """
    if pitch is None or abs(pitch) > math.pi / 2:
        return [pitch]
    return [pitch, math.pi - pitch]


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


def tool_points_in(branch: BaseBranch, tool_angle: float | None) -> bool:
    """True when the tool, at a plane angle [rad] or any, points back at the base axis."""
    if tool_angle is None:
        return False
    outward = math.cos(tool_angle) if branch.front else -math.cos(tool_angle)
    return outward < -LEVEL

"""Any chain of turning joints as Denavit-Hartenberg rows, with the base, the zeros and the tool kept exactly.

Between the axes of two joints lies a fixed transform. With both axes along z it is

    F = Rz(θ1) Tz(d1) · Tx(a) Rx(α) · Rz(θ2) Tz(d2)

and the turns about z merge with those of the joints on either side: one standard row a joint, one fixed row
ahead of the first and one behind the last. Where the common normal of two slanted axes lies far from both
joints, two rows lead from joint to joint instead: what is drawn, and kept off the floor, goes along the rows.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import DHRow
from armctl.kinematics.angles import wrap

FloatArray = NDArray[np.float64]
_PARALLEL = 1e-14
"""sine of the angle below which two axes are parallel"""
_SLANTED = 0.05
"""sine below which the common normal of two axes lies so far off that its lengths would lose digits"""
_FARTHEST = 1.001
"""times the way between two joints; a common normal that meets the second axis farther off is no link"""
_NOTHING = 1e-15
"""lengths [m] and angles [rad] below this are rounding"""
_NONE = DHRow(0.0, 0.0, 0.0, 0.0, joint=False)


def rows_of(origins: Sequence[FloatArray], axes: Sequence[FloatArray], tool: FloatArray) -> list[DHRow]:
    """Standard rows of a chain of turning joints.

    Args:
        origins: n poses (4, 4) of each joint's frame, at zero, in the frame that the joint ahead of it turns
            (the first one: in the base frame) [m].
        axes: n unit vectors (3,) that the joints turn about, each in its own joint's frame.
        tool: (4, 4) the tool frame in the frame that the last joint turns [m].

    Returns:
        Rows whose forward kinematics are ``∏ origin · Rot(axis, q)``, then ``tool``.
    """
    upright = [frame_along(axis) for axis in axes]
    between = [origin @ frame for origin, frame in zip([*origins, tool], [*upright, np.eye(4)], strict=True)]
    for k, frame in enumerate(upright):
        between[k + 1] = frame.T @ between[k + 1]
    rows: list[DHRow] = []
    waiting = _NONE
    for k, fixed in enumerate(between):
        parts, closing = _decomposed(fixed)
        for part in parts:
            rows.append(_merged(waiting, part))
            waiting = _NONE
        waiting = _merged(waiting, closing)
        if k < len(axes):
            if waiting.joint:  # two joints turn about the same line with nothing in between
                rows.append(waiting)
                waiting = _NONE
            waiting = replace(waiting, joint=True)
    return [*rows, waiting] if waiting.joint or waiting != _NONE else rows


def _merged(waiting: DHRow, part: DHRow) -> DHRow:
    """A turn about and shift along z, then a row: one row."""
    return DHRow(
        a_m=part.a_m,
        alpha_rad=part.alpha_rad,
        d_m=waiting.d_m + part.d_m,
        theta_rad=wrap(waiting.theta_rad + part.theta_rad),
        joint=waiting.joint,
    )


def _fixed(theta: float, d: float, a: float = 0.0, alpha: float = 0.0) -> DHRow:
    return DHRow(_clean(a), _clean(wrap(alpha)), _clean(d), _clean(wrap(theta)), joint=False)


def _clean(value: float) -> float:
    return 0.0 if abs(value) < _NOTHING else value


def _decomposed(F: FloatArray) -> tuple[list[DHRow], DHRow]:
    """A fixed transform (4, 4) as fixed rows and a closing turn about and shift along z."""
    (r00, r01, r02), (r10, r11, r12), (_, _, r22) = F[:3, :3].tolist()
    x, y, z = F[:3, 3].tolist()
    facing = 1.0 if r22 > 0 else -1.0
    turn = math.atan2(r10 - facing * r01, r00 + facing * r11)  # θ1 ± θ2, sound also where the axes align
    sine = math.hypot(r02, r12)
    if sine < _PARALLEL:
        offset = math.hypot(x, y)
        first = math.atan2(y, x) if offset > _NOTHING else turn  # any θ1 will do
        row = _fixed(first, z, offset, 0.0 if r22 > 0 else math.pi)
        if row.a_m == row.alpha_rad == 0.0:
            return [], _fixed(turn, z)
        return [row], _fixed(facing * (turn - first), 0.0)
    theta, alpha = math.atan2(r02, -r12), math.atan2(sine, r22)
    if abs(theta) > math.pi / 2 + 1e-9:  # of the two ways the one with the smaller turn
        theta, alpha = theta - math.pi, -alpha
    closing = facing * (turn - theta)
    c, s = math.cos(theta), math.sin(theta)
    shift = (s * x - c * y) / math.sin(alpha)
    if sine < _SLANTED or abs(shift) > _FARTHEST * math.hypot(x, y, z):
        along = math.atan2(y, x)
        ahead = [_fixed(along, z, math.hypot(x, y)), _fixed(theta - along, 0.0, 0.0, alpha)]
        return ahead, _fixed(closing, 0.0)
    return [_fixed(theta, z - shift * r22, c * x + s * y, alpha)], _fixed(closing, shift)


def frame_along(axis: FloatArray) -> FloatArray:
    """(4, 4) a turn that takes z to a unit vector, the smallest there is."""
    x, y, z = axis.tolist()
    T = np.eye(4)
    if math.hypot(x, y) < _PARALLEL:
        T[1, 1] = T[2, 2] = math.copysign(1.0, z)
    elif z > -0.5:
        h = 1.0 / (1.0 + z)
        T[:3, :3] = [[1 - h * x * x, -h * x * y, x], [-h * x * y, 1 - h * y * y, y], [-x, -y, z]]
    else:  # half a turn about x first: 1 + z has no digits near -1
        h = 1.0 / (1.0 - z)
        T[:3, :3] = [[1 - h * x * x, h * x * y, x], [-h * x * y, h * y * y - 1, y], [x, -y, z]]
    return T

"""One pitch joint of three held where |θ| has an end or a kink: what is left is a triangle."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from armctl.kinematics.two_link import bend_angle, inner_angle
from armctl.kinematics.yaw_pitch_roll.geometry import YawPitchRoll
from armctl.kinematics.yaw_pitch_roll.joint_windows import nearest_image

Turned = tuple[float, float, float, float]
"""what the pitch joints turn in all, and their angles [rad]"""


class PitchJoint(NamedTuple):
    """θ = sense · (t - offset), t the plane angle; between limits [rad]."""

    sense: int
    offset: float
    low: float
    high: float


class Lock(NamedTuple):
    """One pitch joint held; the other two follow from a triangle."""

    spent: float
    """|θ| of the joint [rad]"""
    joint: int
    """0: first, 1: second, 2: third pitch joint"""
    angle: float
    """θ [rad]"""
    x: float
    y: float
    """with the first joint held, the end of its link [m]; else 0"""
    near: float
    far: float
    """the two links of the triangle [m]"""
    lag: float
    lead: float
    """plane angles of the free joints: the first angle less ``lag``, the bend and ``lead`` [rad]"""
    first: PitchJoint
    second: PitchJoint
    """the free joints"""


def pitch_locks(geometry: YawPitchRoll, joints: Sequence[PitchJoint]) -> list[Lock]:
    """The locks of an arm with three pitch joints, by how much the locked one turns, least first."""
    locks = [lock for k in range(3) for lock in _locks_of(geometry, k, joints)]
    return sorted(locks, key=lambda lock: lock.spent)


def _locks_of(geometry: YawPitchRoll, k: int, joints: Sequence[PitchJoint]) -> Iterator[Lock]:
    """A pitch joint at its limits and at zero; the second one also where sin t3 = 0."""
    _, _, low, high = joints[k]
    angles = {low, high, *((0.0,) if low < 0 < high else ())}
    if k == 1:
        straight = (geometry.joint_angle(1, v) for v in (0.0, math.pi))
        angles |= {a for v in straight if (a := nearest_image(v, low, high)) is not None}
    l2, l3, l4 = geometry.lengths
    free = [joint for i, joint in enumerate(joints) if i != k]
    for angle in angles:
        v = geometry.plane_angle(k, angle)
        before, behind = ((0.0, l2), (l2, l3), (l3, l4))[k]
        whole = before + behind * cmath.exp(1j * v)  # the links that the joint holds together, as one
        length, turn = abs(whole), cmath.phase(whole)
        if k == 0:
            yield Lock(abs(angle), 0, angle, whole.real, whole.imag, l3, l4, v, 0.0, *free)
        elif length > 1e-12 and k == 1:
            yield Lock(abs(angle), 1, angle, 0.0, 0.0, length, l4, turn, turn - v, *free)
        elif length > 1e-12:
            yield Lock(abs(angle), 2, angle, 0.0, 0.0, l2, length, 0.0, -turn, *free)


def bent_lock(lock: Lock, side: int, x: float, y: float) -> Turned | None:
    """The posture of a lock that reaches a point, if the free joints are inside their limits.

    Args:
        lock: which joint is held, and where.
        side: +1: the bend is positive, -1: negative; links in line are found with +1 alone.
        x: the point seen from the first pitch axis, forward [m].
        y: and upward [m].
    """
    spent, joint, angle, held_x, held_y, near, far, lag, lead, first, second = lock
    x, y = x - held_x, y - held_y
    bend = bend_angle(x * x + y * y, near, far)
    if bend is None or (side < 0 and (bend == 0.0 or bend == math.pi)):
        return None
    sense, offset, low, high = second
    b = nearest_image(sense * (side * bend + lead - offset), low, high)
    if b is None:
        return None
    sense, offset, low, high = first
    towards = math.atan2(y, x) - side * inner_angle(near, far, bend) - lag
    a = nearest_image(sense * (towards - offset), low, high)
    if a is None:
        return None
    turn = spent + abs(a) + abs(b)
    return (turn, angle, a, b) if joint == 0 else (turn, a, angle, b) if joint == 1 else (turn, a, b, angle)

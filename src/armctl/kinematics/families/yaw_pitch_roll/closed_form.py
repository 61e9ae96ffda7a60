"""The closed form of the tool plane, for one pose in plain floats and for many in arrays.

Everything comes down to the triangle of two links that reach a point (x, y), seen from the first joint:

    cos(bend) = (x² + y² - a² - b²) / 2ab
    first     = arg(x + i y) ∓ atan2(b sin(bend), a + b cos(bend))       for a bend of ± that angle

With three pitch joints a pitch gives the direction of the last link, and what is left is that triangle.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from math import acos, atan2, cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import (
    LIMIT_TOLERANCE,
    TWO_PI,
    half_angle_cos_sin,
    images,
    into_limits,
    nearest_image,
    rest_angle,
    wrap,
)
from armctl.kinematics.families.yaw_pitch_roll.geometry import (
    BRANCHES,
    LEVEL,
    base_angles,
    bend_sense,
    branch_index,
)
from armctl.kinematics.solutions import BatchSolutions
from armctl.kinematics.subproblems import ToolPlane

Rows = NDArray[np.intp]
REACH_TOLERANCE = 1e-12
"""how far beyond the two links' reach rounding may carry a target [m]"""
ON_JOINT = 1e-12
"""how near to the first joint a target says nothing about the direction of links folded onto it [m]"""
_STRETCHED = 1.0 - 1e-13
"""From this cosine on the links count as stretched: the angle is lost in rounding (1e-16 in the cosine is
1e-8 rad), and a joint that stands on its limit would seem outside; the tip moves 1e-14 m."""
_FOLDING = -1.0 + 1e-6
"""up to this cosine the half angle is taken"""
_FOLDED = 1e-14
"""how far a tip may lie from where two folded links bring it [m]"""


def bend_angle(square: float, a: float, b: float) -> float | None:
    """The bend in [0, pi] of two links (a, b > 0 [m]) with the tip at a squared distance, if they reach."""
    cosine = (square - a * a - b * b) / (2.0 * a * b)
    if _FOLDING <= cosine <= _STRETCHED:
        return acos(cosine)
    distance = sqrt(square)
    if cosine > 0.0:
        return 0.0 if distance - (a + b) <= REACH_TOLERANCE else None
    least = abs(a - b)
    if distance <= least + _FOLDED:
        return math.pi if distance >= least - REACH_TOLERANCE else None
    # the half angle keeps its digits where the arc cosine loses them
    return math.pi - 2.0 * math.asin(sqrt((distance - least) * (distance + least) / (4.0 * a * b)))


def inner_angle(a: float, b: float, bend: float) -> float:
    """Direction of the tip of two links against the first [rad]; ``bend`` as ``bend_angle`` has it."""
    if bend == 0.0 or bend == math.pi:
        return math.pi if bend and b > a else 0.0
    return atan2(b * sin(bend), a + b * cos(bend))


def two_link(x: float, y: float, a: float, b: float) -> list[tuple[float, float]]:
    """``(first, bend)`` [rad] of two links (a, b > 0 [m]) that reach a point x along, y across [m].

    None, one (stretched or folded) or two (bend positive first). On the first joint itself (a = b, folded)
    the direction is undefined and 0 is given.
    """
    bend = bend_angle(x * x + y * y, a, b)
    if bend is None:
        return []
    direction, inner = atan2(y, x), inner_angle(a, b, bend)
    if bend == 0.0 or bend == math.pi:
        return [(direction - inner, bend)]
    return [(direction - inner, bend), (direction + inner, -bend)]


# Postures of the pitch joints that bring the tip to a point of the tool plane, special places included.

_PITCH_TOLERANCE = 1e-6
"""how far from the pitch asked for two pitch joints may leave the tool [rad]"""


class PlanePostures:
    """The closed form in the tool plane of one arm. Immutable; safe in several threads."""

    def __init__(self, geometry: ToolPlane, limits: FloatArray) -> None:
        self.geometry = geometry
        self._limits = [(float(low), float(high)) for low, high in limits[1 : 1 + len(geometry.lengths)]]

    def at(self, r: float, z: float, tool_angle: float | None) -> list[tuple[float, ...]]:
        """Plane angles [rad] of a tip forward and up of the base origin [m], limits not looked at.

        With the plane angle of the approach axis [rad], or with any (two pitch joints). Folded onto its own
        first axis the arm may point anywhere: then one posture is inside the limits if any is.
        """
        lengths, shoulder = self.geometry.lengths, self.geometry.shoulder
        x, y = r - shoulder.real, z - shoulder.imag
        if tool_angle is None:
            return self._pairs(x, y, None) if len(lengths) == 2 else []
        last = tool_angle - (self.geometry.tool_angle or 0.0)  # absolute direction of the last link
        if len(lengths) == 2:
            pairs = self._pairs(x, y, last)
            return [p for p in pairs if abs(wrap(sum(p) - last)) < _PITCH_TOLERANCE]
        return self.reaching(x - lengths[2] * cos(last), y - lengths[2] * sin(last), last)

    def reaching(self, x: float, y: float, last: float | None) -> list[tuple[float, ...]]:
        """``at`` for the end of the second link, with the direction of the third [rad] if there is one."""
        pairs = self._pairs(x, y, last)
        return pairs if last is None else [(*pair, last - sum(pair)) for pair in pairs]

    def _pairs(self, x: float, y: float, last: float | None) -> list[tuple[float, ...]]:
        """Angles of the first two links; ``last`` is the direction of the arm's last link."""
        pairs = two_link(x, y, self.geometry.lengths[0], self.geometry.lengths[1])
        if not pairs or math.hypot(x, y) > ON_JOINT:
            return list(pairs)
        bend = pairs[0][1]
        firsts = [self.geometry.plane_angle(0, way) for way in (0.0, *self._limits[0])]
        if last is not None and len(self.geometry.lengths) == 2:
            firsts.append(last - bend)
        elif last is not None:
            firsts += [last - bend - self.geometry.plane_angle(2, way) for way in (0.0, *self._limits[2])]
        return [(first, bend) for first in firsts]

    def joint_images(self, plane: tuple[float, ...]) -> list[tuple[float, ...]]:
        """Every set of joint angles inside the limits that has these plane angles [rad]."""
        angles = (self.geometry.joint_angle(k, angle) for k, angle in enumerate(plane))
        return list(itertools.product(*(images(q, *self._limits[k]) for k, q in enumerate(angles))))

    def inside(self, r: float, z: float, tool_angle: float | None) -> list[tuple[float, ...]]:
        """``at`` as joint angles inside the limits [rad]."""
        return [angles for plane in self.at(r, z, tool_angle) for angles in self.joint_images(plane)]


# One pose in plain floats.

_Postures = tuple[list[int], list[tuple[float, ...]]]
PoseFunction = Callable[[float, float, float, float, Sequence[float]], _Postures | None]
"""(x, y, z, pitch, rolls): every configuration inside the limits, in the order of the general solver.

A tool point in the base frame [m], the pitch [rad], and what the roll joint may be at [rad], one number for
an arm without one. Gives indices into ``BRANCHES`` and joint angles [rad]; None at a special place.
"""
UPRIGHT = 5e-13
"""how near to ±90° the two readings of a pitch are one [rad]"""
_EDGE = 1e-9
"""how near to the base axis the general solver takes over [m²]"""
_SURE, _REACHED = 1.0 - 1e-9, 1.0 + 1e-9
"""between these cosines of the elbow rounding decides"""
_SAME_LENGTH = 1e-15
"""links whose lengths differ by no more are equal but for rounding, and make an isosceles triangle [m]"""


def pose_function(geometry: ToolPlane, limits: FloatArray) -> PoseFunction | None:
    """Position, pitch and roll of the usual arm, in a tenth of the time that ``PlanePostures`` takes.

    That one does what is special: links in line or folded, a target on the base axis (the function gives
    None), and arms with two pitch joints, without a pitch or with a joint that may turn a whole turn (None).
    """
    wide = limits[:4, 1] - limits[:4, 0] >= TWO_PI - 2 * LIMIT_TOLERANCE
    if len(geometry.lengths) != 3 or geometry.tool_angle is None or wide.any():
        return None
    d, tool, (l2, l3, l4) = geometry.lateral, geometry.tool_angle, geometry.lengths
    (x0, y0, z0), rows, stands = geometry.origin.tolist(), geometry.frame.T.tolist(), geometry.upright
    forward, height = geometry.shoulder.real, geometry.shoulder.imag
    yaw_sign, (s2, s3, s4), (o2, o3, o4) = geometry.yaw_sign, geometry.signs, geometry.offsets
    squares, scale, isosceles = l2 * l2 + l3 * l3, 0.5 / (l2 * l3), abs(l2 - l3) < _SAME_LENGTH
    most, rolling = math.pi / 2 - UPRIGHT, geometry.roll_joint is not None
    yaw_inside, shoulder_inside, elbow_inside, wrist_inside = map(_inside, limits[:4].tolist())

    def at(x: float, y: float, z: float, pitch: float, rolls: Sequence[float]) -> _Postures | None:
        if not stands:
            x, y, z = x - x0, y - y0, z - z0
            x, y, z = (a * x + b * y + c * z for a, b, c in rows)
        square = x * x + y * y - d * d
        if not square >= _EDGE:
            return None
        r, azimuth = sqrt(square), atan2(y, x)
        aside = atan2(d, r) if d else 0.0
        outward, z = cos(pitch), z - height
        index, found = list[int](), list[tuple[float, ...]]()
        readings = [(pitch - tool, outward < -LEVEL, outward > LEVEL)]
        if -most <= pitch <= most:  # beyond, there is one reading, whichever way it points
            readings.append((math.pi - tool - pitch, outward > LEVEL, outward < -LEVEL))
        for back, facing, ahead in ((0, azimuth - aside, r), (1, azimuth + aside - math.pi, -r)):
            if (yaw := yaw_inside(yaw_sign * facing)) is None:
                continue
            for last, *inward in readings:
                x, y = ahead - forward - l4 * cos(last), z - l4 * sin(last)
                cosine = (x * x + y * y - squares) * scale
                if not -_SURE < cosine < _SURE:
                    if -_REACHED < cosine < _REACHED:
                        return None
                    continue
                bend, direction = acos(cosine), atan2(y, x)
                inner = 0.5 * bend if isosceles else atan2(l3 * sqrt(1.0 - cosine * cosine), l2 + l3 * cosine)
                # a positive bend is down in front
                for first, turn, branch in (
                    (direction - inner, bend, 4 if back else 2),
                    (direction + inner, -bend, 6 if back else 0),
                ):
                    if (elbow := elbow_inside(s3 * (turn - o3))) is None:
                        continue
                    if (shoulder := shoulder_inside(s2 * (first - o2))) is None:
                        continue
                    if (wrist := wrist_inside(s4 * (last - first - turn - o4))) is not None:
                        for roll in rolls:
                            index.append(branch + inward[back])
                            joints = yaw, shoulder, elbow, wrist
                            found.append((*joints, roll) if rolling else joints)
        return index, found

    return at


def _inside(limits: tuple[float, float]) -> Callable[[float], float | None]:
    """Puts an angle inside limits [rad] less than a turn apart; None where no image of it is there."""
    low, high = limits
    above, below = high + 2 * LIMIT_TOLERANCE, low - 2 * LIMIT_TOLERANCE

    def inside(angle: float) -> float | None:
        if low <= angle <= high:
            return angle
        if above < angle < below + TWO_PI or above - TWO_PI < angle < below:  # in a gap between images
            return None
        return nearest_image(angle, low, high)

    return inside


# Many poses in arrays: each way to face the target with each reading of its pitch, and both elbows of each.

_CHUNK = 16_384
"""poses worked on at a time: more would leave the cache"""


def solve_batch(
    planar: PlanePostures,
    limits: FloatArray,
    position: FloatArray,
    pitch: FloatArray | None,
    roll: FloatArray | None,
) -> BatchSolutions:
    """Every branch of many poses of an arm inside its limits (n, 2) [rad].

    Tool points (k, 3) in the base frame [m]; pitch (k,) [rad], None with two pitch joints; angle (k,) of the
    roll joint [rad], None: the one nearest to zero.
    """
    k = len(position)
    q = np.empty((len(limits), len(BRANCHES), k))  # joint by joint in memory, as it is computed
    if pitch is None:
        q.fill(np.nan)  # else branch by branch, while it is in the cache
    found = np.zeros((len(BRANCHES), k), dtype=np.bool_)
    for at in range(0, k, _CHUNK):
        cut = slice(at, at + _CHUNK)
        p, w = (None if angle is None else angle[cut] for angle in (pitch, roll))
        with np.errstate(invalid="ignore", divide="ignore"):
            _solve_chunk(planar, limits, position[cut], p, w, q[..., cut], found[:, cut])
    return BatchSolutions(q.transpose(2, 1, 0), found.T, BRANCHES)


def _solve_chunk(
    planar: PlanePostures,
    limits: FloatArray,
    position: FloatArray,
    pitch: FloatArray | None,
    roll: FloatArray | None,
    q: FloatArray,
    found: NDArray[np.bool_],
) -> None:
    """``solve_batch`` for some poses, written into ``q`` (n, branches, m) and ``found`` (branches, m)."""
    geometry, ranges = planar.geometry, limits.tolist()
    local = position if geometry.upright else (position - geometry.origin) @ geometry.frame
    forward, left, up = np.ascontiguousarray(local.T)
    yaw, r, faces = base_angles(geometry, forward, left, ranges[0])
    np.clip(yaw, *ranges[0], out=yaw)
    rolls = _held_rolls(geometry, ranges, roll, faces)
    r -= geometry.shoulder.real
    up -= geometry.shoulder.imag
    l2, l3, *_ = geometry.lengths
    least, most = cosines_within(*geometry.plane_limits(1, limits))
    for back, tool_in, only, last, along, across in _readings(geometry, pitch):
        x, y = r[back] - along, up - across
        cosine = _bend_cosine(x, y, l2, l3)
        reached = (cosine > least) & (cosine < most) & faces[back]
        if only is not None:
            reached &= only
        pose = np.flatnonzero(reached)
        x, y, cosine = x[pose], y[pose], cosine[pose]
        direction, bend = np.arctan2(y, x), np.arccos(cosine)
        inner = 0.5 * bend
        if abs(l2 - l3) >= _SAME_LENGTH:
            inner = np.arctan2(l3 * np.sqrt(1.0 - cosine * cosine), l2 + l3 * cosine)
        in_line = np.abs(cosine) > _SURE
        third = None if last is None else last[pose]
        for sense in (1, -1):
            plane = [direction - sense * inner, sense * bend]
            if third is not None:
                plane.append(third - plane[0])
                plane[2] -= plane[1]
            kept = np.flatnonzero(_joints_inside(geometry, plane, ranges) & ~in_line)
            at = pose[kept]
            branch = branch_index(not back, sense, bool(tool_in))
            found[branch][at] = True
            rows = q[:, branch]
            rows[...] = np.nan
            rows[0][at] = yaw[back][at]
            for row, angle, span in zip(rows[1:], plane, ranges[1:], strict=False):
                row[at] = np.clip(angle[kept], *span)
            if rolls is not None:
                rows[-1][at] = rolls[at]
        for i in np.flatnonzero(in_line).tolist():  # rounding decides: one by one
            at = pose[i]
            last = None if third is None else float(third[i])
            for angles in planar.reaching(float(x[i]), float(y[i]), last):
                branch = branch_index(not back, bend_sense(angles[1]), bool(tool_in))
                images = planar.joint_images(angles)
                if images and not found[branch, at]:
                    found[branch, at] = True
                    q[:, branch, at] = [yaw[back, at], *images[0], *(() if rolls is None else (rolls[at],))]


def _held_rolls(
    geometry: ToolPlane, ranges: list[list[float]], roll: FloatArray | None, faces: NDArray[np.bool_]
) -> FloatArray | None:
    """The roll joint's angle at each pose (m,) [rad]; clears ``faces`` (2, m) where it leaves its limits."""
    if geometry.roll_joint is None:
        return None
    span = ranges[geometry.roll_joint]
    rolls = np.full(faces.shape[1], rest_angle(*span)) if roll is None else roll.copy()
    faces &= into_limits(rolls, *span)
    return np.clip(rolls, *span, out=rolls)


def _joints_inside(
    geometry: ToolPlane, plane: Sequence[FloatArray], ranges: list[list[float]]
) -> NDArray[np.bool_]:
    """Turn plane angles (m,) each into joint angles, in place; where all of them are inside the limits."""
    inside = np.ones(len(plane[0]), dtype=np.bool_)
    for angle, sign, offset, span in zip(plane, geometry.signs, geometry.offsets, ranges[1:], strict=False):
        if sign < 0:
            np.subtract(offset, angle, out=angle)
        elif offset:
            angle -= offset
        inside &= into_limits(angle, *span)
    return inside


def _bend_cosine(x: FloatArray, y: FloatArray, l2: float, l3: float) -> FloatArray:
    """Cosine of the bend between two links that reach (x, y) (m,) [m] from the shoulder."""
    cosine = x * x
    cosine += y * y
    cosine -= l2 * l2 + l3 * l3
    cosine *= 0.5 / (l2 * l3)
    return cosine


def _readings(
    geometry: ToolPlane, pitch: FloatArray | None
) -> Iterator[
    tuple[int, int, NDArray[np.bool_] | None, FloatArray | None, FloatArray | float, FloatArray | float]
]:
    """Each way to face and to point, over the poses (m,).

    1 at the back; 1 where the tool points back at the base axis; where there is such a posture (None:
    everywhere); the direction of the last link [rad], if a pitch gives it; what it adds forward and up [m].
    """
    if pitch is None:
        yield from ((back, 0, None, None, 0.0, 0.0) for back in (0, 1))
        return
    tool, l4 = geometry.tool_angle or 0.0, geometry.lengths[2]
    outward, upward = half_angle_cos_sin(pitch)
    readings: list[list[FloatArray]] = []
    for last, sense in ((pitch - tool, 1.0), (math.pi - tool - pitch, -1.0)):
        along, across = (sense * l4 * cos(tool)) * outward, (l4 * cos(tool)) * upward
        if tool:
            along += (l4 * sin(tool)) * upward
            across -= (sense * l4 * sin(tool)) * outward
        readings.append([last, along, across])
    two = np.abs(pitch) <= math.pi / 2 - UPRIGHT
    every = bool(two.all())
    if not every:  # beyond ±90° there is one reading, whichever way it points
        readings[1] = [np.where(two, other, one) for one, other in zip(*readings, strict=True)]
    for back, tool_in in itertools.product((0, 1), (0, 1)):
        only = None if every else two | (((1 - 2 * back) * outward < -LEVEL) == tool_in)
        last, along, across = readings[back ^ tool_in]
        yield back, tool_in, only, last, along, across


def cosines_within(low: float, high: float) -> tuple[float, float]:
    """Between which cosines a bend inside its limits [rad] lies; no wider than the links reach."""
    sizes = [abs(wrap(limit)) for limit in (low, high)]
    sharpest = math.pi if images(math.pi, low, high) else max(sizes)
    slightest = 0.0 if images(0.0, low, high) else min(sizes)
    slack = 2.0 * LIMIT_TOLERANCE
    return max(cos(sharpest) - slack, -_REACHED), min(cos(slightest) + slack, _REACHED)

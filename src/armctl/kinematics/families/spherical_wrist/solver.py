"""Inverse kinematics of six-joint arms whose last three axes meet in a point, or the first three."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Self, cast

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, Range, images
from armctl.kinematics.chain import Chain
from armctl.kinematics.energy import EnergyModel
from armctl.kinematics.explanations import all_of
from armctl.kinematics.families.numeric.solver import roll_joint
from armctl.kinematics.families.spherical_wrist.careful import CarefulSolver
from armctl.kinematics.families.spherical_wrist.closed_form import (
    ALMOST_HALF_TURN,
    BEYOND,
    CLIPPED,
    DOUBLE,
    NEAR,
    ClosedForm,
    Row,
)
from armctl.kinematics.families.spherical_wrist.geometry import SphericalWrist, recognise_wrist
from armctl.kinematics.families.whole_pose import Configurations, WholePoses
from armctl.kinematics.samples import DEFAULT_STEP, checked_step
from armctl.kinematics.solutions import BatchSolutions, Solutions
from armctl.kinematics.solver import InverseKinematics
from armctl.kinematics.target import Target

# Every branch of many poses of a spherical-wrist arm at once, joint limits not looked at.

_CHUNK = 4096
"""poses worked on at a time, so that what they need stays in the processor's cache"""


def solve_poses(closed: ClosedForm, poses: FloatArray) -> FloatArray:
    """(k, 8, 6) angles [rad] in the order of the geometry of tool poses (k, 4, 4) [m].

    NaN where a pose lacks a branch. All infinite where a pose needs care, which the caller has to solve.
    """
    q = np.empty((6, 8, len(poses)))  # joint by joint in memory: contiguous to write
    for at in range(0, len(poses), _CHUNK):
        _solve_into(closed, poses[at : at + _CHUNK], q[:, :, at : at + _CHUNK])
    return q.transpose(2, 1, 0)


def _solve_into(closed: ClosedForm, poses: FloatArray, q: FloatArray) -> None:
    (X, Y, Z), (px, py, pz), (qx, qy, qz), (rx, ry, rz) = _placed(closed, poses)
    first, third, care = _pairs(closed, X, Y, Z)
    c, s = np.cos(first), np.sin(first)
    u, v = X * c + Y * s - closed.a1, closed.ca1 * (Y * c - X * s) + closed.sa1 * Z - closed.v0
    c3, s3 = np.cos(third), np.sin(third)
    g, h = closed.a2 + closed.r * c3, closed.ca2 * closed.r * s3 + closed.side
    square = u * u + v * v
    care |= (square < closed.near**2).any(axis=0)
    square = np.maximum(square, closed.near**2)
    c2, s2 = (g * u + h * v) / square, (g * v - h * u) / square
    second = np.arctan2(s2, c2)

    def seen(x: FloatArray, y: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """A column of the rotation in the frame of the second axis ahead of its turn."""
        x, y = x * c + y * s, y * c - x * s
        return x, closed.ca1 * y + closed.sa1 * z, closed.ca1 * z - closed.sa1 * y

    def fourth_frame(x: float, y: float, z: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """An axis of the fourth joint's frame there."""
        ax, ay = c3 * x - s3 * y, s3 * x + c3 * y
        ay, az = closed.ca2 * ay - closed.sa2 * z, closed.sa2 * ay + closed.ca2 * z
        return c2 * ax - s2 * ay, s2 * ax + c2 * ay, az

    xx, xy, xz, yx, yy, yz, zx, zy, zz = closed.C
    r = seen(rx, ry, rz)
    x4, y4, z4 = fourth_frame(xx, xy, xz), fourth_frame(yx, yy, yz), fourth_frame(zx, zy, zz)
    m13, m23, m33 = (a[0] * r[0] + a[1] * r[1] + a[2] * r[2] for a in (x4, y4, z4))
    m31, m32 = (
        z4[0] * column[0] + z4[1] * column[1] + z4[2] * column[2]
        for column in (seen(px, py, pz), seen(qx, qy, qz))
    )
    level = np.sqrt(m13 * m13 + m23 * m23)
    care |= (level < NEAR).any(axis=0)
    ca, sa, cb, sb = closed.wrist
    if closed.right_angled:
        bend = np.arctan2(level, -m33)
    else:
        bend = _bend(*closed.geometry.wrist, np.arctan2(level, m33))
        care |= ((bend < NEAR) | (bend > ALMOST_HALF_TURN)).any(axis=0)
    fourth, sixth = np.arctan2(m23, m13), -np.arctan2(m32, m31)
    bad = ~np.isfinite(second + bend)
    o2, o3, o5 = closed.geometry.offsets
    c, s = np.cos(bend), np.sin(bend)
    for flip, sign in enumerate((-1.0, 1.0) if closed.first_is_flipped else (1.0, -1.0)):
        if closed.right_angled:  # what is added below is 0, or half a turn
            half = 0.0 if sign > 0.0 else math.pi
            q4, q6 = fourth + half, sixth + half
        else:
            q4 = fourth - np.arctan2(-(ca * c * sb + sa * cb), sign * sb * s)
            q6 = sixth + np.arctan2(sa * c * cb + ca * sb, sign * sa * s)
        for joint, angle in enumerate((first, second - o2, third - o3, q4, sign * bend - o5, q6)):
            q[joint, flip::2] = angle
        q[:, flip::2][:, bad] = math.nan
    q[:, :, care] = math.inf


def _placed(closed: ClosedForm, poses: FloatArray) -> tuple[FloatArray, ...]:
    """W [m] and the columns of ``B' R F``, as ``ClosedForm.place``: (3, k) each."""
    g = closed.geometry
    position, rotation = poses[:, :3, 3], poses[:, :3, :3]
    if g.backward:
        rotation = rotation.swapaxes(1, 2)
    left, right = (np.array(m).reshape(3, 3) for m in (closed.left, closed.right))
    turned = left @ rotation
    centre = np.array(closed.centre)
    if g.backward:
        place = np.einsum("kij,kj->ik", turned, centre - position)
    else:
        place = left @ position.T + np.einsum("kij,j->ik", turned, centre)
    columns = np.ascontiguousarray((turned @ right).transpose(2, 1, 0))
    return place + np.array(closed.offset)[:, None], columns[0], columns[1], columns[2]


def _pairs(
    closed: ClosedForm, X: FloatArray, Y: FloatArray, Z: FloatArray
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """As ``ClosedForm.pairs``: θ1 and φ3 (4, k) [rad], or NaN; and which poses need care (k,)."""
    flat = X * X + Y * Y
    whole = flat + Z * Z
    care = flat < closed.near**2
    if closed.geometry.regional == "skew":
        pairs = np.full((len(X), 4, 2), math.nan)
        for i, centre in enumerate(zip(X.tolist(), Y.tolist(), Z.tolist(), strict=True)):
            found, care[i] = closed.pairs(centre)
            for first, third, way in found:
                pairs[i, way] = first, third
        return pairs[..., 0].T, pairs[..., 1].T, care
    b, c = closed.m1 * X + closed.m2 * Y, closed.m1 * Y - closed.m2 * X
    size, middle = np.sqrt(b * b + c * c), np.arctan2(c, b)
    signs = np.array([[1.0], [-1.0]])
    if closed.first_comes_first:
        if closed.by_height:
            value = closed.w0 - closed.ca1 * Z
        else:
            value = closed.k - whole + 2.0 * closed.d2 * (closed.ca1 * Z - closed.w0)
        away, close = _away(size, value, closed.first_beyond)
        first = middle + closed.front * signs * away
        c1, s1 = np.cos(first), np.sin(first)
        if closed.by_height:
            value = whole - 2.0 * closed.a1 * (X * c1 + Y * s1) - closed.k
        else:
            value = closed.ca1 * Z + closed.sa1 * (X * s1 - Y * c1) - closed.w0
        bend, bent = _away(np.full_like(size, closed.third_size), value, closed.third_beyond)
        up = np.array([1.0, -1.0, -1.0, 1.0] if closed.named else [1.0, -1.0, 1.0, -1.0])[:, None]
        bend = closed.elbow_up * up * np.repeat(bend, 2, axis=0)
        return np.repeat(first, 2, axis=0), closed.third_middle + bend, care | close | bent.any(axis=0)
    value = whole - closed.k if closed.by_height else closed.ca1 * Z - closed.w0
    bend, bent = _away(np.full_like(size, closed.third_size), value, closed.third_beyond)
    third = closed.third_middle + signs * bend
    if closed.by_height:
        value = closed.w0 + closed.sa2 * closed.r * np.sin(third) - closed.ca1 * Z
    else:
        distance = closed.a2 * np.cos(third) + closed.d2 * closed.sa2 * np.sin(third)
        value = closed.k - whole + 2.0 * closed.r * distance
    away, close = _away(size, value, closed.first_beyond)
    first = np.concatenate([middle + away, middle - away])
    return first, np.concatenate([third, third]), care | bent | close.any(axis=0)


def _away(size: FloatArray, value: FloatArray, beyond: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """The angle in 0..pi with ``size · cos = value``, NaN: there is none; and where rounding needs care."""
    near, far = size - value, size + value
    least = np.minimum(near, far)
    away = 2.0 * np.arctan2(np.sqrt(np.maximum(near, 0.0)), np.sqrt(np.maximum(far, 0.0)))
    return np.where(least < -beyond, math.nan, away), (least <= DOUBLE * size) & (least >= -beyond)


def _bend(alpha: float, beta: float, side: FloatArray) -> FloatArray:
    """As the wrist's b for the angle between its outer axes [rad]; NaN where there is none."""
    wide = np.sin(0.5 * (side + alpha - beta)) * np.sin(0.5 * (side - alpha + beta))
    close = np.sin(0.5 * (alpha + beta + side)) * np.sin(0.5 * (alpha + beta - side))
    away = 2.0 * np.arctan2(np.sqrt(np.maximum(wide, 0.0)), np.sqrt(np.maximum(close, 0.0)))
    return np.where(np.minimum(wide, close) < -BEYOND, math.nan, math.pi - away)


_ROUNDING = 1e-13
"""how far the wrist's axes may miss each other where nothing has to be made up for [m]"""
_IN_FLOATS = 64
"""images of one configuration that are listed in plain floats"""


class SphericalWristSolver(InverseKinematics):
    """One arm of the family inside its limits. Immutable; safe in several threads.

    A pose has up to eight solutions, in closed form. A position alone, or with a pitch, is searched for.
    """

    family = "spherical wrist"
    searches_parts = True

    def __init__(
        self,
        chain: Chain,
        geometry: SphericalWrist,
        limits: FloatArray,
        energy: EnergyModel,
        titles: Sequence[str],
    ) -> None:
        super().__init__(chain, limits, energy, titles, roll_joint=roll_joint(chain))
        self.geometry = geometry
        self._closed = ClosedForm(geometry)
        self._answers = WholePoses(
            chain, limits, energy, titles, branch_names(self._closed), self._roll, self.of
        )
        self._ranges = [Range.of(low, high, CLIPPED) for low, high in geometry.order(limits.T).T.tolist()]
        self._careful = CarefulSolver(self._closed, chain, limits, titles)
        self._rough = geometry.misfit > _ROUNDING
        spans = [(k, low, high) for k, (low, high) in enumerate(limits.tolist())]
        self._turning = [span for span in spans if span[2] - span[1] > TWO_PI + LIMIT_TOLERANCE]
        """joints of which an angle may have several images, with their limits"""
        images_of_one = math.prod(1 + int((high - low) / TWO_PI) for _, low, high in self._turning)
        self._in_floats = images_of_one <= _IN_FLOATS and not self._rough

    @classmethod
    def recognises(cls, chain: Chain) -> bool:
        """See ``InverseKinematics``."""
        return recognise_wrist(chain) is not None

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """See ``InverseKinematics``."""
        geometry = recognise_wrist(chain)
        return None if geometry is None else cls(chain, geometry, limits, energy, titles)

    @cached_property
    def _unlimited(self) -> CarefulSolver:
        whole = np.tile([-math.pi, math.pi], (6, 1))
        return CarefulSolver(self._closed, self.chain, whole, self.titles)

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """All solutions inside the limits with all their images; of a continuum the one nearest to ``start``.

        A rotation that cannot be had is approached, and a position alone or with a pitch is searched for
        (``NumericSolver``). Nothing is swept, ``step`` [rad] is only looked at.
        Raises ``InputError``: ``step`` is not a positive number.
        """
        if target.rotation is not None and self._in_floats:  # most poses: twice as fast as by arrays
            if step is not DEFAULT_STEP:
                checked_step(step)
            quick = self._closed.quick(self._closed.place(target.point, target.rotation), self._ranges)
            if quick is not None and quick[0]:
                return self._with_images(target, *quick)
        return self._answers.solve(target, step, start, self._every_way)

    def _every_way(self, pose: FloatArray, start: FloatArray | None) -> Configurations:
        quick = None
        if not self._rough:
            placed = self._closed.place(pose[:3, 3].tolist(), pose[:3, :3])
            quick = self._closed.quick(placed, self._ranges)
        if quick is None:
            q, branches, continua = self._careful.solve(pose, start)
        else:
            q, branches, continua = np.array(quick[0]).reshape(-1, 6), quick[1], ()
            q = self.geometry.order(q)
        return Configurations(q, np.array(branches, dtype=np.int8), all_of(*continua))

    def _with_images(self, target: Target, rows: list[Row], branches: list[int]) -> Solutions:
        """The answer of configurations [rad] in the geometry's order, with their few images."""
        if self.geometry.backward:
            rows = [cast("Row", row[::-1]) for row in rows]
        for joint, low, high in self._turning:
            several = [images(row[joint], low, high) for row in rows]
            branches = [branch for branch, angles in zip(branches, several, strict=True) for _ in angles]
            rows = [
                cast("Row", (*row[:joint], angle, *row[joint + 1 :]))
                for row, angles in zip(rows, several, strict=True)
                for angle in angles
            ]
        return Solutions(self._answers.arm, target, rows, branches)

    def solve_poses(self, poses: FloatArray) -> BatchSolutions:
        """See ``InverseKinematics``."""
        q = solve_poses(self._closed, poses)
        for k in np.flatnonzero(np.isinf(q[:, 0, 0])).tolist():
            q[k] = self._one_pose(poses[k])
        q = self.geometry.order(q)
        return BatchSolutions(q, np.isfinite(q[:, :, 0]), self._answers.arm.branch_names)

    def _one_pose(self, pose: FloatArray) -> FloatArray:
        """(8, 6) every branch of one pose (4, 4), with care; in the order of the geometry."""
        found = self._unlimited.solve(pose, None)
        q = np.full((8, 6), math.nan)
        q[found.branches] = self.geometry.order(found.q)
        return q


def branch_names(closed: ClosedForm) -> tuple[str, ...]:
    """Names of the eight branches; index: 4 · shoulder + 2 · elbow + flip.

    Front: W is on the side of the first axis on which the second one is; where this meets the first, on the
    side on which W is at the zero pose. The elbow is up when a bend lifts it above the line from the second
    axis to W in front. These words need parallel second and third axes; without, the two roots are plus and
    minus. Four postures without such roots are numbered by rising θ1. With a flip the fifth joint is bent
    against its positive sense.
    """
    if closed.named:
        arms = ["front elbow-up", "front elbow-down", "back elbow-up", "back elbow-down"]
    elif closed.geometry.regional == "skew":
        arms = [f"posture-{k}" for k in (1, 2, 3, 4)]
    else:
        signs = itertools.product(("plus", "minus"), repeat=2)
        arms = [f"shoulder-{shoulder} elbow-{elbow}" for shoulder, elbow in signs]
    return tuple(f"{arm} {flip}" for arm in arms for flip in ("no-flip", "flip"))

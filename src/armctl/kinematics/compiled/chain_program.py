"""The tool pose and the Jacobian of a chain of joints as straight-line arithmetic.

Neighbouring joints with parallel axes are taken together: inside such a group the chain is planar, only
the sums of the joint angles count, and each link turns with one of them. With F_g the frame of group g,
φ_k the sum up to its joint k and (u_k, v_k, w) the tool point seen from joint k in F_g:

* the tool point is found from the tool backwards: (u, v, w)_k = (u, v, w)_(k+1) + Rz(φ_k) link_k, so
  that what only turns about itself drops out and links behind each other become one constant;
* the rotation is found from the base forwards, one product a group;
* joint k turns the tool point by z x lever = u_k y - v_k x, with x, y, z the columns of F_g.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.compiled.straight_line import ONE, ZERO, StraightLine, Value, Vector

FloatArray = NDArray[np.float64]
_PARALLEL = 1e-15
"""sine of the angle between two axes that rounding alone keeps apart"""
Columns = tuple[Vector, Vector, Vector]


class Angle(NamedTuple):
    """A sum of joint angles: ``±q[joint] + constant``, added to the angle ``before`` it in its group."""

    before: int | None
    joint: int
    sign: int
    constant: float


@dataclass
class _Group:
    """Joints with parallel axes: the fixed transform ahead of them, and what follows each of them."""

    rotation: FloatArray
    translation: FloatArray
    turns: list[tuple[Value, Value]] = field(default_factory=list[tuple[Value, Value]])
    """(cos φ_k, sin φ_k)"""
    senses: list[int] = field(default_factory=list[int])
    """+1 or -1: whether joint k turns about +z or -z of the group's frame"""
    links: list[FloatArray] = field(default_factory=list[FloatArray])
    """from joint k to the next, in the frame that turns with joint k"""


class ChainProgram:
    """Straight-line arithmetic of one chain: ``segments`` ahead of each turn about z, and a ``tail``."""

    def __init__(self, segments: Sequence[FloatArray], tail: FloatArray) -> None:
        self.line = StraightLine()
        self.angles: list[Angle] = []
        self._groups = self._grouped(segments)
        self._tail = tail
        self._frames, rotation = self._forwards()
        self._levers, tip = self._backwards()
        self.pose: list[Value] = [
            entry for i in range(3) for entry in (rotation[0][i], rotation[1][i], rotation[2][i], tip[i])
        ] + [ZERO, ZERO, ZERO, ONE]
        """row by row"""
        self.jacobian: list[Value] = self._jacobian()
        """row by row"""

    def _grouped(self, segments: Sequence[FloatArray]) -> list[_Group]:
        groups: list[_Group] = []
        quarters, sense, rest = 0, 1, 0.0
        for joint, segment in enumerate(segments):
            R, t = segment[:3, :3], segment[:3, 3]
            together = bool(groups) and np.abs([*R[:2, 2], *R[2, :2]]).max() < _PARALLEL
            if together:
                groups[-1].links.append(t)
                turned, rest = _quarter_turns(sense * math.atan2(R[1, 0], R[0, 0]))
                quarters += turned
                sense *= 1 if R[2, 2] > 0 else -1
                before = len(self.angles) - 1
            else:
                groups.append(_Group(R, t))
                quarters, sense, rest, before = 0, 1, 0.0, None
            index = len(self.angles)
            self.angles.append(Angle(before, joint, sense, rest))
            cos, sin = Value(1.0, f"c{index}"), Value(1.0, f"s{index}")
            for _ in range(quarters % 4):
                cos, sin = sin.times(-1.0), cos
            groups[-1].turns.append((cos, sin))
            groups[-1].senses.append(sense)
        return groups

    def _turned(self, group: _Group, k: int, v: Vector) -> Vector:
        """A vector that turns with joint k, in the group's frame."""
        (cos, sin), sense = group.turns[k], group.senses[k]
        line, across = self.line, v[1].times(sense)
        return (
            line.total(line.product(cos, v[0]), line.product(sin, across).times(-1.0)),
            line.total(line.product(sin, v[0]), line.product(cos, across)),
            v[2].times(sense),
        )

    def _sum(self, a: Vector, b: Vector) -> Vector:
        x, y, z = (self.line.total(p, q) for p, q in zip(a, b, strict=True))
        return x, y, z

    def _times(self, columns: Columns, rotation: FloatArray) -> Columns:
        x, y, z = (self._apply(columns, _constants(rotation[:, j])) for j in range(3))
        return x, y, z

    def _apply(self, columns: Columns, v: Vector) -> Vector:
        x, y, z = (self.line.dot([column[i] for column in columns], v) for i in range(3))
        return x, y, z

    def _forwards(self) -> tuple[list[Columns], Columns]:
        """Columns of each group's frame, and of the tool's."""
        frames: list[Columns] = []
        columns: Columns = ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE))
        for group in self._groups:
            columns = self._times(columns, group.rotation)
            frames.append(columns)
            (cos, sin), sense = group.turns[-1], group.senses[-1]
            along: Vector = (cos, sin, ZERO)
            across: Vector = (sin.times(-sense), cos.times(sense), ZERO)
            upright: Vector = (ZERO, ZERO, Value(float(sense)))
            columns = (
                self._apply(columns, along), self._apply(columns, across), self._apply(columns, upright)
            )  # fmt: skip
        return frames, self._times(columns, self._tail[:3, :3])

    def _backwards(self) -> tuple[list[list[Vector]], Vector]:
        """The tool point from each joint, in its group's frame; and from the base."""
        levers: list[list[Vector]] = []
        tip = _constants(self._tail[:3, 3])
        for group in reversed(self._groups):
            tip = self._turned(group, len(group.turns) - 1, tip)
            seen = [tip]
            for k in range(len(group.links) - 1, -1, -1):
                tip = self._sum(tip, self._turned(group, k, _constants(group.links[k])))
                seen.insert(0, tip)
            levers.insert(0, seen)
            fixed: Columns = (
                _constants(group.rotation[:, 0]),
                _constants(group.rotation[:, 1]),
                _constants(group.rotation[:, 2]),
            )
            tip = self._sum(self._apply(fixed, tip), _constants(group.translation))
        return levers, tip

    def _jacobian(self) -> list[Value]:
        line = self.line
        columns: list[list[Value]] = []
        for group, (x, y, z), levers in zip(self._groups, self._frames, self._levers, strict=True):
            for sense, (u, v, _) in zip(group.senses, levers, strict=True):
                linear = [
                    line.total(line.product(yi, u), line.product(xi, v).times(-1.0)).times(sense)
                    for xi, yi in zip(x, y, strict=True)
                ]
                columns.append(linear + [zi.times(sense) for zi in z])
        return list(itertools.chain.from_iterable(zip(*columns, strict=True)))


def _constants(v: FloatArray) -> Vector:
    x, y, z = (Value(float(entry)) for entry in v)
    return x, y, z


def _quarter_turns(angle: float) -> tuple[int, float]:
    """Whole quarter turns in an angle, which cost nothing, and what is left [rad]."""
    quarters = round(angle / (math.pi / 2))
    rest = angle - quarters * (math.pi / 2)
    return quarters, rest if abs(rest) > _PARALLEL else 0.0

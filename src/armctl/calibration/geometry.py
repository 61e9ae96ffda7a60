"""The numbers of an arm that may be wrong, and how far each moves the tool."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armctl.robot import Robot

FloatArray = NDArray[np.float64]
Kind = Literal["zero", "scale", "a", "d", "base"]
_LENGTHS: tuple[Literal["a"], Literal["d"]] = ("a", "d")
BlameUnit = Literal["mm", "°", "%"]
_UNITS: dict[Kind, tuple[BlameUnit, float]] = {
    "zero": ("°", math.radians(1.0)),
    "scale": ("%", 0.01),
    "a": ("mm", 0.001),
    "d": ("mm", 0.001),
    "base": ("mm", 0.001),
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number that may be wrong."""

    kind: Kind
    index: int
    """of the joint, of the DH row, or of the base's axis"""
    title: str

    @property
    def unit(self) -> BlameUnit:
        """What its error is told in."""
        return _UNITS[self.kind][0]

    @property
    def size(self) -> float:
        """One of its unit, in SI."""
        return _UNITS[self.kind][1]


class Geometry:
    """An arm at measured configurations, as a function of its parameters' errors.

    With the errors x the arm stands at q + zero + scale · q, its DH rows have lengths a and d with their
    errors added, and its base is moved by ``base`` among the points. Lengths turn nothing: each runs along
    an axis of a frame, which the angles alone decide, and the tool moves by it along that axis.
    """

    def __init__(self, robot: Robot, q: FloatArray) -> None:
        """``q`` (k, n) [rad], as the board was told or as it measured."""
        self._chain, self._q = robot.chain, q
        self.parameters = _parameters(robot)
        self._sizes = np.array([parameter.size for parameter in self.parameters])

    def tips(self, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the tool is with errors (p,), each in its unit, and how that changes with each of them.

        Returns:
            (k, 3) tool points [m], and their derivatives (k, 3, p) [m a unit].
        """
        zero, scale, lengths, base = self._sorted(errors * self._sizes)
        q = self._q * (1 + scale) + zero
        frames, jacobian = self._chain.frames(q), self._chain.jacobian(q)[:, :3]
        axes = self._axes(frames)
        for joint, row in enumerate(self._chain.joint_rows):
            # Longer lengths behind a joint are a longer lever about its axis, along which its own d runs.
            lever = np.einsum("kxlr,lr->kx", axes, np.where(self._behind(row), lengths, 0.0))
            jacobian[:, :, joint] += np.cross(axes[:, :, 1, row], lever)
        columns = np.stack([self._column(one, axes, jacobian) for one in self.parameters], axis=-1)
        tips = frames[:, -1, :3, 3] + np.einsum("kxlr,lr->kx", axes, lengths) + base
        return tips, columns * self._sizes

    def _sorted(self, errors: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Errors in SI as those of zeros (n,), scales (n,), lengths (2, rows) and the base (3,)."""
        zero, scale = np.zeros(self._chain.n), np.zeros(self._chain.n)
        lengths, base = np.zeros((2, len(self._chain.rows))), np.zeros(3)
        of = {"zero": zero, "scale": scale, "a": lengths[0], "d": lengths[1], "base": base}
        for parameter, error in zip(self.parameters, errors.tolist(), strict=True):
            of[parameter.kind][parameter.index] = error
        return zero, scale, lengths, base

    def _behind(self, row: int) -> NDArray[np.bool_]:
        """(2, rows) which a and d a joint in ``row`` turns."""
        behind = np.zeros((2, len(self._chain.rows)), dtype=np.bool_)
        behind[:, row + 1 :] = True
        behind[0, row] = self._chain.convention == "standard"  # modified rows go along x before they turn
        return behind

    def _column(self, parameter: Parameter, axes: FloatArray, jacobian: FloatArray) -> FloatArray:
        """(k, 3) derivative of the tool point [m a SI unit]."""
        i = parameter.index
        match parameter.kind:
            case "zero":
                return jacobian[:, :, i]
            case "scale":
                return jacobian[:, :, i] * self._q[:, i, None]
            case "base":
                return np.broadcast_to(np.eye(3)[i], (len(self._q), 3))
            case "a":
                return axes[:, :, 0, i]
            case "d":
                return axes[:, :, 1, i]

    def _axes(self, frames: FloatArray) -> FloatArray:
        """(k, 3, 2, rows) along what a and d of each row run.

        Rx keeps x and Rz keeps z, so each length runs along an axis of the frame on one side of its row.
        """
        before, behind = frames[:, :-1, :3], frames[:, 1:, :3]
        along_a, along_d = (behind, before) if self._chain.convention == "standard" else (before, behind)
        return np.stack([along_a[..., 0], along_d[..., 2]], axis=1).transpose(0, 3, 1, 2)


def _parameters(robot: Robot) -> tuple[Parameter, ...]:
    """All of them; of two that look the same the more likely one comes first."""
    rows, joints = robot.chain.rows, robot.joints
    zeros = [Parameter("zero", i, f"zero of {joint.title}") for i, joint in enumerate(joints)]
    scales = [Parameter("scale", i, f"scale of {joint.title}") for i, joint in enumerate(joints)]
    lengths = [
        Parameter(kind, i, f"{_length_title(robot, kind, i)}{_of_joint(robot, i)}")
        for i in range(len(rows))
        for kind in _LENGTHS
    ]
    written = [one for one in lengths if _length(robot, one) != 0]
    others = [one for one in lengths if _length(robot, one) == 0]
    base = [Parameter("base", i, f"place of the points along {axis}") for i, axis in enumerate("xyz")]
    return (*zeros, *written, *scales, *base, *others)


def _length_title(robot: Robot, kind: Literal["a", "d"], row: int) -> str:
    rows = robot.chain.rows
    last = max((i for i, one in enumerate(rows) if one.d_m != 0), default=-1)
    if kind == "d" and row == last and row >= robot.chain.joint_rows[-1]:
        return f"tool length (d_mm of DH row {row + 1})"
    return f"{kind}_mm of DH row {row + 1}"


def _length(robot: Robot, parameter: Parameter) -> float:
    row = robot.chain.rows[parameter.index]
    return row.a_m if parameter.kind == "a" else row.d_m


def _of_joint(robot: Robot, row: int) -> str:
    rows = robot.chain.joint_rows
    return f" ({robot.joints[rows.index(row)].title})" if row in rows else ""

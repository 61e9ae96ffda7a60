"""Where the tool is when numbers of an arm are wrong: zeros, sag, play, lengths, and where a sheet lies.

An angle is read where the tool touches a point, by the board's encoders, or as it was commanded where
the board measures nothing. The link stands at ``reading + zero + scale · reading``, less what weight bends
between the reading and the link (``compliance · torque``), and less half of the play, towards the side on
which the joint leans. All of it is in the joints; lengths move the tool along axes of the DH frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.arrays import FloatArray
from armctl.errors import CalibrationError
from armctl.facts.angles import DEGREE
from armctl.facts.causes import PointsTogether, TooFew
from armctl.kinematics.target import as_numbers
from armctl.lazy_dataclass import dataclass
from armctl.robot import Deflection, Robot

Kind = Literal["zero", "sag", "play", "scale", "a", "d", "place", "tilt", "heading"]
Frame = Literal["base", "sheet"]
LEAST_POINTS = 6
_LEAST_SPREAD_M = 0.02
_SD = {"zero": 3.0 * DEGREE, "sag": 2.0 * DEGREE, "play": 1.0 * DEGREE, "scale": 0.02, "a": 0.003, "d": 0.003}
"""how far a number may well be off: the standard deviation of what is expected [rad, a share, m]"""
_SHEET_SD = {"place": 1.0, "tilt": 2.0 * DEGREE, "heading": 3.0}
"""of a sheet that lies anywhere, flat [m, rad]"""
_BASE_SD = 0.005
"""of points that are given in the base frame: how far all of them may be displaced [m]"""
_CARRIES = 0.04
"""a joint whose largest torque is a smaller share of the arm's largest one does not sag"""
_TURNS = 2
"""fixed-point steps from the shaft's angle to the link's: each leaves a tenth of the error at most"""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an arm, or of where its points lie, that may be wrong."""

    kind: Kind
    index: int
    """of the joint, of the DH row, or of the axis"""


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """What was noted where the tool touched points."""

    q: FloatArray
    """(k, n) joint angles [rad] as the robot shows them: measured, else commanded"""
    points_m: FloatArray
    """(k, 3) the points [m], in ``frame``"""
    frame: Frame = "base"
    """of the points: the base's, or the sheet's own, whose place nobody knows"""
    sense: FloatArray | None = None
    """(k, n) in which sense each joint turned last: 1, -1, 0 not known; None: nobody knows"""
    commanded: FloatArray | None = None
    """(k, n) setpoints [rad] where ``q`` is measured; None: not noted"""

    def __len__(self) -> int:
        return len(self.q)

    @property
    def senses(self) -> FloatArray:
        """(k, n); 0 where nobody knows."""
        return np.zeros(self.q.shape) if self.sense is None else self.sense

    def only(self, kept: NDArray[np.bool_] | NDArray[np.intp]) -> Touches:
        """Some of them."""
        sense = None if self.sense is None else self.sense[kept]
        commanded = None if self.commanded is None else self.commanded[kept]
        return replace(self, q=self.q[kept], points_m=self.points_m[kept], sense=sense, commanded=commanded)

    @classmethod
    def checked(
        cls,
        robot: Robot,
        q: ArrayLike,
        points_m: ArrayLike,
        frame: Frame = "base",
        sense: ArrayLike | None = None,
        commanded: ArrayLike | None = None,
    ) -> Touches:
        """Touches of a robot. ``CalibrationError``: too few, all in one place, or not finite numbers."""
        angles, points = as_numbers(q, "joint angles"), as_numbers(points_m, "touched points")
        k = len(points) if points.ndim == 2 else 0
        given = [None if one is None else as_numbers(one, "angles of joints") for one in (sense, commanded)]
        if points.shape != (k, 3) or any(
            one is not None and one.shape != (k, robot.n) for one in (angles, *given)
        ):
            raise CalibrationError(
                f"each point needs {robot.n} joint angles and x, y, z; got arrays of the shapes "
                f"{angles.shape} and {points.shape}"
            )
        if k < LEAST_POINTS:
            raise CalibrationError(TooFew("points", k, LEAST_POINTS))
        rows = [angles, points, *(one for one in given if one is not None)]
        for number, row in enumerate(np.hstack(rows), 1):
            if not np.isfinite(row).all():
                raise CalibrationError(f"point {number} holds a value that is not a finite number")
        if np.ptp(points, axis=0).max() < _LEAST_SPREAD_M:
            raise CalibrationError(PointsTogether(_LEAST_SPREAD_M))
        return cls(angles, points, frame, *given)


@dataclass(frozen=True, slots=True, eq=False)
class Values:
    """Numbers of an arm that may be wrong."""

    zero: FloatArray
    """(n,) [rad]"""
    compliance: FloatArray
    """(n,) between the reading and the link [rad/(N·m)]"""
    play: FloatArray
    """(n,) [rad]"""
    scale: FloatArray
    """(n,) shares"""
    lengths: FloatArray
    """(rows, 2) by which a and d are longer [m]"""
    place: FloatArray
    """(3,) where the points' frame is, base frame [m]"""
    turn: FloatArray
    """(3,) rotation vector of the points' frame, after its heading as guessed [rad]"""


@dataclass(frozen=True, eq=False)
class TouchModel:
    """Where a robot's tool is, as a function of numbers that may be wrong. Immutable."""

    robot: Robot
    load_kg: float = 0.0
    """held at the tool point while points are touched"""
    heading: float = 0.0
    """of the sheet, as guessed [rad]"""
    frame: Frame = "base"
    _shape: tuple[int, int] = field(init=False, default=(0, 2), repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_shape", (len(self.robot.chain.rows), 2))

    @cached_property
    def deflection(self) -> Deflection:
        """Of the robot as it is; with all at zero where it has none."""
        known = self.robot.outputs.deflection
        gravity = replace(self.robot.gravity, payload_kg=self.load_kg)
        return Deflection.of(gravity, self.heaviest) if known is None else replace(known, gravity=gravity)

    @cached_property
    def heaviest(self) -> FloatArray:
        """(n,) largest torque of each joint inside its limits [N·m]."""
        return replace(self.robot.gravity, payload_kg=self.load_kg).heaviest(self.robot.limits)

    @property
    def carries(self) -> NDArray[np.bool_]:
        """(n,) joints that hold a weight, so that they sag."""
        return self.heaviest > _CARRIES * max(float(self.heaviest.max()), 1e-9)

    @property
    def known(self) -> Values:
        """The numbers that the robot goes by."""
        n, one = self.robot.n, self.deflection
        zero, scale = np.zeros(n), np.zeros(n)
        return Values(zero, one.link, one.play, scale, np.zeros(self._shape), np.zeros(3), np.zeros(3))

    def parameters(self, touches: Touches, *, lengths: bool = False) -> list[Parameter]:
        """What is fitted: zeros, sag, play where points are approached from both sides, the sheet's pose.

        With ``lengths`` also a and d of the DH rows.
        """
        turning = np.flatnonzero(self.robot.limits[:, 0] < self.robot.limits[:, 1]).tolist()
        found = [Parameter("zero", i) for i in turning]
        found += [Parameter("sag", i) for i in turning if self.carries[i] and self.robot.gravity.weighs]
        sense = touches.senses
        both = np.logical_and((sense > 0).any(axis=0), (sense < 0).any(axis=0)).tolist()
        found += [Parameter("play", i) for i in turning if both[i]]
        if lengths:
            found += self.lengths()
        return [*found, *self.of_sheet()]

    def of_sheet(self) -> list[Parameter]:
        """Of a sheet that lies anywhere, its pose."""
        if self.frame == "base":
            return []
        places = [Parameter("place", i) for i in range(3)]
        return [*places, Parameter("tilt", 0), Parameter("tilt", 1), Parameter("heading", 2)]

    def others(self) -> list[Parameter]:
        """What is looked at besides, where one number explains more than all of those do."""
        turning = np.flatnonzero(self.robot.limits[:, 0] < self.robot.limits[:, 1]).tolist()
        places = [Parameter("place", i) for i in range(3)] if self.frame == "base" else []
        return [*(Parameter("scale", i) for i in turning), *places]

    def lengths(self) -> list[Parameter]:
        """All lengths, those that the robot file gives first."""
        given: list[Parameter] = []
        others: list[Parameter] = []
        for i, row in enumerate(self.robot.chain.rows):
            (given if row.a_m else others).append(Parameter("a", i))
            (given if row.d_m else others).append(Parameter("d", i))
        return given + others

    def sd(self, parameter: Parameter) -> float:
        """What is expected of a parameter before anything is touched: its standard deviation, SI."""
        match parameter.kind:
            case "place":
                return _SHEET_SD["place"] if self.frame == "sheet" else _BASE_SD
            case "tilt" | "heading":
                return _SHEET_SD[parameter.kind]
            case "sag":
                return _SD["sag"] / float(self.heaviest[parameter.index])
            case _:
                return _SD[parameter.kind]

    def with_values(self, parameters: Sequence[Parameter], x: FloatArray) -> Values:
        """The robot's numbers, changed by ``x`` (p,) in SI; sag and play are those numbers themselves."""
        now = self.known
        arrays = {
            "zero": now.zero, "sag": now.compliance.copy(), "play": now.play.copy(), "scale": now.scale,
            "place": now.place, "tilt": now.turn, "heading": now.turn,
        }  # fmt: skip
        for one, value in zip(parameters, x.tolist(), strict=True):
            if one.kind in ("a", "d"):
                now.lengths[one.index, "ad".index(one.kind)] = value
            else:
                arrays[one.kind][one.index] = value
        return replace(now, compliance=arrays["sag"], play=arrays["play"])

    def start(self, parameters: Sequence[Parameter]) -> FloatArray:
        """(p,) the parameters as the robot goes by them, SI."""
        now = self.known
        begin = {"sag": now.compliance, "play": now.play}
        return np.array([begin[one.kind][one.index] if one.kind in begin else 0.0 for one in parameters])

    def shaft(self, q: FloatArray) -> FloatArray:
        """What was read (k, n) [rad] where the robot shows ``q`` (k, n), by the load that it goes by."""
        known = self.robot.outputs.deflection
        return q if known is None else known.shaft(q)

    def links(self, values: Values, q: FloatArray, sense: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Link angles (k, n) [rad] at readings ``q`` (k, n), and the torques (k, n) there [N·m]."""
        one = replace(self.deflection, link=values.compliance, play=values.play)
        shaft = self.shaft(q)
        shaft = shaft + values.zero + values.scale * shaft
        theta, torque = shaft, one.gravity.torque(shaft)
        for _ in range(_TURNS):
            theta = shaft - one.bent(torque, sense)
            torque = one.gravity.torque(theta)
        return theta, torque

    def tips(
        self, values: Values, q: FloatArray, sense: FloatArray, theta: FloatArray | None = None
    ) -> FloatArray:
        """(k, 3) where the tool is at readings ``q`` (k, n) [rad], base frame [m]; ``theta``: its links."""
        theta = self.links(values, q, sense)[0] if theta is None else theta
        tips = self.robot.forward(theta)[:, :3, 3]
        if values.lengths.any():
            tips = tips + np.einsum("rj,krji->ki", values.lengths, self._axes(theta))
        return tips

    def on_sheet(self, values: Values, tips: FloatArray) -> FloatArray:
        """Points (k, 3) of the base frame in that of the touched points [m]."""
        return (tips - values.place) @ self._rotation(values)

    def along(self, values: Values, vectors: FloatArray) -> FloatArray:
        """Vectors (k, 3) of the base frame along the axes of the points' frame."""
        return vectors @ self._rotation(values)

    def in_base(self, values: Values, points: FloatArray) -> FloatArray:
        """Touched points (k, 3) in the base frame [m]."""
        return points @ self._rotation(values).T + values.place

    def _rotation(self, values: Values) -> FloatArray:
        c, s = math.cos(self.heading), math.sin(self.heading)
        return _turned(values.turn) @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])

    def _axes(self, theta: FloatArray) -> FloatArray:
        """(k, rows, 2, 3) directions along which a and d of each row move the tool."""
        frames = self.robot.frames(theta)[..., :3, :3]
        ahead, behind = frames[:, :-1], frames[:, 1:]
        if self.robot.chain.convention == "modified":
            return np.stack([ahead[..., 0], behind[..., 2]], axis=2)
        return np.stack([behind[..., 0], ahead[..., 2]], axis=2)

    def errors(self, values: Values, touches: Touches, theta: FloatArray | None = None) -> FloatArray:
        """(k, 3) from each touched point to where the tool is said to be, base frame [m]."""
        return self.tips(values, touches.q, touches.senses, theta) - self.in_base(values, touches.points_m)

    def slopes(
        self,
        values: Values,
        touches: Touches,
        parameters: Sequence[Parameter],
        links: tuple[FloatArray, FloatArray] | None = None,
    ) -> FloatArray:
        """(k, 3, p) derivatives of ``errors`` by the parameters, SI; ``links``: as that method gives them.

        The links' own turns by what bends them are left out of it: some hundredths.
        """
        sense = touches.senses
        theta, torque = self.links(values, touches.q, sense) if links is None else links
        J = self.robot.jacobian(theta)[:, :3]
        shaft, side = self.shaft(touches.q), self.deflection.side(torque, sense)
        axes = self._axes(theta) if any(one.kind in ("a", "d") for one in parameters) else np.empty(0)
        spun = self.in_base(values, touches.points_m) - values.place
        columns: list[FloatArray] = []
        for one in parameters:
            i = one.index
            match one.kind:
                case "zero":
                    columns.append(J[:, :, i])
                case "sag":
                    columns.append(-torque[:, i, None] * J[:, :, i])
                case "play":
                    columns.append(-0.5 * side[:, i, None] * J[:, :, i])
                case "scale":
                    columns.append(shaft[:, i, None] * J[:, :, i])
                case "a" | "d":
                    columns.append(axes[:, i, "ad".index(one.kind)])
                case "place":
                    columns.append(np.broadcast_to(-np.eye(3)[i], spun.shape))
                case "tilt" | "heading":
                    columns.append(-np.cross(np.eye(3)[i], spun))
        return np.stack(columns, axis=2) if columns else np.empty((*spun.shape, 0))

    def placed(self, touches: Touches) -> TouchModel:
        """The same for these points: with their frame, and the heading of a sheet as it seems to lie."""
        if touches.frame == "base":
            return replace(self, frame="base", heading=0.0)
        tips = self.tips(self.known, touches.q, touches.senses)[:, :2]
        here, there = tips - np.median(tips, axis=0), touches.points_m[:, :2]
        there = there - np.median(there, axis=0)
        sine = np.sum(there[:, 0] * here[:, 1] - there[:, 1] * here[:, 0])
        return replace(self, frame="sheet", heading=math.atan2(float(sine), float(np.sum(there * here))))


def _turned(vector: FloatArray) -> FloatArray:
    """(3, 3) of a rotation vector (3,) [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = (vector / angle).tolist()
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * K + (1 - math.cos(angle)) * (K @ K)

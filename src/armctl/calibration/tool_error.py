"""How far the tool is from points that it touches, and the one parameter most to blame."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import CalibrationError
from armctl.kinematics.target import as_numbers
from armctl.robot import Robot

Kind = Literal["zero", "scale", "a", "d", "base"]
BlameUnit = Literal["mm", "°", "%"]
LEAST_POINTS = 6
_LEAST_SPREAD_M = 0.02
_UNITS: dict[Kind, tuple[BlameUnit, float]] = {
    "zero": ("°", math.radians(1.0)),
    "scale": ("%", 0.01),
    "a": ("mm", 0.001),
    "d": ("mm", 0.001),
    "base": ("mm", 0.001),
}
_TOUCH_M = 0.0005
"""standard deviation of a coordinate of a touch, before anything is measured [m]"""
_TOUCH_WEIGHT = 5.0
"""how many coordinates that is worth"""
_UNSEEN_M = 0.00005
"""what moves the tool by less than this for a unit of error cannot be seen [m]"""
_CHANCE = 4.5
"""a parameter is blamed where it explains more than so many standard deviations of chance"""
_LIKE = 3.0
"""parameters that explain less than so many standard deviations less than the best are named beside it"""
_PROMISING = 0.25
"""of the best drop that the derivatives foresee; parameters below it are not looked at closer"""
_ROUNDS = 12


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an arm that may be wrong."""

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


@dataclass(frozen=True, slots=True)
class Blame:
    """The parameter that explains most of the tool's error."""

    title: str
    amount: float
    """how much larger it is than the robot says, in ``unit``"""
    unit: BlameUnit
    or_else: tuple[str, ...]
    """parameters that would explain these points as well"""

    def __str__(self) -> str:
        """One line."""
        digits = 2 if self.unit != "mm" else 1
        told = f"{self.title}: {self.amount:+.{digits}f} {self.unit}"
        return f"{told}, or else {', '.join(self.or_else)}" if self.or_else else told


@dataclass(frozen=True, slots=True)
class Change:
    """A value of the robot file, or of the calibration where that stands above it."""

    table: str
    """where it is: ``joints.elbow.servo``, ``dh.rows, row 3 (joint elbow)``, ``calibration: joints.elbow``"""
    key: str
    old: float
    new: float

    def __str__(self) -> str:
        """As it is to be written, with what it was."""
        return f"{self.key} = {self.new:.6g}  # was {self.old:.6g}"


@dataclass(frozen=True, slots=True)
class ToolError:
    """What touched points tell of an arm."""

    errors_m: FloatArray
    """(k, 3) each point less where the robot's numbers put the tool [m]"""
    left_m: FloatArray
    """(k, 3) the same with the blamed parameter corrected [m]"""
    blame: Blame | None
    """None: no parameter explains more than chance would"""
    changes: tuple[Change, ...]
    """of robot file or calibration, where the blamed parameter stands in it"""

    @property
    def rms_m(self) -> float:
        """Root mean square of the distances [m]."""
        return _rms(self.errors_m)

    @property
    def largest_m(self) -> float:
        """Largest distance [m]."""
        return float(np.linalg.norm(self.errors_m, axis=1).max())

    @property
    def rms_after_m(self) -> float:
        """``rms_m`` with the blamed parameter corrected."""
        return _rms(self.left_m)

    @property
    def largest_after_m(self) -> float:
        """``largest_m`` with the blamed parameter corrected."""
        return float(np.linalg.norm(self.left_m, axis=1).max())

    @property
    def words(self) -> tuple[str, ...]:
        """All of it for the user."""
        told = (
            f"tool error of {len(self.errors_m)} points: RMS {1000 * self.rms_m:.2f} mm, largest "
            f"{1000 * self.largest_m:.2f} mm"
        )
        if self.blame is None:
            return told, "no parameter is to blame: none explains more of it than chance would"
        return (
            told,
            f"most to blame: {self.blame}",
            f"with that corrected: RMS {1000 * self.rms_after_m:.2f} mm, largest "
            f"{1000 * self.largest_after_m:.2f} mm",
        )

    def toml(self) -> str:
        """The changed values, each with the old one and where it stands."""
        if not self.changes:
            return ""
        return f"# [{self.changes[0].table}]\n" + "".join(f"{change}\n" for change in self.changes)


def tool_error(
    robot: Robot, q: ArrayLike, points_m: ArrayLike, calibrated: Collection[str] = ()
) -> ToolError:
    """Compare where the tool is with where the robot's numbers put it.

    Args:
        robot: as the arm runs: with its calibration.
        q: (k, n) joint angles as commanded or measured while the tool touched each point [rad].
        points_m: (k, 3) the points in the base frame [m].
        calibrated: names of the joints that a calibration is in force for: what the robot file says of their
            zero and scale counts for nothing.

    Raises:
        CalibrationError: fewer than six points, not finite, of a wrong shape, or all in one place.
    """
    configurations, points = _checked(robot, q, points_m)
    model = ErrorModel(robot, configurations)
    errors = points - model.tips
    drops = np.array([_drop(model.column(one), errors) for one in model.parameters])
    promising = np.flatnonzero((drops >= _PROMISING * drops.max()) & (drops > 0)).tolist()
    solved = {i: _solve(model, model.parameters[i], points) for i in promising}
    nothing = ToolError(errors, errors, None, ())
    if not solved:
        return nothing
    squares = {i: float(np.sum(left**2)) for i, (_, left) in solved.items()}
    freedom = _TOUCH_WEIGHT + errors.size - 1
    least = min(squares.values())
    variance = (_TOUCH_WEIGHT * _TOUCH_M**2 + least) / freedom
    if float(np.sum(errors**2)) - least <= _CHANCE**2 * variance:
        return nothing
    # of parameters that explain equally much the likelier one: they are listed in that order
    best = next(i for i in promising if squares[i] - least <= 1e-6 * variance)
    amount, left = solved[best]
    parameter = model.parameters[best]
    like = [i for i in promising if i != best and squares[i] - least <= _LIKE**2 * variance]
    return ToolError(
        errors,
        left,
        Blame(parameter.title, amount, parameter.unit, tuple(model.parameters[i].title for i in like)),
        _changes(robot, parameter, amount * parameter.size, calibrated),
    )


class ErrorModel:
    """An arm with one wrong number, at configurations in which its tool touched something."""

    def __init__(self, robot: Robot, q: FloatArray) -> None:
        """``q`` (k, n) [rad], as the board was told or as it measured."""
        self.parameters = _parameters(robot)
        self._chain, self._q = robot.chain, q
        frames = self._chain.frames(q)
        self.tips: FloatArray = frames[:, -1, :3, 3]
        """(k, 3) where the tool is without an error [m]"""
        count = len(self._chain.rows)  # none of an arm from a URDF file
        before, behind = frames[:, :count, :3], frames[:, 1 : count + 1, :3]
        # Rx keeps x and Rz keeps z: each length runs along an axis of the frame on one side of its row.
        standard = self._chain.convention == "standard"
        self._along = {
            "a": (behind if standard else before)[..., 0],
            "d": (before if standard else behind)[..., 2],
        }

    def tips_with(self, parameter: Parameter, amount: float) -> FloatArray:
        """(k, 3) tool points where a parameter is wrong by ``amount`` of its unit [m]; exact."""
        if parameter.kind in ("zero", "scale"):
            return self._chain.forward(self._turned(parameter, amount))[:, :3, 3]
        return self.tips + amount * self.column(parameter)

    def column(self, parameter: Parameter, amount: float = 0.0) -> FloatArray:
        """(k, 3) how ``tips_with`` changes with the amount there [m a unit]."""
        i = parameter.index
        if parameter.kind == "base":
            return np.broadcast_to(np.eye(3)[i] * parameter.size, self.tips.shape)
        if parameter.kind in ("a", "d"):
            return self._along[parameter.kind][:, i] * parameter.size
        column = self._chain.jacobian(self._turned(parameter, amount))[:, :3, i]
        return parameter.size * (column * self._q[:, i, None] if parameter.kind == "scale" else column)

    def _turned(self, parameter: Parameter, amount: float) -> FloatArray:
        """(k, n) where the joints truly stand [rad]."""
        q, i, error = self._q.copy(), parameter.index, amount * parameter.size
        q[:, i] += error if parameter.kind == "zero" else error * q[:, i]
        return q


def _drop(column: FloatArray, errors: FloatArray) -> float:
    """How much of the squared errors a parameter takes away, by its derivative."""
    size = float(np.sum(column**2))
    if size < _UNSEEN_M**2 * len(errors):
        return 0.0
    return float(np.sum(column * errors)) ** 2 / size


def _solve(model: ErrorModel, parameter: Parameter, points: FloatArray) -> tuple[float, FloatArray]:
    """The error of one parameter that explains the points best (Gauss-Newton), and what it leaves (k, 3)."""
    amount = 0.0
    for _ in range(_ROUNDS):
        column = model.column(parameter, amount)
        step = float(np.sum(column * (points - model.tips_with(parameter, amount))) / np.sum(column**2))
        amount += step
        if abs(step) < 1e-9:
            break
    return amount, points - model.tips_with(parameter, amount)


def _checked(robot: Robot, q: ArrayLike, points_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
    configurations, points = as_numbers(q, "joint angles"), as_numbers(points_m, "touched points")
    k = len(points) if points.ndim == 2 else 0
    if points.shape != (k, 3) or configurations.shape != (k, robot.n):
        raise CalibrationError(
            f"each point needs {robot.n} joint angles and x, y, z; got arrays of the shapes "
            f"{configurations.shape} and {points.shape}"
        )
    if k < LEAST_POINTS:
        raise CalibrationError(
            f"{k} points are too few: touch {LEAST_POINTS} at least, better 10, in different poses of the arm"
        )
    for number, row in enumerate(np.hstack([configurations, points]), 1):
        if not np.isfinite(row).all():
            raise CalibrationError(f"point {number} holds a value that is not a finite number")
    if np.ptp(points, axis=0).max() < _LEAST_SPREAD_M:
        raise CalibrationError(
            f"the points are all within {1000 * _LEAST_SPREAD_M:.0f} mm of each other: spread them over the "
            "arm's workspace"
        )
    return configurations, points


def _parameters(robot: Robot) -> tuple[Parameter, ...]:
    """All numbers that may be wrong, the likelier ones first."""
    zeros = [Parameter("zero", i, f"zero of {joint.title}") for i, joint in enumerate(robot.joints)]
    scales = [Parameter("scale", i, f"scale of {joint.title}") for i, joint in enumerate(robot.joints)]
    written: list[Parameter] = []
    others: list[Parameter] = []
    for i, row in enumerate(robot.chain.rows):
        lengths: tuple[tuple[Kind, float], ...] = (("a", row.a_m), ("d", row.d_m))
        for kind, length in lengths:
            (written if length != 0 else others).append(Parameter(kind, i, _length_title(robot, kind, i)))
    base = [Parameter("base", i, f"place of the points along {axis}") for i, axis in enumerate("xyz")]
    return (*zeros, *written, *scales, *base, *others)


def _length_title(robot: Robot, kind: Kind, row: int) -> str:
    rows, joint_rows = robot.chain.rows, robot.chain.joint_rows
    last = max((i for i, one in enumerate(rows) if one.d_m != 0), default=-1)
    title = f"{kind}_mm of DH row {row + 1}"
    if kind == "d" and row == last and row >= joint_rows[-1]:
        title = f"tool length ({title})"
    return f"{title} ({robot.joints[joint_rows.index(row)].title})" if row in joint_rows else title


def _changes(
    robot: Robot, parameter: Parameter, error: float, calibrated: Collection[str]
) -> tuple[Change, ...]:
    """What to write where a parameter is wrong by ``error`` [m, rad or a share]."""
    i = parameter.index
    if parameter.kind == "base":
        return ()
    if parameter.kind in ("a", "d"):
        row = robot.chain.rows[i]
        old = 1000 * (row.a_m if parameter.kind == "a" else row.d_m)
        return (Change(_row_table(robot, i), f"{parameter.kind}_mm", old, old + 1000 * error),)
    offset, scale = (error, 0.0) if parameter.kind == "zero" else (0.0, error)
    outputs, name = robot.output_map, robot.joint_names[i]
    if outputs is None and not robot.chain.rows:
        table = f"the URDF file, joint {name}: the turn of its origin about its axis"
        return (Change(table, "offset_deg", 0.0, math.degrees(offset)),)
    if outputs is None:
        row_of = robot.chain.joint_rows[i]
        old = math.degrees(robot.chain.rows[row_of].theta_rad)
        return (Change(_row_table(robot, row_of), "theta_deg", old, old + math.degrees(offset)),)
    # The map under which a joint that says θ stands at θ + offset + scale · θ.
    per, zero = float(outputs.per_rad[i]), float(outputs.zero[i])
    new_per = per / (1 + scale)
    new_zero = zero - offset * new_per
    if name in calibrated:
        pairs = [("zero", zero, new_zero), ("per_deg", math.radians(per), math.radians(new_per))]
        table = f"calibration: joints.{name}"
    else:
        scale = (f"{outputs.key}_per_deg", math.radians(per), math.radians(new_per))
        home = ("home_deg", math.degrees(-zero / per), math.degrees(-new_zero / new_per))
        pairs = [scale, home] if outputs.homed else [(f"zero_{outputs.key}", zero, new_zero), scale]
        table = f"joints.{name}.{outputs.table}"
    return tuple(Change(table, key, old, new) for key, old, new in pairs if not math.isclose(old, new))


def _row_table(robot: Robot, row: int) -> str:
    rows = robot.chain.joint_rows
    joint = f' (joint = "{robot.joint_names[rows.index(row)]}")' if row in rows else ""
    return f"dh.rows, row {row + 1}{joint}"


def _rms(errors: FloatArray) -> float:
    return math.sqrt(float(np.sum(errors**2)) / len(errors))

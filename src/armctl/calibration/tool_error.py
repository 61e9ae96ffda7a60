"""How far the tool is from points that it touches, and the one parameter most to blame."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from armctl.apart import require_wanted
from armctl.arrays import FloatArray
from armctl.errors import CalibrationError
from armctl.kinematics import Chain
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
"""the unit of a parameter's error, and one of it in SI"""
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
_ROUNDS = 12
_STEP = 0.001
"""units of error over which a derivative is taken"""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of an arm that may be wrong."""

    kind: Kind
    index: int
    """of the joint, of the DH row, or of the base's axis"""
    title: str

    def tips(self, robot: Robot, q: FloatArray, amount: float) -> FloatArray:
        """(k, 3) tool points [m] at ``q`` (k, n) [rad] where it is larger by ``amount`` of its unit."""
        chain, i, error = robot.chain, self.index, amount * _UNITS[self.kind][1]
        match self.kind:
            case "base":
                return chain.forward(q)[:, :3, 3] + error * np.eye(3)[i]
            case "zero" | "scale":
                q = q.copy()
                q[:, i] += error if self.kind == "zero" else error * q[:, i]
            case _:
                rows = list(chain.rows)
                key = f"{self.kind}_m"
                rows[i] = replace(rows[i], **{key: getattr(rows[i], key) + error})
                convention = "modified" if chain.convention == "modified" else "standard"
                chain = Chain.from_dh(rows, convention, chain.coupling)
        return chain.forward(q)[:, :3, 3]

    def solve(self, robot: Robot, q: FloatArray, points: FloatArray) -> tuple[float, FloatArray] | None:
        """The error that explains the points best (Gauss-Newton), and what it leaves (k, 3) [m].

        None where the points cannot show it.
        """
        amount = 0.0
        for _ in range(_ROUNDS):
            here = self.tips(robot, q, amount)
            slope = (self.tips(robot, q, amount + _STEP) - here) / _STEP
            size = float(np.sum(slope**2))
            if size < _UNSEEN_M**2 * len(points):
                return None
            step = float(np.sum(slope * (points - here))) / size
            amount += step
            if abs(step) < 1e-9:
                break
        return amount, points - self.tips(robot, q, amount)


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
        text = f"{self.title}: {self.amount:+.{digits}f} {self.unit}"
        return f"{text}, or else {', '.join(self.or_else)}" if self.or_else else text


@dataclass(frozen=True, slots=True)
class Change:
    """A value of the robot file, or of the calibration where that stands above it."""

    table: str
    """where it is: ``joints.elbow.servo``, ``dh.rows, row 3 (joint elbow)``, ``calibration: joints.elbow``"""
    key: str
    old: float
    new: float


@dataclass(frozen=True, slots=True)
class ToolError:
    """What touched points say about an arm."""

    count: int
    """of the points"""
    rms_m: float
    """root mean square of the distances between the points and where the robot's numbers put the tool [m]"""
    largest_m: float
    """largest of these distances [m]"""
    rms_after_m: float
    """``rms_m`` with the blamed parameter corrected"""
    largest_after_m: float
    blame: Blame | None
    """None: no parameter explains more than chance would"""
    changes: tuple[Change, ...]
    """of robot file or calibration, where the blamed parameter stands in it"""

    @property
    def words(self) -> tuple[str, ...]:
        """All of it for the user."""

        def figures(rms: float, largest: float) -> str:
            return f"RMS {1000 * rms:.2f} mm, largest {1000 * largest:.2f} mm"

        error = f"tool error of {self.count} points: {figures(self.rms_m, self.largest_m)}"
        if self.blame is None:
            return error, "no single number explains the error better than chance"
        after = f"with that corrected: {figures(self.rms_after_m, self.largest_after_m)}"
        return error, f"most likely cause: {self.blame}", after

    def toml(self) -> str:
        """The changed values, each with the old one and where it stands."""
        lines: list[str] = []
        table = None
        for one in self.changes:
            if one.table != table:
                table = one.table
                lines.append(f"# [{table}]")
            lines.append(f"{one.key} = {one.new:.6g}  # was {one.old:.6g}")
        return "".join(f"{line}\n" for line in lines)


def tool_error(
    robot: Robot, q: ArrayLike, points_m: ArrayLike, calibrated: Collection[str] = ()
) -> ToolError:
    """Compare where the tool is with where the robot's numbers put it.

    ``robot`` is as the arm runs, with its calibration; ``q`` (k, n) [rad] as commanded or measured while the
    tool touched each of ``points_m`` (k, 3), base frame [m]. Zero and scale of the joints ``calibrated`` are
    corrected in the calibration, not in the robot file. Refuses fewer than six points, or all in one place;
    ends with a ``LimitError`` where nobody waits for it any more (``apart.is_given_up``).
    """
    configurations, points = _checked(robot, q, points_m)
    errors = points - robot.forward(configurations)[:, :3, 3]
    parameters = parameters_of(robot)
    solved: dict[Parameter, tuple[float, FloatArray]] = {}
    for one in parameters:
        require_wanted()
        if found := one.solve(robot, configurations, points):
            solved[one] = found
    squares = {one: float(np.sum(left**2)) for one, (_, left) in solved.items()}
    least = min(squares.values())
    variance = (_TOUCH_WEIGHT * _TOUCH_M**2 + least) / (_TOUCH_WEIGHT + errors.size - 1)
    before = _sizes(errors)
    if float(np.sum(errors**2)) - least <= _CHANCE**2 * variance:
        return ToolError(len(points), *before, *before, None, ())
    # of parameters that explain equally much the likelier one: they are listed in that order
    best = next(one for one in solved if squares[one] - least <= 1e-6 * variance)
    amount, left = solved[best]
    like = [one.title for one in solved if one != best and squares[one] - least <= _LIKE**2 * variance]
    unit, size = _UNITS[best.kind]
    return ToolError(
        len(points),
        *before,
        *_sizes(left),
        Blame(best.title, amount, unit, tuple(like)),
        _changes(robot, best, amount * size, calibrated),
    )


def _sizes(errors: FloatArray) -> tuple[float, float]:
    """RMS and largest length of errors (k, 3)."""
    lengths: FloatArray = np.linalg.norm(errors, axis=1)
    return math.sqrt(np.mean(lengths**2)), float(lengths.max())


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


def parameters_of(robot: Robot) -> tuple[Parameter, ...]:
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
    return f"{title} ({robot.link_titles[joint_rows.index(row)]})" if row in joint_rows else title


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
        return _turned_rows(robot, i, math.degrees(offset)) if offset else ()
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


def _turned_rows(robot: Robot, joint: int, offset_deg: float) -> tuple[Change, ...]:
    """The zero of a joint written into the DH rows: of all links that it turns, which several do by rods."""
    chain = robot.chain
    coupling = np.eye(robot.n) if chain.coupling is None else chain.coupling
    changes: list[Change] = []
    for link in np.flatnonzero(coupling[:, joint]).tolist():
        row = chain.joint_rows[link]
        old = math.degrees(chain.rows[row].theta_rad)
        new = old + float(coupling[link, joint]) * offset_deg
        changes.append(Change(_row_table(robot, row), "theta_deg", old, new))
    return tuple(changes)


def _row_table(robot: Robot, row: int) -> str:
    rows = [robot.chain.joint_rows[link] for link in robot.chain.first_links]
    joint = f' (joint = "{robot.joint_names[rows.index(row)]}")' if row in rows else ""
    return f"dh.rows, row {row + 1}{joint}"

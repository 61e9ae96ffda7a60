"""How far the tool is from points that it touches, which parameter is to blame, and what to write instead."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.calibration.blame import Correction, Step, find_blame, solve, unseen
from armctl.calibration.geometry import BlameUnit, Geometry, Parameter
from armctl.errors import CalibrationError
from armctl.kinematics.checks import as_numbers
from armctl.robot import Robot

FloatArray = NDArray[np.float64]
LEAST_POINTS = 6
_LEAST_SPREAD_M = 0.02
_STRAY = 5.0
"""a point that is left further off than this many standard deviations was hardly touched right"""
_LEAST_TOUCH = 0.001
"""a point within a millimetre or so of the others is never called stray [m]"""


@dataclass(frozen=True, slots=True)
class Blame:
    """A parameter that explains the tool's error."""

    title: str
    amount: float
    """how much larger it is than the robot says, in ``unit``"""
    unit: BlameUnit
    standard_error: float
    """in ``unit``"""
    or_else: tuple[str, ...]
    """parameters that would explain these points as well"""

    def __str__(self) -> str:
        """One line."""
        digits = 2 if self.unit != "mm" else 1
        told = f"{self.title}: {self.amount:+.{digits}f} {self.unit} (± {self.standard_error:.{digits}f})"
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
    """(k, 3) the same with the blamed parameters corrected [m]"""
    blamed: tuple[Blame, ...]
    """the one that explains most first; empty: none explains more than chance would"""
    not_told_apart: tuple[str, ...]
    """what these points cannot tell, in words"""
    changes: tuple[Change, ...]
    """of robot file and calibration, where the blamed parameters stand in them"""
    stray: tuple[int, ...]
    """points that do not fit even so, by index"""

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
        """``rms_m`` with the blamed parameters corrected."""
        return _rms(self.left_m)

    @property
    def largest_after_m(self) -> float:
        """``largest_m`` with the blamed parameters corrected."""
        return float(np.linalg.norm(self.left_m, axis=1).max())

    @property
    def words(self) -> tuple[str, ...]:
        """All of it for the user."""
        told = [
            f"tool error of {len(self.errors_m)} points: RMS {1000 * self.rms_m:.2f} mm, largest "
            f"{1000 * self.largest_m:.2f} mm"
        ]
        if self.blamed:
            told += [f"to blame: {one}" for one in self.blamed]
            told.append(
                f"with that corrected: RMS {1000 * self.rms_after_m:.2f} mm, largest "
                f"{1000 * self.largest_after_m:.2f} mm"
            )
        else:
            told.append("no parameter is to blame: none explains more of it than chance would")
        for index in self.stray:
            off = 1000 * float(np.linalg.norm(self.left_m[index]))
            told.append(
                f"point {index + 1} is still {off:.1f} mm off and does not fit the others: touch it again"
            )
        return tuple(told)

    def toml(self) -> str:
        """The changed values, each with the old one and where it stands."""
        lines: list[str] = []
        for change in self.changes:
            heading = f"# [{change.table}]"
            if heading not in lines:
                lines.append(heading)
            lines.append(str(change))
        return "".join(f"{line}\n" for line in lines)


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
    geometry = Geometry(robot, configurations)
    before = solve(geometry, points, ())
    after, steps = find_blame(geometry, points)
    return ToolError(
        errors_m=before.left,
        left_m=after.left,
        blamed=_blamed(geometry, after, steps),
        not_told_apart=_not_told_apart(geometry, before.columns),
        changes=_changes(robot, [geometry.parameters[i] for i in after.chosen], after.amounts, calibrated),
        stray=_stray(after),
    )


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


def _blamed(geometry: Geometry, after: Correction, steps: tuple[Step, ...]) -> tuple[Blame, ...]:
    errors = after.standard_errors if steps else np.empty(0)
    return tuple(
        Blame(
            geometry.parameters[step.parameter].title,
            amount,
            geometry.parameters[step.parameter].unit,
            error,
            tuple(geometry.parameters[i].title for i in step.or_else),
        )
        for step, amount, error in zip(steps, after.amounts.tolist(), errors.tolist(), strict=True)
    )


def _not_told_apart(geometry: Geometry, columns: FloatArray) -> tuple[str, ...]:
    without, sets = unseen(columns)
    titles = [parameter.title for parameter in geometry.parameters]
    told = [f"these points do not show the {titles[i]}" for i in without]
    told += [f"these points do not tell apart: {', '.join(titles[i] for i in one)}" for one in sets]
    return tuple(told)


def _stray(after: Correction) -> tuple[int, ...]:
    """Points further off than the others let expect."""
    squares = np.sum(after.left**2, axis=1)
    others = (after.squares - squares + 3 * _LEAST_TOUCH**2) / max(after.left.size - 3, 1)
    return tuple(np.flatnonzero(squares > _STRAY**2 * others).tolist())


def _changes(
    robot: Robot, parameters: list[Parameter], amounts: FloatArray, calibrated: Collection[str]
) -> tuple[Change, ...]:
    found: list[Change] = []
    joints: dict[int, tuple[float, float]] = {}
    for parameter, amount in zip(parameters, amounts.tolist(), strict=True):
        error = amount * parameter.size
        if parameter.kind in ("a", "d"):
            row = robot.chain.rows[parameter.index]
            old = 1000 * (row.a_m if parameter.kind == "a" else row.d_m)
            table = _row_table(robot, parameter.index)
            found.append(Change(table, f"{parameter.kind}_mm", old, old + 1000 * error))
        elif parameter.kind in ("zero", "scale"):
            zero, scale = joints.get(parameter.index, (0.0, 0.0))
            joints[parameter.index] = (error, scale) if parameter.kind == "zero" else (zero, error)
    for index, (zero, scale) in joints.items():
        found += _joint_changes(robot, index, zero, scale, robot.joint_names[index] in calibrated)
    return tuple(found)


def _joint_changes(robot: Robot, index: int, offset: float, scale: float, calibrated: bool) -> list[Change]:
    """The map under which a joint that says θ stands at θ + offset + scale · θ."""
    outputs, name = robot.output_map, robot.joint_names[index]
    if outputs is None:
        row = robot.chain.joint_rows[index]
        old = math.degrees(robot.chain.rows[row].theta_rad)
        return [Change(_row_table(robot, row), "theta_deg", old, old + math.degrees(offset))]
    per, zero = float(outputs.per_rad[index]), float(outputs.zero[index])
    new_per = per / (1 + scale)
    new_zero = zero - offset * new_per
    if calibrated:
        pairs = [("zero", zero, new_zero), ("per_deg", math.radians(per), math.radians(new_per))]
        table = f"calibration: joints.{name}"
    elif outputs.unit == "counts":
        pairs = [
            ("counts_per_deg", math.radians(per), math.radians(new_per)),
            ("home_deg", math.degrees(-zero / per), math.degrees(-new_zero / new_per)),
        ]
        table = f"joints.{name}.encoder"
    else:
        pairs = [("zero_us", zero, new_zero), ("us_per_deg", math.radians(per), math.radians(new_per))]
        table = f"joints.{name}.servo"
    return [Change(table, key, old, new) for key, old, new in pairs if not math.isclose(old, new)]


def _row_table(robot: Robot, row: int) -> str:
    rows = robot.chain.joint_rows
    joint = f' (joint = "{robot.joint_names[rows.index(row)]}")' if row in rows else ""
    return f"dh.rows, row {row + 1}{joint}"


def _rms(errors: FloatArray) -> float:
    return math.sqrt(float(np.sum(errors**2)) / len(errors))

"""How far the tool is from points that it touches, which parameter is to blame, and what to write instead."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.errors import CalibrationError
from armctl.kinematics.target import as_numbers
from armctl.robot import Robot

# The numbers of an arm that may be wrong, and how far each moves the tool.

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


# Which parameters of an arm explain where its tool went, as far as the touched points can tell.

TOUCH_M = 0.0005
"""standard deviation of a coordinate of a touch, before anything is measured [m]"""
TOUCH_WEIGHT = 5.0
"""how many coordinates that is worth"""
UNSEEN_M = 0.00005
"""what moves the tool by less than this for a unit of error cannot be seen [m]"""
_FALSE_ALARM = 0.01
_MOST_BLAMED = 3
_ROUNDS = 12
_SHARE = 0.1
"""of a movement of the tool; what has less part in it is not named"""
_PROMISING = 0.25
"""of the best drop that the first derivatives foresee; candidates below it are not looked at closer"""


@dataclass(frozen=True, slots=True)
class Correction:
    """Errors of some parameters that explain the touches best."""

    chosen: tuple[int, ...]
    amounts: FloatArray
    """of each chosen parameter, in its unit"""
    left: FloatArray
    """(k, 3) what they leave [m]"""
    columns: FloatArray
    """(k, 3, p) derivatives by all parameters there [m a unit]"""

    @property
    def squares(self) -> float:
        """Summed squares of what is left [m²]."""
        return float(np.sum(self.left**2))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of ``variance``."""
        return TOUCH_WEIGHT + self.left.size - len(self.chosen)

    @property
    def variance(self) -> float:
        """Of one coordinate [m²], from what is left and from what a touch is known for."""
        return (TOUCH_WEIGHT * TOUCH_M**2 + self.squares) / self.freedom

    @property
    def standard_errors(self) -> FloatArray:
        """Of each amount, in its unit."""
        seen = self.columns[..., list(self.chosen)].reshape(-1, len(self.chosen))
        return np.sqrt(self.variance * np.diag(np.linalg.inv(seen.T @ seen)))


@dataclass(frozen=True, slots=True)
class Step:
    """One parameter that was blamed, and those that would have explained as much."""

    parameter: int
    or_else: tuple[int, ...]


def find_blame(geometry: Geometry, points: FloatArray) -> tuple[Correction, tuple[Step, ...]]:
    """Blame one parameter after another, while each makes the touches fit better than chance would.

    Chance: at the level of 1 % over all the parameters that could have been blamed (Bonferroni).

    Args:
        geometry: the arm at the configurations (k, n) in which it touched.
        points: (k, 3) what it touched [m].
    """
    now = solve(geometry, points, ())
    steps: list[Step] = []
    for _ in range(_MOST_BLAMED):
        tried = _tried(geometry, points, now)
        if not tried:
            break
        least = min(one.squares for one in tried)
        best = next(one for one in tried if one.squares - least <= 1e-6 * one.variance)
        limit = _quantile(1 - _FALSE_ALARM / (2 * len(geometry.parameters)), best.freedom)
        if now.squares - best.squares <= limit**2 * best.variance:
            break
        doubt = _quantile(1 - _FALSE_ALARM / 2, best.freedom) ** 2 * best.variance
        like = [one.chosen[-1] for one in tried if one is not best and one.squares - least <= doubt]
        steps.append(Step(best.chosen[-1], tuple(like)))
        now = best
    return now, tuple(steps)


def solve(
    geometry: Geometry, points: FloatArray, chosen: Sequence[int], start: FloatArray | None = None
) -> Correction:
    """The errors of the chosen parameters that explain the points best (Gauss-Newton)."""
    picked = list(chosen)
    amounts = np.zeros(len(picked)) if start is None else start.copy()
    errors = np.zeros(len(geometry.parameters))
    errors[picked] = amounts
    tips, columns = geometry.tips(errors)
    left = points - tips
    for _ in range(_ROUNDS if picked else 0):
        step = np.linalg.lstsq(columns[..., picked].reshape(-1, len(picked)), left.ravel(), rcond=None)[0]
        if np.abs(step).max() < 1e-9:
            break
        errors[picked] = amounts = amounts + step
        tips, columns = geometry.tips(errors)
        left = points - tips
    return Correction(tuple(picked), amounts, left, columns)


def unseen(columns: FloatArray) -> tuple[tuple[int, ...], tuple[tuple[int, ...], ...]]:
    """What the touches cannot tell: parameters without effect, and sets of which any one could be the others.

    Args:
        columns: (k, 3, p) derivatives of the tool points [m a unit].

    Returns:
        The parameters without effect, and the sets that depend on each other, by index.
    """
    flat = columns.reshape(-1, columns.shape[-1]) / math.sqrt(len(columns))
    size = np.linalg.norm(flat, axis=0)
    told: list[int] = []
    sets: list[tuple[int, ...]] = []
    # In the order of likelihood: a set says which likelier ones another one looks like.
    for column in np.flatnonzero(size >= UNSEEN_M).tolist():
        before = flat[:, told]
        share = np.linalg.lstsq(before, flat[:, column], rcond=None)[0]
        if np.linalg.norm(flat[:, column] - before @ share) >= UNSEEN_M:
            told.append(column)
            continue
        matters = np.abs(share) * size[told] > _SHARE * size[column]
        sets.append((*(i for i, one in zip(told, matters.tolist(), strict=True) if one), column))
    return tuple(np.flatnonzero(size < UNSEEN_M).tolist()), tuple(sorted(_merged(sets)))


def _merged(sets: list[tuple[int, ...]]) -> list[tuple[int, ...]]:
    """Sets of two that share one are one: each of their parameters could be any other."""
    pairs = [set(one) for one in sets if len(one) == 2]
    merged: list[set[int]] = []
    for pair in pairs:
        apart = [one for one in merged if not one & pair]
        merged = [*apart, pair.union(*(one for one in merged if one & pair))]
    return [*(one for one in sets if len(one) != 2), *(tuple(sorted(one)) for one in merged)]


def _tried(geometry: Geometry, points: FloatArray, now: Correction) -> list[Correction]:
    """What one more parameter would make of it, for each promising one, the likeliest first."""
    drops = _drops(now)
    if drops.max(initial=0.0) <= 0:
        return []
    promising = np.flatnonzero(drops >= _PROMISING * drops.max())
    return [solve(geometry, points, (*now.chosen, int(i)), np.append(now.amounts, 0.0)) for i in promising]


def _drops(now: Correction) -> FloatArray:
    """(p,) how much of the squares each further parameter would take away, by the first derivatives."""
    left, columns = now.left.ravel(), now.columns.reshape(now.left.size, -1)
    if now.chosen:
        basis = np.linalg.qr(columns[:, list(now.chosen)])[0]
        columns = columns - basis @ (basis.T @ columns)
    size = np.linalg.norm(columns, axis=0)
    told = size >= UNSEEN_M * math.sqrt(len(now.left))
    drops = (columns.T @ left) ** 2 / np.where(told, size, 1.0) ** 2
    return np.where(told, drops, 0.0)


def _quantile(probability: float, freedom: float) -> float:
    from scipy.special import stdtrit  # slow to import, and only a tool error needs it

    return float(stdtrit(freedom, probability))


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

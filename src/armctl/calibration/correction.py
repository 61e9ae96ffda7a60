"""What is written where touched points correct an arm: into its calibration, or into its robot file."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import Literal

import msgspec
import numpy as np

from armctl.calibration.apply import own_calibration, own_map
from armctl.calibration.record import Calibration, JointCalibration, JointDeflection, LengthChange
from armctl.calibration.touch_report import TouchFit
from armctl.errors import CalibrationError
from armctl.facts import say
from armctl.facts.angles import to_degrees
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot

_KEYS: tuple[Literal["a", "d"], ...] = ("a", "d")


@dataclass(frozen=True, slots=True)
class Change:
    """A value of the robot file, or of the calibration where that stands above it."""

    table: str
    """where it is: ``joints.elbow.servo``, ``dh.rows, row 3 (joint elbow)``, ``calibration: joints.elbow``"""
    key: str
    old: float
    new: float


def corrected(fit: TouchFit, now: Calibration) -> Calibration:
    """The calibration ``now`` of the fit's robot with what the points say: zeros, sag, play and lengths.

    ``CalibrationError``: the points say nothing better, or the robot's outputs are not known.
    """
    if not fit.correct:
        raise CalibrationError(
            f"there is nothing to correct: {'' if fit.verdict is None else say(fit.verdict)}"
        )
    robot, values = fit.robot, fit.values
    own_map(robot)
    joints, bends = dict(now.joints), dict[str, JointDeflection]()
    for i, name in enumerate(robot.joint_names):
        zero, scale = float(values.zero[i]), float(values.scale[i])
        if zero or scale:
            one = own_calibration(robot, name)
            per = one.per_rad / (1 + scale)
            joints[name] = JointCalibration(one.zero - zero * per, per, one.low, one.high)
        before = now.deflection.get(name, JointDeflection())
        drive = before.drive if fit.drive is None else float(fit.drive[i])
        one = JointDeflection(float(values.compliance[i]), drive, float(values.play[i]))
        if one != JointDeflection():
            bends[name] = one
    lengths: dict[tuple[int, Literal["a", "d"]], float] = {
        (one.row, one.key): one.off_m for one in now.lengths
    }
    for row, pair in enumerate(values.lengths.tolist()):
        for key, off in zip(_KEYS, pair, strict=True):
            if off:
                lengths[row, key] = lengths.get((row, key), 0.0) + off
    return msgspec.structs.replace(
        now,
        joints=joints,
        deflection=bends,
        load_kg=fit.load_kg,
        lengths=tuple(LengthChange(row, key, off) for (row, key), off in lengths.items()),
    )


def changes(fit: TouchFit, calibrated: Collection[str] = ()) -> tuple[Change, ...]:
    """Where the corrected numbers stand, those of the joints ``calibrated`` in the calibration."""
    robot, values, known = fit.robot, fit.values, fit.known
    found: list[Change] = []
    for i, name in enumerate(robot.joint_names):
        zero, scale = float(values.zero[i]), float(values.scale[i])
        if zero or scale:
            found += _of_joint(robot, i, zero, scale, calibrated)
        bends = (
            ("compliance_deg_per_nm", float(known.compliance[i]), float(values.compliance[i])),
            ("play_deg", float(known.play[i]), float(values.play[i])),
        )
        found += [
            Change(f"calibration: deflection.{name}", key, to_degrees(old), to_degrees(new))
            for key, old, new in bends
            if old != new
        ]
    for row, pair in enumerate(values.lengths.tolist()):
        for key, off in zip(("a", "d"), pair, strict=True):
            if off:
                old = 1000 * float(getattr(robot.chain.rows[row], f"{key}_m"))
                found.append(Change(_row_table(robot, row), f"{key}_mm", old, old + 1000 * off))
    return tuple(found)


def suggestion(found: tuple[Change, ...]) -> str:
    """The changed values, each with the old one and where it stands."""

    def lines() -> Iterator[str]:
        table = None
        for one in found:
            if one.table != table:
                table = one.table
                yield f"# [{table}]\n"
            yield f"{one.key} = {one.new:.6g}  # was {one.old:.6g}\n"

    return "".join(lines())


def _of_joint(
    robot: Robot, i: int, offset: float, scale: float, calibrated: Collection[str]
) -> tuple[Change, ...]:
    """What to write where a joint stands further by ``offset`` [rad] and by the share ``scale``."""
    outputs, name = robot.output_map, robot.joint_names[i]
    if outputs is None and not robot.chain.rows:
        table = f"the URDF file, joint {name}: the turn of its origin about its axis"
        return (Change(table, "offset_deg", 0.0, to_degrees(offset)),)
    if outputs is None:
        return _turned_rows(robot, i, to_degrees(offset)) if offset else ()
    # The map under which a joint that says θ stands at θ + offset + scale · θ.
    per, zero = float(outputs.per_rad[i]), float(outputs.zero[i])
    new_per = per / (1 + scale)
    new_zero = zero - offset * new_per
    if name in calibrated:
        pairs = [("zero", zero, new_zero), ("per_deg", math.radians(per), math.radians(new_per))]
        table = f"calibration: joints.{name}"
    else:
        per_deg = (f"{outputs.key}_per_deg", math.radians(per), math.radians(new_per))
        home = ("home_deg", to_degrees(-zero / per), to_degrees(-new_zero / new_per))
        pairs = [per_deg, home] if outputs.homed else [(f"zero_{outputs.key}", zero, new_zero), per_deg]
        table = f"joints.{name}.{outputs.table}"
    return tuple(Change(table, key, old, new) for key, old, new in pairs if not math.isclose(old, new))


def _turned_rows(robot: Robot, joint: int, offset_deg: float) -> tuple[Change, ...]:
    """The zero of a joint written into the DH rows: of all links that it turns, which several do by rods."""
    chain = robot.chain
    coupling = np.eye(robot.n) if chain.coupling is None else chain.coupling
    found: list[Change] = []
    for link in np.flatnonzero(coupling[:, joint]).tolist():
        row = chain.joint_rows[link]
        old = to_degrees(chain.rows[row].theta_rad)
        new = old + float(coupling[link, joint]) * offset_deg
        found.append(Change(_row_table(robot, row), "theta_deg", old, new))
    return tuple(found)


def _row_table(robot: Robot, row: int) -> str:
    rows = [robot.chain.joint_rows[link] for link in robot.chain.first_links]
    joint = f' (joint = "{robot.joint_names[rows.index(row)]}")' if row in rows else ""
    return f"dh.rows, row {row + 1}{joint}"

"""What a calibration says: of one robot on one board."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from armctl.errors import CalibrationError
from armctl.robot import FLATTEST_PER_DEG, OutputUnit

LARGEST_OUTPUT = 1e9
"""no output of any board is larger"""


class JointCalibration(msgspec.Struct, frozen=True):
    """output = zero + per_rad · angle, and the outputs that are safe; in the board's unit."""

    zero: float
    """output at 0 rad"""
    per_rad: float
    """signed"""
    low: float
    """smallest output that is safe"""
    high: float
    """largest one"""

    def angles(self) -> tuple[float, float]:
        """The angles at the safe outputs, the smaller one first [rad]."""
        first, last = sorted(((self.low - self.zero) / self.per_rad, (self.high - self.zero) / self.per_rad))
        return first, last


class Calibration(msgspec.Struct, frozen=True):
    """What was measured of one robot on one board. What it does not name is as in the robot file."""

    robot: str
    """name of the robot"""
    board: str
    """serial number of the board, or "simulated" """
    unit: OutputUnit
    joints: Mapping[str, JointCalibration]
    """by name"""
    gripper: tuple[float, float] | None = None
    """outputs at which it is closed and open"""
    made: str = ""
    """when it was measured (ISO 8601)"""
    note: str = ""

    @property
    def empty(self) -> bool:
        """It changes nothing: the robot file holds as it is."""
        return not self.joints and self.gripper is None


def checked_calibration(calibration: Calibration) -> Calibration:
    """The calibration, if its numbers make sense by themselves.

    Raises:
        CalibrationError: names the part, its value and what is allowed.
    """
    for key in ("robot", "board"):
        if not getattr(calibration, key):
            raise CalibrationError(f"{key} is empty; a calibration is of one robot on one board")
    for name, joint in calibration.joints.items():
        per_deg = math.radians(joint.per_rad)  # as the file has it
        values = {"zero": joint.zero, "per_deg": per_deg, "low": joint.low, "high": joint.high}
        for key, value in values.items():
            _require_usable(f"joints.{name}.{key}", value)
        if abs(per_deg) < FLATTEST_PER_DEG:
            raise CalibrationError(
                f"joints.{name}.per_deg = {per_deg:g}: the joint would not move; {FLATTEST_PER_DEG} "
                f"{calibration.unit} a degree or more"
            )
        if joint.low >= joint.high:
            raise CalibrationError(
                f"joints.{name}: low = {joint.low:g} and high = {joint.high:g} {calibration.unit}: "
                "the smallest safe output comes first"
            )
    if calibration.gripper is not None:
        closed, opened = calibration.gripper
        _require_usable("gripper.closed", closed)
        _require_usable("gripper.open", opened)
        if closed == opened:
            raise CalibrationError(f"gripper: closed and open are both {closed:g} {calibration.unit}")
    return calibration


def _require_usable(key: str, value: float) -> None:
    if not (math.isfinite(value) and abs(value) <= LARGEST_OUTPUT):
        raise CalibrationError(f"{key} = {value}: must be a finite number within ±{LARGEST_OUTPUT:.0e}")

"""A joint with a hidden map, read off a protractor; calibrations to store."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration import Calibration, JointCalibration, Mark


@dataclass(frozen=True)
class HiddenJoint:
    """output = zero + per_deg · angle, and nobody knows the two numbers."""

    zero: float = 1520.0
    per_deg: float = -9.4

    def marks(
        self, angles_deg: FloatArray, noise_deg: float = 0.0, rng: np.random.Generator | None = None
    ) -> list[Mark]:
        """What is read where the joint truly stands at ``angles_deg``."""
        noise = np.zeros(len(angles_deg)) if rng is None else rng.normal(0.0, noise_deg, len(angles_deg))
        return [
            Mark(self.zero + self.per_deg * angle, math.radians(angle + wrong))
            for angle, wrong in zip(angles_deg.tolist(), noise.tolist(), strict=True)
        ]


def with_wrong(marks: list[Mark], index: int, by_deg: float) -> list[Mark]:
    """The same with one mark misread."""
    wrong = Mark(marks[index].output, marks[index].angle + math.radians(by_deg))
    return [*marks[:index], wrong, *marks[index + 1 :]]


def calibration(zero: float = 1500.0, board: str = "00123456", note: str = "") -> Calibration:
    """One of uzuner's elbow."""
    return Calibration(
        robot="uzuner",
        board=board,
        unit="µs",
        joints={"elbow": JointCalibration(zero, 573.0, 700.0, 2300.0)},
        gripper=(1100.0, 1900.0),
        made="2025-03-01T12:00:00+01:00",
        note=note,
    )

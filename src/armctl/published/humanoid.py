"""The humanoid arm: the printed pose, and the paper's inverse kinematics against an exact one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.published.report import Comparison, Improvement, Report, floats
from armctl.robot import load_robot

FloatArray = NDArray[np.float64]
CM = 100.0
"""centimetres in a metre: the paper's unit"""
LENGTH_DIGIT = 0.00005
"""half a unit of the fourth decimal [cm]"""
PRINTED_POSE = ((45, 0, 30, 50, 0), (32.5689, 32.5689, -35.3467))
"""angles [degrees], position [cm]"""
PRINTED_ROW = (0.0, -0.1736)
"""r32 and r33 of that pose, as they should have been printed"""
ROTATION_DIGIT = 0.00005
TARGET = (15.0, -10.0, -59.0)
"""[cm]"""
TARGET_ROTATION = ((-0.8572, 0.0, 0.5150), (-0.0894, 0.9848, -0.1488), (-0.5072, -0.1736, -0.8441))
PRINTED_SOLUTION = (0, -9.62, 0, 31, 0)
"""the paper's angles for the target [degrees]"""
PRINTED_TIP = (14.936, -10.003, -59.016)
"""where those angles put the tip [cm]"""
TIP_DIGIT = 0.0005
EXACT = 1e-7
"""what counts as on the target [cm]: 1e-9 m"""

ERRATA = (
    "Eq. 45 prints r33 = +0.1736; right is −0.1736",
    "Eq. 44 prints r32 = 1; right is 0",
    "Eq. 38 loses the sign of θ3",
    "the inverse kinematics is inexact (mean error of its cases 0.026 to 0.79 cm): the position has an exact "
    "solution, and the elbow's swivel about the line from shoulder to hand is free for the orientation",
)


def humanoid_report() -> Report:
    """Forward kinematics as printed; the inverse one with the paper's error and ours."""
    robot = load_robot("humanoid")
    pose = robot.forward(np.radians(PRINTED_POSE[0]))
    paper = robot.forward(np.radians(PRINTED_SOLUTION))
    target, rotation = np.array(TARGET) / CM, np.array(TARGET_ROTATION)
    solutions = robot.inverse(target, rotation=rotation)
    exact = robot.forward(solutions.q[int(solutions.residual_rad.argmin())])
    there = "at (45, 0, 30, 50, 0)°"
    comparisons = (
        Comparison(f"position {there}", "cm", PRINTED_POSE[1], floats(CM * pose[:3, 3]), LENGTH_DIGIT, 4),
        Comparison(
            f"r32, r33 {there}, errata mended", "–", PRINTED_ROW, floats(pose[2, 1:3]), ROTATION_DIGIT, 4
        ),
        Comparison(
            "tip of the paper's angles for (15, −10, −59)",
            "cm",
            PRINTED_TIP,
            floats(CM * paper[:3, 3]),
            TIP_DIGIT,
        ),
        Comparison("tip of armctl's angles for it", "cm", TARGET, floats(CM * exact[:3, 3]), EXACT),
    )
    improvements = (
        Improvement("distance from the target", "cm", *(CM * _distance(T, target) for T in (paper, exact))),
        Improvement(
            "orientation residual (Frobenius norm)", "–", *(_turned(T, rotation) for T in (paper, exact))
        ),
    )
    return Report("humanoid", "5-DOF humanoid arm (HRA)", comparisons, ERRATA, improvements)


def _distance(T: FloatArray, target: FloatArray) -> float:
    return float(np.linalg.norm(T[:3, 3] - target))


def _turned(T: FloatArray, rotation: FloatArray) -> float:
    return float(np.linalg.norm(T[:3, :3] - rotation))

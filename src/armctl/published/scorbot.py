"""Scorbot ER-4PC: the printed tip formula and reach, and the two elbow solutions of a pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from armctl.published.report import Comparison, Report
from armctl.robot import Robot, load_robot

FloatArray = NDArray[np.float64]
REACH_MM = 604.0
STRETCHED = np.radians([0.0, 0.0, 0.0, -90.0, 0.0])
"""both links and the tool in one level line"""
_CONFIGURATIONS = 1000

ERRATA = (
    "θ4 = θ2 + θ3 − θ234 as printed; right is θ4 = θ234 − θ2 − θ3",
    "θ5 as printed loses a quadrant and divides by cos θ5: derived anew from the joint axes",
)


def scorbot_report() -> Report:
    """Tip formula, reach, and how many elbow solutions a pose has."""
    robot = load_robot("scorbot")
    reach = 1000 * float(np.hypot(*robot.forward(STRETCHED)[:2, 3]))
    comparisons = (
        Comparison("reach from the waist axis, stretched", "mm", (REACH_MM,), (reach,), 1e-6, 1),
        Comparison(
            f"printed tip formula against the DH rows, largest difference of {_CONFIGURATIONS}",
            "mm",
            (0.0,),
            (_formula_error_mm(robot),),
            1e-9,
            1,
        ),
        _solutions(robot, "elbow solutions of the home pose", robot.pose("home"), 2),
        _solutions(robot, "elbow solutions of the stretched pose", STRETCHED, 1),
    )
    return Report("scorbot", "Scorbot ER-4PC on an Arduino Mega 2560", comparisons, ERRATA)


def printed_tip(q: FloatArray) -> FloatArray:
    """The paper's formula: tip (k, 3) [m] of configurations (k, 5) [rad]."""
    t1, t2, t3, t4 = q[:, :4].T
    r = 0.025 + 0.222 * np.cos(t2) + 0.222 * np.cos(t2 + t3) - 0.135 * np.sin(t2 + t3 + t4)
    z = 0.325 - 0.222 * np.sin(t2) - 0.222 * np.sin(t2 + t3) - 0.135 * np.cos(t2 + t3 + t4)
    return np.stack([r * np.cos(t1), r * np.sin(t1), z], axis=1)


def _formula_error_mm(robot: Robot) -> float:
    rng = np.random.default_rng(4)
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (_CONFIGURATIONS, robot.n))
    return 1000 * float(np.abs(robot.forward(q)[:, :3, 3] - printed_tip(q)).max())


def _solutions(robot: Robot, what: str, q: FloatArray, printed: int) -> Comparison:
    """Solutions of the tool pose of ``q`` that face it as ``q`` does."""
    T = robot.forward(q)
    solutions = robot.inverse(T[:3, 3], rotation=T[:3, :3])
    same_waist = np.abs(solutions.q[:, 0] - q[0]) < 1e-6
    return Comparison(what, "solutions", (float(printed),), (float(same_waist.sum()),), 0, 0)

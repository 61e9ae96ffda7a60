"""Uzuner, Toz et al.: the printed inverse kinematics, and the two test trajectories."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from armctl.motion import arc, line
from armctl.published.report import Comparison, Report, floats
from armctl.robot import Robot, load_robot

FloatArray = NDArray[np.float64]
PEN_PLANE_MM = 85.0
ANGLE_DIGIT = 0.0005
"""half a unit of the third decimal that the paper prints [degrees]"""
TIP_TOLERANCE_MM = 0.005
"""the paper's RMSE of the solutions [mm]"""

PRINTED: tuple[tuple[str, tuple[float, float], tuple[float, float, float, float]], ...] = (
    ("arc 1", (10.46, -199.73), (-88.039, 43.57, -84.341, -31.568)),
    ("arc 2", (21.08, -198.89), (-84.987, 43.57, -84.341, -31.568)),
    ("arc 3", (31.63, -197.48), (-81.937, 43.57, -84.339, -31.576)),
    ("line 1", (220.0, -196.0), (-42.402, 14.4, -45.909, -1.305)),
    ("line 2", (220.0, -182.0), (-40.326, 18.92, -53.929, -0.64)),
    ("line 3", (220.0, -168.0), (-38.116, 22.72, -60.482, -0.533)),
)
"""name, x and y [mm], θ1 … θ4 [degrees]"""

ERRATA = (
    "Eq. 12-14 are garbled in print (a positive root only, a misplaced bracket, θi): derived anew",
    "gripper opening 0 … 330 'mm' is the travel of the gripper servo's encoder: taken as 0 … 100 %",
    "the text says least sum of the angles; the tables follow min |θ1+θ2+θ3+θ4| among θ4 ≤ 0 ('published')",
)


def uzuner_report() -> Report:
    """The printed rows with the ``published`` criterion, their tips, and both trajectories."""
    robot = load_robot("uzuner")
    comparisons: list[Comparison] = []
    for name, (x, y), angles in PRINTED:
        q = robot.inverse(np.array([x, y, PEN_PLANE_MM]) / 1000).best("published")
        computed = np.degrees(q[:4])
        comparisons.append(
            Comparison(f"{name}: θ1 … θ4 at ({x:g}, {y:g}, 85)", "°", angles, floats(computed), ANGLE_DIGIT)
        )
        tip = 1000 * robot.forward(np.radians([*angles, 0.0]))[:3, 3]
        comparisons.append(
            Comparison(
                f"{name}: tip of the printed angles",
                "mm",
                (x, y, PEN_PLANE_MM),
                floats(tip),
                TIP_TOLERANCE_MM,
                4,
            )
        )
    comparisons += [_trajectory(robot, "arc", arc), _trajectory(robot, "line", line)]
    return Report(
        "uzuner", "Uzuner, Toz et al.: 5-DOF arm on a Pololu Micro Maestro", tuple(comparisons), ERRATA
    )


def _trajectory(robot: Robot, name: str, points: Callable[[], FloatArray]) -> Comparison:
    """Points of a test trajectory that are solved and reached within the paper's RMSE."""
    path = points()
    reached = 0
    for point in path:
        solutions = robot.inverse(point)
        if not solutions.success:
            continue
        miss_mm = 1000 * float(np.linalg.norm(robot.forward(solutions.best("published"))[:3, 3] - point))
        reached += miss_mm <= TIP_TOLERANCE_MM
    return Comparison(f"{name}: points solved", "points", (float(len(path)),), (float(reached),), 0.0, 0)

"""Kinova MICO lab sheet: the two solutions of a point, and why another one cannot be reached."""

from __future__ import annotations

import numpy as np

from armctl.published.report import Comparison, Report, floats
from armctl.robot import Robot, load_robot

ANGLE_DIGIT = 0.0005
"""half a unit of the third decimal that the sheet prints [degrees]"""
ABOVE_BASE = (0.0, 0.0, 0.7)
PRINTED: tuple[tuple[str, tuple[float, float, float]], ...] = (
    ("solution 1", (0, -131.626, -5.532)),
    ("solution 2", (0, -48.374, -174.468)),
)
"""name, θ1 … θ3 [degrees] for the point above the base"""
OUT_OF_REACH = (0.5, 0.0, 0.7)
SHOULDER_HEIGHT = 0.2755
PRINTED_DISTANCE_MM, PRINTED_REACH_MM, PRINTED_MISS_MM = 655.9, 573.3, 82.6
LENGTH_DIGIT = 0.05


def mico_report() -> Report:
    """Both printed solutions, and the miss of the point that is too far."""
    robot = load_robot("mico")
    comparisons: list[Comparison] = []
    solutions = robot.inverse(ABOVE_BASE)
    for name, angles in PRINTED:
        found = solutions.q[solutions.index_of(np.radians([*angles, 0.0]))]
        comparisons.append(
            Comparison(
                f"{name}: θ1 … θ3 at (0, 0, 700)", "°", angles, floats(np.degrees(found[:3])), ANGLE_DIGIT
            )
        )
    comparisons.append(
        Comparison(
            "(500, 0, 700): distance from the shoulder, reach, too far by",
            "mm",
            (PRINTED_DISTANCE_MM, PRINTED_REACH_MM, PRINTED_MISS_MM),
            _out_of_reach(robot),
            LENGTH_DIGIT,
            1,
        )
    )
    return Report("mico", "Kinova MICO as a 4-DOF teaching arm (lab sheet)", tuple(comparisons), ())


def _out_of_reach(robot: Robot) -> tuple[float, float, float]:
    """Of the point that is too far [mm]: its distance, how far the arm gets, and the rest."""
    shoulder = np.array([0.0, 0.0, SHOULDER_HEIGHT])
    nearest = robot.inverse(OUT_OF_REACH).nearest_m
    if nearest is None:  # reached after all: nothing is missing
        nearest = np.array(OUT_OF_REACH)
    distance, reach, miss = (
        1000 * float(np.linalg.norm(vector))
        for vector in (OUT_OF_REACH - shoulder, nearest - shoulder, OUT_OF_REACH - nearest)
    )
    return distance, reach, miss

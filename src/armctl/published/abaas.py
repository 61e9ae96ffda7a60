"""Abaas et al.: the printed servo angles with their tips, and the tip speed of each joint."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.errors import RobotFileError
from armctl.published.report import Comparison, Improvement, Report, floats
from armctl.robot import Robot, load_robot

FloatArray = NDArray[np.float64]
SERVO_PULSE_US = (544.0, 2400.0)
"""pulses of the Arduino Servo library at 0° and 180°"""
WHOLE_DEGREES_MM = 0.7
"""what servo angles printed in whole degrees leave open in the tip [mm]"""
PRINTED: tuple[tuple[tuple[float, ...], tuple[float, float, float]], ...] = (
    ((86, 130, 125, 60, 90), (-21.05, 308.3, 172.5)),
    ((144, 110, 135, 54, 90), (221.4, 160.9, 218)),
)
"""Table 2: servo angles [degrees], tip [mm]"""
STUDY_SPEED = math.radians(20)
"""speed of the one joint that turns in the paper's velocity figure [rad/s]"""
PRINTED_SPEED_MM_S = 8.32e3
MOST_EFFECTIVE = 2
"""the joint that the paper finds to move the tip fastest: the shoulder"""
STRETCHED = np.radians([0.0, 0.0, 0.0, 90.0, 0.0])
"""the tip as far from the shoulder as the links allow"""
_CONFIGURATIONS = 4000

ERRATA = (
    "Eq. 12-15 mix a sign and an index (a3, a4 for a2, a3), and the cosine rule lacks squares: derived anew",
    "Table 2 lists servo angles s, not DH angles: θ1 = −s1, θ2 = s2, θ3 = s3 − 90, θ4 = 180 − s4, θ5 = s5",
    "the printed tip speed of 8.32·10³ mm/s cannot be: a joint at 20°/s moves a tip at most 355 mm away "
    "with 123.9 mm/s",
)


def abaas_report() -> Report:
    """The printed rows through the servo map, back by inverse kinematics, and the speed study.

    Raises:
        RobotFileError: the robot file has lost its servo map.
    """
    robot = load_robot("abaas")
    servos = robot.output_map
    if servos is None:
        raise RobotFileError("abaas: the printed rows are servo angles, and the robot file has no servo map")
    comparisons: list[Comparison] = []
    for printed, tip in PRINTED:
        q = servos.angles(dict(zip(servos.channels, pulses(printed), strict=True)))
        row = f"servo angles {', '.join(f'{angle:g}' for angle in printed)}"
        reached = robot.forward(q)[:3, 3]
        comparisons.append(Comparison(f"{row}: tip", "mm", tip, floats(1000 * reached), WHOLE_DEGREES_MM, 2))
        pitch, roll = robot.inverse_kinematics.pitch_and_roll(q)
        solutions = robot.inverse(reached, pitch, roll)
        sent = servos.outputs(solutions.q[solutions.index_of(q)])
        back = servo_angles([sent[channel] for channel in servos.channels])
        comparisons.append(Comparison(f"{row}: back by inverse kinematics", "°", floats(printed), back, 1e-6))
    speeds = tip_speeds(robot)
    fastest = 1.0 + float(speeds.mean(axis=0).argmax())
    comparisons.append(
        Comparison(
            "joint that moves the tip fastest, on average", "(number)", (MOST_EFFECTIVE,), (fastest,), 0, 0
        )
    )
    impossible = Improvement(
        "largest tip speed with one joint at 20°/s", "mm/s", PRINTED_SPEED_MM_S, 1000 * float(speeds.max())
    )
    return Report(
        "abaas", "Abaas et al.: 5-DOF arm on an Arduino Mega 2560", tuple(comparisons), ERRATA, (impossible,)
    )


def pulses(servo_angles: Sequence[float]) -> list[float]:
    """Pulse widths [µs] that the Arduino Servo library sends for servo angles [degrees]."""
    low, high = SERVO_PULSE_US
    return [low + (high - low) * angle / 180 for angle in servo_angles]


def servo_angles(pulses_us: Sequence[float]) -> tuple[float, ...]:
    """The opposite of ``pulses``."""
    low, high = SERVO_PULSE_US
    return tuple(180 * (pulse - low) / (high - low) for pulse in pulses_us)


def tip_speeds(robot: Robot) -> FloatArray:
    """Tip speed (k, n) [m/s] with one joint alone at the study's speed, over the joint limits.

    The first is the stretched arm, where the tip is farthest from the shoulder.
    """
    rng = np.random.default_rng(2020)
    q = rng.uniform(robot.limits[:, 0], robot.limits[:, 1], (_CONFIGURATIONS, robot.n))
    q[0] = STRETCHED
    return STUDY_SPEED * np.linalg.norm(robot.jacobian(q)[:, :3], axis=1)

"""The printed figures of the papers, recomputed."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import RobotFileError
from armctl.lazy_dataclass import dataclass
from armctl.motion import arc, line
from armctl.robot import Robot, load_robot

__all__ = ["REPORTS", "Comparison", "Improvement", "Report"]


@dataclass(frozen=True, slots=True)
class Comparison:
    """One printed figure and what armctl computes for it, in the print's own unit."""

    what: str
    unit: str
    printed: tuple[float, ...]
    computed: tuple[float, ...]
    tolerance: float
    """largest difference that the print's rounding allows"""
    digits: int = 3
    """decimals worth showing"""

    @property
    def difference(self) -> float:
        """Largest difference between a printed figure and the computed one."""
        return max(abs(a - b) for a, b in zip(self.printed, self.computed, strict=True))

    @property
    def agrees(self) -> bool:
        """True when the figure is reproduced within the print's rounding."""
        return self.difference <= self.tolerance


@dataclass(frozen=True, slots=True)
class Improvement:
    """Where the paper's own method is inexact: its error, and armctl's."""

    what: str
    unit: str
    paper: float
    armctl: float


@dataclass(frozen=True, slots=True)
class Report:
    """One paper's figures."""

    robot: str
    title: str
    comparisons: tuple[Comparison, ...]
    errata: tuple[str, ...]
    """where the print is wrong, and what is right"""
    improvements: tuple[Improvement, ...] = ()

    @property
    def agrees(self) -> bool:
        """True when all figures are reproduced."""
        return all(one.agrees for one in self.comparisons)


def _compared(
    what: str, unit: str, printed: tuple[float, ...], computed: ArrayLike, tolerance: float, digits: int = 3
) -> Comparison:
    """A comparison with a computed number or array."""
    plain = np.atleast_1d(np.asarray(computed, dtype=np.float64)).tolist()
    return Comparison(what, unit, printed, tuple(plain), tolerance, digits)


# Uzuner, Toz et al.: the printed inverse kinematics, and the two test trajectories.

ANGLE_DIGIT = 0.0005
"""half a unit of the third decimal that the paper and the MICO sheet print [degrees]"""
PEN_PLANE_MM = 85.0
TIP_TOLERANCE_MM = 0.005
"""the paper's RMSE of the solutions [mm]"""
UZUNER_PRINTED: tuple[tuple[str, tuple[float, float], tuple[float, float, float, float]], ...] = (
    ("arc 1", (10.46, -199.73), (-88.039, 43.57, -84.341, -31.568)),
    ("arc 2", (21.08, -198.89), (-84.987, 43.57, -84.341, -31.568)),
    ("arc 3", (31.63, -197.48), (-81.937, 43.57, -84.339, -31.576)),
    ("line 1", (220.0, -196.0), (-42.402, 14.4, -45.909, -1.305)),
    ("line 2", (220.0, -182.0), (-40.326, 18.92, -53.929, -0.64)),
    ("line 3", (220.0, -168.0), (-38.116, 22.72, -60.482, -0.533)),
)
"""name, x and y [mm], θ1 … θ4 [degrees]"""
UZUNER_ERRATA = (
    "Eq. 12-14 are garbled in print (a positive root only, a misplaced bracket, θi): derived anew",
    "gripper opening 0 … 330 'mm' is the travel of the gripper servo's encoder: taken as 0 … 100 %",
    "the text says least sum of the angles; the tables follow min |θ1+θ2+θ3+θ4| among θ4 ≤ 0 ('published')",
)


def uzuner_report() -> Report:
    """The printed rows with the ``published`` criterion, their tips, and both trajectories."""
    robot = load_robot("uzuner")
    rows: list[Comparison] = []
    for name, (x, y), angles in UZUNER_PRINTED:
        point_mm = (x, y, PEN_PLANE_MM)
        q = robot.inverse(np.array(point_mm) / 1000).best("published")
        what = f"{name}: θ1 … θ4 at ({x:g}, {y:g}, 85)"
        rows.append(_compared(what, "°", angles, np.degrees(q[:4]), ANGLE_DIGIT))
        tip_mm = 1000 * robot.forward(np.radians([*angles, 0.0]))[:3, 3]
        what = f"{name}: tip of the printed angles"
        rows.append(_compared(what, "mm", point_mm, tip_mm, TIP_TOLERANCE_MM, 4))
    for name, path in (("arc", arc()), ("line", line())):
        reached = sum(_reached(robot, point) for point in path)
        rows.append(_compared(f"{name}: points solved", "points", (float(len(path)),), reached, 0.0, 0))
    title = "Uzuner, Toz et al.: 5-DOF arm on a Pololu Micro Maestro"
    return Report("uzuner", title, tuple(rows), UZUNER_ERRATA)


def _reached(robot: Robot, point: FloatArray) -> bool:
    """Whether a point (3,) [m] is solved and reached within the paper's RMSE."""
    solutions = robot.inverse(point)
    if not solutions.success:
        return False
    tip = robot.forward(solutions.best("published"))[:3, 3]
    return 1000 * float(np.linalg.norm(tip - point)) <= TIP_TOLERANCE_MM


# Abaas et al.: the printed servo angles with their tips, and the tip speed of each joint.

SERVO_PULSE_US = (544.0, 2400.0)
"""pulses of the Arduino Servo library at 0° and 180°"""
WHOLE_DEGREES_MM = 0.7
"""what servo angles printed in whole degrees leave open in the tip [mm]"""
ABAAS_PRINTED: tuple[tuple[tuple[float, ...], tuple[float, float, float]], ...] = (
    ((86, 130, 125, 60, 90), (-21.05, 308.3, 172.5)),
    ((144, 110, 135, 54, 90), (221.4, 160.9, 218)),
)
"""Table 2: servo angles [degrees], tip [mm]"""
STUDY_SPEED = math.radians(20)
"""speed of the one joint that turns in the paper's velocity figure [rad/s]"""
PRINTED_SPEED_MM_S = 8.32e3
MOST_EFFECTIVE = 2
"""the joint that the paper finds to move the tip fastest: the shoulder"""
ABAAS_STRETCHED = np.radians([0.0, 0.0, 0.0, 90.0, 0.0])
"""the tip as far from the shoulder as the links allow"""
ABAAS_ERRATA = (
    "Eq. 12-15 mix a sign and an index (a3, a4 for a2, a3), and the cosine rule lacks squares: derived anew",
    "Table 2 lists servo angles s, not DH angles: θ1 = −s1, θ2 = s2, θ3 = s3 − 90, θ4 = 180 − s4, θ5 = s5",
    "the printed tip speed of 8.32·10³ mm/s cannot be: a joint at 20°/s moves a tip at most 355 mm away "
    "with 123.9 mm/s",
)


def abaas_report() -> Report:
    """The printed rows through the servo map, back by inverse kinematics, and the speed study."""
    robot = load_robot("abaas")
    servos = robot.output_map
    if servos is None:
        raise RobotFileError("abaas: the printed rows are servo angles, and the robot file has no servo map")
    low, high = SERVO_PULSE_US
    rows: list[Comparison] = []
    for printed, tip_mm in ABAAS_PRINTED:
        pulses = [low + (high - low) * angle / 180 for angle in printed]
        q = servos.angles(dict(zip(servos.channels, pulses, strict=True)))
        row = f"servo angles {', '.join(f'{angle:g}' for angle in printed)}"
        tip = robot.forward(q)[:3, 3]
        rows.append(_compared(f"{row}: tip", "mm", tip_mm, 1000 * tip, WHOLE_DEGREES_MM, 2))
        solutions = robot.inverse(tip, *robot.inverse_kinematics.pitch_and_roll(q))
        sent = servos.outputs(solutions.q[solutions.index_of(q)])
        back = [180 * (sent[channel] - low) / (high - low) for channel in servos.channels]
        rows.append(_compared(f"{row}: back by inverse kinematics", "°", printed, back, 1e-6))
    # Tip speeds with one joint alone at the study's speed, over the joint limits; the stretched arm first.
    q = _anywhere(robot, seed=2020, count=4000)
    q[0] = ABAAS_STRETCHED
    speeds = STUDY_SPEED * np.linalg.norm(robot.jacobian(q)[:, :3], axis=1)
    fastest = 1 + speeds.mean(axis=0).argmax()
    what = "joint that moves the tip fastest, on average"
    rows.append(_compared(what, "(number)", (MOST_EFFECTIVE,), fastest, 0, 0))
    what, most_mm_s = "largest tip speed with one joint at 20°/s", 1000 * float(speeds.max())
    impossible = Improvement(what, "mm/s", PRINTED_SPEED_MM_S, most_mm_s)
    title = "Abaas et al.: 5-DOF arm on an Arduino Mega 2560"
    return Report("abaas", title, tuple(rows), ABAAS_ERRATA, (impossible,))


def _anywhere(robot: Robot, seed: int, count: int) -> FloatArray:
    """Configurations (count, n) [rad] inside the limits."""
    low, high = robot.limits.T
    return np.random.default_rng(seed).uniform(low, high, (count, robot.n))


# Scorbot ER-4PC: the printed tip formula and reach, and the two elbow solutions of a pose.

REACH_MM = 604.0
SCORBOT_STRETCHED = np.radians([0.0, 0.0, 0.0, -90.0, 0.0])
"""both links and the tool in one level line"""
SCORBOT_ERRATA = (
    "θ4 = θ2 + θ3 − θ234 as printed; right is θ4 = θ234 − θ2 − θ3",
    "θ5 as printed loses a quadrant and divides by cos θ5: derived anew from the joint axes",
)


def scorbot_report() -> Report:
    """Tip formula, reach, and how many elbow solutions a pose has."""
    robot, count = load_robot("scorbot"), 1000
    reach = 1000 * np.hypot(*robot.forward(SCORBOT_STRETCHED)[:2, 3])
    q = _anywhere(robot, seed=4, count=count)
    off = 1000 * np.abs(robot.forward(q)[:, :3, 3] - printed_tip(q)).max()
    formula = f"printed tip formula against the DH rows, largest difference of {count}"
    rows = [
        _compared("reach from the waist axis, stretched", "mm", (REACH_MM,), reach, 1e-6, 1),
        _compared(formula, "mm", (0.0,), off, 1e-9, 1),
    ]
    for name, pose, printed in (("home", robot.pose("home"), 2.0), ("stretched", SCORBOT_STRETCHED, 1.0)):
        T = robot.forward(pose)
        found = robot.inverse(T[:3, 3], rotation=T[:3, :3]).q
        facing = np.abs(found[:, 0] - pose[0]) < 1e-6  # the waist as it is
        what = f"elbow solutions of the {name} pose"
        rows.append(_compared(what, "solutions", (printed,), facing.sum(), 0, 0))
    return Report("scorbot", "Scorbot ER-4PC on an Arduino Mega 2560", tuple(rows), SCORBOT_ERRATA)


def printed_tip(q: FloatArray) -> FloatArray:
    """The paper's formula: tip (k, 3) [m] of configurations (k, 5) [rad]."""
    t1, t2, t3, t4 = q[:, :4].T
    r = 0.025 + 0.222 * np.cos(t2) + 0.222 * np.cos(t2 + t3) - 0.135 * np.sin(t2 + t3 + t4)
    z = 0.325 - 0.222 * np.sin(t2) - 0.222 * np.sin(t2 + t3) - 0.135 * np.cos(t2 + t3 + t4)
    return np.stack([r * np.cos(t1), r * np.sin(t1), z], axis=1)


# The humanoid arm: the printed pose, and the paper's inverse kinematics against an exact one.

CM = 100.0
"""centimetres in a metre: the paper's unit"""
FOURTH_DIGIT, THIRD_DIGIT = 0.00005, 0.0005
"""half a unit of the last decimal printed"""
PRINTED_POSE = ((45, 0, 30, 50, 0), (32.5689, 32.5689, -35.3467))
"""angles [degrees], position [cm]"""
PRINTED_ROW = (0.0, -0.1736)
"""r32 and r33 of that pose, as they should have been printed"""
TARGET = (15.0, -10.0, -59.0)
"""[cm]"""
TARGET_ROTATION = ((-0.8572, 0.0, 0.5150), (-0.0894, 0.9848, -0.1488), (-0.5072, -0.1736, -0.8441))
PRINTED_SOLUTION = (0, -9.62, 0, 31, 0)
"""the paper's angles for the target [degrees]"""
PRINTED_TIP = (14.936, -10.003, -59.016)
"""where those angles put the tip [cm]"""
EXACT = 1e-7
"""what counts as on the target [cm]: 1e-9 m"""
HUMANOID_ERRATA = (
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
    tip = "tip of the paper's angles for (15, −10, −59)"
    rows = (
        _compared(f"position {there}", "cm", PRINTED_POSE[1], CM * pose[:3, 3], FOURTH_DIGIT, 4),
        _compared(f"r32, r33 {there}, errata mended", "–", PRINTED_ROW, pose[2, 1:3], FOURTH_DIGIT, 4),
        _compared(tip, "cm", PRINTED_TIP, CM * paper[:3, 3], THIRD_DIGIT),
        _compared("tip of armctl's angles for it", "cm", TARGET, CM * exact[:3, 3], EXACT),
    )
    away = [CM * float(np.linalg.norm(T[:3, 3] - target)) for T in (paper, exact)]
    turned = [float(np.linalg.norm(T[:3, :3] - rotation)) for T in (paper, exact)]
    improvements = (
        Improvement("distance from the target", "cm", *away),
        Improvement("orientation residual (Frobenius norm)", "–", *turned),
    )
    return Report("humanoid", "5-DOF humanoid arm (HRA)", rows, HUMANOID_ERRATA, improvements)


# Kinova MICO lab sheet: the two solutions of a point, and why another one cannot be reached.

ABOVE_BASE = (0.0, 0.0, 0.7)
MICO_PRINTED = {"solution 1": (0, -131.626, -5.532), "solution 2": (0, -48.374, -174.468)}
"""θ1 … θ3 [degrees] for the point above the base"""
OUT_OF_REACH = (0.5, 0.0, 0.7)
SHOULDER = (0.0, 0.0, 0.2755)
OUT_OF_REACH_MM = (655.9, 573.3, 82.6)
"""of that point: distance from the shoulder, how far the arm gets, and the rest"""


def mico_report() -> Report:
    """Both printed solutions, and the miss of the point that is too far."""
    robot = load_robot("mico")
    rows: list[Comparison] = []
    solutions = robot.inverse(ABOVE_BASE)
    for name, angles in MICO_PRINTED.items():
        found = solutions.q[solutions.index_of(np.radians([*angles, 0.0]))]
        what = f"{name}: θ1 … θ3 at (0, 0, 700)"
        rows.append(_compared(what, "°", angles, np.degrees(found[:3]), ANGLE_DIGIT))
    shoulder, point = np.array(SHOULDER), np.array(OUT_OF_REACH)
    nearest = robot.inverse(point).nearest_m
    if nearest is None:  # reached after all: nothing is missing
        nearest = point
    ways_mm = 1000 * np.array([point - shoulder, nearest - shoulder, point - nearest])
    what = "(500, 0, 700): distance from the shoulder, reach, too far by"
    rows.append(_compared(what, "mm", OUT_OF_REACH_MM, np.linalg.norm(ways_mm, axis=1), 0.05, 1))
    return Report("mico", "Kinova MICO as a 4-DOF teaching arm (lab sheet)", tuple(rows), ())


REPORTS: dict[str, Callable[[], Report]] = {
    "uzuner": uzuner_report,
    "abaas": abaas_report,
    "scorbot": scorbot_report,
    "humanoid": humanoid_report,
    "mico": mico_report,
}
"""What recomputes each paper, by the name of its robot."""

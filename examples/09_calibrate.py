"""Calibrate an arm: read a protractor at five marks, fit a line, and see how much nearer the tool gets.

The real arm is played by a second servo map: its elbow horn sits 6° off, and its servo turns 4 % too far.
"""

from dataclasses import replace

import numpy as np

import armctl
from armctl.calibration import Calibration, JointCalibration, Mark, calibrated, fit_joint

ELBOW, MARKS = 2, (-70, -35, 0, 35, 70)  # index of the joint; commanded angles [°]

robot = armctl.load_robot("uzuner")
servos = robot.output_map
as_built = replace(
    servos,
    zero=servos.zero + np.array([0, 0, 60, 0, 0]),  # µs
    per_rad=servos.per_rad / np.array([1, 1, 1.04, 1, 1]),
)
random = np.random.default_rng(1)

marks = []
with armctl.Arm.open(robot) as arm:
    arm.enable()
    for angle in MARKS:
        arm.go_joints([0, 100, angle, 0, 0])
        sent = servos.outputs(arm.snapshot.q_command)  # what the board was told [µs]
        read = as_built.angles(sent)[ELBOW] + np.radians(random.normal(0, 0.3))  # a protractor, read by eye
        marks.append(Mark(sent[servos.channels[ELBOW]], float(read)))
        print(f"commanded {angle:4d}°, sent {marks[-1].output:.0f} µs, read {np.degrees(read):6.1f}°")

fit = fit_joint(marks)
per_deg, rms_deg = np.radians(fit.per_rad), np.degrees(fit.rms_rad)
print(f"0° is at {fit.zero:.0f} µs, {per_deg:.2f} µs a degree; RMS {rms_deg:.2f}°")
low, high = servos.low[ELBOW], servos.high[ELBOW]
measured = Calibration(
    "uzuner", "simulated", servos.unit, {"elbow": JointCalibration(fit.zero, fit.per_rad, low, high)}
)

target = np.array([0.200, 0.0, 0.100])
for name, used in (("before", robot), ("after", calibrated(robot, measured))):
    q = used.inverse(target).best()
    reached = robot.forward(as_built.angles(used.output_map.outputs(q)))[:3, 3]
    print(f"{name}: the tool misses by {1000 * np.linalg.norm(reached - target):.1f} mm")

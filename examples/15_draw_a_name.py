"""Draw a name with a pen: an SVG file on a plane that was touched at three points."""

from pathlib import Path

import numpy as np

import armctl
from armctl.program import DrawStep, Program

# X, Y, Z in mm, where the tip of the pen touched the paper: the origin, to the right, and upwards.
touched = (190.0, 30.0, 30.0, 190.0, -70.0, 30.0, 260.0, 30.0, 30.0)
file = Path(__file__).with_name("name.svg")
step = DrawStep(file=str(file), plane_mm=touched, width_mm=50, pen_speed_mm_s=40)

robot = armctl.load_robot("uzuner")
plan = step.drawn(robot, robot.first_pose)
tilt = abs(np.degrees(plan.hold.tilt))
print(f"{len(plan.left_out)} strokes are left out; the pen is tilted by {tilt:.0f}°")
print(f"{1000 * plan.drawn_m:.0f} mm, within {1000 * plan.line_error_m:.2f} mm of the file")

with armctl.Arm.open("uzuner") as arm:
    arm.enable()
    arm.run(Program(robot="uzuner", name="name", steps=(step,)))
    print("the pen is lifted at z =", round(arm.position_mm[2]), "mm")

"""The arc of the Uzuner paper: solved as in the paper, run on the simulated board, its error reported."""

import time

import numpy as np

import armctl
from armctl.motion import arc
from armctl.motion.analysis import ErrorReport, as_printed, closest_on_path
from armctl.program import MoveStep, Program

robot = armctl.load_robot("uzuner")
points = arc()  # 58 points, 200 mm about the base axis, from -87° to 87°
q = np.array([robot.inverse(point).best("published") for point in points])
theoretical = ErrorReport(points, robot.forward(as_printed(q))[:, :3, 3])  # angles as printed, to 0.001°

steps = tuple(MoveStep(joints_deg=tuple(np.degrees(one)), blend_mm=3) for one in q)  # passes without a stop
program = Program(robot="uzuner", name="arc", steps=steps)
readings = []
with armctl.Arm.open(robot) as arm:
    arm.enable()
    arm.go_joints(np.degrees(q[0]))
    motion = arm.run(program, wait=False)
    while not motion.done:
        readings.append(np.radians(arm.measured_deg))
        time.sleep(0.01)
    motion.result()
    readings.append(np.radians(arm.measured_deg))
tool = robot.forward(np.array(readings))[:, :3, 3]
applied = ErrorReport(points, closest_on_path(points, tool))

print(f"{len(points)} points, {len(readings)} readings; errors in mm")
for name, report in (("solutions", theoretical), ("drawn", applied)):
    rmse, largest = 1000 * report.rmse, 1000 * report.largest
    print(f"{name:<10} RMSE x {rmse[0]:.4f} y {rmse[1]:.4f}   largest x {largest[0]:.4f} y {largest[1]:.4f}")

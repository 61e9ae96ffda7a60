"""A line and an arc of the tool: planned, checked and drawn first, then run as they were drawn."""

import numpy as np
from matplotlib import pyplot as plt

import armctl
from armctl.motion import plan_arc, plan_line, preflight

robot = armctl.load_robot("uzuner")
start = robot.inverse([0.220, -0.060, 0.100]).best()
line = plan_line(robot, start, [0.220, 0.060, 0.100], pitch="free", speed=0.2)  # metres, m/s
arc = plan_arc(robot, line.end, [0.250, 0.000, 0.100], [0.220, -0.060, 0.100], pitch="free", speed=0.2)

figure, (path, speeds) = plt.subplots(1, 2, figsize=(11, 4), layout="constrained")
begin = 0.0
for name, motion in (("line", line), ("arc", arc)):
    print(f"{name}: {motion.duration:.2f} s")
    for finding in preflight(robot, motion):
        print(f"  {finding.severity}: {finding}")
    time = np.linspace(0, motion.duration, 200)
    state = motion.sample(time)
    tool = robot.forward(state.q)[:, :3, 3]
    velocity = np.einsum("kij,kj->ki", robot.jacobian(state.q)[:, :3], state.velocity)
    path.plot(1000 * tool[:, 1], 1000 * tool[:, 0], label=name)
    speeds.plot(begin + time, 1000 * np.linalg.norm(velocity, axis=1), label=name)
    begin += motion.duration
path.set(aspect="equal", xlabel="y [mm]", ylabel="x [mm]")
speeds.set(xlabel="time [s]", ylabel="tool speed [mm/s]")
path.legend()
figure.savefig("line_and_arc.png")
print("drawn: line_and_arc.png")

with armctl.Arm.open(robot) as arm:
    arm.enable()
    arm.go_joints(np.degrees(start))
    arm.follow(line)
    arm.follow(arc)
    x, y, z = arm.position_mm
    print(f"tool at x {x:z.1f}, y {y:z.1f}, z {z:z.1f} mm")

"""Which of many solutions is "least energy"? The five criteria, compared for one point."""

import numpy as np

import armctl
from armctl.kinematics import CRITERIA
from armctl.motion import plan_joints

robot = armctl.load_robot("uzuner")
start = robot.pose("home")
solutions = robot.inverse([0.180, 0.000, 0.040])
print(f"{len(solutions):,} solutions\n")
print(f"{'criterion':<16}{'Σ|θ| [°]':>10}{'travel [°]':>12}{'time [s]':>10}{'load':>8}")

load = {}
for criterion in CRITERIA:
    q = solutions.best(criterion, start=start)
    rotation, travel = np.degrees(np.abs(q).sum()), np.degrees(np.abs(q - start).sum())
    seconds = plan_joints(robot, start, q, checked=False).duration
    shares = robot.gravity.torque(q) / robot.energy.stall_torque  # what gravity takes of each servo's torque
    load[criterion] = (shares**2).sum()  # a servo's heat grows with the square
    print(f"{criterion:<16}{rotation:>10.1f}{travel:>12.1f}{seconds:>10.2f}{load[criterion]:>8.4f}")

saved = 1 - load["least-torque"] / load["least-rotation"]
print(f"\nleast-torque loads the servos {saved:.0%} less than least-rotation")

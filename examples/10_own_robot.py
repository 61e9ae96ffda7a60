"""A robot of your own: a file with its lengths, limits and servos. armctl finds the inverse kinematics."""

from pathlib import Path

import armctl

robot = armctl.load_robot(Path(__file__).with_name("my_arm.toml"))
solver = robot.inverse_kinematics
print(f"{robot.title}: {robot.n} joints, solved as '{solver.family}'")
print("complete list of solutions:", "yes" if solver.complete else "no")

for way in robot.branches(robot.point("cup"), pitch=-0.8):  # the tool points down by 0.8 rad
    print(f"  {way.name}: {'; '.join(way.forbidden) or 'allowed'}")

with armctl.Arm.open(robot) as arm:
    arm.enable()
    x, y, z = 1000 * robot.point("cup")
    arm.go(x, y, z)
    print("joints at the cup [°]:", *arm.joints_deg.round(1))

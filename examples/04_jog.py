"""A jog loop: the arm moves as long as commands come, and stops by itself when they end."""

import time

import armctl
from armctl.facts import State

with armctl.Arm.open("uzuner") as arm:
    arm.enable()
    before = arm.joints_deg
    for _ in range(16):  # as a held key would: a command is valid for 100 ms
        arm.jog([20, 0, 0, 0, 0])  # percent of each joint's speed limit
        time.sleep(0.05)
    while arm.snapshot.state is State.MOVING:  # no command comes: the arm slows down
        time.sleep(0.02)
    print(f"base turned by {arm.joints_deg[0] - before[0]:.1f}°")

    height = arm.position_mm[2]
    for _ in range(16):
        arm.jog_tool(z_mm_s=20)  # straight up, in the base frame
        time.sleep(0.05)
    while arm.snapshot.state is State.MOVING:
        time.sleep(0.02)
    print(f"tool raised by {arm.position_mm[2] - height:.1f} mm")

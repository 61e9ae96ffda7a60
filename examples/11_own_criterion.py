"""A criterion of your own: spare a weak wrist, and keep the elbow above a box on the table."""

import numpy as np

import armctl

BOX_MM = 190  # the wrist joint stays above this height

robot = armctl.load_robot("uzuner")
wrist = robot.chain.joint_rows[3] + 1  # the frame of the wrist pitch joint among ``robot.frames``


def spare_the_wrist(q, start):
    """Energies (k,) of the solutions q (k, n) [rad]; infinity excludes one."""
    weights = np.array([1, 1, 1, 5, 1])
    energy = np.abs(q - start) @ weights
    height_mm = 1000 * robot.frames(q)[:, wrist, 2, 3]
    return np.where(height_mm > BOX_MM, energy, np.inf)


with armctl.Arm.open(robot) as arm:
    arm.enable()
    for choose in ("least-rotation", spare_the_wrist):
        arm.go_pose("home")
        arm.go(x_mm=200, y_mm=0, z_mm=120, choose=choose)
        height_mm = 1000 * robot.frames(arm.snapshot.q_command)[wrist, 2, 3]
        name = choose if isinstance(choose, str) else choose.__name__
        turned = abs(arm.joints_deg - np.degrees(robot.pose("home")))[3]
        print(f"{name}: wrist joint {height_mm:.0f} mm high, turned by {turned:.1f}°")

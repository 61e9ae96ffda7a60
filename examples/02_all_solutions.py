"""All solutions of one point, drawn: a few arms of each branch, and the joint angles of all of them."""

import numpy as np
from matplotlib import pyplot as plt

import armctl

TARGET = np.array([0.220, -0.196, 0.085])  # metres, base frame

robot = armctl.load_robot("uzuner")
solutions = robot.inverse(TARGET)
branches = sorted(set(solutions.branch.tolist()))
print(f"{len(solutions):,} solutions on {len(branches)} branches: {', '.join(branches)}")

figure, (side, angles) = plt.subplots(1, 2, figsize=(11, 5), layout="constrained")
toward = TARGET[:2] / np.linalg.norm(
    TARGET[:2]
)  # the vertical plane through base and target, seen from the side
for number, branch in enumerate(branches):
    q = solutions.q[solutions.branch == branch]
    for arm in q[:: max(1, len(q) // 4)]:
        points = robot.frames(arm)[:, :3, 3]
        side.plot(1000 * points[:, :2] @ toward, 1000 * points[:, 2], f"C{number}o-", markersize=3, alpha=0.6)
    angles.plot(*np.degrees(q[:, 1:3]).T, f"C{number}.", markersize=2, label=branch)
side.plot(1000 * TARGET[:2] @ toward, 1000 * TARGET[2], "k*", markersize=12)
side.set(aspect="equal", xlabel="distance from the base axis [mm]", ylabel="z [mm]")
angles.set(xlabel="shoulder [°]", ylabel="elbow [°]")
angles.legend()
figure.savefig("all_solutions.png")
print("drawn: all_solutions.png")

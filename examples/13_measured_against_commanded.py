"""Commanded against measured: an arm with encoders, here simulated, lags a little behind its setpoints."""

import time

import numpy as np
from matplotlib import pyplot as plt

import armctl

rows = []
with armctl.Arm.open("scorbot") as arm:
    arm.enable()  # looks for the home switches first: one axis after the other, about 6 s
    goal = np.add(arm.joints_deg, [8, 6, -6, 10, 20])
    motion = arm.go_joints(goal, wait=False)
    while not motion.done:
        seen = arm.snapshot
        rows.append([seen.stamp, *np.degrees(seen.q_command), *np.degrees(seen.q)])
        time.sleep(0.02)
    motion.result()
    names = [joint.title for joint in arm.robot.joints]
    print("the positions are", arm.source.value)

stamp, *columns = np.array(rows).T
commanded, measured = np.array(columns[: len(names)]), np.array(columns[len(names) :])
error = np.abs(measured - commanded).max(axis=1)
for name, largest in zip(names, error, strict=True):
    print(f"{name:<12} largest error {largest:.2f}°")

figure, (way, lag) = plt.subplots(2, 1, sharex=True, figsize=(8, 6), layout="constrained")
for i, name in enumerate(names):
    way.plot(stamp - stamp[0], commanded[i], f"C{i}--")
    way.plot(stamp - stamp[0], measured[i], f"C{i}", label=name)
    lag.plot(stamp - stamp[0], measured[i] - commanded[i], f"C{i}")
way.set(ylabel="joint angle [°], dashed: commanded")
lag.set(xlabel="time [s]", ylabel="measured - commanded [°]")
way.legend(ncols=len(names), fontsize=8)
figure.savefig("measured_against_commanded.png")
print("drawn: measured_against_commanded.png")

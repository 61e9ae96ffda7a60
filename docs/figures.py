"""Draws the figures of docs/kinematics.md: ``python docs/figures.py``. armctl solves what they show."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("svg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

import armctl
from armctl.arrays import FloatArray
from armctl.robot import Robot

FOLDER = Path(__file__).parent / "pictures"
COLORS = ("#1864ab", "#e8590c", "#2b8a3e", "#862e9c", "#c92a2a", "#0b7285", "#5f3dc4", "#846358")


def links(robot: Robot, q: FloatArray) -> FloatArray:
    """(m, 3) points along the arm at ``q`` (n,) [rad]: base, joints, tool [mm]."""
    points = [np.zeros(3), *robot.chain.axes(q)[0], robot.forward(q)[:3, 3]]
    return 1000.0 * np.array(points)


def two_elbows(axes: Axes) -> None:
    """One point, one pitch: elbow up and down, tool outward and back."""
    robot = armctl.load_robot("al5d")
    ways = robot.branches([0.22, 0.0, 0.15], pitch=np.radians(-40))
    front = [branch for branch in ways if branch.name.startswith("front")]
    for branch, color in zip(front, COLORS, strict=False):
        line = links(robot, branch.q)
        dashed = "--" if branch.forbidden else "-"
        axes.plot(line[:, 0], line[:, 2], dashed, color=color, marker="o", label=branch.name)
    axes.plot(220, 150, "k*", markersize=12)
    axes.set(
        aspect="equal", xlabel="x [mm]", ylabel="z [mm]", title="One point, one pitch (dashed: beyond limits)"
    )
    axes.legend(fontsize=7)


def free_joint(axes: Axes) -> None:
    """Σ|θ| over the swept shoulder of uzuner, on each branch, and its exact least."""
    robot = armctl.load_robot("uzuner")
    found = robot.inverse([0.22, -0.196, 0.085])
    energy = np.degrees(found.energies("least-rotation"))
    for name, color in zip(found.branch_names, COLORS, strict=False):
        own = np.flatnonzero(found.branch == name)[::20]
        if len(own):
            axes.plot(np.degrees(found.q[own, 1]), energy[own], ".", markersize=2, color=color, label=name)
    best = found.best("least-rotation")
    axes.plot(np.degrees(best[1]), np.degrees(np.abs(best).sum()), "k*", markersize=12)
    axes.set(
        xlabel="shoulder [°]",
        ylabel="Σ|θ| [°]",
        title=f"A point leaves the shoulder free: {len(found):,} solutions",
    )
    axes.legend(fontsize=7)


def eight(axes: Axes) -> None:
    """The solutions of one pose of a UR5, seen from the side."""
    robot = armctl.load_robot("ur5")
    T = robot.forward(np.radians([20, -100, 110, -60, -70, 30]))
    found = robot.inverse(T[:3, 3], rotation=T[:3, :3])
    shown: list[FloatArray] = []
    for q in found.q:
        turned = np.exp(1j * q)
        if all(np.abs(turned - np.exp(1j * other)).max() > 1e-6 for other in shown):
            shown.append(q)
    for q, color in zip(shown, COLORS, strict=False):
        line = links(robot, q)
        axes.plot(line[:, 0], line[:, 2], color=color, marker="o", markersize=3)
    axes.set(aspect="equal", xlabel="x [mm]", ylabel="z [mm]", title=f"One pose of a UR5: {len(shown)} ways")


FIGURES = {"two-elbows": two_elbows, "free-joint": free_joint, "eight-ways": eight}


def main(folder: Path = FOLDER) -> None:
    """Write every figure into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    mpl.rcParams["svg.hashsalt"] = "armctl"  # the same figure gives the same file
    for name, draw in FIGURES.items():
        figure, axes = plt.subplots(figsize=(6.0, 4.0), layout="constrained")
        axes.grid(alpha=0.3)
        draw(axes)
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
        plt.close(figure)


if __name__ == "__main__":
    main()

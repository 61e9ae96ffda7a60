"""Draws the figures of the docs: ``python docs/figures.py``.

armctl solves what the first ones show; the others are drawn from the tables that the benchmarks wrote. Each
file carries a fingerprint of what is drawn, which ``tests/kinematics/test_figures.py`` compares.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("svg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

import armctl
from armctl.arrays import FloatArray
from armctl.calibration import Mark, fit_joint
from armctl.motion import PROFILES, plan_joints
from armctl.program import LineStep, Program
from armctl.program.rehearsal import rehearse
from armctl.robot import Robot
from armctl.robot.draft import BUILDS, Build, Draft

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


# Tables of docs/speed.md as bars.


def rows(maker: str) -> list[list[str]]:
    """The cells of the table that ``maker`` wrote, without its head."""
    _, _, after = (FOLDER.parent / "speed.md").read_text().partition(f"<!-- {maker}: begin -->")
    table, _, _ = after.partition(f"<!-- {maker}: end -->")
    lines = [line for line in table.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def bars(axes: Axes, names: Sequence[str], sides: Sequence[tuple[str, Sequence[float], str]]) -> None:
    """Groups of horizontal bars, the first at the top, with their figures behind them."""
    height = 0.8 / len(sides)
    for j, (label, values, color) in enumerate(sides):
        places = np.arange(len(names)) + (j - 0.5 * (len(sides) - 1)) * height
        drawn = axes.barh(places, values, height, color=color, label=label)
        axes.bar_label(drawn, [f"{value:,.3g}" if value < 1000 else f"{value:,.0f}" for value in values],
                       padding=2, fontsize=6)  # fmt: skip
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
    axes.margins(x=0.12)
    axes.legend(fontsize=7)


def solvers(axes: Axes) -> None:
    """How long one answer takes, beside the others."""
    timed = [row for row in rows("make bench") if row[2] != "–" and not re.search("toppra|ms of", row[1])]
    names = [f"{re.sub(' one p(oint|ose)$', '', work)}\n{other}" for work, other, *_ in timed]
    theirs, ours = ([float(row[i].replace(",", "")) for row in timed] for i in (2, 3))
    axes.set(xscale="log", xlabel="µs an answer (shorter is faster)")
    bars(axes, names, [("armctl", ours, COLORS[0]), ("the other", theirs, "#adb5bd")])


def waits(axes: Axes) -> None:
    """How long a user waits until the arm obeys: the median, and the slowest of a hundred."""
    timed = [row for row in rows("make bench-live") if "setpoint" in row[0] and " / " in row[1]]
    median, slowest = ([float(re.split(" / |,", row[1])[i]) for row in timed] for i in (0, 1))
    names = [row[0].replace(" → ", "\n→ ") for row in timed]
    axes.set(xscale="log", xlabel="ms (shorter is faster)")
    bars(axes, names, [("median", median, COLORS[0]), ("99 of 100 are faster", slowest, "#74c0fc")])


# Of a motion, and of a calibration.


def profiles(axes: Axes) -> None:
    """Speed over time of one joint turned by 60°, with each law."""
    robot = armctl.load_robot("uzuner")
    start = robot.pose("home")
    end = start + np.radians([60, 0, 0, 0, 0])
    for profile, color in zip(PROFILES, COLORS, strict=False):
        motion = plan_joints(robot, start, end, profile=profile)
        t = np.linspace(0.0, motion.duration, 400)
        speed = np.degrees(motion.sample(t).velocity[:, 0])
        axes.plot(t, speed, color=color, label=f"{profile}: {motion.duration:.2f} s")
    axes.axhline(np.degrees(robot.joints[0].speed), color="k", linestyle="--", linewidth=0.8)
    axes.set(xlabel="time [s]", ylabel="speed [°/s]", title="60° of the base, as fast as its limits allow")
    axes.legend(fontsize=7)


def blending(axes: Axes) -> None:
    """A corner of two lines, with blend radii, seen from above."""
    robot = armctl.load_robot("uzuner")
    start = robot.least_rotation([0.22, -0.06, 0.1])
    for radius, color in zip((0.0, 10.0, 30.0), COLORS, strict=False):
        way = ((220.0, 40.0, 100.0, radius), (160.0, 40.0, 100.0, 0.0))
        steps = tuple(
            LineStep(x_mm=x, y_mm=y, z_mm=z, pitch="free", blend_mm=blend) for x, y, z, blend in way
        )
        done = rehearse(robot, Program(robot="uzuner", steps=steps), start)
        path = 1000 * done.tool_path(robot, 1000)
        axes.plot(path[:, 1], path[:, 0], color=color, label=f"blend {radius:g} mm: {done.duration:.2f} s")
    axes.set(aspect="equal", xlabel="y [mm]", ylabel="x [mm]", title="A corner with and without blending")
    axes.legend(fontsize=7)


def marks(axes: Axes) -> None:
    """The line through the marks of a joint, and the mark that does not fit it."""
    read = [(900, -60), (1200, -29), (1500, 0.5), (1800, 38), (2100, 60)]
    fit = fit_joint([Mark(output, np.radians(angle)) for output, angle in read])
    outputs = np.array([output for output, _ in read])
    axes.plot(outputs, np.degrees([fit.angle(output) for output in outputs]), color=COLORS[0])
    for i, (output, angle) in enumerate(read):
        wrong = i == fit.suspect
        axes.plot(output, angle, "x" if wrong else "o", color=COLORS[1] if wrong else COLORS[0])
        if wrong:
            axes.annotate("does not fit", (output, angle), (output - 330, angle), fontsize=8)
    axes.set(xlabel="pulse [µs]", ylabel="angle [°]", title=f"{fit.per_rad * np.pi / 180:.2f} µs a degree")


# The builds of ``armctl new``.

LENGTHS_MM = {
    "height": 80.0, "ahead": 58.0, "upper": 110.0, "fore": 100.0, "hand": 60.0, "drop": 45.0, "offset": 25.0,
    "aside": 65.0, "wrist": 50.0, "tool": 55.0,
}  # fmt: skip
"""no two are the same, so that each straight part of a DH row tells which length it is [mm]"""
ANGLES_DEG = {"shoulder": 70.0, "elbow": -50.0, "wrist": -35.0, "wrist_1": -20.0}
LEVEL_ELBOW_DEG = 20.0
"""of a palletiser, whose forearm its shoulder does not turn"""
CELL_MM, COLUMNS = (295.0, 290.0), 3
TO_VIEWER = np.array([[1.0, 0.0], [-0.5, 0.35], [0.0, 1.0]])
"""an oblique drawing from the side: where x, y and z point on the paper"""


def builds(axes: Axes) -> None:
    """Which length is which, on each build from the side."""
    shown = [build for build in BUILDS if build.name != "pitch3"]  # it has the lengths of pitch3-roll
    for i, build in enumerate(shown):
        row, column = divmod(i, COLUMNS)
        title = build.name.replace("pitch3-roll", "pitch3, pitch3-roll")
        side_view(axes, build, title, np.array([column, -row]) * CELL_MM)
    axes.set(aspect="equal", title="Lengths of the builds")
    axes.set_axis_off()


def side_view(axes: Axes, build: Build, title: str, at: FloatArray) -> None:
    """One build, its base at ``at`` (2,) [mm]: named lengths, joints as dots, the tool as a star."""
    lengths = {one.key: LENGTHS_MM[one.key] for one in build.lengths}
    names = {mm: key for key, mm in lengths.items()}
    robot = Draft.of_build("shown", title, build, lengths).robot()
    angles = ANGLES_DEG | ({"elbow": LEVEL_ELBOW_DEG} if build.name.startswith("palletiser") else {})
    frames = robot.frames(np.radians([angles.get(name, 0.0) for name in robot.joint_names]))

    def paper(point_m: FloatArray) -> FloatArray:
        return at + 1000 * point_m @ TO_VIEWER

    x, y = at
    axes.plot([x, x], [y, y + 150], "--", color="#adb5bd", linewidth=1)
    axes.plot([x - 35, x + 120], [y, y], color="#868e96", linewidth=1)
    for row, before, after in zip(build.rows(lengths), frames[:-1], frames[1:], strict=True):
        begin, end = before[:3, 3], after[:3, 3]
        corner = begin + 0.001 * row["d_mm"] * before[:3, 2]
        for mm, ends in ((row["d_mm"], (begin, corner)), (row["a_mm"], (corner, end))):
            if mm:
                line = np.array([paper(one) for one in ends])
                color = COLORS[list(LENGTHS_MM).index(names[mm]) % len(COLORS)]
                axes.plot(*line.T, color=color, linewidth=3, solid_capstyle="round")
                along = (line[1] - line[0]) / np.linalg.norm(line[1] - line[0])
                across = np.array([along[1], -along[0]])
                across *= np.sign(across[np.abs(across).argmax()])  # names stand on the right, or above
                axes.text(*(line.mean(axis=0) + 11 * across), names[mm], color=color, fontsize=8,
                          ha="left" if across[0] > 0.5 else "center", va="center")  # fmt: skip
        if "joint" in row:
            axes.plot(*paper(begin), "o", color="#343a40", markersize=4, zorder=3)
    axes.plot(*paper(frames[-1][:3, 3]), "k*", markersize=9, zorder=3)
    axes.text(x + 40, y - 22, title, fontsize=8, ha="center", weight="bold")


FIGURES = {
    "builds": (builds, 5.0),
    "two-elbows": (two_elbows, 4.0),
    "free-joint": (free_joint, 4.0),
    "eight-ways": (eight, 4.0),
    "profiles": (profiles, 3.2),
    "blending": (blending, 3.2),
    "marks": (marks, 3.2),
    "solvers": (solvers, 5.5),
    "waits": (waits, 5.0),
}
"""what draws them, and how high they are [inch]"""


def fingerprint(axes: Axes) -> str:
    """A hash of what is drawn: lines, bars and words."""
    lines = [line.get_xydata() for line in axes.lines]
    widths = [np.array([patch.get_width() for patch in axes.patches])]  # type: ignore[attr-defined]
    numbers = np.concatenate([np.asarray(one, dtype=float).reshape(-1) for one in (*lines, *widths)])
    words = [axes.get_title(), axes.get_xlabel()]
    words += [text.get_text() for text in (*axes.get_yticklabels(), *axes.texts)]
    told = "\n".join([*words, *(f"{number:z.3f}" for number in numbers)])
    return hashlib.sha256(told.encode()).hexdigest()


def main(folder: Path = FOLDER) -> None:
    """Write every figure into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    mpl.rcParams["svg.hashsalt"] = "armctl"  # the same figure gives the same file
    mpl.rcParams["svg.fonttype"] = "none"  # texts stay texts, so the files are small
    for name, (draw, height) in FIGURES.items():
        figure, axes = plt.subplots(figsize=(6.0, height), layout="constrained")
        axes.grid(alpha=0.3)
        draw(axes)
        metadata = {"Date": None, "Description": fingerprint(axes)}
        figure.savefig(folder / f"{name}.svg", metadata=metadata)
        plt.close(figure)


if __name__ == "__main__":
    main()

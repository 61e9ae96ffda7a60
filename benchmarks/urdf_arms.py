"""URDF files as they are published: does each load, in which family, and how closely do the capsules fit?

    python -m benchmarks.urdf_arms FOLDER [FOLDER ...]

The folders are those of installed packages (benchmarks/peers.txt: example-robot-data, rtb-data). Nothing is
installed or downloaded here. What is not there is told. Prints a table in Markdown.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

from armctl import load_robot
from armctl.errors import ArmctlError
from armctl.robot import Robot

ARMS = {
    "SO-100": "so_arm_description/urdf/so100.urdf",
    "SO-101": "so_arm_description/urdf/so101.urdf",
    "UR3": "ur_description/urdf/ur3_robot.urdf",
    "UR5": "ur_description/urdf/ur5_robot.urdf",
    "UR5, limited joints": "ur_description/urdf/ur5_joint_limited_robot.urdf",
    "UR10": "ur_description/urdf/ur10_robot.urdf",
    "Franka Panda": "panda_description/urdf/panda.urdf",
    "Kinova j2s6s200": "kinova_description/robots/kinova.urdf",
    "UFACTORY xArm 7": "xarm_description/urdf/xarm7.urdf",
    "Unitree Z1": "z1_description/urdf/z1.urdf",
    "Talos, left arm": "talos_data/robots/talos_left_arm.urdf",
    "ABB IRB 140": "abb_irb140_description/urdf/irb140.urdf",
    "KUKA LBR iiwa 14": "kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf",
    "KUKA KR 16": "kuka_description/kuka_kr16/urdf/kr16_2.urdf",
    "KUKA KR 120": "kuka_description/kuka_kr120/urdf/kr120r2500pro.urdf",
    "KUKA KR 210": "kuka_description/kuka_kr210/urdf/kr210l150.urdf",
    "PUMA 560": "unimation_puma560_description/urdf/puma560_robot.urdf",
    "Lynxmotion AL5D": "lynxmotion_al5d_description/urdf/al5d_robot.urdf",
    "PincherX 100": "trossen_descriptions/urdf/px100.urdf.xacro",
    "PincherX 150": "trossen_descriptions/urdf/px150.urdf.xacro",
    "ReactorX 150": "trossen_descriptions/urdf/rx150.urdf.xacro",
    "ReactorX 200": "trossen_descriptions/urdf/rx200.urdf.xacro",
    "ViperX 250": "trossen_descriptions/urdf/vx250.urdf.xacro",
    "ViperX 300": "trossen_descriptions/urdf/vx300.urdf.xacro",
    "ViperX 300s": "trossen_descriptions/urdf/vx300s.urdf.xacro",
    "WidowX 200": "trossen_descriptions/urdf/wx200.urdf.xacro",
    "WidowX 250": "trossen_descriptions/urdf/wx250.urdf.xacro",
    "WidowX 250s": "trossen_descriptions/urdf/wx250s.urdf.xacro",
    "KUKA KR 5 arc": "kuka_description/kuka_kr5/urdf/kr5_arc.xacro",
    "KUKA KR 6": "kuka_description/kuka_kr6/urdf/kr6r700sixx.xacro",
}
"""name and where its file ends up below some folder"""


def found(folders: list[Path]) -> Iterator[tuple[str, Path | None]]:
    """Each arm and its file; None where no folder holds it."""
    for name, place in ARMS.items():
        files = (path for folder in folders for path in folder.rglob(Path(place).name) if path.match(place))
        yield name, next(files, None)


def row(name: str, robot: Robot) -> str:
    """A line of the table."""
    body = next((text for text in robot.assumed if text.startswith("the body:")), "the body: bars")
    solver, clear = robot.inverse_kinematics, "yes" if _above(robot) else "side file"
    drawn = f"{len(robot.shapes)} shapes" if robot.shapes else "bars"
    cells = (name, str(robot.n), solver.family, str(solver.complete), drawn, body[10:], clear)
    return f"| {' | '.join(cells)} |"


def _above(robot: Robot) -> bool:
    """Whether the arm can be enabled as it is."""
    from armctl.motion import Floor

    floor = Floor(robot)
    return bool((floor.clearance(robot.first_pose) >= floor.closed - 5e-4).all())


def main() -> int:
    """Print the table; the number of files that did not load."""
    folders = [Path(one) for one in sys.argv[1:]] or [Path(one) for one in sys.path if Path(one).is_dir()]
    print("| arm | joints | family | every solution | drawn | body | enabled as it is |\n" + 7 * "|---" + "|")
    failed = 0
    for name, path in found(folders):
        if path is None:
            print(f"| {name} | not found below {', '.join(map(str, folders))} |")
            continue
        try:
            print(row(name, load_robot(path).with_body()), flush=True)
        except ArmctlError as refusal:
            failed += 1
            print(f"| {name} | refused: {refusal} |")
    return failed


if __name__ == "__main__":
    sys.exit(main())

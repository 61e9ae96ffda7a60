"""Pick a part from a conveyor and place it: one program, checked before anything moves."""

import numpy as np

import armctl
from armctl.program import GripperStep, LineStep, PointStep, Program, WaitStep, check_program

robot = armctl.load_robot("abaas")
CONVEYOR, TRAY = 1000 * robot.point("pick"), 1000 * robot.point("place")  # named in the robot file
ABOVE = np.array([0, 0, 25])  # mm


def xyz(point_mm):
    return dict(zip(("x_mm", "y_mm", "z_mm"), point_mm.tolist(), strict=True))


program = Program(
    robot=robot.name,
    name="conveyor",
    steps=(
        GripperStep(open_percent=80),
        PointStep(**xyz(CONVEYOR + ABOVE), choose="least-travel", note="above the part"),
        LineStep(**xyz(CONVEYOR), pitch="free", speed_mm_s=100),
        GripperStep(open_percent=20),
        WaitStep(seconds=0.2),
        LineStep(**xyz(CONVEYOR + ABOVE), pitch="free"),
        PointStep(**xyz(TRAY + ABOVE), choose="least-travel", note="above the tray"),
        LineStep(**xyz(TRAY), pitch="free", speed_mm_s=100),
        GripperStep(open_percent=80),
        LineStep(**xyz(TRAY + ABOVE), pitch="free"),
    ),
)
findings = check_program(program, robot, start=robot.pose("rest"))
print(*findings or ["no findings"], sep="\n")

with armctl.Arm.open(robot) as arm:
    arm.enable()
    arm.run(program)
    x, y, z = arm.position_mm
    print(f"placed; tool at x {x:z.1f}, y {y:z.1f}, z {z:z.1f} mm")

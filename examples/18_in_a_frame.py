"""A program in a user frame: the fixture is moved, touched anew, and the program goes with it."""

import armctl
from armctl.program import FrameStep, LineStep, PointStep, Program, UserFrame, check_program
from armctl.program.edit import put_frame
from armctl.program.frames import turn_errors

# Where the tool stood at three touches: the origin, a point on +x, a point on the side of +y.
touches = (180, -60, 60), (180, 40, 60), (110, 0, 60)
table = UserFrame.taught(*touches)
turned = 57.3 * max(turn_errors(*touches, touch_mm=0.5))
print(f"table at {table.describe()}; touches by eye leave {turned:.1f}° open")

square = [(20, 0), (60, 0), (60, 40), (20, 40), (20, 0)]
steps = [LineStep(x_mm=x, y_mm=y, z_mm=40, pitch="free") for x, y in square]
program = Program(
    robot="uzuner",
    name="square on the table",
    frames={"table": table},
    steps=(FrameStep(frame="table"), PointStep(x_mm=20, y_mm=0, z_mm=60), *steps),
)
robot = armctl.load_robot("uzuner")


def errors(program: Program) -> list[str]:
    """What is wrong with a program from the home pose."""
    found = check_program(program, robot, start=robot.pose("home"))
    return [str(one) for one in found if one.severity == "error"]


moved = put_frame(program, "table", UserFrame.taught((210, 0, 40), (170, 90, 40), (120, -20, 40)))
away = put_frame(program, "table", UserFrame(x_mm=400, y_mm=0, z_mm=60))
print(f"where it was: {len(errors(program))} errors; moved: {len(errors(moved))} errors")
print(errors(away)[0])

with armctl.Arm.open("uzuner") as arm:
    arm.enable()
    for one in (program, moved):
        arm.run(one)
        x, y, z = arm.position_mm
        print(f"the square ends at x {x:.1f}, y {y:.1f}, z {z:.1f} mm")
    arm.set_frame(table)
    arm.go(x_mm=20, y_mm=0, z_mm=60)
    print("above the table's first corner again:", [round(float(value), 1) for value in arm.position_mm])

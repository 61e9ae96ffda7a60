"""Palletise: parts into a grid of 3 x 4 x 2 cells, each of which is checked before the arm moves."""

import armctl
from armctl.program import EndStep, GridStep, GripperStep, LineStep, PointStep, Program, Step, check_program
from armctl.program.rehearsal import rehearse


def palletise(rows: int, columns: int, layers: int, far_x_mm: float = 220) -> Program:
    """One part into each cell of a grid, which ends at ``far_x_mm``."""
    steps: tuple[Step, ...] = (
        GridStep(
            x_mm=180, y_mm=10, z_mm=80,  # the first cell,
            row_x_mm=180, row_y_mm=70, row_z_mm=80,  # the last one of its row,
            column_x_mm=far_x_mm, column_y_mm=10, column_z_mm=80,  # and the last one of its column
            rows=rows, columns=columns, layers=layers, layer_mm=15, order="snake",
        ),
        PointStep(x_mm=190, y_mm=-80, z_mm=120, note="above the parts: a point of the base"),
        LineStep(x_mm=190, y_mm=-80, z_mm=90),
        GripperStep(open_percent=20),
        LineStep(x_mm=190, y_mm=-80, z_mm=120),
        PointStep(x_mm=0, y_mm=0, z_mm=40, frame="cell", note="above the cell"),
        LineStep(x_mm=0, y_mm=0, z_mm=0, frame="cell"),
        GripperStep(open_percent=60),
        LineStep(x_mm=0, y_mm=0, z_mm=40, frame="cell"),
        EndStep(),
    )  # fmt: skip
    return Program(robot="uzuner", name="palletise", steps=steps)


robot = armctl.load_robot("uzuner")
program, home = palletise(rows=3, columns=4, layers=2), robot.pose("home")
errors = [one for one in check_program(program, robot, start=home) if one.severity == "error"]
whole = rehearse(robot, program, home, opening=0.6)
placed = sum(step.index == 7 for step in whole.steps)
print(f"checked: {len(errors)} errors, {placed} parts in {whole.duration:.0f} s")

too_far = palletise(rows=3, columns=4, layers=1, far_x_mm=380)
print(next(str(one) for one in check_program(too_far, robot, start=home) if one.severity == "error"))

with armctl.Arm.open("uzuner") as arm:
    arm.enable()
    arm.run(palletise(rows=1, columns=2, layers=1))
    x, y, z = arm.position_mm
    print(f"two placed; tool at x {x:z.0f}, y {y:z.0f}, z {z:z.0f} mm")

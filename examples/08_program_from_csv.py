"""A program from a spreadsheet: read, checked, run, and kept as a program file that the page opens, too."""

from pathlib import Path

import armctl
from armctl.program import check_program, open_program, save_program

robot = armctl.load_robot("uzuner")
program = open_program(Path(__file__).with_name("square.csv"), robot)  # a CSV names no robot
for number, step in enumerate(program.steps, 1):
    print(number, step.describe())
errors = [one for one in check_program(program, robot) if one.severity == "error"]
print(f"{len(errors)} errors")

with armctl.Arm.open(robot) as arm:
    arm.enable()
    arm.run(program)
save_program(program, "square.toml")
print("saved: square.toml")

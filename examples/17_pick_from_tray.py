"""Pick from a tray and sort by an input: one program calls another, both are checked before the arm moves."""

import shutil
import threading
from pathlib import Path

import armctl
from armctl.program import check_program, load_program
from armctl.program.rehearsal import rehearse
from armctl.robot import robots_folder

PINS = """
[[inputs]]
name = "held"           # the gripper holds a part
channel = 6

[[inputs]]
name = "good"           # the part is good
channel = 7
"""
here = Path(__file__).parent
for name in ("pick_from_tray.toml", "sort_part.toml"):  # a program finds the one that it calls beside itself
    shutil.copy(here / name, name)
robot_file = Path("tray_arm.toml")
robot_file.write_text((robots_folder() / "uzuner.toml").read_text(encoding="utf-8") + PINS, encoding="utf-8")
robot, program = armctl.load_robot(robot_file), load_program("pick_from_tray.toml")

home = robot.pose("home")
errors = [one for one in check_program(program, robot, start=home) if one.severity == "error"]
whole = rehearse(robot, program, home, opening=0.8)
gripped = sum(step.place.part == "grip" for step in whole.steps)
print(f"checked: {len(errors)} errors, {gripped} parts in {whole.duration:.0f} s")

with armctl.Arm.open(robot_file) as arm:
    # On a real board the sensors see the parts. The simulated board needs to be told.
    arm.simulate_input("held", 1)
    arm.simulate_input("good", 1)
    arm.enable()
    running = arm.run(program, wait=False)
    while arm.snapshot.message is None or not arm.snapshot.message.waits:
        threading.Event().wait(0.05)
    print(f"asks: {arm.snapshot.message.text}")
    arm.confirm()  # at a terminal, arm.run(program) asks for Enter; a page has a button
    running.result()
    x, y, z = arm.position_mm
    print(f"says: {arm.snapshot.message.text}; tool at x {x:z.0f}, y {y:z.0f}, z {z:z.0f} mm")

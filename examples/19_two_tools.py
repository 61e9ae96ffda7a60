"""Two tools of one arm: the jaws put a cube aside, then a pen draws a name, each by its own tip."""

import shutil
import threading
from pathlib import Path

import armctl
from armctl.program import check_program, load_program
from armctl.program.rehearsal import rehearse
from armctl.robot import robots_folder

TOOLS = """
[[tools]]
name = "jaws"
gripper = true

[[tools]]
name = "pen"            # 40 mm longer than the jaws
offset_mm = [0, 0, 40]
mass_kg = 0.02
pieces = [{ from_mm = [0, 0, -30], to_mm = [0, 0, 40], radius_mm = 5, color = "blue" }]
"""
here = Path(__file__).parent
for name in ("two_tools.toml", "name.svg"):
    shutil.copy(here / name, name)
robot_file = Path("arm_with_tools.toml")
robot_file.write_text((robots_folder() / "uzuner.toml").read_text(encoding="utf-8") + TOOLS, encoding="utf-8")
robot, program = armctl.load_robot(robot_file), load_program("two_tools.toml")
pen, home = robot.with_tool("pen"), robot.pose("home")
longer = pen.forward(home)[:3, 3] - robot.forward(home)[:3, 3]
print(f"the tip of the pen is {1000 * float((longer @ longer) ** 0.5):.0f} mm from that of the jaws")

errors = [one for one in check_program(program, robot, start=home) if one.severity == "error"]
whole = rehearse(robot, program, home, opening=0.8)
print(f"checked: {len(errors)} errors, {whole.duration:.0f} s")

with armctl.Arm.open(robot_file) as arm:
    arm.set_tool("jaws")  # a real board needs it before enable
    arm.enable()
    running = arm.run(program, wait=False)
    while arm.snapshot.message is None or not arm.snapshot.message.waits:
        threading.Event().wait(0.05)
    print(f"asks: {arm.snapshot.message.text}; on is {arm.tool}")
    arm.confirm()  # at a terminal, arm.run(program) asks for Enter; a page has a button
    running.result()
    print(f"on is {arm.tool}, its tip lifted at z = {arm.position_mm[2]:.0f} mm")

"""Inputs and outputs of the board: wait for a button, light a lamp."""

import threading
from pathlib import Path

import armctl
from armctl.program import Program, SetStep, WaitForStep
from armctl.robot import robots_folder

PINS = """
[[inputs]]
name = "button"
channel = 6
active_low = true       # to ground, with a pull-up resistor
debounce_ms = 20

[[outputs]]
name = "lamp"
channel = 7
at_stop = "off"
"""
robot = Path("button_arm.toml")
robot.write_text((robots_folder() / "uzuner.toml").read_text(encoding="utf-8") + PINS, encoding="utf-8")

with armctl.Arm.open(robot) as arm:
    # On a real board somebody presses it. The simulated board needs to be told.
    threading.Timer(0.5, arm.simulate_input, ("button", 1)).start()
    arm.wait_for("button", 1, timeout_s=30)
    print("pressed")
    arm.enable()
    arm.set_output("lamp", 1)
    print(f"lamp {arm.outputs['lamp']:g}")

    let_go = WaitForStep(watch="button", value=0, timeout_s=30)
    threading.Timer(0.5, arm.simulate_input, ("button", 0)).start()
    arm.run(Program(robot="uzuner", name="let go", steps=(let_go, SetStep(output="lamp", value=0))))
    print(f"let go: lamp {arm.outputs['lamp']:g}")

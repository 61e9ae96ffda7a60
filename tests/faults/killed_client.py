"""A program that moves an arm and saves files all the time, until it is killed; it says what it sees."""

from __future__ import annotations

import itertools
import signal
import sys
import threading
import time
from pathlib import Path

from armctl.calibration import Calibration, CalibrationStore, JointCalibration
from armctl.facts import State
from armctl.process import start_arm
from armctl.program import Program, WaitStep, save_program
from armctl.protocol import Connect, Enable, MoveJoints, Origin
from armctl.robot import load_robot


def save(folder: Path) -> None:
    """Programs in one file, calibrations each in its own, as fast as the disk takes them."""
    store = CalibrationStore()
    joints = {
        joint.name: JointCalibration(1500.0, 500.0, 600.0, 2400.0) for joint in load_robot("uzuner").joints
    }
    for count in itertools.count(1):
        steps = tuple(WaitStep(seconds=float(count % 1000)) for _ in range(200))
        save_program(Program(robot="uzuner", steps=steps), folder / "program.toml")
        if count % 20 == 0:
            store.save(Calibration("uzuner", "killed", "µs", joints))


def say(*words: object) -> None:
    sys.stdout.write(" ".join(map(str, words)) + "\n")
    sys.stdout.flush()


def main(port: str, folder: Path) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it would be ignored
    robot = load_robot("uzuner")
    link = start_arm(robot, name="killed")
    say("arm", link._process.pid)
    link.submit(Connect(port)).result(20)
    say("connected")
    threading.Thread(target=save, args=(folder,), daemon=True).start()
    enabling = link.submit(Enable(robot.pose("rest")), Origin("killed"))
    goals = itertools.cycle([robot.pose("home"), robot.pose("rest")])
    told = False
    while True:
        snapshot = link.snapshot
        if snapshot.state is State.OFF and enabling.finished.done():  # a busy computer: once more
            enabling = link.submit(Enable(robot.pose("rest")), Origin("killed"))
        if snapshot.state is State.FAULT and not told:
            told = True
            say("fault", time.time(), snapshot.cause)
        elif snapshot.state is State.HOLDING:
            link.submit(MoveJoints(next(goals), duration_s=2.0))
            say("moving")
            time.sleep(0.3)
        time.sleep(0.01)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))

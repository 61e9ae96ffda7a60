"""Lesson 3: ``python lesson_3.py my_program.toml`` checks a program that was recorded and downloaded."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from exercises import check

import armctl
from armctl.errors import ArmctlError
from armctl.program import check_program, load_program
from armctl.program.rehearsal import Rehearsal, rehearse

PICK_MM, PLACE_MM = (200, -80, 90), (200, 80, 90)
NEAR_MM, SAFE_MM, LONGEST_S = 3.0, 120.0, 25.0
ROBOT = armctl.load_robot("uzuner")


class Seen:
    """The program over time: the tool [mm] and the gripper (0 closed, 1 open) every 20 ms."""

    def __init__(self, rehearsal: Rehearsal) -> None:
        self.seconds = rehearsal.duration
        states = [rehearsal.sample(t) for t in np.arange(0.0, rehearsal.duration + 0.02, 0.02)]
        self.tool = 1000 * ROBOT.forward(np.array([state.q for state in states]))[:, :3, 3]
        self.closed = np.array([state.opening is not None and state.opening < 0.4 for state in states])

    def at(self, point_mm: tuple[float, float, float]) -> np.ndarray:
        return np.linalg.norm(self.tool - point_mm, axis=1) < NEAR_MM

    def picks(self) -> bool:
        closing = np.flatnonzero(~self.closed[:-1] & self.closed[1:])
        return bool(len(closing)) and bool(self.at(PICK_MM)[closing[0]])

    def places(self) -> bool:
        opening = np.flatnonzero(self.closed[:-1] & ~self.closed[1:])
        return self.picks() and bool(len(opening)) and bool(self.at(PLACE_MM)[opening[-1]])

    def carries_high(self) -> bool:
        between = self.closed & (np.abs(self.tool[:, 1]) < 60)
        return bool(between.any()) and bool((self.tool[between, 2] > SAFE_MM).all())


def errors(path: Path) -> list[str]:
    findings = check_program(load_program(path), ROBOT)
    return [str(finding) for finding in findings if finding.severity == "error"]


def main(path: Path) -> None:
    """Check the program in a file."""
    try:
        wrong = errors(path)
        seen = None if wrong else Seen(rehearse(ROBOT, load_program(path), ROBOT.pose("home"), 1.0))
    except ArmctlError as error:
        wrong, seen = [str(error)], None
    check(
        (path, lambda _: not wrong, "; ".join(wrong)),
        (seen or ..., Seen.picks, f"Close the gripper (below 40 %) while the tool is at {PICK_MM}."),
        (seen or ..., Seen.places, f"Carry the part to {PLACE_MM}, and open the gripper there."),
        (seen or ..., Seen.carries_high, f"Lift the part above {SAFE_MM:g} mm where Y is -60 … 60."),
        (seen or ..., lambda one: one.seconds <= LONGEST_S, f"Be faster than {LONGEST_S:g} s: blend."),
    )


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("say which program: python lesson_3.py my_program.toml")
    main(Path(sys.argv[1]))

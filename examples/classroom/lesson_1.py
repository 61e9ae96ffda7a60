"""Lesson 1: joints and the tool. Replace each ``...`` by your answer, then run this file with Python."""

from __future__ import annotations

import numpy as np
from exercises import check, near

import armctl

UZUNER = armctl.load_robot("uzuner")
AL5D = armctl.load_robot("al5d")

# 1. Robot uzuner, all joints at 0°: where is the tool? (X, Y, Z) in mm. (Forward, Fill with "zero")
TOOL_AT_ZERO_MM = ...

# 2. Robot uzuner at home: which joint moves the tip fastest, at the same joint speed? Its name in the robot
#    file. (Forward, Jacobian: the upper three numbers of a column are the tip's velocity)
FASTEST_JOINT = ...

# 3. Robot uzuner at home: how far away is the tip after the elbow turned by +10°? In mm, in a straight line.
TIP_MOVES_MM = ...


# 4. Write the forward kinematics of the AL5D in its plane: distance from the base axis, and height, in mm.
#    Base height 67.31, upper arm 146.05, forearm 187.325, hand 100. Each angle counts from the link before,
#    the shoulder's from the horizontal.
def tip_mm(shoulder_deg: float, elbow_deg: float, wrist_deg: float) -> tuple[float, float]:
    """Distance and height of the tip."""
    raise NotImplementedError("write this function")


# What follows checks your answers.


def at_zero(answer: tuple[float, float, float]) -> bool:
    return np.allclose(answer, 1000 * UZUNER.forward(np.zeros(5))[:3, 3], atol=0.15)


def fastest(answer: str) -> bool:
    speeds = np.linalg.norm(UZUNER.jacobian(UZUNER.pose("home"))[:3], axis=0)
    return answer == UZUNER.joint_names[int(speeds.argmax())]


def elbow_moves() -> float:
    before, after = UZUNER.pose("home").copy(), UZUNER.pose("home").copy()
    after[UZUNER.joint_names.index("elbow")] += np.radians(10)
    tips = [UZUNER.forward(q)[:3, 3] for q in (before, after)]
    return 1000 * float(np.linalg.norm(tips[1] - tips[0]))


def is_forward(answer: object) -> bool:
    for shoulder, elbow, wrist in np.random.default_rng(1).uniform((0, -150, -90), (150, 10, 90), (100, 3)):
        tip = 1000 * AL5D.forward(np.radians([0, shoulder, elbow, wrist]))[:3, 3]
        if not np.allclose(tip_mm(shoulder, elbow, wrist), (tip[0], tip[2]), atol=1e-6):
            return False
    return True


if __name__ == "__main__":
    check(
        (TOOL_AT_ZERO_MM, at_zero, "Type 0 into every joint in Forward, and read X, Y and Z."),
        (FASTEST_JOINT, fastest, "The joint whose axis is farthest from the tip moves it fastest."),
        (TIP_MOVES_MM, near(elbow_moves(), 0.3), "Subtract the two tips, then take the length."),
        (tip_mm, is_forward, "Add up the links: each angle is the sum of all angles before it."),
    )

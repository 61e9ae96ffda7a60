"""How long an arm needs to come to rest."""

from __future__ import annotations

from armctl.robot import Robot


def stopping_s(robot: Robot) -> float:
    """What the slowest joint needs from its full speed to rest on a straight way [s].

    On a bend the path itself takes some of the acceleration: allow for several times as much.
    """
    return float((robot.speed_limits / robot.acceleration_limits).max())

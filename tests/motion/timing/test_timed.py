"""A path made a motion by a named profile."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from armctl.errors import MotionRefusedError
from armctl.motion import PiecewisePolynomial, ProfileName
from armctl.motion.profiles import shortest_words
from armctl.motion.timing import timed
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
HOME = ROBOT.pose("home")


def way(*turns: float) -> PiecewisePolynomial:
    """A straight way of the joints, over 0 … 1."""
    return PiecewisePolynomial([0.0, 1.0], np.stack([HOME, np.resize(np.array(turns), ROBOT.n)])[None])


@pytest.mark.parametrize(
    ("turns", "factors", "profile", "cap", "what"),
    [
        ((1.0, 0.1, 0, 0, 0), (1.0, 9.0, 9.0), "trapezoid", np.inf, "Base is near its largest speed, 60 °/s"),
        ((0.1, 1.0, 0, 0, 0), (9.0, 1.0, 9.0), "trapezoid", np.inf, "Shoulder is near its largest acceler"),
        ((0.1, 1.0, 0, 0, 0), (9.0, 9.0, 1.0), "s-curve", np.inf, "Shoulder is near its largest jerk"),
        ((1.0, 0.1, 0, 0, 0), (1.0, 9.0, 9.0), "trapezoid", 0.1, "it goes at the speed that was asked for"),
    ],
)
def test_too_short_a_duration_is_refused_with_the_joint_and_its_limit(
    turns: tuple[float, ...], factors: tuple[float, ...], profile: ProfileName, cap: float, what: str
) -> None:
    speed, push, jerk = factors
    joints = tuple(
        replace(
            joint, speed=speed * joint.speed, acceleration=push * joint.acceleration, jerk=jerk * joint.jerk
        )
        for joint in ROBOT.joints
    )
    robot = replace(ROBOT, joints=joints)
    with pytest.raises(MotionRefusedError, match=re.escape(f"most of the time {what}")) as refused:
        timed(robot, way(*turns), profile=profile, rate_cap=cap, duration_s=0.05)
    shortest = timed(robot, way(*turns), profile=profile, rate_cap=cap).duration
    assert shortest_words(shortest) in str(refused.value)

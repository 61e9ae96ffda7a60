"""The joint that rolls the tool about its approach axis."""

from __future__ import annotations

import math
from collections.abc import Sequence

from armctl.kinematics.angles import LIMIT_TOLERANCE, TWO_PI, images, nearest_angle, rest_angle, wrap
from armctl.kinematics.solutions import needs

NO_ROLL = "this arm has no joint that rolls the tool"
_NOTHING = (0.0,)


class RollJoint:
    """One roll joint inside its limits. Immutable; safe in several threads."""

    def __init__(self, index: int, title: str, limits: Sequence[float]) -> None:
        self.index, self.title = index, title
        self.low, self.high = map(float, limits)
        self.resting = rest_angle(self.low, self.high)
        """where it stands when any roll will do [rad]"""
        self._any = (self.resting,)
        # between these a roll has no image inside the limits but itself
        slack = LIMIT_TOLERANCE if self.high - self.low <= TWO_PI else math.inf
        self._alone_from, self._alone_to = self.low + slack, self.high - slack

    def angles(self, roll: float | None) -> Sequence[float]:
        """What the joint may be at for a roll asked for, or any [rad]; empty where its limits forbid it."""
        if roll is None:
            return self._any
        if self._alone_from < roll < self._alone_to:
            return (roll,)
        return images(roll, self.low, self.high)


def roll_angles(joint: RollJoint | None, roll: float | None) -> Sequence[float]:
    """``RollJoint.angles``; for an arm without the joint one number that says nothing."""
    return _NOTHING if joint is None else joint.angles(roll)


def held_roll(joint: RollJoint | None, roll: float | None) -> tuple[str | None, float]:
    """What the roll joint is held at for a roll asked for, or any [rad].

    Returns:
        Why that roll cannot be, or None; and the joint's angle: where there are several the one nearest to
        zero, where it cannot be the nearest that can, 0 where there is no such joint.
    """
    if joint is None:
        return (None if roll is None else NO_ROLL), 0.0
    angles = joint.angles(roll)
    if roll is None or angles:
        return None, min(angles, key=abs)
    return needs(joint.title, (joint.low, joint.high), wrap(roll)), nearest_angle(roll, joint.low, joint.high)

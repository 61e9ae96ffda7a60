"""Coming to a pose from one side, so that each joint stands on the same side of its play each time.

A joint whose gear has play stays where it was pushed to last. Gravity decides that for joints that carry; the
others are led past the pose and turn back to it: all of them end turning in one sense.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.errors import MotionRefusedError
from armctl.facts import NoRoomToTurn
from armctl.facts.angles import DEGREE
from armctl.robot import Deflection, Robot

OneSided = Literal["end-plus", "end-minus"]
ONE_SIDED: tuple[OneSided, ...] = ("end-plus", "end-minus")
"""each joint ends turning to larger angles; or to smaller ones"""
_BACK = 2.0 * DEGREE
"""so far a joint turns in that sense at the end, or half as much again as its play"""
_MORE = 1.5
_LEAST = 1.0 * DEGREE
"""with less room than that, and than its play, a joint cannot come from there"""
_DECIDED = 0.9
"""gravity holds a joint at one side of its play where it leans so far to it (``Deflection.side``)"""


def commanded_end(robot: Robot, q: FloatArray, profile: OneSided) -> FloatArray:
    """(n,) what to command so that links come to stand at ``q`` (n,) [rad], when they come from one side.

    A command counts from the middle of the play, as far as that is known, and the joints lag behind it by
    half of it, where gravity does not decide.
    """
    known = robot.outputs.deflection
    if known is None:
        return q
    torque = known.gravity.torque(q)
    off = known.side(torque, _sense(profile)) - known.side(torque)
    return np.clip(q + 0.5 * known.play * off, *robot.limits.T)


def turning_point(robot: Robot, start: FloatArray, end: FloatArray, profile: OneSided) -> FloatArray | None:
    """(n,) where the joints turn round on the way from ``start`` to ``end`` (n,) [rad]; None: none has to.

    ``MotionRefusedError``: a joint has no room behind ``end``.
    """
    sense, (low, high) = _sense(profile), robot.limits.T
    known = robot.outputs.deflection
    play = np.zeros(robot.n) if known is None else known.play
    back = np.maximum(_BACK, _MORE * play)
    free = (high > low) & _undecided(robot, end)
    if known is not None:
        free &= known.play > 0.0
    turns = free & (sense * (end - start) < back)
    if not turns.any():
        return None
    room = end - low if sense > 0 else high - end
    needed = np.maximum(_LEAST, play)
    for i in np.flatnonzero(turns & (room < needed)).tolist():
        raise MotionRefusedError(NoRoomToTurn(robot.joints[i].title, float(room[i]), float(needed[i])))
    return np.where(turns, end - sense * np.minimum(back, room), end)


def one_sided_stops(robot: Robot, start: FloatArray, end: FloatArray, profile: OneSided) -> list[FloatArray]:
    """Where the joints stand at the begin, where they turn round, if they have to, and at the end."""
    via = turning_point(robot, start, end, profile)
    return [start, end] if via is None else [start, via, end]


def _sense(profile: OneSided) -> float:
    return 1.0 if profile == "end-plus" else -1.0


def _undecided(robot: Robot, q: FloatArray) -> NDArray[np.bool_]:
    """(n,) joints which gravity does not hold at one side of their play at ``q`` (n,) [rad]."""
    known = robot.outputs.deflection
    if known is None and not robot.gravity.weighs:
        return np.ones(robot.n, dtype=np.bool_)
    if known is None:
        known = Deflection.of(robot.gravity, robot.gravity.heaviest(robot.limits))
    return np.abs(known.side(known.gravity.torque(q))) < _DECIDED

"""What the sliders and the −/+ buttons ask for, checked before it is sent."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError, MotionRefusedError, StateError
from armctl.motion.program.program import LONGEST_WAIT_S
from armctl.robot import Joint, Robot
from armctl.runtime import Snapshot

FloatArray = NDArray[np.float64]
_ROUNDING = 1e-9


def stepped(robot: Robot, q: FloatArray, joint: int, step_deg: float) -> FloatArray:
    """``q`` (n,) [rad] with one joint turned by ``step_deg``.

    Raises:
        MotionRefusedError: the joint would pass its limit; says by how much it may still turn.
    """
    asked = q.copy()
    asked[joint] += math.radians(step_deg)
    one = robot.joints[joint]
    limit = one.upper if step_deg > 0 else one.lower
    beyond = asked[joint] - limit if step_deg > 0 else limit - asked[joint]
    if beyond > _ROUNDING:
        left = abs(limit - float(q[joint]))
        raise MotionRefusedError(
            f"{one.title}: {step_deg:+g}° from {math.degrees(float(q[joint])):.2f}° leads to "
            f"{math.degrees(float(asked[joint])):.2f}°, the limit is {math.degrees(limit):.2f}°; "
            f"it can turn {math.degrees(left):.2f}° more that way"
        )
    asked[joint] = min(max(float(asked[joint]), one.lower), one.upper)
    return asked


def held_at(joint: Joint) -> str | None:
    """What the controls of a joint say whose limits are one and the same angle; None: it can turn."""
    return f"held at {round(math.degrees(joint.lower), 2):g}°" if joint.lower == joint.upper else None


def slider_limits(robot: Robot) -> FloatArray:
    """(n, 2) ends of the sliders [degrees]: the limits, or the hundredth next to them inside.

    The page writes them out, and a URDF has limits such as 1.91986 rad, which are 109.99987…°.
    """
    exact = np.degrees(robot.limits)
    low, high = np.ceil(100 * exact[:, 0] - _ROUNDING) / 100, np.floor(100 * exact[:, 1] + _ROUNDING) / 100
    return np.where((low < high)[:, None], np.stack([low, high], axis=1), exact)


def slider_degrees(robot: Robot, q: FloatArray) -> list[float]:
    """``q`` (n,) [rad] as slider positions: degrees rounded to 0.01, inside the limits."""
    low, high = slider_limits(robot).T
    return np.clip(np.round(np.degrees(q), 2), low, high).tolist()


def asked_pose(robot: Robot, degrees: Sequence[float]) -> FloatArray:
    """The pose (n,) [rad] that slider positions ask for.

    Raises:
        InputError: not finite.
        MotionRefusedError: outside the limits.
    """
    return robot.check_limits(np.radians(degrees))


def present_pose_deg(robot: Robot, snapshot: Snapshot) -> tuple[float, ...]:
    """The pose to record, in degrees: what the arm was told last; before that, what its board says.

    Raises:
        StateError: the arm was told nothing, and its board does not know.
    """
    if snapshot.commanded:
        return tuple(slider_degrees(robot, snapshot.q_command))
    if np.isfinite(snapshot.q).all():
        return tuple(slider_degrees(robot, snapshot.q))
    raise StateError(
        f"the arm is {snapshot.state.value}, so nobody knows where it stands; connect and enable it first"
    )


def checked_percent(value: float, what: str) -> float:
    """A percentage.

    Raises:
        InputError: not finite, or outside 0 … 100.
    """
    if not math.isfinite(value) or not 0 <= value <= 100:
        raise InputError(f"{what}: {value:g} % is outside 0 … 100 %")
    return float(value)


def checked_seconds(value: float) -> float:
    """How long to wait [s].

    Raises:
        InputError: not finite, or outside 0 … 86400.
    """
    if not math.isfinite(value) or not 0 <= value <= LONGEST_WAIT_S:
        raise InputError(f"a wait of {value:g} s is outside 0 … {LONGEST_WAIT_S} s")
    return float(value)

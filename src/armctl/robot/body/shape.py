"""How wide an arm is taken to be, and whether its tool points along its hand."""

from __future__ import annotations

import math
from typing import NamedTuple

from armctl.kinematics import Chain
from armctl.robot.parts import Look


def width(chain: Chain, look: Look) -> float:
    """Width of the links [m]."""
    return look.width * chain.length


_ACROSS, _PARALLEL = 0.4, 0.999


class AxisNote(NamedTuple):
    """That the tool axis lies across the last link."""

    what: str
    mend: str


def across_the_link(chain: Chain) -> AxisNote | None:
    """What to know where the tool axis is parallel to the last joint, and the tool point is off that axis.

    So it is where the DH rows of an arm of pitch joints end with its last joint. Such a tool cannot be
    pitched: all pitch joints turn it about its own axis. None: it is not so, or there are no DH rows.
    """
    axis, (x, y, z) = chain.tail[:3, 2], chain.tail[:3, 3].tolist()
    off = math.hypot(x, y)
    if not chain.rows or off < 1e-6 or abs(axis[2]) < _PARALLEL or abs(z) > _ACROSS * off:
        return None
    ahead = chain.tail[:3, :3].T @ [x, y, 0.0]
    theta = round(math.degrees(math.atan2(ahead[1], ahead[0])) + 90.0, 3) + 0.0
    theta = theta - 360.0 if theta > 180.0 else theta
    turn = f"{{ a_mm = 0, alpha_deg = 90, d_mm = 0, theta_deg = {theta:g} }}"
    if chain.convention == "modified":  # alpha comes before theta there
        turn = (
            f"{{ a_mm = 0, alpha_deg = 0, d_mm = 0, theta_deg = {theta:g} }}, "
            "{ a_mm = 0, alpha_deg = 90, d_mm = 0 }"
        )
    rows = "these two rows" if chain.convention == "modified" else "this row"
    return AxisNote(
        "z of the last DH row lies across the last link, along the axis of the last joint: "
        "no joint can change the pitch of the tool",
        f"add {rows} at the end of dh.rows, and z points along the link: {turn}",
    )

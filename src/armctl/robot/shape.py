"""An arm's shape: bars along its DH rows or from joint to joint, and a hand or a tip at the tool point.

What is drawn and what the pre-flight keeps apart are the same shape.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from armctl.kinematics import Chain
from armctl.robot.parts import Look
from armctl.robot.solids import Point

# The gripper, as fractions of the reach (y from finger to finger, z along the tool) ...
FINGER, PALM = (0.026, 0.012, 0.085), (0.03, 0.15, 0.022)
GAP_CLOSED, GAP_OPEN = 0.008, 0.065
# ... and the tip of an arm without one, as multiples of the links' width.
TIP_RADIUS, TIP_LENGTH = 0.4, 1.6


# A hand whose tool does not point along it.

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


@dataclass(frozen=True, slots=True)
class Bar:
    """A straight piece of a link."""

    frame: int
    """the frame it is fixed to: index into ``Chain.places``"""
    name: str
    """tells it from the others"""
    link: int
    """index of the link; -1: the base"""
    start: Point
    """in its frame [m]"""
    end: Point

    @property
    def length(self) -> float:
        """[m]."""
        return math.dist(self.start, self.end)


def width(chain: Chain, look: Look) -> float:
    """Width of the links [m]."""
    return look.width * chain.length


def tool_length(chain: Chain, look: Look, *, gripper: bool) -> float:
    """How much shorter the last bar is, so that the fingers or the tip end at the tool point [m]."""
    return chain.length * FINGER[2] if gripper else width(chain, look) * TIP_LENGTH


def bars(chain: Chain, shorten: float) -> Iterator[Bar]:
    """The bars from the base to the tool, those of no length too.

    ``shorten``: what the hand or the tip takes of the last bar, along the tool's z [m].
    """
    yield from _bars_of_rows(chain, shorten) if chain.rows else _bars_of_joints(chain, shorten)


def _bars_of_rows(chain: Chain, shorten: float) -> Iterator[Bar]:
    """Modified rows go along a on the frame before and along d on their own; standard ones vice versa."""
    link = -1
    for i, row in enumerate(chain.rows):
        before, link = link, link + row.joint
        d = _shortened(row.d_m, shorten if i == len(chain.rows) - 1 else 0.0)
        if chain.convention == "modified":
            yield Bar(i, f"a{i}", before, (0, 0, 0), (row.a_m, 0, 0))
            yield Bar(i + 1, f"d{i}", link, (0, 0, -row.d_m), (0, 0, d - row.d_m))
        else:
            # where the hand takes from d, what lies along a is moved to where d ends now
            back = d - row.d_m
            y, z = back * math.sin(row.alpha_rad), back * math.cos(row.alpha_rad)
            yield Bar(i, f"d{i}", before, (0, 0, 0), (0, 0, d))
            yield Bar(i + 1, f"a{i}", link, (-row.a_m, y, z), (0, y, z))


def _bars_of_joints(chain: Chain, shorten: float) -> Iterator[Bar]:
    """Straight from the origin of each joint's frame to the next one's, and to the tool."""
    for i, segment in enumerate(chain.segments):
        x, y, z = segment[:3, 3].tolist()
        yield Bar(i, f"link{i}", i - 1, (0, 0, 0), (x, y, z))
    along = float(chain.tail[:3, 3] @ chain.tail[:3, 2])
    x, y, z = (chain.tail[:3, 3] + (_shortened(along, shorten) - along) * chain.tail[:3, 2]).tolist()
    last = len(chain.segments)
    yield Bar(last, f"link{last}", last - 1, (0, 0, 0), (x, y, z))


def _shortened(length: float, by: float) -> float:
    return math.copysign(max(0.0, abs(length) - by), length)

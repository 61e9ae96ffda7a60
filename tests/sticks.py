"""An arm as sticks: capsules round bars along its DH rows, whose gaps a test can work out by hand."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armctl.kinematics import Chain
from armctl.robot import Robot, load_robot
from armctl.robot.body.arm_body import Capsule, capsule, moved, width
from armctl.robot.parts import Look
from armctl.robot.solids import Point

# The gripper, as fractions of the reach (y from finger to finger, z along the tool) ...
FINGER, PALM = (0.026, 0.012, 0.085), (0.03, 0.15, 0.022)
GAP_CLOSED, GAP_OPEN = 0.008, 0.065
# ... and the tip of an arm without one, as multiples of the links' width.
TIP_RADIUS, TIP_LENGTH = 0.4, 1.6

_LOOKS = {
    "abaas": Look(shape="square", width=0.06),
    "humanoid": Look(width=0.07),
    "mico": Look(width=0.08),
    "scorbot": Look(shape="square", width=0.07),
}


def of_sticks(robot: Robot | str, look: Look | None = None) -> Robot:
    """A shipped arm with the body of sticks instead of its look."""
    robot = load_robot(robot) if isinstance(robot, str) else robot
    look = look or _LOOKS.get(robot.name, Look())
    capsules = shape_capsules(robot.chain, look, robot.link_titles, gripper=robot.gripper is not None)
    return replace(robot, look=look, capsules=capsules)


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


def shape_capsules(chain: Chain, look: Look, titles: Sequence[str], *, gripper: bool) -> tuple[Capsule, ...]:
    """The capsules of an arm as it is drawn; without a gripper it ends in a tip.

    A bar shorter than the links are wide lies inside the drum of its joint and is left out; bars in one
    line are one capsule. Round a square beam the capsule goes through its corners. The fingers are one
    capsule round both when they are closed; the palm is as wide as it is when they are open.
    """
    wide = width(chain, look)
    radius = wide * (0.5 if look.shape == "round" else math.sqrt(0.5))
    links: list[Capsule] = []
    for bar in bars(chain, tool_length(chain, look, gripper=gripper)):
        if bar.length > 1e-9:
            piece = capsule(chain, titles, bar.frame, (bar.start, bar.end), radius)
            if links and _goes_on(links[-1], piece):
                piece = replace(piece, start=links.pop().start)
            links.append(piece)
    links = [piece for piece in links if math.dist(piece.start, piece.end) >= wide]
    return (*links, *_hand(chain, wide, gripper=gripper))


def _goes_on(last: Capsule, piece: Capsule) -> bool:
    """Whether a piece of the same link goes on in the same direction where the last one ends."""
    before, after = last.end - last.start, piece.end - piece.start
    straight = before @ after > (1 - 1e-9) * np.linalg.norm(before) * np.linalg.norm(after)
    return last.link == piece.link and bool(straight) and np.allclose(last.end, piece.start, atol=1e-9)


def _hand(chain: Chain, wide: float, *, gripper: bool) -> list[Capsule]:
    """What ends at the tool point, along the tool's z."""
    link, T = chain.places[-1]

    def piece(start: tuple[float, float], end: tuple[float, float], radius: float, part: str) -> Capsule:
        return Capsule(link, moved(T, (0.0, *start)), moved(T, (0.0, *end)), radius, part)

    if not gripper:
        radius = 0.5 * TIP_RADIUS * wide  # half way along the cone
        return [piece((0, -TIP_LENGTH * wide), (0, -radius), radius, "the tool")]
    size = chain.length
    finger, palm = 0.5 * FINGER[0] * size, 0.5 * PALM[0] * size
    behind, half = -(FINGER[2] + 0.5 * PALM[2]) * size, 0.5 * PALM[1] * size - palm
    return [
        piece((-half, behind), (half, behind), palm, "the gripper"),
        piece((0, behind), (0, -finger), finger, "the gripper"),
    ]

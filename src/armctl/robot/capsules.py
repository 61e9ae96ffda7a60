"""The arm's body as capsules: segments with a radius, each fixed to a link."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.kinematics import DHChain
from armctl.kinematics.link_frames import row_in_link
from armctl.robot.look import Look
from armctl.robot.skeleton import (
    FINGER,
    PALM,
    TIP_LENGTH,
    TIP_RADIUS,
    bars,
    reach,
    tool_length,
    width,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Capsule:
    """All points within a radius of a segment."""

    link: int
    """index of the joint that moves it; -1: the base"""
    start: FloatArray
    """(3,) in the link's frame (``LinkFrames``) [m]"""
    end: FloatArray
    """(3,) [m]"""
    radius: float
    """[m]"""
    part: str
    """what people call it"""


def capsule(
    chain: DHChain, titles: Sequence[str], frame: int, ends: tuple[ArrayLike, ArrayLike], radius: float
) -> Capsule:
    """A capsule between two points of a DH frame.

    Args:
        chain: the arm.
        titles: of the joints, for the part's name.
        frame: 0 the base, i + 1 the frame behind DH row i.
        ends: two points (3,) in that frame [m].
        radius: [m].
    """
    link, T = row_in_link(chain)[frame]
    start, end = (T[:3, :3] @ np.asarray(point, dtype=np.float64) + T[:3, 3] for point in ends)
    return Capsule(link, start, end, radius, link_name(link, titles))


def link_name(link: int, titles: Sequence[str]) -> str:
    """What people call a link: the base, or the link behind a joint."""
    return "the base" if link < 0 else f"the link behind {titles[link].lower()}"


def shape_capsules(
    chain: DHChain, look: Look, titles: Sequence[str], *, gripper: bool
) -> tuple[Capsule, ...]:
    """The capsules of an arm as it is drawn.

    A bar shorter than the links are wide lies inside the drum of its joint and is left out; bars in one
    line are one capsule. Round a square beam the capsule goes through its corners. The fingers are one
    capsule round both when they are closed; the palm is as wide as it is when they are open.

    Args:
        chain: the arm.
        look: how it is drawn.
        titles: of the joints.
        gripper: whether it has one; else it ends in a tip.
    """
    wide = width(chain, look)
    radius = wide * (0.5 if look.shape == "round" else math.sqrt(0.5))
    drawn = [bar for bar in bars(chain, tool_length(chain, look, gripper=gripper)) if bar.length > 1e-9]
    pieces = [capsule(chain, titles, bar.frame, (bar.start, bar.end), radius) for bar in drawn]
    links = [piece for piece in _in_one_line(pieces) if math.dist(piece.start, piece.end) >= wide]
    return (*links, *_hand(chain, look, gripper=gripper))


def _in_one_line(pieces: Iterable[Capsule]) -> list[Capsule]:
    """Pieces of one link that go on in the same direction where the one before ends, put together."""
    joined: list[Capsule] = []
    for piece in pieces:
        last = joined[-1] if joined else None
        if last is not None and last.link == piece.link:
            before, after = last.end - last.start, piece.end - piece.start
            straight = before @ after > (1 - 1e-9) * np.linalg.norm(before) * np.linalg.norm(after)
            if straight and np.allclose(last.end, piece.start, atol=1e-9):
                joined[-1] = Capsule(last.link, last.start, piece.end, last.radius, last.part)
                continue
        joined.append(piece)
    return joined


def _hand(chain: DHChain, look: Look, *, gripper: bool) -> list[Capsule]:
    """What ends at the tool point, along the tool's z."""
    link, T = row_in_link(chain)[-1]
    size = reach(chain)

    def along(y: float, z: float) -> FloatArray:
        return T[:3, :3] @ np.array([0.0, y, z]) + T[:3, 3]

    if not gripper:
        wide = width(chain, look)
        radius = 0.5 * TIP_RADIUS * wide  # half way along the cone
        return [Capsule(link, along(0, -TIP_LENGTH * wide), along(0, -radius), radius, "the tool")]
    finger, palm = 0.5 * FINGER[0] * size, 0.5 * PALM[0] * size
    behind, half = -(FINGER[2] + 0.5 * PALM[2]) * size, 0.5 * PALM[1] * size - palm
    return [
        Capsule(link, along(-half, behind), along(half, behind), palm, "the gripper"),
        Capsule(link, along(0, behind), along(0, -finger), finger, "the gripper"),
    ]

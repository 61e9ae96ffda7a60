"""The corners of an arm: what comes nearest to a plane that it must stay above."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics import DHChain
from armctl.kinematics.link_frames import LinkFrames, row_in_link
from armctl.kinematics.workspace.joint_samples import joint_samples
from armctl.robot.capsules import link_name
from armctl.robot.levers import lever_bounds

FloatArray = NDArray[np.float64]
_PROBES = 24


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """A point of a link."""

    link: int
    """index of the joint that moves it"""
    point: FloatArray
    """(3,) in the link's frame [m]"""
    part: str
    """what people call the part that it belongs to"""
    levers: FloatArray
    """(n,) how far it rises or sinks a radian of each joint, at most [m/rad]"""


def moving_corners(chain: DHChain, titles: Sequence[str], limits: FloatArray) -> tuple[Corner, ...]:
    """The corners and frame origins of an arm that joints raise or lower, from the base to the tool.

    Between two frames a DH row runs along x and z in straight lines, and over a plane a straight line is
    lowest at one of its ends: the origins and the corners between them are the whole arm.

    Args:
        chain: the arm.
        titles: of the joints, for the names of the parts.
        limits: (n, 2) [rad].
    """
    probes = LinkFrames.at(chain, joint_samples(limits, _PROBES))
    upright = abs(chain.segments[0][2, 2]) > 1 - 1e-12  # then the first joint changes no height
    corners: list[Corner] = []
    for link, point, part in _points(chain, titles):
        if np.ptp(probes.place(link, point[None])[2, 0]) > 1e-9:
            levers = lever_bounds(chain, link, point[None])
            levers[0] *= not upright
            corners.append(Corner(link, point, part, levers))
    return tuple(corners)


def _points(chain: DHChain, titles: Sequence[str]) -> Iterator[tuple[int, FloatArray, str]]:
    places = row_in_link(chain)
    last = len(chain.rows) - 1
    for i, (row, (ahead, T_ahead), (link, T_link)) in enumerate(
        zip(chain.rows, places[:-1], places[1:], strict=True)
    ):
        # modified rows go along x first, standard ones along z: the end of that way is the corner
        offset = (row.a_m, 0.0, 0.0) if chain.convention == "modified" else (0.0, 0.0, row.d_m)
        yield ahead, T_ahead[:3, :3] @ np.array(offset) + T_ahead[:3, 3], link_name(ahead, titles)
        yield link, T_link[:3, 3], "the tool" if i == last else link_name(link, titles)

"""The frames that move with the joints, at many configurations at once, entry by entry in memory.

``DHChain.frames`` gives whole matrices behind every DH row; checks over hundreds of thousands of
configurations need only what moves, and numpy works on an entry of all of them with one call.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from armctl.kinematics.chain import DHChain

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LinkFrames:
    """Where the links are in m configurations. Link j turns about its own z with joint j; -1 is the base."""

    rotation: tuple[FloatArray, ...]
    """one a joint, (3, 3, m): ``R_base_link``"""
    origin: tuple[FloatArray, ...]
    """one a joint, (3, m): a point of the joint's axis, base frame [m]"""

    @classmethod
    def at(cls, chain: DHChain, q: ArrayLike) -> LinkFrames:
        """The links of ``chain`` at ``q`` (m, n) [rad]."""
        q = chain.checked(q)
        cosines, sines = np.cos(q.T), np.sin(q.T)
        rotations: list[FloatArray] = []
        origins: list[FloatArray] = []
        for j, segment in enumerate(chain.segments):
            if j == 0:
                ahead = np.broadcast_to(segment[:3, :3, None], (3, 3, len(q)))
                origin = np.broadcast_to(segment[:3, 3, None], (3, len(q)))
            else:
                ahead = np.matmul(segment[:3, :3].T, rotations[-1])
                origin = origins[-1] + np.matmul(segment[:3, 3], rotations[-1])
            turned = np.empty((3, 3, len(q)))
            turned[:, 0] = ahead[:, 0] * cosines[j] + ahead[:, 1] * sines[j]
            turned[:, 1] = ahead[:, 1] * cosines[j] - ahead[:, 0] * sines[j]
            turned[:, 2] = ahead[:, 2]
            rotations.append(turned)
            origins.append(origin)
        return cls(tuple(rotations), tuple(origins))

    def place(self, link: int, points: ArrayLike) -> FloatArray:
        """Points that are fixed to a link, in the base frame.

        Args:
            link: index of the joint that moves it; -1 for the base.
            points: (p, 3) in the frame of the link [m].

        Returns:
            (3, p, m) [m].
        """
        points = np.asarray(points, dtype=np.float64)
        if link < 0:
            return np.broadcast_to(points.T[:, :, None], (3, len(points), self.origin[0].shape[-1]))
        return np.matmul(points, self.rotation[link]) + self.origin[link][:, None, :]


def row_in_link(chain: DHChain) -> list[tuple[int, FloatArray]]:
    """For the base and the frame behind each DH row: the link it belongs to, and ``T_link_frame`` (4, 4)."""
    places = [(-1, np.eye(4))]
    link = -1
    zero = chain.frames(np.zeros(chain.n))
    links = LinkFrames.at(chain, np.zeros((1, chain.n)))
    for row, frame in zip(chain.rows, zero[1:], strict=True):
        link += row.joint
        T_base_link = np.eye(4)
        if link >= 0:
            T_base_link[:3, :3] = links.rotation[link][:, :, 0]
            T_base_link[:3, 3] = links.origin[link][:, 0]
        R = T_base_link[:3, :3].T
        T = np.eye(4)
        T[:3, :3] = R @ frame[:3, :3]
        T[:3, 3] = R @ (frame[:3, 3] - T_base_link[:3, 3])
        places.append((link, T))
    return places

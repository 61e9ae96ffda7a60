"""Static gravity torque of an arm at rest."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from armctl.kinematics.chain import DHChain
from armctl.kinematics.link_frames import LinkFrames, row_in_link

FloatArray = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665
"""m/s² (CGPM 1901)"""


@dataclass(frozen=True, slots=True)
class Body:
    """A point mass that moves with a joint."""

    joint: int
    """index of the joint that carries it"""
    mass_kg: float
    com_m: tuple[float, float, float]
    """in the frame of the joint's DH row"""


@dataclass(frozen=True, slots=True)
class GravityModel:
    """Masses of an arm; gravity points along -z of the base frame."""

    chain: DHChain
    bodies: tuple[Body, ...]
    payload_kg: float = 0.0
    """held at the tool point"""
    _carried: tuple[tuple[tuple[float, FloatArray], ...], ...] = field(init=False, repr=False, compare=False)
    """for each joint: mass and point (3,) in the link's frame of what it carries until the next joint"""

    def __post_init__(self) -> None:
        places, n = row_in_link(self.chain), self.chain.n
        carried: list[list[tuple[float, FloatArray]]] = [[] for _ in range(n)]
        for body in self.bodies:
            T = places[self.chain.joint_rows[body.joint] + 1][1]
            carried[body.joint].append((body.mass_kg, T[:3, :3] @ np.array(body.com_m) + T[:3, 3]))
        carried[n - 1].append((self.payload_kg, places[-1][1][:3, 3]))
        object.__setattr__(self, "_carried", tuple(map(tuple, carried)))

    def torque(self, q: FloatArray) -> FloatArray:
        """Torque that each joint must hold against gravity.

        Args:
            q: (..., n) joint angles [rad].

        Returns:
            (..., n) [N·m], positive where gravity would turn the joint to smaller angles.

        The sum over all masses beyond the joint of ``m g (z_axis x lever)_z``: the gradient of the
        potential energy.
        """
        q = self.chain.checked(q)
        flat = q.reshape(-1, self.chain.n)
        return self.torque_of(LinkFrames.at(self.chain, flat)).T.reshape(q.shape)

    def torque_of(self, links: LinkFrames) -> FloatArray:
        """As ``torque``, for links that are placed already: (n, m) [N·m], a column a configuration."""
        n, m = self.chain.n, links.origin[0].shape[-1]
        torque = np.empty((n, m))
        mass, moment = 0.0, np.zeros((2, m))  # of everything beyond the joint: Σ m and Σ m (x, y)
        for j in reversed(range(n)):
            for weight, point in self._carried[j]:
                mass += weight
                moment += weight * links.place(j, point[None])[:2, 0]
            z, origin = links.rotation[j][:, 2], links.origin[j]
            torque[j] = z[0] * (moment[1] - mass * origin[1]) - z[1] * (moment[0] - mass * origin[0])
        torque *= STANDARD_GRAVITY
        return torque

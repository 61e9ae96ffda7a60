"""Recognising arms of the build *yaw + parallel pitch joints + roll* with the tool beside the roll axis.

At each roll the arm is one of the build *yaw + parallel pitch joints*, with another last link and another
lateral offset of its tool plane. Both go round with the roll angle c:

    L(c) = L0 + L1 cos c + L2 sin c         from the last pitch axis to the tip, in the tool plane
    d(c) = d0 + d1 cos c + d2 sin c         how far the tip lies to the left of the base axis
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.kinematics.angles import wrap
from armctl.kinematics.chain import Chain
from armctl.kinematics.families.yaw_pitch_roll.geometry import recognise
from armctl.kinematics.geometry.tool_plane import ToolPlane

ComplexArray = NDArray[np.complex128]
_ALIGNED = 1e-9
"""how far from parallel or perpendicular axes may be (sine of the angle)"""
_SHORTEST_M = 1e-6
"""a last link that gets shorter than this at some roll has no direction there [m]"""
_CLEAN_M = 1e-14
"""an offset below this is rounding [m]"""
_LOOKS = 64


@dataclass(frozen=True)
class OffsetRoll:
    """How such an arm moves its tool: lengths in metres, angles in radians."""

    plane: ToolPlane
    """the tool plane with the roll joint at zero"""
    joint: int
    """index of the roll joint"""
    hand: tuple[complex, complex, complex]
    """L0, L1, L2 at the zero pose"""
    side: tuple[float, float, float]
    """d0, d1, d2"""
    before: float
    """direction of the link ahead of the last pitch axis at the zero pose"""
    roll_axis: FloatArray
    """(3,) the direction of the roll axis at the zero pose: forward, left, up"""

    @property
    def pitched(self) -> bool:
        """True where a pitch and a roll are as many as the joints can hold: three pitch joints."""
        return len(self.plane.lengths) == 3

    def last_link(self, roll: FloatArray) -> ComplexArray:
        """L(c) for roll angles (k,)."""
        L0, L1, L2 = self.hand
        link: ComplexArray = L0 + L1 * np.cos(roll) + L2 * np.sin(roll)
        return link

    def lateral(self, roll: FloatArray) -> FloatArray:
        """d(c) for roll angles (k,)."""
        d0, d1, d2 = self.side
        return d0 + d1 * np.cos(roll) + d2 * np.sin(roll)

    def at(self, roll: float) -> ToolPlane:
        """The tool plane with the roll joint held at an angle."""
        plane, angle = self.plane, np.array([roll])
        lateral = float(self.lateral(angle)[0])
        link, zero = complex(self.last_link(angle)[0]), self.before + plane.offsets[-1]
        offset = wrap(cmath.phase(link) - self.before)
        tool = plane.tool_angle
        return replace(
            plane,
            lateral=lateral if abs(lateral) >= _CLEAN_M else 0.0,
            lengths=(*plane.lengths[:-1], abs(link)),
            offsets=(*plane.offsets[:-1], offset),
            tool_angle=None if tool is None else wrap(tool + zero - self.before - offset),
        )


def recognise_offset_roll(chain: Chain) -> OffsetRoll | None:
    """The arm's geometry, or None when it is not of this build.

    Needed: a first joint, two or three parallel joints perpendicular to it, and a last one perpendicular to
    those; without the last one the arm is of the build *yaw + parallel pitch joints*.
    """
    if chain.n not in (4, 5):
        return None
    plane = recognise(chain.with_last_held(0.0))
    _, axes = chain.axes()
    if plane is None or len(plane.lengths) != chain.n - 2 or abs(axes[-1] @ axes[1]) > _ALIGNED:
        return None
    rolls = np.zeros((3, chain.n))
    rolls[:, -1] = 0.0, 0.5 * math.pi, math.pi
    tips = (chain.forward(rolls)[:, :3, 3] - plane.origin) @ plane.frame
    ahead = np.cumsum(plane.offsets[:-1]).tolist()
    wrist = plane.shoulder + sum(map(cmath.rect, plane.lengths[:-1], ahead))
    links = [complex(x, z) - wrist for x, _, z in tips.tolist()]
    sides: list[float] = tips[:, 1].tolist()
    approach = chain.forward(np.zeros(chain.n))[:3, 2]
    along = np.linalg.norm(np.cross(axes[-1], approach)) < _ALIGNED
    L0, d0 = 0.5 * (links[0] + links[2]), 0.5 * (sides[0] + sides[2])
    found = OffsetRoll(
        plane=plane if along else replace(plane, tool_angle=None),
        joint=chain.n - 1,
        hand=(L0, links[0] - L0, links[1] - L0),
        side=(d0, sides[0] - d0, sides[1] - d0),
        before=ahead[-1],
        roll_axis=plane.frame.T @ axes[-1],
    )
    turns = np.linspace(0.0, 2.0 * math.pi, _LOOKS)
    return found if np.abs(found.last_link(turns)).min() > _SHORTEST_M else None

"""A solver family of your own, the smallest whole one: two parallel joints solve a planar triangle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.kinematics import Chain, EnergyModel, InverseKinematics, Solutions, Target
from armctl.kinematics.solutions import SolvedArm


class TwoLinks(InverseKinematics):
    """Two parallel joints about z, straight ahead along x at zero: the planar triangle."""

    family = "two links in a plane"

    @classmethod
    def of(cls, chain: Chain, limits: FloatArray, energy: EnergyModel, titles: Sequence[str]) -> Self | None:
        """A solver of this family; None: the chain is none of it."""
        points, axes = chain.axes()
        if chain.n != 2 or not np.allclose(axes, [[0.0, 0.0, 1.0]] * 2):
            return None
        tip = chain.forward(np.zeros(2))[:3, 3]
        ahead = np.allclose(points[0], 0.0) and np.allclose([points[1][1:], tip[1:]], 0.0)
        return cls(chain, limits, energy, titles) if ahead and 0.0 < points[1][0] < tip[0] else None

    def solve(self, target: Target, step: float, start: FloatArray | None = None) -> Solutions:
        """All configurations that put the tool on ``target.point`` [m], or the reason why there is none."""
        arm = SolvedArm(("left", "right"), self.chain, self.energy)
        points, _ = self.chain.axes()
        tip = self.chain.forward(np.zeros(2))[:3, 3]
        a, b = points[1][0], tip[0] - points[1][0]
        x, y, z = target.point
        cosine = (x * x + y * y - a * a - b * b) / (2 * a * b)
        if abs(cosine) > 1.0 or abs(z) > 1e-9:
            straight = np.array([math.atan2(y, x), 0.0])
            return Solutions(arm, target, (), (), reason="off the table", nearest_q=straight)
        found: list[tuple[float, float]] = []
        for bend in (math.acos(cosine), -math.acos(cosine)):
            first = math.atan2(y, x) - math.atan2(b * math.sin(bend), a + b * math.cos(bend))
            found.append((math.remainder(first, math.tau), bend))
        kept = [k for k, q in enumerate(found) if self._inside(q)]
        reason = None if kept else "a joint would leave its limits, left and right"
        return Solutions(arm, target, [found[k] for k in kept], kept, reason=reason)

    def _inside(self, q: tuple[float, float]) -> bool:
        return all(low <= angle <= high for angle, (low, high) in zip(q, self.limits, strict=True))

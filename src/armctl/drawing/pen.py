"""How the arm holds the pen: straight onto the plane where it can, else tilted as little as serves."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from armctl.arrays import FloatArray
from armctl.drawing.plane import DrawingPlane
from armctl.errors import InputError
from armctl.facts import Reason
from armctl.facts.angles import DEGREE
from armctl.lazy_dataclass import dataclass
from armctl.motion.paths.tool_curve import NO_WAY_M, ToolCurve, ToolLine
from armctl.motion.paths.tool_path import led_far, usual_pitch
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.robot import Robot

_TILTS = tuple(range(0, 61, 10))
"""tried one after the other, to either side [degrees]"""
_ROLLS = 12
"""turns of the pen about itself that an arm tries which can orient it"""
_STEP = 5 * DEGREE
_SHORT_M = 3e-3
_NO_PITCH = 3
"""joints that have enough to do with the position"""
_ANOTHER_RAD, _MOST_CONFIGURATIONS = 0.2, 5
"""configurations that differ by less are not tried one by one, and no more than so many"""


@dataclass(frozen=True, eq=False)
class PenHold:
    """One way to hold the pen along a whole drawing."""

    robot: Robot
    rotation: FloatArray | None = None
    """(3, 3) ``R_base_tool`` that is kept"""
    pitch: float | None = None
    """tool pitch that is kept [rad]; neither: the position decides"""
    tilt: float = 0.0
    """how far the pitch is from straight onto the plane [rad]"""

    def solve(self, point: FloatArray, near: FloatArray) -> tuple[list[FloatArray], Reason | None]:
        """Configurations (n,) that put the pen on a point (3,) [m], the nearest first; or why none do."""
        solutions = self.robot.inverse(point, self.pitch, self._roll, self.rotation, _STEP)
        if not solutions.success:
            return [], solutions.refusal
        far = (np.abs(solutions.q - near) / self.robot.speed_limits).max(axis=1)
        found: list[FloatArray] = []
        for k in np.argsort(far, kind="stable").tolist():
            q = solutions.q[k]
            if self._meets(q) and all(np.abs(q - other).max() > _ANOTHER_RAD for other in found):
                found.append(q)
                if len(found) == _MOST_CONFIGURATIONS:
                    break
        return found, None if found else solutions.refusal

    def reaches(self, points: FloatArray) -> NDArray[np.bool_]:
        """(k,) whether the pen can be put on points (k, 3) [m]."""
        if self.rotation is None and self.pitch is not None:
            try:
                batch = self.robot.inverse_batch(points, np.full(len(points), self.pitch))
            except InputError:  # not every family has such an answer
                pass
            else:
                return np.asarray(np.isfinite(batch.q).all(axis=-1).any(axis=-1))
        middle = self.robot.limits.mean(axis=1)
        return np.array([bool(self.solve(point, middle)[0]) for point in points], dtype=np.bool_)

    def keeps(self, point: FloatArray, plane: DrawingPlane) -> bool:
        """Whether the arm can lead the pen so at all: short ways are tried from a point (3,) in reach."""
        for q in self.solve(point, self.robot.limits.mean(axis=1))[0]:
            for way in (*plane.axes.T[:2], *-plane.axes.T[:2]):
                if self.lead(q, ToolLine(point, point + _SHORT_M * way))[1] >= _SHORT_M - NO_WAY_M:
                    return True
        return False

    def lead(self, q: FloatArray, curve: ToolCurve) -> tuple[PiecewisePolynomial | None, float]:
        """The joints' path along a curve from ``q`` (n,) [rad], and how far it leads [m]; None: nowhere."""
        if self.rotation is not None:
            return led_far(self.robot, q, curve, orientation="kept")
        return led_far(self.robot, q, curve, "free" if self.pitch is None else "kept")

    @property
    def _roll(self) -> float | None:
        """A tool that rolls about the pen keeps its roll where it is nearest to 0."""
        joint = self.robot.inverse_kinematics.roll_joint
        if joint is None or self.rotation is not None:
            return None
        return float(np.clip(0.0, *self.robot.limits[joint]))

    def _meets(self, q: FloatArray) -> bool:
        """Not where a solver answers what cannot be had by the nearest."""
        if self.rotation is None:
            return True
        return float(np.abs(self.robot.forward(q)[:3, :3] - self.rotation).max()) < 1e-5


def pen_holds(robot: Robot, plane: DrawingPlane, pitch: float | None = None) -> list[PenHold]:
    """What may be tried, the best first; ``pitch``: the one that is asked for [rad]."""
    straight = math.asin(float(np.clip(-plane.normal[2], -1.0, 1.0)))
    if pitch is not None:
        return [PenHold(robot, pitch=pitch, tilt=pitch - straight)]
    if robot.orients_tool:
        return [PenHold(robot, rotation=_onto(plane, 2.0 * math.pi * k / _ROLLS)) for k in range(_ROLLS)]
    moving = int(np.count_nonzero(robot.limits[:, 0] < robot.limits[:, 1]))
    if usual_pitch(robot) == "free" or moving <= _NO_PITCH:
        return [PenHold(robot)]
    holds: list[PenHold] = []
    for tilt in _TILTS:
        for sense in (1, -1):
            tilted = straight + sense * tilt * DEGREE
            if abs(tilted) <= math.pi / 2 + 1e-9 and (tilt or sense > 0):
                holds.append(PenHold(robot, pitch=tilted, tilt=sense * tilt * DEGREE))
    return holds


def _onto(plane: DrawingPlane, roll: float) -> FloatArray:
    """(3, 3) the tool's z axis straight into the plane, its x axis turned from that of the plane."""
    normal = plane.normal
    across = plane.axes[:, :2] @ np.array([math.cos(roll), math.sin(roll)])
    side: FloatArray = np.cross(-normal, across)
    return np.stack([across, side, -normal], axis=1)


Part = Literal["go", "down", "draw", "up"]
"""what the arm does: to the next stroke, onto the plane, along the stroke, off the plane"""

"""The tool point, taught by touching one point from several sides.

The tip stands at the same unknown point c each time: p_i + R_i d = c, with R_i and p_i the turn and the
place of the tool frame as the robot has it, and d how far the true tip is from that, along the axes of the
tool. With the means R̄ and p̄ taken off, c is gone: (R_i − R̄) d = −(p_i − p̄). That is linear in d, and
solved by least squares (singular values). Touches that are off by σ leave an error of σ/s along a direction
with the singular value s. Where the tool was turned about one axis only, s is 0 along that axis: the touches
tell nothing there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from armctl.arrays import FloatArray
from armctl.errors import CalibrationError
from armctl.facts import Reason
from armctl.facts.causes import TaughtTip, TipAsBefore, TipUntold, TooFew, ToolTurnedLittle
from armctl.kinematics.target import as_numbers, require_finite
from armctl.lazy_dataclass import dataclass
from armctl.robot import Robot
from armctl.robot.tools import tool_of

LEAST_SIDES = 4
TOUCH_M = 0.0005
"""how true a touch by eye is taken to be: the standard deviation of each coordinate"""
_TOLD = 0.05
"""singular value below which a direction counts as not told: an error of 0.5 mm would come back as 10 mm"""
_LOOSE_M = 0.001
"""a direction that is told less well than that is named"""
_TRUE_M = 0.0003
"""a tip that is no farther from where the robot has it, and by no more than chance, is where it was"""


@dataclass(frozen=True, slots=True, eq=False)
class ToolPoint:
    """Where the tip of the tool is, by touches of one point."""

    robot: Robot
    offset_m: FloatArray
    """(3,) from the tool point as the robot has it, along the axes of the tool [m]; 0 where it is not told"""
    directions: FloatArray
    """(3, 3) rows: unit vectors along axes of the tool, the best told first"""
    sd_m: FloatArray
    """(3,) how far it may be off along each: the standard deviation [m]; infinite where it is not told"""
    point_m: FloatArray
    """(3,) the point that was touched, base frame [m]"""
    away_m: FloatArray
    """(k,) how far from it the tip was in each touch by this result [m]"""

    @property
    def rank(self) -> int:
        """How many directions the touches tell."""
        return int(np.isfinite(self.sd_m).sum())

    @property
    def residual_m(self) -> float:
        """RMS of ``away_m`` [m]."""
        return math.sqrt(float(np.mean(self.away_m**2)))

    @property
    def differs(self) -> bool:
        """Whether the tip is elsewhere than the robot has it, by more than chance."""
        told = np.isfinite(self.sd_m)
        along, size = np.abs(self.directions @ self.offset_m), float(np.linalg.norm(self.offset_m))
        return size > _TRUE_M and bool((along[told] > 2 * self.sd_m[told]).any())

    @property
    def facts(self) -> tuple[Reason, ...]:
        """All of it, in the order in which it is read."""
        told = self.sd_m[np.isfinite(self.sd_m)]
        sd = math.sqrt(float(np.sum(told**2)))
        x, y, z = self.offset_m.tolist()
        worst = int(self.away_m.argmax())
        figures = TaughtTip(
            len(self.away_m), (x, y, z), sd, self.residual_m, worst + 1, float(self.away_m[worst])
        )
        untold = [
            TipUntold((float(a), float(b), float(c)), None if math.isinf(sd) else sd)
            for (a, b, c), sd in zip(self.directions.tolist(), self.sd_m.tolist(), strict=True)
            if sd > _LOOSE_M
        ]
        return (figures, *([] if self.differs else [TipAsBefore()]), *untold)

    @property
    def suggestion(self) -> str:
        """What to write where; empty where the tip is where the robot has it."""
        return "".join(_lines(self)) if self.differs else ""


def teach_tool(robot: Robot, q: ArrayLike) -> ToolPoint:
    """The tool point from joint angles ``q`` (k, n) [rad] at which the tip touched one point.

    CalibrationError: fewer than four touches, the wrong shape, not finite, or all with the tool turned alike.
    """
    angles = as_numbers(q, "joint angles")
    if angles.ndim != 2 or angles.shape[1] != robot.n:
        raise CalibrationError(
            f"each touch needs {robot.n} joint angles; got an array of shape {angles.shape}"
        )
    require_finite(angles, "joint angles")
    if len(angles) < LEAST_SIDES:
        raise CalibrationError(TooFew("touches", len(angles), LEAST_SIDES))
    T = robot.forward(angles)
    R, p = T[:, :3, :3], T[:, :3, 3]
    A, b = R - R.mean(axis=0), p.mean(axis=0) - p
    left, s, directions = np.linalg.svd(A.reshape(-1, 3), full_matrices=False)
    told = s >= _TOLD
    if not told.any():
        raise CalibrationError(ToolTurnedLittle(_turned(R)))
    along = np.where(told, (left.T @ b.ravel()) / np.where(told, s, 1.0), 0.0)
    offset: FloatArray = along @ directions
    tips = p + R @ offset
    point = tips.mean(axis=0)
    away: FloatArray = np.linalg.norm(tips - point, axis=1)
    free = 3 * len(p) - 3 - int(told.sum())
    noise = max(math.sqrt(float(np.sum(away**2)) / free), TOUCH_M)
    sd = np.where(told, noise / np.where(told, s, 1.0), np.inf)
    return ToolPoint(robot, offset, directions, sd, point, away)


def _turned(R: FloatArray) -> float:
    """Largest turn between two of rotations (k, 3, 3) [rad]."""
    least = float(np.einsum("kij,lij->kl", R, R).min())
    return math.acos(min(max((least - 1) / 2, -1.0), 1.0))


def _lines(found: ToolPoint) -> Iterator[str]:
    """The tip as rows of a robot file, or as an offset in a side file."""
    x, y, z = (1000 * found.offset_m).tolist()
    robot, chain = found.robot, found.robot.chain
    if robot.tool:
        T = tool_of(robot.tools, robot.tool).T_flange_tip
        x, y, z = (1000 * (T[:3, :3] @ found.offset_m + T[:3, 3])).tolist()
        yield f"# robot file: in the table [[tools]] of {robot.tool!r}, in place of what is there\n"
        yield f"offset_mm = [{x:.2f}, {y:.2f}, {z:.2f}]\n"
        return
    if not chain.rows:
        yield "# side file of the arm: add these to offset_mm there, where approach is z\n"
        yield "# (with another approach they are still along the axes of the tool: x, y, and z ahead)\n"
        yield f"[tool]\noffset_mm = [{x:.2f}, {y:.2f}, {z:.2f}]\n"
        return
    aside, turn = math.hypot(x, y), math.degrees(math.atan2(y, x))
    yield "# robot file: add these rows behind the last one of [dh] rows\n"
    turned, back = f"theta_deg = {turn:.2f}", f"theta_deg = {-turn:.2f}"
    if chain.convention == "modified":
        yield f"{{ alpha_deg = 0, a_mm = 0, d_mm = {z:.2f}, {turned} }},\n"
        yield f"{{ alpha_deg = 0, a_mm = {aside:.2f}, d_mm = 0, {back} }},\n"
    else:
        yield f"{{ a_mm = {aside:.2f}, alpha_deg = 0, d_mm = {z:.2f}, {turned} }},\n"
        yield f"{{ a_mm = 0, alpha_deg = 0, d_mm = 0, {back} }},\n"

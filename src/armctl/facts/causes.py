"""What is to blame for a tool that is not where it should be, and why marks or touches do not tell it.

A frozen record each, in SI units and radians.

``part`` is the title of a joint; ``sd`` the standard deviation of the number ahead of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

from armctl.facts.reasons import Reason
from armctl.lazy_dataclass import dataclass


def in_signed_millimetres(vector_m: Sequence[float]) -> str:
    """The parts of a vector [m] in mm, each with its sign: "+17.1, -3.0, +0.4"."""
    return ", ".join(f"{1000 * one:+.1f}" for one in vector_m)


@dataclass(frozen=True, slots=True)
class ZeroOff(Reason):
    """A joint stands further by an angle than its output says."""

    part: str
    off: float
    sd: float


@dataclass(frozen=True, slots=True)
class Sags(Reason):
    """What bends at a joint under the arm's own weight, where that pulls most."""

    part: str
    angle: float
    sd: float


@dataclass(frozen=True, slots=True)
class HasPlay(Reason):
    """A joint is loose, from one side to the other."""

    part: str
    angle: float
    sd: float


@dataclass(frozen=True, slots=True)
class ScaleOff(Reason):
    """A joint turns further than its output says, by a share."""

    part: str
    share: float
    sd: float


@dataclass(frozen=True, slots=True)
class LengthOff(Reason):
    """A length of a DH row is longer than the robot file says [m]."""

    part: str
    row: int
    """from 1"""
    key: Literal["a", "d"]
    old: float
    off: float
    sd: float


@dataclass(frozen=True, slots=True)
class PlaceOff(Reason):
    """All points lie further along an axis of the base frame than they were noted [m]."""

    part: str
    """x, y or z"""
    off: float
    sd: float


@dataclass(frozen=True, slots=True)
class MistakenPoint(Reason):
    """A touched point that fits to none of the others."""

    number: int
    """from 1"""
    off: tuple[float, float, float]
    """from where the others put it to where the tool was, along x, y, z of the points' frame [m]"""

    @property
    def away(self) -> float:
        """How far [m]."""
        return math.hypot(*self.off)


@dataclass(frozen=True, slots=True)
class WorstPoint(Reason):
    """The touched point that fits worst to the others, and still belongs to them."""

    number: int
    """from 1"""
    off: tuple[float, float, float]
    """as in ``MistakenPoint``"""


@dataclass(frozen=True, slots=True)
class NotTold(Reason):
    """A number of a joint or a link that touched points cannot tell."""

    part: str
    what: Literal["zero", "sag", "play", "scale", "a", "d", "place", "tilt", "heading"]


@dataclass(frozen=True, slots=True)
class FitFigures(Reason):
    """How far the tool is off, at points that were not used for it [m]."""

    count: int
    before: float
    before_largest: float
    after: float
    after_largest: float
    low: float
    """at points nearby that nobody has touched, with the correction: less in 5 of 100 such fits"""
    high: float
    """… and more in 5 of 100"""
    corrected: bool


@dataclass(frozen=True, slots=True)
class GoodAlready(Reason):
    """The tool is as near to the points as they can be measured [m]."""

    rms: float


@dataclass(frozen=True, slots=True)
class NotBetter(Reason):
    """No correction is better at points that were left out than the numbers as they are [m]."""

    before: float
    after: float


@dataclass(frozen=True, slots=True)
class TaughtTip(Reason):
    """Where the tip of the tool is, by touches of one point [m]."""

    count: int
    offset: tuple[float, float, float]
    """from the tool point as the robot has it, along the axes of the tool"""
    sd: float
    residual: float
    worst: int
    """the touch that is farthest off, from 1"""
    away: float
    """… by so much"""


@dataclass(frozen=True, slots=True)
class TipAsBefore(Reason):
    """The tip is where the robot has it, as far as touches can tell."""


@dataclass(frozen=True, slots=True)
class TipUntold(Reason):
    """A direction in which touches do not tell where the tip is, or not well."""

    axis: tuple[float, float, float]
    """unit vector along the axes of the tool"""
    sd: float | None
    """how far it may be off there [m]; None: nothing is told"""


@dataclass(frozen=True, slots=True)
class TooFew(Reason):
    """Marks of a joint, touches of one point, or points that are fewer than are needed."""

    of: Literal["marks", "touches", "points"]
    count: int
    least: int


@dataclass(frozen=True, slots=True)
class MarksTogether(Reason):
    """Marks of a joint that are at too few places of its output."""

    places: int
    least: int
    output: float | None = None
    """where all of them are [of the board]; None: at several places"""
    unit: str = ""
    """of the output"""


@dataclass(frozen=True, slots=True)
class MarksNarrow(Reason):
    """Marks of a joint whose angles spread too little [rad]."""

    spread: float
    least: float


@dataclass(frozen=True, slots=True)
class PointsTogether(Reason):
    """Touched points that lie too close to each other [m]."""

    within: float


@dataclass(frozen=True, slots=True)
class ToolTurnedLittle(Reason):
    """A tool that was turned too little [rad] from touch to touch."""

    turn: float


@dataclass(frozen=True, slots=True)
class PlanePointsNear(Reason):
    """Two touched points of a plane that are too close to each other [m]."""

    first: int
    """from 1"""
    second: int
    apart: float
    least: float


@dataclass(frozen=True, slots=True)
class PlanePointsInLine(Reason):
    """Three touched points that give no plane."""


@dataclass(frozen=True, slots=True)
class PlaneFromBelow(Reason):
    """Three touched points that give a plane which is seen from below."""


@dataclass(frozen=True, slots=True)
class PlanePointOff(Reason):
    """A touched point that lies off the plane of the first three [m]."""

    number: int
    """from 1"""
    off: float
    most: float


@dataclass(frozen=True, slots=True)
class PlaneOutOfReach(Reason):
    """A plane on which a drawing of no size is wholly in reach."""

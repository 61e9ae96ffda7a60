"""The kinds of reasons why a target has no solution, or a list may miss some: in metres and radians.

A joint is called by its title, as in ``armctl.facts.reasons``. Reasons that belong to one target follow each
other in ``Several``.
"""

from __future__ import annotations

from typing import Literal

from armctl.facts.reasons import AngleNeeded, Reason
from armctl.lazy_dataclass import dataclass

Side = Literal["facing", "over the back"]
"""how the base turns to a target"""


# What the joints would have to do.


@dataclass(frozen=True, slots=True)
class JointsNeeded(Reason):
    """Joints that would have to leave their limits together, for one way to reach a target."""

    needs: tuple[AngleNeeded, ...]
    """empty: the links do not reach it this way"""
    side: Side | None = None
    least: bool = False
    """there are other ways, which would leave the limits by more"""


@dataclass(frozen=True, slots=True)
class LimitsForbid(Reason):
    """A target that the links reach and the joint limits forbid."""

    ways: tuple[JointsNeeded, ...]
    """empty: not known"""
    pitched: bool = False
    """the links reach it at the pitch asked for"""


# What the links do not reach, whatever the joint limits.


@dataclass(frozen=True, slots=True)
class OutOfReach(Reason):
    """A target too far or too near for the links, seen from the shoulder."""

    far: bool
    miss_m: float
    length_m: float
    """how far the links reach, or how near"""
    distance_m: float | None
    """of ``point`` from the shoulder; None: the way by which it misses is in no plane of the arm's"""
    point: Literal["target", "wrist"] = "target"
    shoulder: str = ""
    """title of the joint; empty: all of its joints meet there"""
    links: Literal["arm", "two links"] = "arm"
    pitched: bool = False
    """said with the tool at the pitch asked for"""
    side: Side | None = None


@dataclass(frozen=True, slots=True)
class NoRoomToTurn(Reason):
    """A joint stands too near to its limit to come to a pose from that side [rad]."""

    part: str
    room: float
    needed: float


@dataclass(frozen=True, slots=True)
class OutOfBound(Reason):
    """A target too far or too near for the links, by a bound about a point of the first axis."""

    far: bool
    miss_m: float
    length_m: float
    distance_m: float
    centre_m: tuple[float, float, float]
    """that point, in the base frame"""
    joint: str
    """which turns about that axis"""


@dataclass(frozen=True, slots=True)
class InsideCylinder(Reason):
    """A target nearer to the base axis than the tool plane passes it."""

    radius_m: float
    distance_m: float


@dataclass(frozen=True, slots=True)
class BesideAxis(Reason):
    """A target nearer to the base axis than a tool that is led by rods comes to it."""

    radius_m: float
    distance_m: float


@dataclass(frozen=True, slots=True)
class BetweenReaches(Reason):
    """A target too near one way round and too far the other, for two links from the shoulder."""

    near_m: float
    far_m: float
    least_m: float
    most_m: float


# Pitch, roll and orientation.


@dataclass(frozen=True, slots=True)
class NoSuchAngle(Reason):
    """What cannot be asked of an arm: a pitch or a roll that it has not, an elevation that nothing has."""

    what: Literal["pitch", "roll", "elevation"]


@dataclass(frozen=True, slots=True)
class PitchByPosition(Reason):
    """A pitch of an arm with two pitch joints, where the position decides it."""

    pitches: tuple[float, ...]
    """those that the links would give"""


@dataclass(frozen=True, slots=True)
class PitchOutside(Reason):
    """A pitch outside those that the arm can hold at a point."""

    low: float
    high: float
    nearest: float
    joint: str = ""
    """which swings the tool, and is held; empty: none does"""
    held: float = 0.0


@dataclass(frozen=True, slots=True)
class PitchOfRods(Reason):
    """A pitch other than the one at which rods keep the tool."""

    kept: float
    asked: float


@dataclass(frozen=True, slots=True)
class NotInOrientation(Reason):
    """A point that the arm reaches, but not in the orientation asked for."""

    pitched: bool


@dataclass(frozen=True, slots=True)
class OffRotation(Reason):
    """A configuration on the point whose rotation misses the one asked for."""

    angle: float


@dataclass(frozen=True, slots=True)
class OrientationImpossible(Reason):
    """An orientation that the arm has not, whatever the joint limits."""

    proven: bool
    """False: none was found by search"""


@dataclass(frozen=True, slots=True)
class OrientationNeeds(Reason):
    """What the joints would have to do for an orientation."""

    way: JointsNeeded


@dataclass(frozen=True, slots=True)
class NoOrientationNear(Reason):
    """A search that found no orientation near the one asked for."""


# What was searched for and not found.


@dataclass(frozen=True, slots=True)
class NotFound(Reason):
    """A search that came to no solution, and how near it came."""

    starts: int
    away_m: float
    turned: bool
    """an orientation was asked for, and none was found at the point"""


@dataclass(frozen=True, slots=True)
class PitchNotFound(Reason):
    """A search that came to the point, but not with the pitch."""

    starts: int
    asked: float
    nearest: float


@dataclass(frozen=True, slots=True)
class NoneWithoutLimits(Reason):
    """A search that came to no solution without joint limits, either."""

    starts: int


@dataclass(frozen=True, slots=True)
class MayExist(Reason):
    """A solution inside the limits may have been missed."""


# Why solutions may be missing from a list.


@dataclass(frozen=True, slots=True)
class Searched(Reason):
    """A list that a search found."""

    continuum: bool = False
    """it stands for a continuum"""


@dataclass(frozen=True, slots=True)
class MoreByTurns(Reason):
    """So many more solutions, which differ from listed ones by whole turns."""

    count: int


@dataclass(frozen=True, slots=True)
class ListedAt(Reason):
    """A joint that is free besides another one, and listed at one angle [rad]."""

    joint: str
    angle: float


@dataclass(frozen=True, slots=True)
class ListedInSteps(Reason):
    """A joint that is swept in steps [rad]: a run of solutions may lie between two."""

    joint: str
    step: float


@dataclass(frozen=True, slots=True)
class MayTurn(Reason):
    """Joints that may turn while the tool stays."""

    joints: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class AnyAngle(Reason):
    """A joint that may be at any angle, as what it carries lies on its axis."""

    joint: str
    what: Literal["target on base axis", "wrist on shoulder axis", "centre of wrist"]


@dataclass(frozen=True, slots=True)
class TurnTogether(Reason):
    """A singular pose, in which joints can turn without moving the tool."""

    joints: tuple[str, ...]
    """which turn against each other; empty: several"""


@dataclass(frozen=True, slots=True)
class OneLine(Reason):
    """Joints whose axes are one line, so that only the sum or the difference of their angles counts."""

    joints: tuple[str, str]
    counts: Literal["sum", "difference"]


@dataclass(frozen=True, slots=True)
class MayBeHidden(Reason):
    """A pose so near to a singular one that rounding may hide solutions."""


@dataclass(frozen=True, slots=True)
class LostAtLimit(Reason):
    """A joint at its limit, where rounding decides about a solution."""

    joint: str


# What becomes of a target that is not gone to; behind why it is not.


@dataclass(frozen=True, slots=True)
class Instead(Reason):
    """What the arm does instead of going to a live target."""

    what: Literal["wait", "go near"]
    branch: str = ""
    """of the nearest point, for which the arm does not leave its own"""


@dataclass(frozen=True, slots=True)
class PoseUnmet(Reason):
    """A pose that was typed, and beside which the joint angles are of another one."""

    reason: Reason | None
    """None: those of the pose are still being computed"""


# What is said besides, or ahead of another reason.


@dataclass(frozen=True, slots=True)
class Besides(Reason):
    """What forbids the rest of a target, whose roll or pitch cannot be had."""

    reason: Reason


Without = Literal["pitch", "roll", "pitch and roll", "orientation"]


@dataclass(frozen=True, slots=True)
class ReachedFree(Reason):
    """A point that is reached with less asked of the tool; ahead of why it is not, with all of it."""

    without: Without


@dataclass(frozen=True, slots=True)
class AtRoll(Reason):
    """Why there is no solution with the roll at which the tool comes nearest."""

    joint: str
    roll: float
    reason: Reason


@dataclass(frozen=True, slots=True)
class AtPoint(Reason):
    """Why one of several points cannot be reached."""

    number: int
    """counted from 1"""
    count: int
    reason: Reason


@dataclass(frozen=True, slots=True)
class HeldAtLimit(Reason):
    """A joint at a limit, beyond which the tool would come nearer to the target."""

    joint: str
    limit: float


@dataclass(frozen=True, slots=True)
class NearestPoint(Reason):
    """The nearest point to a target that the arm can reach."""

    point_m: tuple[float, float, float]
    away_m: float
    orientation: Literal["", "pitch kept", "any"] = ""
    """what becomes of the orientation asked for; empty: none was, or it is not known"""
    held: tuple[HeldAtLimit, ...] = ()


@dataclass(frozen=True, slots=True)
class PointReached(Reason):
    """The point itself can be reached."""


@dataclass(frozen=True, slots=True)
class ToolStepRefused(Reason):
    """A step of the tool along the axes of the base (3,) [m] that the arm does not make from where it is."""

    step_m: tuple[float, float, float]
    turns: float | None = None
    """it would turn a joint by more than this [rad]; None: it is out of reach"""


@dataclass(frozen=True, slots=True)
class OtherConfiguration(Reason):
    """A place that the arm reaches, but not from where it comes without changing its configuration."""


@dataclass(frozen=True, slots=True)
class StrokeLeftOut(Reason):
    """A stroke of a drawing, or a piece of one, that the arm cannot draw."""

    stroke: int
    """in the order of the file, from 1"""
    line: int
    """of the file"""
    begin: float
    end: float
    """from where to where, on its way as it is drawn [m]"""
    length: float
    """of the whole stroke [m]"""
    why: Reason | None = None

"""The kinds of reasons: one frozen record each, in SI units and radians.

A reason is what armctl knows, not what it says of it: ``armctl.facts.words`` has the words. ``part`` is the
title of a joint, of an angle between links or of a part of the arm, as its robot file has it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum
from typing import Any, ClassVar, Literal

from armctl.facts.angles import to_degrees
from armctl.lazy_dataclass import dataclass

# The states of an arm, and what a command needs of them.


class State(Enum):
    """The controller's states."""

    DISCONNECTED = "disconnected"
    OFF = "off"  # connected; nothing is sent, and where the arm is counts for nothing
    HOLDING = "holding"
    MOVING = "moving"
    PAUSED = "paused"
    FAULT = "fault"


class Need(Enum):
    """What a command needs of the arm; the controller and the buttons of the pages ask the same rule."""

    HOLDING = "holding"
    JOG = "holding, or jogged"
    PAUSE = "moving"
    GRIPPER = "enabled"
    OFF = "off"
    OFF_OR_HOLDING = "off or holding"
    HOLDING_SOME = "holding, some joints at least"
    CONNECTED = "connected and without a fault"


# Numbers as people read them.

UNITS = {"speed": "°/s", "acceleration": "°/s²", "jerk": "°/s³"}
"""of the rates of a joint, as people read them"""


def decimals_apart(value: float, *others: float, least: int = 2) -> int:
    """With how many decimals a number and each of some others read differently."""
    for k in range(least, 10):
        if f"{value:.{k}f}" not in {f"{other:.{k}f}" for other in others}:
            return k
    return least


def limits_apart(angles: Sequence[float], low: float, high: float) -> tuple[list[str], str, str]:
    """Each of some angles once, and limits, all [rad], as texts in degrees that read unlike each other."""
    least, most, *needed = (to_degrees(angle) + 0.0 for angle in (low, high, *angles))
    digits = max((decimals_apart(angle, least, most) for angle in needed), default=2)
    first, last, *said = (f"{angle:z.{digits}f}°" for angle in (least, most, *needed))
    return list(dict.fromkeys(said)), first, last


def in_millimetres(metres: float) -> str:
    """A length [m] as a number of mm: with one decimal, or two digits of one that would read as 0.0."""
    length = 1000.0 * metres
    return f"{length:.1f}" if abs(length) >= 0.05 else f"{length:.2g}"


class Reason:
    """Why something is refused or warned of; each kind is a frozen dataclass."""

    __slots__ = ()
    __dataclass_fields__: ClassVar[dict[str, Any]]


@dataclass(frozen=True, slots=True)
class Said(Reason):
    """What only a sentence tells so far."""

    text: str
    mend: str = ""
    """what to do about it; empty where ``text`` says it"""


@dataclass(frozen=True, slots=True)
class Unanswered(Reason):
    """A board that did not answer, or nothing that can be read."""

    what: str
    check: str
    """where the cause may be"""


@dataclass(frozen=True, slots=True)
class Several(Reason):
    """More than one reason at once."""

    reasons: tuple[Reason, ...]


@dataclass(frozen=True, slots=True)
class About(Reason):
    """A reason with what it is about: a file, a step, a joint."""

    thing: str
    reason: Reason


@dataclass(frozen=True, slots=True)
class Advised(Reason):
    """A reason, and what to do about it where it was met."""

    reason: Reason
    mend: str


@dataclass(frozen=True, slots=True)
class Found(Reason):
    """What a check of a motion or a program found, with where and when."""

    reason: Reason
    part: str = ""
    """the joint, or the part of the arm"""
    at_s: float | None = None
    """when it is worst; None: not a matter of time"""
    digits: int = 2
    """decimals with which the time is said"""
    step: int | None = None
    """index of the program's step"""
    more: int = 0
    """how many more things it found"""


@dataclass(frozen=True, slots=True)
class ToDo(Reason):
    """What to do about the reason ahead of it, where that was met."""

    what: Literal["other pose", "support and enable", "turn back", "mend pose"]


@dataclass(frozen=True, slots=True)
class NotHomed(Reason):
    """An arm that does not know where it is before it is homed."""


@dataclass(frozen=True, slots=True)
class UnknownTool(Reason):
    """A tool that the arm has not."""

    name: str
    known: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ToolGripsNot(Reason):
    """A gripper that was to move with a tool on that does not grip."""

    tool: str


@dataclass(frozen=True, slots=True)
class ToolToConfirm(Reason):
    """An arm with several tools, of which nobody has said since the connection which one is on."""

    tool: str
    """which one was on last"""
    known: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ToolWhileMoving(Reason):
    """A tool that was to be changed while something moves: the ``cause``, in words."""

    cause: str


@dataclass(frozen=True, slots=True)
class ToolHoldsPart(Reason):
    """A tool that was to be changed while its gripper holds a part of a ``size``, in words."""

    size: str


@dataclass(frozen=True, slots=True)
class OtherRobot(Reason):
    """A program that was made for another robot."""

    made_for: str
    """names of robots"""
    this: str


@dataclass(frozen=True, slots=True)
class NoSteps(Reason):
    """A program with nothing in it."""


@dataclass(frozen=True, slots=True)
class UnmatchedBlock(Reason):
    """A marker of a block whose other marker is missing."""

    marker: str
    """what it says in the file"""


@dataclass(frozen=True, slots=True)
class ShownSoFar(Reason):
    """A motion that is shown only as far as it can be planned."""


@dataclass(frozen=True, slots=True)
class AngleLimit(Reason):
    """A joint, or an angle between links, beyond its limits [rad]."""

    part: str
    angle: float
    low: float
    high: float
    between_links: bool = False


@dataclass(frozen=True, slots=True)
class StandsOutside(Reason):
    """A joint of an arm whose servos are off, beyond its limits [rad]."""

    joint: str
    """its title"""
    angle: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class WrongUnit(Reason):
    """Numbers that are nearly certainly of another unit."""


Rate = Literal["speed", "acceleration", "jerk"]


@dataclass(frozen=True, slots=True)
class RateLimit(Reason):
    """A joint faster than its limit of speed [rad/s], acceleration [rad/s²] or jerk [rad/s³] allows."""

    part: str
    rate: Rate
    value: float
    """infinite: its speed jumps at a corner of the path"""
    limit: float

    @property
    def longer(self) -> float:
        """How many times as long the motion must take, rounded up to hundredths."""
        order = ("speed", "acceleration", "jerk").index(self.rate)
        return math.ceil(100.0 * (self.value / self.limit) ** (1 / (order + 1))) / 100.0


@dataclass(frozen=True, slots=True)
class SpeedJump(Reason):
    """A joint whose speed jumps [rad/s] where one part of a motion ends and the next begins."""

    part: str
    jump: float


@dataclass(frozen=True, slots=True)
class MotionEndsMoving(Reason):
    """A motion at one of whose ends a joint still moves [rad/s]."""

    part: str
    end: Literal["starts", "ends"]
    speed: float


@dataclass(frozen=True, slots=True)
class Blocked(Reason):
    """A part of the arm in the floor, in an obstacle, or in another part of the arm."""

    kind: Literal["floor", "obstacle", "self-collision"]
    part: str
    other: str
    """what it is in; of the floor empty"""
    depth_m: float
    """how deep; negative: so far from it, which is too near"""
    fitted: bool = False
    """told by convex hulls round shapes that may be hollow there"""
    at_rest_m: float = 0.0
    """how deep it is at rest, which is allowed"""
    surfaces: bool = False
    """told by the surfaces themselves, to which a distance is kept"""


@dataclass(frozen=True, slots=True)
class Singular(Reason):
    """A pose in which the tool moves in one direction slowly, or not at all."""

    isotropy: float
    """speed in the slowest direction over that in the fastest"""
    lost: bool
    """whether the motion needs that direction"""


@dataclass(frozen=True, slots=True)
class Overload(Reason):
    """A joint that gravity loads with much of what its motor can hold, or more [N·m]."""

    part: str
    joint: str
    """its name in the robot file"""
    torque: float
    stall: float
    counted: str
    """the masses that are counted"""
    over: bool
    """more than the motor can hold"""
    effort: bool
    """``stall`` is the effort of a URDF file, which simulators need and many files make up"""


Freer = Literal["pitch kept", "pitch free", "orientation free"]
"""what is asked of the tool besides its point, where less would do"""


@dataclass(frozen=True, slots=True)
class OnCurve(Reason):
    """Why the tool cannot be led along a line or an arc, and where."""

    curve: str
    """what it is called"""
    fraction: float
    """share of the way, 0 … 1"""
    point_m: tuple[float, float, float]
    """the tool point there, in the base frame"""
    reason: Reason
    at_s: float | None = None
    """when the tool comes there; None: not known yet"""
    freer: Freer | None = None
    """with how much less asked of the tool the arm can follow the whole curve; None: with nothing less"""


@dataclass(frozen=True, slots=True)
class TooFewJoints(Reason):
    """An orientation on a curve that the arm's joints cannot hold while the tool point follows it."""

    curve: str
    joints: int
    turns: bool
    """the orientation is to change; else it is to be kept"""
    turn: float
    """what the tool would turn by besides [rad/m]"""
    has_plane: bool
    """the arm has a vertical plane of its own, in which its joints suffice"""


@dataclass(frozen=True, slots=True)
class AngleNeeded(Reason):
    """A joint, or an angle between links, that would have to leave its limits [rad]."""

    joint: str
    angles: tuple[float, ...]
    """each of which would do; empty: the place on a curve, as it is said, does not tell it"""
    low: float
    high: float
    percent: float | None = None
    """of the way, where it is farther on a curve; None: for a target"""


@dataclass(frozen=True, slots=True)
class AtLimit(Reason):
    """A joint that comes to its limit on a curve [rad]."""

    curve: str
    joint: str
    limit: float
    needs: tuple[AngleNeeded, ...]
    searched: bool
    """the way is the best of those that were found"""
    branches: tuple[str, ...]
    """that follow the whole curve from its start"""


@dataclass(frozen=True, slots=True)
class SingularStart(Reason):
    """A curve that cannot begin, as the arm stands in a singularity."""

    curve: str


@dataclass(frozen=True, slots=True)
class BranchEnds(Reason):
    """A singularity on a curve, beyond which the branch does not go on."""

    curve: str
    joint: str
    turn: float
    """what that joint turns by before it [rad/m]"""
    at_end: Reason | None
    """why the links alone do not reach the end of the curve; None: that is not known"""
    searched: bool
    """the way is the best of those that were found"""
    branches: tuple[str, ...]
    """that follow the whole curve from its start"""


@dataclass(frozen=True, slots=True)
class BeyondReach(Reason):
    """A curve that leaves what the arm reaches."""

    curve: str
    held: str
    """what is asked for besides the position, ``pitch`` or ``rotation``; empty: nothing"""
    percent: int | None = None
    """of the way, where ``why`` holds"""
    why: Reason | None = None


@dataclass(frozen=True, slots=True)
class PitchDecided(Reason):
    """A tool pitch that the position alone decides, from ``low`` to ``high`` [rad] on a curve."""

    curve: str
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class NotNow(Reason):
    """A command that the arm does not take in the state that it is in."""

    asked: str
    """what was asked for ("a motion"); empty: it is known from where it is said"""
    need: Need
    state: State
    cause: str = ""
    """of the state"""
    doing: str = ""
    """what moves the arm"""
    stopping: bool = False
    connected: bool = True
    """there is a board"""
    homed: bool = True
    """every axis that has to knows where it is"""
    limp: tuple[str, ...] = ()
    """titles of joints that were released by themselves"""

"""Why a command is refused, or ended before it was over: a frozen record each, in SI units."""

from __future__ import annotations

from typing import Literal

from armctl.facts.reasons import Reason, State
from armctl.lazy_dataclass import dataclass


def range_texts(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A number outside a range and its ends as texts, with as many digits as tell it from both ends."""
    ends = f"{low:g}", f"{high:g}"
    texts = (f"{value:.{digits}g}" for digits in range(6, 17))
    return next((text for text in texts if text not in ends), repr(value)), *ends


@dataclass(frozen=True, slots=True)
class Stopped(Reason):
    """Somebody's STOP, or that of armctl itself."""

    by: str
    """whose: what a party calls itself; empty: of whoever reads this"""
    note: str = ""
    """why, where it follows from something else"""
    what: str = ""
    """what was stopped; empty: it is known from where it is said"""
    how: Literal["stopped", "cancelled", "unbegun"] = "stopped"
    """unbegun: it had not begun"""


@dataclass(frozen=True, slots=True)
class Released(Reason):
    """Somebody switched the outputs off."""

    by: str
    joints: bool = False
    """of some joints only"""


@dataclass(frozen=True, slots=True)
class NotOperator(Reason):
    """A command of somebody who does not operate the arm."""

    operator: str = ""
    """who does; empty: nobody"""
    locked: bool = False
    """nobody may take control without the teacher's PIN"""


@dataclass(frozen=True, slots=True)
class ControlLocked(Reason):
    """Control that cannot be taken."""

    by: str = ""
    """who locked it; empty: the teacher"""
    pin: bool = False
    """the teacher's PIN opens it"""


@dataclass(frozen=True, slots=True)
class NothingTo(Reason):
    """A command that has nothing to do in a state."""

    do: Literal["resume", "clear", "release"]
    state: State


@dataclass(frozen=True, slots=True)
class NoBoard(Reason):
    """A command to a board, where none is connected."""


@dataclass(frozen=True, slots=True)
class Disconnected(Reason):
    """The line was closed meanwhile."""

    opening: str = ""
    """the port that was being opened; empty: none was"""


@dataclass(frozen=True, slots=True)
class Superseded(Reason):
    """A newer command of the same kind came."""

    by: Literal["gripper", "edit"]


@dataclass(frozen=True, slots=True)
class PlanningAlready(Reason):
    """A motion that is being planned."""


@dataclass(frozen=True, slots=True)
class PlannedTooLong(Reason):
    """A motion that could not be planned in the time that it may take [s]."""

    limit_s: float


@dataclass(frozen=True, slots=True)
class StartLeft(Reason):
    """An arm that stands elsewhere than a motion was planned from."""


@dataclass(frozen=True, slots=True)
class AfterGap(Reason):
    """A time [s] in which nothing ran, before a command could begin."""

    gap_s: float


@dataclass(frozen=True, slots=True)
class ShareOutside(Reason):
    """A share outside its range."""

    of: Literal["speed", "opening", "torque limit", "input", "output", "gripper"]
    share: float
    low: float
    high: float
    name: str = ""
    """of the input or output, or the title of the gripper"""


@dataclass(frozen=True, slots=True)
class NotDigital(Reason):
    """A value of a digital output that is neither 0 nor 1."""

    name: str
    value: float


@dataclass(frozen=True, slots=True)
class UnknownName(Reason):
    """A name that nothing of its kind has."""

    kind: str
    """joint, input, output, pose or point"""
    name: str
    known: tuple[str, ...]
    robot: str = ""
    """whose names they are; empty: of the arm that runs"""


@dataclass(frozen=True, slots=True)
class NoSuchStep(Reason):
    """A step that a program does not have."""

    program: str
    step: int
    """from 1"""
    steps: int


@dataclass(frozen=True, slots=True)
class PoseUnknown(Reason):
    """An arm that cannot be enabled, as nobody knows where it stands."""

    power: str
    """what is off: pulses or motors"""
    last: str = ""
    """where it was seen last; empty: nobody knows"""


@dataclass(frozen=True, slots=True)
class NothingOn(Reason):
    """A board whose errors keep the arm from being enabled."""

    errors: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class LineSlow(Reason):
    """A line on which answers take too long [s] for the arm to be enabled."""

    took: float
    """infinite: some did not come in time"""
    most: float


@dataclass(frozen=True, slots=True)
class MotorsApart(Reason):
    """Joints of two motors each, which stand apart."""

    joints: tuple[str, ...]
    """their titles"""


@dataclass(frozen=True, slots=True)
class ReadingsDiffer(Reason):
    """Joints of which two readings, one after the other, say another place."""

    joints: tuple[str, ...]
    """their titles"""


@dataclass(frozen=True, slots=True)
class OnUnconfirmed(Reason):
    """A board that does not confirm that its outputs came on: some may be on."""

    power: str
    """what should be on: pulses or motors"""


@dataclass(frozen=True, slots=True)
class ReleaseUnconfirmed(Reason):
    """Outputs that a board did not confirm to be off: the arm may still be held."""

    line: str
    board: str
    """what answers there; empty: the outputs do so themselves"""
    noun: Literal["channel", "pin", "servo"]
    outputs: tuple[int, ...]

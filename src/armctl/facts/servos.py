"""What is not as an arm needs it of the servos on a bus. Positions and ranges are in steps of the servo."""

from __future__ import annotations

from typing import Literal

from armctl.facts.reasons import Reason
from armctl.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class ServoSilent(Reason):
    """A servo of the arm that does not answer."""

    servo: int
    joint: str = ""
    """which it turns; empty: it is known from where it is said"""
    behind: int | None = None
    """the first of several that are silent up to the end of the chain"""
    stranger: int | None = None
    """who answers and is none of this arm's: it may be this one"""


@dataclass(frozen=True, slots=True)
class ServoStranger(Reason):
    """A servo that answers and is none of this arm's."""

    servo: int


@dataclass(frozen=True, slots=True)
class ServoAtBaud(Reason):
    """A servo that answers at another baud rate than the arm's."""

    servo: int
    baud: int
    wanted: int


@dataclass(frozen=True, slots=True)
class ServoUnfit(Reason):
    """A servo that is set up so that no torque may be switched on."""

    servo: int
    why: str
    """in the words of its make"""


@dataclass(frozen=True, slots=True)
class ServoRange(Reason):
    """Limits in a servo's own EEPROM that cut off a part of its joint's range."""

    servo: int
    lowest: int
    highest: int
    minimum: float
    maximum: float


@dataclass(frozen=True, slots=True)
class ServoOffset(Reason):
    """A homing offset that is not 0, and that nobody has kept as right."""

    servo: int
    offset: int


@dataclass(frozen=True, slots=True)
class ServoSeam(Reason):
    """A joint whose range crosses the place where its servo's position begins anew."""

    low: float
    high: float
    """places of the joint on either side of it"""
    turn: float


@dataclass(frozen=True, slots=True)
class ServoTold(Reason):
    """What else is unusual of a servo, or wrong with it."""

    servo: int
    words: str
    """of its make"""


@dataclass(frozen=True, slots=True)
class ServoChanged(Reason):
    """A setting in a servo's EEPROM that another program has changed since armctl kept it as right."""

    servo: int
    register: str
    """``offset``, ``lowest``, ``highest`` or ``mode``"""
    kept: int
    now: int


@dataclass(frozen=True, slots=True)
class ServoUnconfirmed(Reason):
    """A servo that does not confirm what it was told."""

    servo: int
    what: Literal["told", "on", "locked", "open"]
    """anything, its torque, or its EEPROM"""


@dataclass(frozen=True, slots=True)
class ServoNotTaken(Reason):
    """A servo that was told a number, and has another one."""

    servo: int
    number: int
    register: str
    """its name, or "goal" [steps]"""
    has: int | None = None


@dataclass(frozen=True, slots=True)
class ServoTorqueOn(Reason):
    """A servo whose EEPROM cannot be written while its torque is on."""

    servo: int


@dataclass(frozen=True, slots=True)
class ServoTurned(Reason):
    """A servo that has turned [rad] since it was looked at, ahead of its torque."""

    servo: int
    turn: float


@dataclass(frozen=True, slots=True)
class ServoTurning(Reason):
    """A servo that turns while it should stand."""

    servo: int
    enabling: bool = False
    """while its torque is switched on"""


@dataclass(frozen=True, slots=True)
class ServoOutside(Reason):
    """A servo outside the limits of its own EEPROM, into which torque would throw it."""

    servo: int
    place: int
    lowest: int
    highest: int
    jump: float
    """so far [rad]"""

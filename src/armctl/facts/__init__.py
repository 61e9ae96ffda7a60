"""Why something is refused or warned of, as data; words for it are made last (``say``)."""

from armctl.facts.quantities import Quantities
from armctl.facts.reasons import (
    About,
    Advised,
    AngleLimit,
    Blocked,
    Freer,
    MotionEndsMoving,
    NotNow,
    OnCurve,
    Overload,
    Rate,
    RateLimit,
    Reason,
    Said,
    Several,
    Singular,
    SpeedJump,
    StandsOutside,
    WrongUnit,
)
from armctl.facts.states import Need, State
from armctl.facts.words import advice, at, say, state_words, what

__all__ = [
    "About",
    "Advised",
    "AngleLimit",
    "Blocked",
    "Freer",
    "MotionEndsMoving",
    "Need",
    "NotNow",
    "OnCurve",
    "Overload",
    "Quantities",
    "Rate",
    "RateLimit",
    "Reason",
    "Said",
    "Several",
    "Singular",
    "SpeedJump",
    "StandsOutside",
    "State",
    "WrongUnit",
    "advice",
    "at",
    "say",
    "state_words",
    "what",
]

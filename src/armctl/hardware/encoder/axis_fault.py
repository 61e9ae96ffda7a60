"""What the board finds wrong with an axis or with itself, and how a user is told."""

from __future__ import annotations

from enum import IntFlag


class FaultKind(IntFlag):
    """Faults of one axis; each switches all motors off and stays until it is cleared."""

    STALL = 1
    FOLLOWING = 2
    ENCODER = 4
    HOMING = 8
    LIMIT = 16


class BoardFlag(IntFlag):
    """What the board reports of itself."""

    WATCHDOG = 1
    LINE_LOST = 2  # nothing is lost for good: a line without an answer is sent again
    BROWN_OUT = 4
    STOPPED = 8


_AXIS_WORDS = {
    FaultKind.STALL: "stalled: the motor was driven at its limit and did not move; see what is in its way",
    FaultKind.FOLLOWING: (
        "fell too far behind its setpoint (following error); is it overloaded, its supply weak, or the "
        "speed too high?"
    ),
    FaultKind.ENCODER: (
        "its encoder counted nothing, or nonsense, while the motor was driven; check its plug and wires"
    ),
    FaultKind.HOMING: "homing failed; see to its home switch and what is in its way, and home again",
    FaultKind.LIMIT: "went beyond its soft limit; move it back by hand and home again",
}
_BOARD_WORDS = {
    BoardFlag.WATCHDOG: (
        "watchdog: the board heard nothing from this computer for too long (was it busy, or the cable "
        "loose?) and switched its motors off"
    ),
    BoardFlag.BROWN_OUT: "brown-out: the board's supply voltage sagged and it started anew; check the supply",
    BoardFlag.STOPPED: "the motors were switched off at once by the emergency byte",
}


def fault_words(faults: FaultKind, detail: str = "") -> str:
    """What is wrong with an axis, in words for the user that do not name it.

    Args:
        faults: of one axis; none gives an empty string.
        detail: what the board said to it, if anything.
    """
    words = "; ".join(words for kind, words in _AXIS_WORDS.items() if kind in faults)
    return f"{words} ({detail})" if words and detail else words


def flag_words(flags: BoardFlag) -> tuple[str, ...]:
    """What the board reports of itself, in words for the user."""
    return tuple(words for flag, words in _BOARD_WORDS.items() if flag in flags)

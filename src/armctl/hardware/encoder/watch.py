"""Notices what the board did by itself, and goes on saying so until the user has taken note."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armctl.hardware.encoder.axis_fault import BoardFlag, fault_words, flag_words
from armctl.hardware.encoder.messages import Event
from armctl.hardware.encoder.status import Status

_BAD_STARTS = ("brownout", "watchdog")
_HOMING_FAILURES = {
    "notfound": "the switch was not found, on either side",
    "stuck": "the switch stays closed",
    "timeout": "it took too long",
}
_RESETS = {
    "power": "its supply was interrupted",
    "external": "its port was opened by another program, or its reset button pressed",
    "brownout": "its supply voltage sagged",
    "watchdog": "its program hung",
}


class BoardWatch:
    """Compares what the board does with what it was told.

    Motors that the board has switched off by itself stay off, whatever is written, until ``acknowledge``.
    """

    def __init__(self) -> None:
        self.on = False
        """armctl has switched the motors on"""
        self._went_off = False
        self._details: dict[int, str] = {}
        self._faults: dict[int, str] = {}

    @property
    def went_off(self) -> bool:
        """The board has switched the motors off by itself, and nobody has taken note yet."""
        return self._went_off

    @property
    def faults(self) -> Mapping[int, str]:
        """What was wrong with which axis at the last reading, in words."""
        return self._faults

    def acknowledge(self, *, on: bool) -> None:
        """The user has taken note; the motors are ``on`` from now on, or off."""
        self.on, self._went_off = on, False
        self._details.clear()
        self._faults = {}

    def observe(self, status: Status, restarted: str | None, events: Sequence[Event]) -> tuple[str, ...]:
        """Take one reading, and say in words what is wrong with the board; ``faults`` tells of its axes.

        Args:
            status: of the board.
            restarted: why it has started anew, in the board's word; None: it has not.
            events: what happened since the last reading.
        """
        self._details.update(_failures(events))
        self._faults = {
            axis: fault_words(fault, self._details.get(axis, ""))
            for axis, fault in enumerate(status.faults)
            if fault
        }
        words = [restart_words(restarted)] if restarted is not None else []
        words += flag_words(status.flags)
        # A board that brakes because nobody spoke to it switches its motors off in a moment.
        goes_off = not status.mode.powered or BoardFlag.WATCHDOG in status.flags
        if self.on and (goes_off or restarted is not None):
            self.on, self._went_off = False, True
        if self._went_off and not words and not self._faults:
            words.append("the board switched its motors off by itself")
        return tuple(words)


def earlier_words(status: Status, reset: str) -> tuple[str, ...]:
    """What the first status shows of the time before armctl connected; ``reset``: why the board started."""
    words = list(flag_words(status.flags))
    words += [f"axis {axis}: {fault_words(fault)}" for axis, fault in enumerate(status.faults) if fault]
    if reset in _BAD_STARTS and not words:
        words.append(f"its last start was after a {reset} reset; check its supply")
    return tuple(f"before armctl connected, the board had reported: {one}" for one in words)


def restart_words(reset: str) -> str:
    """What a board that has started anew means to the user."""
    why = f" ({_RESETS[reset]})" if reset in _RESETS else ""
    return f"the board has started anew{why}: its motors are off and its zeros are lost; home again"


def _failures(events: Sequence[Event]) -> dict[int, str]:
    """What the board said to each axis that it could not home."""
    found: dict[int, str] = {}
    for event in events:
        match event.words:
            case ("home", "failed", axis, *reason) if axis.isdecimal():
                said = " ".join(reason)
                found[int(axis)] = _HOMING_FAILURES.get(said, said)
            case _:
                pass
    return found

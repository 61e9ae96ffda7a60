"""The step that tells a person something, and waits for OK where it is asked to."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from msgspec import Meta

from armctl.program.base_steps import LONGEST_WAIT_S, Effect, Field, Step, Until
from armctl.program.signal_steps import AtTimeout, LongestWait

LONGEST_MESSAGE = 500
"""letters"""
GoesOn = Literal["at OK", "at once"]
_GOES_ON_HINT = "at OK: the arm stands until the operator presses OK; at once: it is only told."


class MessageStep(Step, frozen=True, kw_only=True, tag="message"):
    """Tell the person something, on all pages, on the terminal and in the log; stand until OK."""

    icon: ClassVar = "message"
    call: ClassVar = ("message", "text", "goes_on", "timeout_s", "otherwise")
    button: ClassVar = ("Wait and tell", "Message", "text")

    text: Annotated[str, Meta(min_length=1, max_length=LONGEST_MESSAGE), Field("Text", "What is told.", 40)]
    goes_on: Annotated[GoesOn, Field("Goes on", _GOES_ON_HINT, 63)] = "at OK"
    timeout_s: Annotated[
        LongestWait | None, Field("Time-out s", "At most so long. Empty: as long as it takes.", 64)
    ] = None
    """of the wait for OK; None: a day"""
    otherwise: AtTimeout = "stop"
    """what the program does where nobody has pressed OK by then"""

    @property
    def effect(self) -> Effect:
        """The text, and the wait for OK."""
        if self.goes_on == "at once":
            return Effect(message=self.text)
        longest = LONGEST_WAIT_S if self.timeout_s is None else self.timeout_s
        goes_on = self.otherwise == "go on"
        what = f"OK to the message {self.text!r}"
        until = Until(what, lambda senses: senses.confirmed, longest, goes_on, by_person=True)
        return Effect(message=self.text, until=until)

    def describe(self) -> str:
        """The text, and how long it stands."""
        if self.goes_on == "at once":
            return f"{self.text} · goes on at once"
        wait = "" if self.timeout_s is None else f", at most {self.timeout_s:g} s, then {self.otherwise}"
        return f"{self.text} · until OK{wait}"

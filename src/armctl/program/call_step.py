"""The step that runs another program."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from armctl.program.base_steps import Field, Step

LONGEST_NAME = 200
_HINT = "The name of its file, as seen from the folder of this one."


class CallStep(Step, frozen=True, kw_only=True, tag="call"):
    """Run another program, once, from where the arm is; then go on here.

    It is a file of its own, found from the folder of the program that calls it. Counters are shared with it;
    the speed that it sets ends with it.
    """

    words: ClassVar = "{0.program}"
    button: ClassVar = ("Program", "Call", "program")

    program: Annotated[
        str,
        Meta(min_length=1, max_length=LONGEST_NAME),
        Field("Program", _HINT, 40, offers="programs"),
    ]

    @property
    def calls(self) -> str:
        """The name."""
        return self.program

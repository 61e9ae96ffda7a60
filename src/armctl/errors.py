"""The one exception tree: every error that armctl raises on purpose is an ``ArmctlError``.

A message says which thing, its value, what is allowed and what to do. Errors of libraries are
translated where they enter (``raise ... from cause``), so that nobody above has to know them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import TracebackType
from typing import ClassVar, Self

from armctl.facts import About, Reason, Said, say
from armctl.facts.english_commands import out_of_range as out_of_range

DOCS = "https://armctl-console.readthedocs.io/en/latest/"
"""where the documentation is published: the same as in pyproject.toml"""


class ArmctlError(Exception):
    """Anything that armctl refuses or that went wrong; its text is in words for the user."""

    section: ClassVar[str] = ""
    """the section of docs/troubleshooting.md that helps; empty: none does"""
    each: Sequence[ArmctlError] = ()
    """the errors that this one tells together; empty: it is one"""
    line: int | None = None
    """of the file that it is about"""

    def __init__(self, reason: Reason | str) -> None:
        super().__init__(reason)
        self.reason = reason if isinstance(reason, Reason) else Said(reason)
        """why, as data"""

    def __str__(self) -> str:
        return say(self.reason)

    def about(self, what: str) -> Self:
        """The same, with what it is about before it."""
        error = type(self)(About(what, self.reason))
        error.each = [one.about(what) for one in self.each]
        error.line = self.line
        return error

    @property
    def help(self) -> str:
        """The address of the section that helps; empty: there is none."""
        return f"{DOCS}troubleshooting/#{self.section}" if self.section else ""


def with_help(error: ArmctlError) -> str:
    """The text for a user: the message, and the address of the section that helps."""
    return f"{error} – see {error.help}" if error.help else str(error)


class RefusedBeforeError(Exception):
    """A check met a value that was refused already, so it cannot tell anything (``decoding.REFUSED``)."""


_TOLD = 3
"""errors that one message tells"""


class Errors:
    """Collects errors, so that who has to mend a file sees them all: ``with errors: check()``."""

    def __init__(self) -> None:
        self.found: list[ArmctlError] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool:
        """Take an ``ArmctlError``; pass over what was refused before."""
        if isinstance(error, ArmctlError):
            self.found += error.each or [error]
        return isinstance(error, ArmctlError | RefusedBeforeError)

    def raise_all(self) -> None:
        """Raise what was found, if anything, in the order of the lines."""
        found = sorted(self.found, key=lambda one: one.line or math.inf)
        if len(found) > 1:
            told = "; ".join(map(str, found[:_TOLD]))
            more = f"; and {len(found) - _TOLD} more (armctl check tells all)" if len(found) > _TOLD else ""
            joined = type(found[0])(f"{len(found)} errors: {told}{more}")
            joined.each = found
            raise joined
        if found:
            raise found[0]


class LimitError(ArmctlError):
    """Work that takes more time or memory than it may."""


class InputError(ArmctlError):
    """A value that nobody can work with: not finite, wrong shape, unknown name."""


class RobotFileError(ArmctlError):
    """A robot file that cannot be read, or that contradicts itself."""

    section = "the-robot-file-cannot-be-read"


class UnclearArmError(RobotFileError):
    """A robot file, or a folder of them, that leaves open which arm or tool link is meant, or what size."""

    arms: Sequence[str] = ()
    """the files that may be meant, seen from the folder"""
    links: Sequence[str] = ()
    """the links that may be the tool, the likeliest first"""
    arguments: Sequence[str] = ()
    """the arguments that the xacro file needs, and that nobody gave"""

    def about(self, what: str) -> Self:
        """See ``ArmctlError``."""
        error = super().about(what)
        error.arms, error.links, error.arguments = self.arms, self.links, self.arguments
        return error


class ProgramError(ArmctlError):
    """A motion program that cannot be read or run; names the file and the step."""

    section = "the-program-cannot-be-read"


class DrawingError(ArmctlError):
    """A drawing that cannot be read or laid out; names the file, and the line or the element."""

    section = "the-drawing-cannot-be-read"


class UnreachableError(ArmctlError):
    """A target without a solution. The message says why and names the nearest reachable point."""

    section = "the-target-is-out-of-reach"


class MotionRefusedError(ArmctlError):
    """A motion that would leave the limits, found before the arm moves."""

    section = "a-motion-is-refused"


class StateError(ArmctlError):
    """A command that the present state does not allow (for example: move while off)."""

    section = "the-arm-does-not-take-a-command"


class StoppedError(StateError):
    """A motion that somebody stopped: nothing went wrong."""

    section = ""


class EnableError(StateError):
    """The arm cannot be enabled where it stands, or as it is."""

    section = "the-arm-cannot-be-enabled"
    channel: int | None = None
    """of the board, where it is about one"""


class BoardError(ArmctlError):
    """The board or the line to it: absent, silent, garbled, or reporting an error."""

    section = "the-board-does-not-answer"


class PortError(BoardError):
    """A serial port that cannot be opened or found."""

    section = "the-port-cannot-be-opened"


class NoBoardError(PortError):
    """No port has the board that is wanted, or several may have."""

    section = "no-board-is-found"


class OtherBoardError(PortError):
    """The board on a port is not the one that the arm is set up for."""

    section = "the-board-belongs-to-another-arm"


class BoardTimeoutError(BoardError):
    """The board did not answer in time."""


class BoardProtocolError(BoardError):
    """The board answered something that its protocol does not allow."""


class ArmProcessError(BoardError):
    """The arm process does not start, does not answer, or has ended."""

    section = "the-arm-process-has-ended"


class ServerError(ArmctlError):
    """The web server cannot be started, or its guard is not effective."""

    section = "the-page-does-not-open"


class CalibrationError(ArmctlError):
    """Marks that give no calibration, or a calibration that cannot be read, kept or used."""

    section = "the-calibration-is-refused"

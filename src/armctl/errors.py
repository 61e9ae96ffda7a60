"""The one exception tree: every error that armctl raises on purpose is an ``ArmctlError``.

A message says which thing, its value, what is allowed and what to do. Errors of libraries are
translated where they enter (``raise ... from cause``), so that nobody above has to know them.
"""

from __future__ import annotations


class ArmctlError(Exception):
    """Anything that armctl refuses or that went wrong, in words for the user."""


class InputError(ArmctlError):
    """A value that nobody can work with: not finite, wrong shape, unknown name."""


class RobotFileError(ArmctlError):
    """A robot file that cannot be read, or that contradicts itself."""


class ProgramError(ArmctlError):
    """A motion program that cannot be read or run; names the file and the step."""


class UnreachableError(ArmctlError):
    """A target without a solution. The message says why and names the nearest reachable point."""


class MotionRefusedError(ArmctlError):
    """A motion that would leave the limits, found before the arm moves."""


class StateError(ArmctlError):
    """A command that the present state does not allow (for example: move while off)."""


class BoardError(ArmctlError):
    """The board or the line to it: absent, silent, garbled, or reporting an error."""


class PortError(BoardError):
    """A serial port that cannot be opened or found."""


class BoardTimeoutError(BoardError):
    """The board did not answer in time."""


class BoardProtocolError(BoardError):
    """The board answered something that its protocol does not allow."""


class ServerError(ArmctlError):
    """The web server cannot be started, or its guard is not effective."""


class CalibrationError(ArmctlError):
    """Marks that give no calibration, or a calibration that cannot be read, kept or used."""

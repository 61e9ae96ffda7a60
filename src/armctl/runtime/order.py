"""A command with what the controller notes of it."""

from __future__ import annotations

from dataclasses import dataclass

from armctl.protocol import Command, MovingCommand, Origin, Ticket
from armctl.protocol.commands import kebab


@dataclass(frozen=True, slots=True)
class Order:
    """A command on its way to the controller thread."""

    command: Command | None
    """None: STOP"""
    origin: Origin
    ticket: Ticket
    given_at: float
    """controller clock [s]"""
    number: int
    """in the order in which they were given, stops included"""

    @property
    def label(self) -> str:
        """What it asks for, in words."""
        return "STOP" if self.command is None else kebab(type(self.command).__name__).replace("-", " ")

    @property
    def motion(self) -> str:
        """The name of the motion that it asks for; empty where it has none."""
        return self.command.motion if isinstance(self.command, MovingCommand) else ""

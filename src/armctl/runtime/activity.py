"""A command on its way, and what the arm is doing: one motion, a jog, a live target, a program, homing."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.lazy_dataclass import dataclass
from armctl.motion import Trajectory
from armctl.protocol import Command, Doing, Jog, MovingCommand, Origin, ProgramProgress, Ticket
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


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Where the joints are to be now, and how they move there: (n,) rad, rad/s, rad/s²."""

    q: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class Activity(ABC):
    """Something that gives one setpoint a tick until it is done. Owned by the controller thread.

    What is given a value here holds for activities that say nothing else.
    """

    label: str = ""
    """its name in the state's cause and in the log"""
    begun: bool = True
    """it has begun; a program begins when its first step could be planned"""
    pausable: bool = False
    gripping: bool = False
    """the gripper is not free meanwhile"""
    releasing: bool = False
    """it switches the outputs off: what the board reports meanwhile is no reason to end it"""
    led_by: ClassVar[tuple[type[Command], ...]] = ()
    """kinds of commands that it goes on by: ``lead`` takes them"""
    error: ArmctlError | None = None
    """why it ended before its end"""
    awaits: int | None = None
    """number of the message that it waits with; None: it waits for no person"""
    _notice: str | None = None
    _done = False

    @property
    def rest(self) -> Trajectory | None:
        """What is left of a motion that was checked with the gripper as it is; None: it needs no check."""
        return None

    @property
    def notice(self) -> str | None:
        """What it holds back, and why."""
        return self._notice

    @property
    def waits(self) -> bool:
        """Whether ``notice`` says what it waits for as it was asked to: nothing is wrong."""
        return False

    @property
    def progress(self) -> float | None:
        """Share of its time at full speed that is over, 0 ... 1; None: not known."""
        return None

    @property
    def program(self) -> ProgramProgress | None:
        """Where the program is that it runs, if it is one."""
        return None

    @property
    def done(self) -> bool:
        """Nothing more will come: it has ended, was stopped, or failed, and the joints are at rest."""
        return self._done

    @property
    @abstractmethod
    def standing(self) -> bool:
        """The joints are at rest now."""

    @abstractmethod
    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds to ``now`` (controller clock); None where no joint moves."""

    @abstractmethod
    def stop(self) -> None:
        """Slow down as hard as the limits allow, then be done."""

    @abstractmethod
    def halt(self) -> None:
        """No setpoint is sent for now, so the arm stands: when it goes on, it begins from rest."""

    def doing(self, stopping: bool) -> Doing:
        """What is told of it; ``stopping``: it was stopped."""
        jogged = Jog in self.led_by
        return Doing(self.label, self.pausable, self.gripping, stopping, self.notice, jogged)

    def lead(self, command: Command, expires: float) -> None:  # noqa: B027
        """Go on by one of ``led_by``, whose values were checked, until the clock says ``expires``."""

    def set_speed(self, fraction: float) -> None:  # noqa: B027
        """Go towards this speed override inside the acceleration limits."""

    def pause(self, paused: bool) -> None:  # noqa: B027
        """Slow down along the path and stand (True), or go on along it (False). Only if ``pausable``."""

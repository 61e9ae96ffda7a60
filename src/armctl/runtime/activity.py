"""What the arm is doing: one motion, a jog, a live target, a program or homing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.motion import Trajectory
from armctl.protocol import ProgramProgress


@dataclass(frozen=True, slots=True)
class Setpoint:
    """Where the joints are to be now, and how they move there: (n,) rad, rad/s, rad/s²."""

    q: FloatArray
    velocity: FloatArray
    acceleration: FloatArray


class Activity(Protocol):
    """Something that gives one setpoint a tick until it is done. Owned by the controller thread."""

    label: str
    """its name in the state's cause and in the log"""
    begun: bool
    """it has begun; a program begins when its first step could be planned"""
    pausable: bool
    gripping: bool
    """the gripper is not free meanwhile"""
    error: ArmctlError | None
    """why it ended before its end"""

    @property
    def rest(self) -> Trajectory | None:
        """What is left of a motion that was checked with the gripper as it is; None: it needs no check."""

    @property
    def notice(self) -> str | None:
        """What it holds back, and why."""

    @property
    def progress(self) -> float | None:
        """Share of its time at full speed that is over, 0 ... 1; None: not known."""

    @property
    def program(self) -> ProgramProgress | None:
        """Where the program is that it runs, if it is one."""

    @property
    def standing(self) -> bool:
        """The joints are at rest now."""
        ...

    @property
    def done(self) -> bool:
        """Nothing more will come: it has ended, was stopped, or failed, and the joints are at rest."""
        ...

    def advance(self, now: float, dt: float) -> Setpoint | None:
        """Go on by ``dt`` seconds to ``now`` (controller clock); None where no joint moves."""

    def set_speed(self, fraction: float) -> None:
        """Go towards this speed override inside the acceleration limits."""

    def pause(self, paused: bool) -> None:
        """Slow down along the path and stand (True), or go on along it (False)."""

    def stop(self) -> None:
        """Slow down as hard as the limits allow, then be done."""

    def halt(self) -> None:
        """No setpoint is sent for now, so the arm stands: when it goes on, it begins from rest."""

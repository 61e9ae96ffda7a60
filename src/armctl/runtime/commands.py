"""What the outside may ask of the controller, and the ticket that it gets for it.

Commands are plain immutable records. STOP is not among them: it bypasses every queue (``Controller.stop``).
"""

from __future__ import annotations

from concurrent.futures import Future
from dataclasses import dataclass
from typing import Literal

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.kinematics import Target
from armctl.motion import Profile, Trajectory
from armctl.program import Program

ToolFrame = Literal["base", "tool"]


@dataclass(frozen=True, slots=True)
class Connect:
    """Open the line to the board: ``sim``, ``auto`` or a device."""

    port: str


@dataclass(frozen=True, slots=True)
class Disconnect:
    """Stop if moving, then close the line. The outputs stay as they are."""


@dataclass(frozen=True, slots=True)
class Enable:
    """Switch the pulses on. Servos that were off jump to ``q`` (n,) [rad] (default: the rest pose)."""

    q: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class HomeAxes:
    """Let a board with encoders find the zero of every axis: the arm moves, slowly, to its switches."""


@dataclass(frozen=True, slots=True)
class Release:
    """Pulses off: the arm drops. Asked for twice in the UI, at once here."""


@dataclass(frozen=True, slots=True)
class Pause:
    """Slow down along the path and stand."""


@dataclass(frozen=True, slots=True)
class Resume:
    """Go on along the same path."""


@dataclass(frozen=True, slots=True)
class ClearFault:
    """Leave ``fault`` for ``off`` (or ``holding`` when the pulses are still on) once its cause is gone."""


@dataclass(frozen=True, slots=True)
class MoveJoints:
    """Go to joint angles ``q`` (n,) [rad]; shortest time unless a duration is given.

    ``profile``: "cubic" (cubic, synchronised) or "normal" (each joint at its own speed; a duration
    then makes it a planned one).
    """

    q: FloatArray
    duration_s: float | None = None
    profile: Profile = "cubic"


@dataclass(frozen=True, slots=True)
class MoveTo:
    """Put the tool on a target by inverse kinematics, choosing by a named criterion."""

    target: Target
    choose: str = "least-rotation"
    duration_s: float | None = None
    profile: Profile = "cubic"


@dataclass(frozen=True, slots=True)
class Follow:
    """Run a trajectory that somebody planned; refused unless the arm stands where it starts."""

    trajectory: Trajectory


@dataclass(frozen=True, slots=True)
class Jog:
    """Turn joints at ``rate`` (n,), each -1 ... 1 of the joint's speed limit, while such commands come.

    Each one expires 100 ms after it arrives; the arm then slows down inside its limits.
    """

    rate: FloatArray


@dataclass(frozen=True, slots=True)
class JogTool:
    """Move the tool along a straight line, or turn it in its place, while such commands come.

    Expires as ``Jog`` does. All speeds are scaled together where the arm cannot give them.
    """

    linear: FloatArray
    """(3,) [m/s], in ``frame``"""
    pitch_rate: float = 0.0
    """[rad/s], positive lifts the tool"""
    roll_rate: float = 0.0
    """[rad/s], of the roll joint"""
    frame: ToolFrame = "base"
    """whose axes ``linear`` is along; the tool's are taken as they are when the jog begins"""

    @property
    def twist(self) -> FloatArray:
        """(5,) all of it: [m/s, m/s, m/s, rad/s, rad/s]."""
        return np.array([*self.linear, self.pitch_rate, self.roll_rate])


@dataclass(frozen=True, slots=True)
class FollowTarget:
    """Follow a target that moves: the newest one counts. Sent again and again while it is followed.

    Expires 500 ms after it arrives; the arm then slows down inside its limits. None: slow down now.
    """

    target: Target | None


@dataclass(frozen=True, slots=True)
class MoveGripper:
    """Open the gripper: 0 closed ... 1 open."""

    opening: float


@dataclass(frozen=True, slots=True)
class SetSpeed:
    """Speed override for everything that moves: 0.05 ... 1, applied to time, so that the path stays."""

    fraction: float


@dataclass(frozen=True, slots=True)
class RunProgram:
    """Run a program ``loops`` times (None: for ever), beginning at step ``first`` of the first pass."""

    program: Program
    loops: int | None = 1
    first: int = 0
    count: int | None = None
    """how many steps to run, e.g. 1; None: all"""


@dataclass(frozen=True, slots=True)
class UpdateProgram:
    """Let the running program go on in another version, from its next pass on."""

    program: Program


Command = (
    Connect
    | Disconnect
    | Enable
    | HomeAxes
    | Release
    | Pause
    | Resume
    | ClearFault
    | MoveJoints
    | MoveTo
    | Follow
    | Jog
    | JogTool
    | FollowTarget
    | MoveGripper
    | SetSpeed
    | RunProgram
    | UpdateProgram
)


@dataclass(frozen=True, slots=True)
class Origin:
    """Who asked: shown in the log."""

    who: str = "library"
    note: str = ""
    """why, where it is not what somebody asked for but what has to follow from something else"""

    def __str__(self) -> str:
        return f"{self.who}: {self.note}" if self.note else self.who


Answer = tuple[Future[None], ArmctlError | None]


class Ticket:
    """Two futures of one command; any thread may wait for them.

    ``accepted`` is done as soon as the command has begun, or carries the ``ArmctlError`` that refused it.
    ``finished`` is done when what it began is over: at once for most commands, at the end of the motion for
    motions; it carries the error that refused, stopped or broke it. Neither can be cancelled: only STOP
    stops a motion.
    """

    def __init__(self, answers: list[Answer] | None = None) -> None:
        """Not answered yet.

        Args:
            answers: queue of the answers that ``give`` delivers once the snapshot shows what came of them;
                None: they are given at once.
        """
        self._answers = answers
        self.accepted: Future[None] = Future()
        self.finished: Future[None] = Future()
        # asyncio.wrap_future cancels what it wraps when its task ends; a running future refuses that.
        self.accepted.set_running_or_notify_cancel()
        self.finished.set_running_or_notify_cancel()

    def accept(self) -> None:
        """The command has begun."""
        self._answer(None, self.accepted)

    def finish(self) -> None:
        """The command is carried out."""
        self._answer(None, self.accepted, self.finished)

    def refuse(self, error: ArmctlError) -> None:
        """The command was refused, or did not come to its end."""
        self._answer(error, self.accepted, self.finished)

    def result(self, timeout: float | None = None) -> None:
        """Wait until it is over.

        Raises:
            ArmctlError: what refused, stopped or broke it.
            TimeoutError: it is not over after ``timeout`` seconds; it goes on.
        """
        self.finished.result(timeout)

    def _answer(self, error: ArmctlError | None, *futures: Future[None]) -> None:
        answers = [(future, error) for future in futures]
        if self._answers is None:
            give(answers)
        else:
            self._answers.extend(answers)


def give(answers: list[Answer]) -> None:
    """Empty the queue: give every future its answer, of several the first one."""
    while answers:
        future, error = answers.pop(0)
        if future.done():
            continue
        if error is None:
            future.set_result(None)
        else:
            future.set_exception(error)

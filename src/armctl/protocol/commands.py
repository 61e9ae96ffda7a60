"""What an arm may be asked for, and its tickets. STOP is a call: ``ArmLink.stop``."""

from __future__ import annotations

import re
from concurrent.futures import Future
from typing import Literal, Protocol

import msgspec
import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.kinematics import Target
from armctl.lazy_dataclass import dataclass
from armctl.motion import Profile, Trajectory
from armctl.program import Program
from armctl.protocol.recording import Recording
from armctl.protocol.snapshot import Snapshot, WrongPins
from armctl.robot import Robot

Frame = Literal["base", "tool"]
LONGEST_NAME = 60
"""letters of what somebody is called"""
JOG_EXPIRY_S = 0.1
"""How long one jog command counts."""
FOLLOW_EXPIRY_S = 0.5
"""How long one target counts. A page that follows repeats it five times as often."""
STREAM_EXPIRY_S = 0.15
"""How long one setpoint of a stream counts."""


def kebab(name: str) -> str:
    """``move-joints`` of ``MoveJoints``."""
    return re.sub(r"(?<=[a-z])(?=[A-Z])", "-", name).lower()


class Command(msgspec.Struct, frozen=True, tag_field="command", tag=kebab, forbid_unknown_fields=True):
    """What the controller may be asked for; ``command`` names its kind, e.g. ``move-joints``."""


class MovingCommand(Command, frozen=True, kw_only=True):
    """A STOP drops it when it was given before."""

    motion: str = ""
    """a name that no other motion has, for ``Cancel``; empty: it can only be stopped"""


class HeldCommand(MovingCommand, frozen=True):
    """Counts only for a moment: it is given again and again."""


class Connect(Command, frozen=True):
    """Open the line to the board: ``sim``, ``auto`` or a device; None: as the last time."""

    port: str | None


class Disconnect(Command, frozen=True):
    """Stop if moving, then close the line. The outputs stay as they are."""


class Enable(MovingCommand, frozen=True):
    """Switch the pulses on, where the arm *is*: nothing jumps if what is said here is true.

    Outputs that are on, and axes that are measured, stay where they are. Servos that are off come on at
    ``q``, one after the other; without it only on the simulated board, which stands in its rest pose.
    """

    q: FloatArray | None = None
    """(n,) where the arm stands [rad]"""
    opening: float | None = None
    """of its gripper, 0 closed ... 1 open; None: not known, half open"""


class HomeAxes(MovingCommand, frozen=True):
    """Let a board with encoders find the zero of every axis: the arm moves, slowly, to its switches."""


class Release(Command, frozen=True):
    """Pulses off: the arm drops. Asked for twice in the UI, at once here."""

    joints: tuple[str, ...] | None = None
    """names of the only ones that are switched off, of an arm that holds, where its board can; None: all"""


class LimitTorque(Command, frozen=True):
    """How strong motors may be, of a board that can limit them."""

    share: float
    """0 ... 1 of their full torque"""
    joints: tuple[str, ...] = ()
    """names; empty: all"""


class SetOutput(Command, frozen=True):
    """Switch an output of the board that moves no joint."""

    name: str
    """as ``Snapshot.outputs`` has it"""
    value: float
    """0, 1, or a share"""


class SimulateInput(Command, frozen=True):
    """Put an input of the simulated board at a value, as if somebody pressed it."""

    name: str
    """as ``Snapshot.inputs`` has it"""
    value: float
    """0, 1, or a share"""


class PlayInputs(Command, frozen=True):
    """Have the inputs of the simulated board follow a script from now on, on the board's clock."""

    script: str
    """as ``armctl.hardware.input_script`` reads it; empty: they stay as they are"""


class SetTool(Command, frozen=True):
    """Say that a tool of the robot file is on, another one or still the same; only while the arm stands.

    It moves and switches nothing. Where its tip is, what it weighs and its body count from then on.
    """

    name: str
    """as ``Robot.tools`` has it"""


class Pause(Command, frozen=True):
    """Slow down along the path and stand."""


class Resume(MovingCommand, frozen=True):
    """Go on along the same path."""


class ClearFault(Command, frozen=True):
    """Leave ``fault`` for ``off`` (or ``holding`` when the pulses are still on) once its cause is gone."""


class ControlCommand(Command, frozen=True):
    """About who operates, which everybody may ask for."""


class Arrive(ControlCommand, frozen=True):
    """Who asks is there, and is called ``name``; it operates when nobody does."""

    name: str = ""
    watch: bool = False
    """it does not want to operate"""


class Leave(ControlCommand, frozen=True):
    """Who asks is gone; what moves at its command is stopped."""

    why: str = "it has gone"


class TakeControl(ControlCommand, frozen=True):
    """Who asks operates from now on, unless control is locked."""

    pin: str = ""
    """the teacher's, who may always"""


class LockControl(ControlCommand, frozen=True):
    """Nobody may take control from the operator, or everybody may again."""

    locked: bool
    pin: str = ""


class LendControl(ControlCommand, frozen=True):
    """Who operates lets another party command beside it, until it takes that back, or loses control.

    Where one of both leaves, what moves is stopped.
    """

    to: str = ""
    """what that party calls itself (``Party.id``); empty: nobody any more"""


class RememberWrongPins(ControlCommand, frozen=True):
    """Go on counting the wrong PINs of the arm that this one takes the place of."""

    wrong_pins: tuple[WrongPins, ...] = ()


class MoveJoints(MovingCommand, frozen=True):
    """Go to ``q`` (n,) [rad], in shortest time by default; profile "normal": each joint at its own speed."""

    q: FloatArray
    duration_s: float | None = None
    profile: Profile = "cubic"


class MoveTo(MovingCommand, frozen=True):
    """Put the tool on a target by inverse kinematics, choosing by a named criterion."""

    target: Target
    choose: str = "least-rotation"
    duration_s: float | None = None
    profile: Profile = "cubic"


class Follow(MovingCommand, frozen=True):
    """Run a trajectory of the caller's own; refused unless the arm stands where it starts."""

    trajectory: Trajectory


class Cancel(Command, frozen=True):
    """STOP for one motion and nothing else: it slows down on its path. Finished once the arm stands."""

    motion: str
    """its name; one that is over already, or is not known, changes nothing"""


class Jog(HeldCommand, frozen=True):
    """Turn joints at ``rate`` (n,), -1 ... 1 of their speed limits; expires after 100 ms, then slows down."""

    rate: FloatArray


class JogTool(HeldCommand, frozen=True):
    """Move the tool along a line, or turn it in its place; scaled as a whole. Expires as ``Jog``."""

    linear: FloatArray
    """(3,) [m/s], in ``frame``"""
    pitch_rate: float = 0.0
    """[rad/s], positive lifts the tool"""
    roll_rate: float = 0.0
    """[rad/s], of the roll joint"""
    frame: Frame = "base"
    """whose axes ``linear`` is along; the tool's are taken as they are when the jog begins"""
    angular: FloatArray | None = None
    """(3,) turn about these axes through the tool point [rad/s], of an arm that orients its tool; None: 0"""
    rests_s: float | None = None
    """no joint turns faster than it can brake from in this time [s]; None: as fast as it may"""

    @property
    def twist(self) -> FloatArray:
        """(8,) all of it: [m/s] three times, then [rad/s]."""
        turn = np.zeros(3) if self.angular is None else self.angular
        return np.array([*self.linear, self.pitch_rate, self.roll_rate, *turn])

    def from_user_frame(self, R: FloatArray) -> JogTool:
        """This jog along the axes of the base; its own are those of a user frame, turned by ``R`` (3, 3)."""
        return msgspec.structs.replace(self, linear=R @ self.linear, angular=R @ self.twist[5:], frame="base")


class FollowTarget(HeldCommand, frozen=True):
    """Follow the newest target (None: slow down now); expires after 500 ms, then slows down."""

    target: Target | None


class StreamJoints(HeldCommand, frozen=True):
    """Go toward ``q`` (n,) [rad], inside every limit, until the next one; expires after 150 ms: slows down.

    A stream has a name (``motion``): after a STOP it goes on only under another one.
    """

    q: FloatArray
    last: bool = False
    """does not expire: the arm goes on to ``q``, and the stream is finished there"""


class MoveGripper(MovingCommand, frozen=True):
    """Open the gripper: 0 closed ... 1 open.

    What is between its jaws from then on counts in all that moves, until it is told to move again, or the
    outputs are switched off.
    """

    opening: float
    part_mm: tuple[float, float, float] | None = None
    """edges of a part along x, y and z of the tool (``CarriedPart``) [mm]; None: nothing is carried"""


class SetSpeed(Command, frozen=True):
    """Speed override for everything that moves: 0.05 ... 1, applied to time, so that the path stays."""

    fraction: float


class RunProgram(MovingCommand, frozen=True):
    """Run a program ``loops`` times (None: for ever), beginning at step ``first`` of the first pass."""

    program: Program
    loops: int | None = 1
    first: int = 0
    count: int | None = None
    """how many steps to run, e.g. 1; None: all"""


class UpdateProgram(Command, frozen=True):
    """Let the running program go on in another version, from its next pass on."""

    program: Program


class ConfirmMessage(Command, frozen=True):
    """Say OK to the message that the program waits with."""

    number: int
    """of the message (``Snapshot.message``)"""


@dataclass(frozen=True, slots=True)
class Origin:
    """Who asked: shown in the log."""

    who: str = "library"
    note: str = ""
    """why, where it is no request of its own but what has to follow from something else"""
    source: str = ""
    """where it comes from, as the server knows it; empty: not known. Read where somebody arrives"""

    def __str__(self) -> str:
        return f"{self.who}: {self.note}" if self.note else self.who


Answer = tuple[Future[None], ArmctlError | None]


class Ticket:
    """Two futures of one command; any thread may wait for them, and none can cancel them: STOP stops.

    ``accepted``: it has begun. ``finished``: what it began is over. Both carry the ``ArmctlError`` that
    refused it, ``finished`` also what stopped or broke it.
    """

    def __init__(self, answers: list[Answer]) -> None:
        """Not answered yet; answers wait in ``answers`` for ``give``: the snapshot comes first."""
        self._answers = answers
        self.accepted: Future[None] = Future()
        self.finished: Future[None] = Future()
        # asyncio.wrap_future cancels what it wraps when its task ends; a running future refuses that.
        self.accepted.set_running_or_notify_cancel()
        self.finished.set_running_or_notify_cancel()

    @classmethod
    def ended(cls, error: ArmctlError | None = None) -> Ticket:
        """A ticket that has its answer."""
        answers: list[Answer] = []
        ticket = cls(answers)
        ticket.end(error)
        give(answers)
        return ticket

    def accept(self) -> None:
        """The command has begun."""
        self._answers.append((self.accepted, None))

    def end(self, error: ArmctlError | None = None) -> None:
        """The command is carried out, or was refused or stopped by ``error``."""
        self._answers += (self.accepted, error), (self.finished, error)

    def result(self, timeout: float | None = None) -> None:
        """Wait until it is over; raises what refused, stopped or broke it. ``TimeoutError``: it goes on."""
        self.finished.result(timeout)


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


class ArmLink(Protocol):
    """What drives an arm, here or in a process of its own; any thread may use it."""

    @property
    def robot(self) -> Robot:
        """The arm, as it is calibrated."""
        ...

    @property
    def snapshot(self) -> Snapshot:
        """The newest that is known of it."""
        ...

    @property
    def ended(self) -> bool:
        """Whether it can never answer again."""
        ...

    def submit(self, command: Command, origin: Origin | None = None) -> Ticket:
        """Ask for something; ``origin`` is for the log."""
        ...

    def stop(self, origin: Origin | None = None) -> Ticket:
        """STOP: drops what was asked for before it; the ticket is ``finished`` when the arm is at rest."""
        ...

    def beat(self) -> None:
        """Whoever commands the arm is alive: needed more often than once a second while it moves."""
        ...

    def black_box(self) -> Recording:
        """The last minute of it. May wait for it; ``BoardError``: it cannot be had."""
        ...

    def simulated_port(self) -> str:
        """Where its simulated board is served, begun where need be. May wait; ``BoardError``: nowhere."""
        ...

    def close(self) -> None:
        """Bring the arm to rest, close the line, end. May be called more than once."""
        ...

"""What an arm shows of itself: one immutable record a tick; and what commands need of its state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from datetime import datetime
from operator import attrgetter

import numpy as np

from armctl.arrays import FloatArray
from armctl.facts import (
    CalledStep,
    InStep,
    LevelPassed,
    Need,
    NotNow,
    Part,
    Quantities,
    QuantityLimits,
    Said,
    State,
)
from armctl.facts.angles import to_degrees
from armctl.facts.commands import NotOperator, Stopped
from armctl.facts.words import place
from armctl.hardware import BoardIdentity, Source
from armctl.kinematics.velocity import position_leaves_pitch
from armctl.lazy_dataclass import dataclass
from armctl.program import Program
from armctl.robot import Robot

# What commands need of the arm. The controller refuses by it, and pages tell by it beforehand.


POWERED = (State.HOLDING, State.MOVING, State.PAUSED)
_MET_IN = {
    Need.HOLDING: (State.HOLDING,),
    Need.JOG: (State.HOLDING,),
    Need.PAUSE: (),
    Need.GRIPPER: POWERED,
    Need.OFF: (State.OFF,),
    Need.OFF_OR_HOLDING: (State.OFF, State.HOLDING),
    Need.HOLDING_SOME: (State.HOLDING,),
    Need.CONNECTED: (State.OFF, *POWERED),
}


@dataclass(frozen=True, slots=True)
class Doing:
    """What moves the arm now, as far as it decides which commands are taken."""

    label: str
    """its name"""
    pausable: bool
    gripping: bool
    """the gripper is not free"""
    stopping: bool
    """it comes to rest, and does not go on"""
    notice: str | None = None
    """what holds it back, in words"""
    jogged: bool = False
    """it goes on by jogs"""

    def takes(self, need: Need) -> bool:
        """Whether what needs this is taken meanwhile."""
        match need:
            case Need.GRIPPER:
                return not self.gripping
            case Need.PAUSE:
                return self.pausable and not self.stopping
            case Need.CONNECTED:
                return True
            case _:
                return need is Need.JOG and self.jogged and not self.stopping


def unmet(
    need: Need,
    state: State,
    *,
    asked: str = "",
    connected: bool,
    homed: bool,
    cause: str = "",
    doing: Doing | None = None,
    limp: tuple[str, ...] = (),
) -> NotNow | None:
    """Why a command is refused, and what to do: "off; enable first". None: its need is met.

    ``asked``: what is asked for; ``connected``: there is a board; ``homed``: every axis that has to knows
    where it is; ``cause``: of the state, to be named in the answer; ``doing``: what moves the arm; ``limp``:
    titles of joints that were released by themselves.
    """
    if limp and need is Need.OFF and state is State.HOLDING:  # Enable takes them back
        return None
    if state is not State.HOLDING or need not in (Need.HOLDING, Need.JOG):
        limp = ()
    if not limp and (state in _MET_IN[need] if doing is None else doing.takes(need)):
        return None
    label, stopping = ("", False) if doing is None else (doing.label, doing.stopping)
    return NotNow(asked, need, state, cause, label, stopping, connected, homed, limp)


def tool_turns(robot: Robot) -> tuple[bool, bool]:
    """Whether the tool of an arm can be pitched, and rolled, while its point stays."""
    roll = robot.inverse_kinematics.roll_joint
    rolls = roll is not None and bool(robot.limits[roll, 0] < robot.limits[roll, 1])
    return position_leaves_pitch(robot.chain, robot.limits), rolls


@dataclass(frozen=True, slots=True)
class ProgramProgress:
    """Where a running program is."""

    name: str
    step: int
    """index of the running step"""
    steps: int
    loop: int
    """passes finished"""
    loops: int | None
    """None: for ever"""
    running: Program
    """the version that the running step belongs to"""
    coming: Program
    """the version that the next pass takes; another one after an edit"""
    calls: tuple[CalledStep, ...] = ()
    """where in the programs that the step calls, the outermost first; empty: it calls none"""
    part: Part = ""
    """what of a step that is made of others, such as "approach" of a pick"""

    @property
    def inside(self) -> str:
        """Where inside the step, in words; empty: it is not made of others."""
        return place(InStep(self.calls, self.part, Said("")))


@dataclass(frozen=True, slots=True)
class Message:
    """What the last ``message`` step of a program has told."""

    text: str
    number: int
    """each message has its own, so that a late OK is none to the next one"""
    waits: bool
    """the arm stands until somebody says OK (``ConfirmMessage``)"""


@dataclass(frozen=True, slots=True)
class AxisHoming:
    """Whether an axis knows where it is."""

    title: str
    homed: bool
    running: bool
    """it looks for its zero now"""


_ENDED = {
    "": "armctl ended without closing the arm",
    "moving": "armctl ended",
    "released": "the arm was released and may have dropped",
    "disconnected": "the arm was disconnected",
    "closed": "armctl was closed",
    "enabling": "armctl ended while its servos were being switched on",
    "fault": "a fault ended it",
}


@dataclass(frozen=True, slots=True)
class LastPose:
    """Where an arm was seen last, and what happened then."""

    q: FloatArray
    """(n,) [rad]"""
    gripper: float | None
    """opening 0..1; None: no gripper, or not known"""
    at: float
    """seconds since the epoch"""
    ended: str
    """released, disconnected, closed or fault; enabling, moving, or "" at rest: it did not end in order"""
    moving: bool = False
    """it was moving when it was last seen, or its servos were coming on: it may stand elsewhere"""
    tool: str = ""
    """name of the tool that was on; empty: the arm had none"""

    def __str__(self) -> str:
        """In words, with the angles in degrees."""
        angles = ", ".join(f"{angle:.1f}" for angle in (to_degrees(self.q) + 0.0).tolist()).replace("-", "−")
        when = datetime.fromtimestamp(self.at).strftime("%Y-%m-%d %H:%M")
        moving = " while it was moving, so it may stand elsewhere" if self.moving else ""
        tool = f", with the tool {self.tool}" if self.tool else ""
        return f"last seen at {angles}° on {when}{tool}{moving}; then {_ENDED.get(self.ended, self.ended)}"


@dataclass(frozen=True, slots=True)
class Party:
    """A page or a program."""

    id: str
    """what it calls itself in ``Origin.who``"""
    name: str
    """what people call it"""
    operates: bool = False


@dataclass(frozen=True, slots=True)
class WrongPins:
    """Who has guessed the teacher's PIN."""

    name: str
    """what it was called then"""
    source: str
    """where it came from, as the server knows it ("programs at 192.168.1.20"); empty: not known"""
    count: int
    """in the last hour"""


@dataclass(frozen=True, slots=True)
class Control:
    """Who is there, and who operates."""

    parties: tuple[Party, ...] = ()
    """in the order in which they came"""
    locked: bool = False
    """control cannot be taken from the operator"""
    by_teacher: bool = False
    """the lock was set with the teacher's PIN, and only that opens it"""
    pin: bool = False
    """there is a teacher's PIN"""
    wrong_pins: tuple[WrongPins, ...] = ()
    """who has guessed it in the last hour, the newest first (bounded)"""
    lent_to: str = ""
    """id of a party that commands beside the operator, such as a gamepad on its page; empty: none"""

    @property
    def operator(self) -> Party | None:
        """Who operates; None: whoever commands first."""
        return next((party for party in self.parties if party.operates), None)

    def party(self, id: str) -> Party | None:
        """A page or a program by its id."""
        return next((party for party in self.parties if party.id == id), None)

    def operates(self, id: str) -> bool:
        """Whether this one operates, or commands beside who does."""
        party = self.party(id)
        return party is not None and (party.operates or party.id == self.lent_to)

    def refusal(self, id: str) -> NotOperator | None:
        """Why this one may not command the arm; None: it may."""
        operator = self.operator
        if operator is not None:
            return None if id in (operator.id, self.lent_to) else NotOperator(operator.name)
        watches = self.party(id) is not None
        return NotOperator(locked=self.locked) if self.locked or watches else None


@dataclass(frozen=True, slots=True)
class Event:
    """One line of the log."""

    stamp: float
    """seconds since the epoch"""
    level: str
    """info, warning or error"""
    text: str
    about: str = ""
    """``TIMING``: the computer was late, and the arm needs nobody for that; else empty"""


TIMING = "timing"


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The arm as the controller knows it at one tick."""

    stamp: float
    """controller clock [s]"""
    tick: int
    state: State
    cause: str
    """why the state is what it is, in words"""
    q_command: FloatArray
    """(n,) last setpoint [rad]; where nothing was sent yet, the pose that Enable or homing would lead to"""
    commanded: bool
    """whether ``q_command`` was sent, or taken over; else it is only where the arm would go"""
    velocity_command: FloatArray
    """(n,) [rad/s]"""
    acceleration_command: FloatArray
    """(n,) [rad/s²]"""
    q: FloatArray
    """(n,) position that the board reports [rad]; NaN for a joint it does not know"""
    source: Source
    """what ``q`` is: commanded, transmitted or measured"""
    powered: bool
    """pulses or motors are on, as far as is known: also where the arm was not enabled"""
    gripper: float | None
    """commanded opening 0..1; None: no gripper, or not commanded yet"""
    speed: float
    """speed override 0.05..1"""
    program: ProgramProgress | None
    board: BoardIdentity | None
    homing: tuple[AxisHoming, ...]
    """every axis of a board that must be homed; empty where there is nothing to home"""
    warnings: tuple[str, ...]
    """what is true now and the user should know"""
    events: tuple[Event, ...]
    """the newest lines of the log, oldest first (bounded)"""
    control: Control = Control()
    """who is there, and who operates"""
    progress: float | None = None
    """share of the motion or program that runs that is over, 0 ... 1; None: none runs, or not known"""
    doing: Doing | None = None
    """what moves the arm; None: nothing"""
    busy: bool = False
    """the arm moves, or only its gripper, or it will as soon as that is planned"""
    last_pose: LastPose | None = None
    """where the arm was seen last on this board; None: not known, or a simulated board"""
    unreachable: bool = False
    """who says this is not the arm itself: its process is gone, or does not answer"""
    part_mm: tuple[float, float, float] | None = None
    """edges of the part that the gripper carries, along x, y and z of the tool [mm]; None: nothing"""
    quantities: Mapping[str, Quantities] = field(default_factory=dict[str, Quantities])
    """by title of a joint: load, temperature, voltage and current, as far as the board measures them"""
    limits: Mapping[str, QuantityLimits] = field(default_factory=dict[str, QuantityLimits])
    """by title: what they may come to"""
    levels: tuple[LevelPassed, ...] = ()
    """which of them are warned of, with their worst values"""
    inputs: Mapping[str, float] = field(default_factory=dict[str, float])
    """what the board's other pins are at, by name: 0, 1, or a share"""
    outputs: Mapping[str, float] = field(default_factory=dict[str, float])
    """what it drives beside the joints, likewise"""
    edges: Mapping[str, int] = field(default_factory=dict[str, int])
    """how often each digital input has changed since the board was connected"""
    scripted: tuple[str, ...] = ()
    """names of the inputs of a simulated board that follow a script"""
    limp: tuple[str, ...] = ()
    """titles of joints that were released by themselves, while the others hold"""
    message: Message | None = None
    """what a program has told last; None: nothing yet"""
    tool: str = ""
    """name of the tool that is on; empty: the robot file names none"""
    tool_unconfirmed: bool = False
    """nobody has said since the connection that it is this one: Enable waits for ``SetTool``"""
    told_by_cause: tuple[int, ...] = ()
    """indices of the ``warnings`` that ``cause`` tells, too"""
    awaited: tuple[int, ...] = ()
    """indices of those that only say what a program waits for: nothing is wrong"""
    stopped: Stopped | None = None
    """whose STOP is the cause of the state; None: nobody's"""
    stops: int = 0
    """rises with each STOP, also with one that finds the arm at rest"""
    last_stop: Stopped | None = None
    """whose the newest of these was"""

    def unmet(self, need: Need) -> NotNow | None:
        """Why what needs this of the arm would be refused now; None: it would not."""
        homed, connected = all(axis.homed for axis in self.homing), self.board is not None
        return unmet(need, self.state, connected=connected, homed=homed, doing=self.doing, limp=self.limp)

    @property
    def measured(self) -> dict[str, str]:
        """``quantities`` in words."""
        return {title: str(one) for title, one in self.quantities.items()}

    @property
    def more_warnings(self) -> tuple[str, ...]:
        """The warnings that ``cause`` does not tell already."""
        return tuple([text for k, text in enumerate(self.warnings) if k not in self.told_by_cause])


_TOLD = attrgetter(
    "state", "cause", "commanded", "source", "powered", "gripper", "part_mm", "speed", "progress", "board",
    "homing", "warnings", "levels", "control", "busy", "unreachable", "inputs", "outputs", "edges",
    "limp", "message", "tool", "tool_unconfirmed", "told_by_cause", "awaited", "stopped", "stops", "scripted",
)  # fmt: skip
_STILL_RAD = 1e-3
"""readings that differ by less are those of an arm that stands"""


def stands_as_before(snapshot: Snapshot, before: Snapshot) -> bool:
    """Whether the arm is at rest in both, and nothing is new but the time and what sensors waver."""
    if snapshot.busy or _TOLD(snapshot) != _TOLD(before):
        return False
    if snapshot.events is not before.events or snapshot.last_pose is not before.last_pose:
        return False
    if not np.array_equal(snapshot.q_command, before.q_command):
        return False
    pairs = zip(snapshot.q.tolist(), before.q.tolist(), strict=True)
    return all(abs(a - b) <= _STILL_RAD or (a != a and b != b) for a, b in pairs)  # not known: NaN


def printable(text: str) -> str:
    """Text without what a terminal would carry out; spaces stand in its place."""
    return "".join([letter if letter.isprintable() else " " for letter in text])

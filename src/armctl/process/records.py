"""What travels between the arm process and its clients: tagged records, as msgpack or JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Annotated, Any, Union, cast, get_args, get_origin

import msgspec
import numpy as np

from armctl.arrays import read_only
from armctl.errors import ArmctlError, InputError, ProgramError
from armctl.facts.words import fact_of, fact_record
from armctl.kinematics import Target
from armctl.kinematics.target import as_numbers
from armctl.process.trajectories import Motion, built, carried
from armctl.program import Program
from armctl.program.program import MOST_CALLED, MOST_STEPS
from armctl.protocol import (
    Arrive,
    Command,
    ControlCommand,
    Event,
    Follow,
    FollowTarget,
    Leave,
    MoveTo,
    RememberWrongPins,
    RunProgram,
    Snapshot,
    UpdateProgram,
)
from armctl.protocol.snapshot import printable
from armctl.robot.record import plain

MOST_BYTES = 8 * 1024 * 1024
"""of one record of who owns the arm: a program of the largest allowed number of steps is a quarter of it"""
MOST_OF_PROGRAM = 4 * 1024 * 1024
"""bytes of a client's program, or trajectory: 20,000 steps are 2.4 MiB, 100 s of samples 3"""
MOST_ELSE = 256 * 1024
"""bytes of a client's other records"""
_LONGEST_STEP = 16 * 1024
"""bytes of a step of a program"""
BEAT_S = 0.1
"""how often a client gives a sign of life"""
SILENCE_S = 0.9
"""A client that is silent for so long counts as lost. The server looks every 0.1 s: STOP comes within 1 s."""

Number = Annotated[int, msgspec.Meta(ge=-(2**53), le=2**53)]
"""that a client chooses, so that its answer can be told from others"""
_LONGEST_TEXT = 2000
"""letters of an error"""


class Record(msgspec.Struct, frozen=True, tag_field="type", tag=str.lower):
    """What is said in either direction; ``type`` names its kind."""


# From a client.


class Request(Record, frozen=True, forbid_unknown_fields=True):
    """What a client says."""


class Hello(Request, frozen=True):
    """The first record on a connection."""

    name: str = "program"
    """what people call it"""
    watch: bool = False
    """it does not want to operate the arm"""
    beats: bool = False
    """It gives ``Beat`` records itself; else that its line answers counts as a sign of life."""


class Trust(Request, frozen=True):
    """Ahead of ``Hello`` on the local socket: who knows the secret may speak for others, or end the arm."""

    secret: str
    relays: bool = False
    """what comes behind it is somebody else's, with no more rights than over the network"""
    source: str = ""
    """whose: which computer it comes from"""
    adopts: bool = False
    """takes over an arm process that nobody owns any more; else refused"""


class Ask(Request, frozen=True):
    """A command; answered by ``Answer`` records with its number."""

    id: Number
    command: Any
    """a ``Command``: decoded by its own tag"""
    who: str = ""
    """whom a trusted client speaks for; empty: itself"""
    note: str = ""
    source: str = ""
    """where whom it speaks for comes from"""


class _Asked(Ask, frozen=True, tag="ask"):
    """An ``Ask`` as it arrives: its command waits in its bytes until ``Codec.command`` decodes them."""

    command: msgspec.Raw


class Stop(Request, frozen=True):
    """STOP; answered when the arm is at rest."""

    id: Number
    who: str = ""
    note: str = ""


class Beat(Request, frozen=True):
    """A sign of life."""


class End(Request, frozen=True):
    """Bring the arm to rest, close the line and end the arm process."""


class Recall(Request, frozen=True):
    """Give the last minute; answered by ``Recalled``."""

    id: Number


class Locate(Request, frozen=True):
    """Say where the simulated board is served; answered by ``Located``. For who owns the arm."""

    id: Number


FromClient = Trust | Hello | Ask | Stop | Beat | End | Recall | Locate


# From the arm process.


class Welcome(Record, frozen=True):
    """The answer to ``Hello``."""

    version: str
    you: str
    """the id that ``Snapshot.control`` knows this client by"""
    robot: Any
    """the arm as it is calibrated, see ``robot_of``"""
    silence_s: float = SILENCE_S
    """a client that is silent for longer while the arm moves at its command is lost, and the arm stops"""


class Seen(Record, frozen=True):
    """The arm at a tick; its log and its programs come apart from it, when they change."""

    snapshot: Snapshot


class Logged(Record, frozen=True):
    """New lines of the log, oldest first."""

    events: tuple[Event, ...]


class Running(Record, frozen=True):
    """The program that runs from the next ``Seen`` on, and the version that its next pass takes."""

    running: Program
    coming: Program


class Answer(Record, frozen=True):
    """What became of a command: it has begun (``accepted``), or is over (``finished``)."""

    id: int
    accepted: bool = False
    finished: bool = False
    error: str = ""
    """why it was refused, stopped or broken, in words; empty: it was not"""
    kind: str = ""
    """of the error, as the classes in ``armctl.errors``"""
    reason: dict[str, Any] = msgspec.field(default_factory=dict[str, Any])
    """why, as data: ``fact``, as the classes in ``armctl.facts``, and its fields; empty: words only"""


class Recalled(Record, frozen=True):
    """The last minute, as the file of a black box."""

    id: int
    content: bytes


class Located(Record, frozen=True):
    """Where it is served."""

    id: int
    port: str


class Refused(Record, frozen=True):
    """A record that is none; the connection is closed behind it."""

    error: str


FromArm = Welcome | Seen | Logged | Running | Answer | Recalled | Located | Refused


# Encoding and decoding.


def _arrived(kind: type, value: Any) -> Any:
    """Lists as arrays, curves as trajectories."""
    if get_origin(kind) is np.ndarray or kind is np.ndarray:
        if isinstance(value, list):
            value = [math.nan if one is None else one for one in cast("list[object]", value)]
        try:
            return read_only(as_numbers(value, "this"))
        except InputError as cause:  # msgspec says where
            raise ValueError(str(cause)) from cause
    raise NotImplementedError(f"a {kind} does not travel")


def _all_kinds(kind: type[Any]) -> list[type[Any]]:
    return [kind, *(one for derived in kind.__subclasses__() for one in _all_kinds(derived))]


def commands() -> tuple[type[Command], ...]:
    """Every kind of command."""
    return tuple(kind for kind in _all_kinds(Command) if not kind.__subclasses__())


HOUSE = Arrive, Leave, RememberWrongPins
"""commands of the house alone: the page server gives them for its pages, the arm process for its clients"""


def asked_of_clients() -> tuple[type[Command], ...]:
    """Every kind of command that a client may send."""
    return tuple(kind for kind in commands() if kind not in HOUSE)


def tag_of(kind: type[Command]) -> str:
    """What names a kind of command in a record."""
    return str(kind.__struct_config__.tag)


_PROGRAMS = frozenset(map(tag_of, (RunProgram, UpdateProgram)))
_AIMED = frozenset(map(tag_of, (MoveTo, FollowTarget)))
CONTROL = frozenset(tag_of(kind) for kind in commands() if issubclass(kind, ControlCommand))
"""tags of the commands that are everybody's"""
BIG = _PROGRAMS | {tag_of(Follow)}
"""tags of the commands that may be larger than ``MOST_ELSE``"""


class _Tagged(msgspec.Struct):
    """As much of a command as tells its kind; the rest is passed over."""

    command: str


class _Steps(msgspec.Struct):
    steps: list[msgspec.Raw] = []
    called: Annotated[list[_Steps], msgspec.Meta(max_length=MOST_CALLED)] = []


class _WithProgram(msgspec.Struct):
    program: _Steps


class _Followed(
    msgspec.Struct, frozen=True, tag_field="command", tag=tag_of(Follow), forbid_unknown_fields=True
):
    """A ``Follow`` as it arrives: its trajectory as numbers."""

    trajectory: Motion
    motion: str = ""


class Codec:
    """Records to bytes and back, as msgpack or as JSON; a connection uses one."""

    def __init__(self, *, json: bool = False, house: bool = True) -> None:
        """``house``: it reads the commands of the house, too."""
        self.json, self.house = json, house
        wire: Any = msgspec.json if json else msgspec.msgpack
        self._encode = wire.Encoder(enc_hook=plain).encode
        arriving: Any = Union[tuple(_Asked if kind is Ask else kind for kind in get_args(FromClient))]  # noqa: UP007
        self._from_client = wire.Decoder(arriving).decode
        self._from_arm = wire.Decoder(FromArm, dec_hook=_arrived).decode
        kinds = commands() if house else asked_of_clients()
        self._tags = frozenset(map(tag_of, kinds))
        self._commands: Any = Union[tuple(_Followed if kind is Follow else kind for kind in kinds)]  # noqa: UP007
        self._command = wire.Decoder(self._commands, dec_hook=_arrived).decode
        self._tagged = wire.Decoder(_Tagged).decode
        self._with_program = wire.Decoder(_WithProgram).decode
        self._anything = wire.Decoder().decode

    @classmethod
    def of(cls, data: bytes, *, house: bool = False) -> Codec:
        """The one that a client speaks whose first record this is."""
        return _codec(is_json(data), house)

    def encode(self, record: Record | Mapping[str, object]) -> bytes:
        """A record as bytes, or the arm itself (``robot_record``)."""
        if isinstance(record, Ask) and isinstance(record.command, Follow):
            motion: Any = carried(record.command.trajectory)
            command = msgspec.structs.replace(record.command, trajectory=motion)
            record = msgspec.structs.replace(record, command=command)
        return self._encode(record)

    def from_client(self, data: bytes | str) -> FromClient:
        """What a client says, the command of an ``Ask`` aside; ``InputError`` says what is wrong with it."""
        try:
            return self._from_client(data)
        except (msgspec.MsgspecError, UnicodeError, RecursionError) as cause:
            raise InputError(f"a record that cannot be read: {cause}") from cause

    def kind(self, record: Ask) -> str:
        """The tag of the command of an ``Ask``, which is not decoded; ``InputError``: it is no command."""
        try:
            tag = self._tagged(record.command).command
        except (msgspec.MsgspecError, UnicodeError, RecursionError) as cause:
            raise InputError(f"a command that cannot be read: {cause}") from cause
        if tag not in self._tags:
            raise InputError(f"a command that cannot be read: Invalid value '{printable(tag[:40])}'")
        return tag

    def command(self, record: Ask) -> Command:
        """The command of an ``Ask``, every value checked; ``ArmctlError`` says what is wrong with it."""
        tag = self.kind(record)
        try:
            if tag in _PROGRAMS:
                self._count_steps(record)
            try:
                command = self._command(record.command)
            except msgspec.ValidationError:  # unless its target is an object
                if tag not in _AIMED:
                    raise
                positional = _positional(self._anything(record.command))
                command = msgspec.convert(positional, self._commands, dec_hook=_arrived)
            if isinstance(command, _Followed):
                command = Follow(built(command.trajectory), motion=command.motion)
        except (msgspec.MsgspecError, ValueError, TypeError, OverflowError, RecursionError) as cause:
            raise InputError(f"a command that cannot be read: {cause}") from cause
        return _checked(command)

    def _count_steps(self, record: Ask) -> None:
        """Refuse (``ProgramError``) more steps, or a larger one, than a program has; none is decoded."""
        program = self._with_program(record.command).program
        for steps in (program.steps, *(one.steps for one in program.called)):
            if len(steps) > MOST_STEPS:
                raise ProgramError(f"it has {len(steps)} steps; a program has {MOST_STEPS} at most")
            for k, step in enumerate(steps, 1):
                if len(bytes(step)) > _LONGEST_STEP:
                    raise ProgramError(f"step {k} is larger than {_LONGEST_STEP >> 10} KiB; no step is")

    def from_arm(self, data: bytes | str) -> FromArm:
        """What the arm process says; ``InputError`` where it is of another version."""
        try:
            return self._from_arm(data)
        except msgspec.MsgspecError as cause:
            raise InputError(f"the arm process speaks another version of this program: {cause}") from cause


def is_json(data: bytes) -> bool:
    """Whether a record is JSON; else it is msgpack."""
    return data.lstrip()[:1] == b"{"


@cache
def _codec(json: bool, house: bool) -> Codec:
    """One for all connections that speak alike: making it takes longer than a small record."""
    return Codec(json=json, house=house)


def _positional(command: object) -> object:
    """A command whose target may be an object, e.g. ``{"point": [0.2, 0, 0.1], "pitch": 0}``."""
    if not isinstance(command, dict):
        return command
    values = cast("dict[str, object]", command)
    if not isinstance(values.get("target"), dict):
        return values
    target = cast("dict[str, object]", values["target"])
    unknown = [key for key in target if key not in Target._fields]
    if unknown or "point" not in target:
        what = f"has no {unknown[0]!r}" if unknown else "needs a point"
        raise InputError(f"a target {what}; it is made of {', '.join(Target._fields)}")
    return {**values, "target": [target.get(name) for name in Target._fields]}


def _checked(command: Command) -> Command:
    """A command as its own constructors would have made it: what msgspec's types do not say."""
    changes: dict[str, Any] = {}
    for name in command.__struct_fields__:
        value = getattr(command, name)
        if isinstance(value, Target):
            changes[name] = Target.of(value.point, value.pitch, value.roll, value.rotation)
        elif isinstance(value, float) and not math.isfinite(value):
            raise InputError(f"{name} must be a finite number, got {value}")
    return msgspec.structs.replace(command, **changes) if changes else command


# Errors keep their class where a program may catch it.

_ERRORS = {
    kind.__name__: kind for kind in _all_kinds(ArmctlError) if kind.__module__ == ArmctlError.__module__
}


def in_short(error: BaseException) -> str:
    """Its message; what quotes a value of the client's may be of any length."""
    text = str(error)
    return text if len(text) <= _LONGEST_TEXT else f"{text[:_LONGEST_TEXT]} …"


def answer(number: int, error: BaseException | None, *, accepted: bool = False) -> Answer:
    """What became of a command."""
    if error is None:
        return Answer(number, accepted=accepted, finished=not accepted)
    kind = next((one.__name__ for one in type(error).__mro__ if one.__name__ in _ERRORS), "ArmctlError")
    reason = fact_record(error.reason) if isinstance(error, ArmctlError) else {}
    if len(repr(reason)) > 2 * _LONGEST_TEXT:  # what quotes a value of the client's
        reason = {}
    return Answer(number, accepted, not accepted, in_short(error), kind, reason)


def error_of(record: Answer) -> ArmctlError | None:
    """The error that an answer tells of; its words are made here, in this reader's language."""
    if not record.error:
        return None
    return _ERRORS.get(record.kind, ArmctlError)(fact_of(record.reason) or record.error)


def new_events(events: tuple[Event, ...], told: Event | None) -> tuple[Event, ...]:
    """Those behind the one that was told last."""
    start = next((k for k in range(len(events), 0, -1) if events[k - 1] is told), 0)
    return events[start:]

"""Serial motion: a named list of steps that the arm runs once, N times or for ever."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, Self, get_args

import msgspec
from msgspec import Meta

from armctl.errors import InputError, ProgramError
from armctl.motion.paths.tool_path import PitchMode
from armctl.motion.profiles import ProfileName

Percent = Annotated[float, Meta(ge=0, le=100)]
LONGEST_WAIT_S = 86_400
Seconds = Annotated[float, Meta(ge=0, le=LONGEST_WAIT_S)]
MOST_REPEATS = 1_000_000
SLOWEST_PERCENT = 5
WIDEST_BLEND_MM = 1000


class _Step(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", kw_only=True):
    """What all steps share; in the file, ``do`` names the kind."""

    note: str = ""


class _Motion(_Step, frozen=True, kw_only=True):
    """What all moving steps share."""

    duration_s: Seconds | None = None
    """None: as fast as the limits allow"""
    blend_mm: Annotated[float, Meta(ge=0, le=WIDEST_BLEND_MM)] = 0.0
    """how far from its end the tool may begin to turn off towards the next step; 0: it stops there"""


class MoveStep(_Motion, frozen=True, kw_only=True, tag="move"):
    """Go to joint angles [degrees], in the order of the robot's joints."""

    joints_deg: tuple[float, ...]
    profile: ProfileName = "cubic"


class PointStep(_Motion, frozen=True, kw_only=True, tag="point"):
    """Put the tool on a point [mm] by inverse kinematics, joint by joint."""

    x_mm: float
    y_mm: float
    z_mm: float
    pitch_deg: float | None = None
    roll_deg: float | None = None
    choose: str = "least-rotation"
    profile: ProfileName = "cubic"


class LineStep(_Motion, frozen=True, kw_only=True, tag="line"):
    """Lead the tool to a point [mm] in a straight line, on the branch the arm is on."""

    x_mm: float
    y_mm: float
    z_mm: float
    pitch: PitchMode = "kept"
    pitch_deg: float | None = None
    """tool pitch at the end; only with pitch = "interpolated", and needed there"""
    speed_mm_s: Annotated[float, Meta(gt=0)] | None = None
    """largest speed of the tool; None: as fast as the limits allow"""


class ArcStep(_Motion, frozen=True, kw_only=True, tag="arc"):
    """Lead the tool along a circular arc through a point to another [mm], on the branch the arm is on."""

    via_x_mm: float
    via_y_mm: float
    via_z_mm: float
    x_mm: float
    y_mm: float
    z_mm: float
    pitch: PitchMode = "kept"
    pitch_deg: float | None = None
    """as in a line"""
    speed_mm_s: Annotated[float, Meta(gt=0)] | None = None


class WaitStep(_Step, frozen=True, kw_only=True, tag="wait"):
    """Stand still."""

    seconds: Seconds


class GripperStep(_Step, frozen=True, kw_only=True, tag="gripper"):
    """Open the gripper to a percentage: 0 closed, 100 open."""

    open_percent: Percent


class SpeedStep(_Step, frozen=True, kw_only=True, tag="speed"):
    """Run the steps after it at a percentage of their speed, on top of the operator's override."""

    percent: Annotated[float, Meta(ge=SLOWEST_PERCENT, le=100)]


class RepeatStep(_Step, frozen=True, kw_only=True, tag="repeat"):
    """Run the steps as far as the matching ``end`` several times."""

    times: Annotated[int, Meta(ge=1, le=MOST_REPEATS)]


class EndStep(_Step, frozen=True, kw_only=True, tag="end"):
    """End of the block that the last open ``repeat`` began."""


class CommentStep(_Step, frozen=True, kw_only=True, tag="comment"):
    """Nothing: its note is for people."""


MotionStep = MoveStep | PointStep | LineStep | ArcStep
Step = MotionStep | WaitStep | GripperStep | SpeedStep | RepeatStep | EndStep | CommentStep


_DEFAULTS: dict[type, dict[str, object]] = {
    kind: {field.name: field.default for field in msgspec.structs.fields(kind)} for kind in get_args(Step)
}


def defaults_of(step: Step) -> Mapping[str, object]:
    """Every key of a step's kind and its default, or ``msgspec.NODEFAULT``."""
    return _DEFAULTS[type(step)]


def kind_of(step: Step) -> str:
    """What a step's ``do`` says in the file."""
    return str(step.__struct_config__.tag)


class Program(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A program, as written in its file."""

    format: Literal[1] = 1
    robot: str
    name: str = "untitled"
    steps: tuple[Step, ...] = ()


# Which ``repeat`` belongs to which ``end``.

_OUTSIDE = -1


@dataclass(frozen=True, slots=True)
class Blocks:
    """The repeat blocks of a program whose markers match."""

    _partners: dict[int, int]
    """index of a marker to that of the one it belongs to, both ways"""
    _parents: Sequence[int]
    """for each step the index of the innermost ``repeat`` around it; a block's own markers lie outside"""
    _depths: Sequence[int]

    @classmethod
    def of(cls, program: Program) -> Self:
        """Match the markers of a program.

        Raises:
            ProgramError: a ``repeat`` without an ``end`` or the reverse; names the first such step.
        """
        found = block_findings(program)
        if found:
            index, what = found[0]
            raise ProgramError(f"step {index + 1}: {what}")
        partners, parents, depths, _ = _scan(program.steps)
        return cls(partners, parents, depths)

    def partner(self, index: int) -> int | None:
        """Index of the marker that belongs to the one at ``index``; None for any other step."""
        return self._partners.get(index)

    def depth(self, index: int) -> int:
        """How many blocks are around a step; 0: none. A block's markers are as deep as what is around it."""
        return self._depths[index]

    def around(self, index: int) -> list[int]:
        """Indices of the ``repeat`` steps that the step lies in, the outermost first.

        An ``end`` lies in the block that it ends, so that a run that begins there goes on with the next pass.
        """
        inner = self._partners[index] if self._partners.get(index, index) < index else self._parents[index]
        found: list[int] = []
        while inner != _OUTSIDE:
            found.append(inner)
            inner = self._parents[inner]
        return found[::-1]


def block_findings(program: Program) -> list[tuple[int, str]]:
    """What is wrong with a program's blocks: (index of the step, what), in the order of the steps."""
    return _scan(program.steps)[3]


def depths_of(steps: Sequence[Step]) -> list[int]:
    """How many blocks are around each step, also where markers do not match."""
    return _scan(steps)[2]


def partner_of(steps: Sequence[Step], index: int) -> int | None:
    """Index of the marker that belongs to the one at ``index``; None where there is none."""
    return _scan(steps)[0].get(index)


def _scan(steps: Sequence[Step]) -> tuple[dict[int, int], list[int], list[int], list[tuple[int, str]]]:
    partners: dict[int, int] = {}
    parents: list[int] = []
    depths: list[int] = []
    findings: list[tuple[int, str]] = []
    open_blocks: list[int] = []
    for index, step in enumerate(steps):
        if isinstance(step, EndStep):
            if open_blocks:
                begin = open_blocks.pop()
                partners[begin], partners[index] = index, begin
            else:
                findings.append((index, "'end' without a 'repeat' before it; delete it, or add the 'repeat'"))
        parents.append(open_blocks[-1] if open_blocks else _OUTSIDE)
        depths.append(len(open_blocks))
        if isinstance(step, RepeatStep):
            open_blocks.append(index)
    findings += [
        (index, "this 'repeat' has no 'end'; add one behind the last step to repeat") for index in open_blocks
    ]
    return partners, parents, depths, sorted(findings)


# Editing a program: pure functions, each gives a new program.


def insert(program: Program, index: int, step: Step) -> Program:
    """``step`` before the step that is now at ``index``; at ``len(steps)`` it is appended.

    Raises:
        ProgramError: no such place.
    """
    if not 0 <= index <= len(program.steps):
        raise ProgramError(f"a step cannot be inserted at {index + 1}; the program has {_size(program)}")
    return _with(program, (*program.steps[:index], step, *program.steps[index:]))


def replace(program: Program, index: int, step: Step) -> Program:
    """``step`` instead of the one at ``index``.

    Raises:
        ProgramError: no such step.
    """
    _check(program, index)
    return _with(program, (*program.steps[:index], step, *program.steps[index + 1 :]))


def delete(program: Program, index: int) -> Program:
    """Without the step at ``index``; one marker of a block takes the other with it, what it repeated stays.

    Raises:
        ProgramError: no such step.
    """
    _check(program, index)
    gone = {index, partner_of(program.steps, index)}
    return _with(program, tuple(step for i, step in enumerate(program.steps) if i not in gone))


def duplicate(program: Program, index: int) -> Program:
    """With a copy of the step at ``index`` behind it; of a block's marker, the whole block behind its end.

    Raises:
        ProgramError: no such step.
    """
    _check(program, index)
    partner = partner_of(program.steps, index)
    first, last = sorted((index, index if partner is None else partner))
    copied = program.steps[first : last + 1]
    return _with(program, (*program.steps[: last + 1], *copied, *program.steps[last + 1 :]))


def repeat(program: Program, first: int, last: int, times: int) -> Program:
    """With the steps ``first`` ... ``last`` in a block that runs ``times`` times.

    Raises:
        ProgramError: no such steps, a number of times that cannot be, or a range that cuts another block.
    """
    _check(program, first)
    _check(program, last)
    if last < first:
        raise ProgramError(f"a block cannot go from step {first + 1} back to step {last + 1}")
    if not 1 <= times <= MOST_REPEATS:
        raise ProgramError(f"a block repeats 1 … {MOST_REPEATS} times, not {times}")
    blocks = Blocks.of(program)
    for index in range(first, last + 1):
        partner = blocks.partner(index)
        if partner is not None and not first <= partner <= last:
            begin, end = sorted((index, partner))
            raise ProgramError(
                f"steps {first + 1} … {last + 1} cut the block of steps {begin + 1} … {end + 1}; "
                "take all of it, or none"
            )
    steps = program.steps
    inside = steps[first : last + 1]
    return _with(program, (*steps[:first], RepeatStep(times=times), *inside, EndStep(), *steps[last + 1 :]))


def move(program: Program, index: int, to: int) -> Program:
    """The step at ``index`` taken out and put back so that it ends up at ``to``.

    Raises:
        ProgramError: no such step or no such place.
    """
    _check(program, index)
    _check(program, to)
    steps = list(program.steps)
    steps.insert(to, steps.pop(index))
    return _with(program, tuple(steps))


def _check(program: Program, index: int) -> None:
    if not 0 <= index < len(program.steps):
        raise ProgramError(f"there is no step {index + 1}; the program has {_size(program)}")


def _size(program: Program) -> str:
    count = len(program.steps)
    return "1 step" if count == 1 else f"{count} steps"


def _with(program: Program, steps: tuple[Step, ...]) -> Program:
    return msgspec.structs.replace(program, steps=steps)


# The steps of a program in the order in which they are executed.


class Cursor:
    """Where one pass of a program is; repeats are counted, never written out.

    Only steps that do something are handed out: not comments, nor the markers of blocks. Blocks without
    such a step are passed over whole, however often they are to be repeated. A copy has one counter for
    each open block of its own and shares the rest.
    """

    def __init__(self, program: Program, first: int = 0) -> None:
        """Stand before a step.

        Args:
            program: whose steps.
            first: index of the step to begin with. Inside a block, this is the first of the block's
                passes; on its ``end``, that pass is over at once.

        Raises:
            ProgramError: a ``repeat`` without ``end`` or the reverse; names the step.
            InputError: no such step.
        """
        steps = program.steps
        blocks = Blocks.of(program)
        if not 0 <= first < max(len(steps), 1):
            raise InputError(f"{program.name} has no step {first + 1}; it has {len(steps)}")
        self._steps = steps
        self._blocks = blocks
        self._goals = _goals(steps, blocks)
        self._next = self._goals[first]
        self._left: list[int] = []
        """passes still to be begun or under way, for each open block, the outermost first"""
        for begin in blocks.around(first) if steps else ():
            step = steps[begin]
            if isinstance(step, RepeatStep) and self._goals[begin] == begin:
                self._left.append(step.times)

    def copy(self) -> Self:
        """Another cursor at the same place."""
        twin = object.__new__(type(self))
        twin._steps, twin._blocks, twin._goals = self._steps, self._blocks, self._goals
        twin._next = self._next
        twin._left = self._left.copy()
        return twin

    def next(self) -> tuple[int, Step] | None:
        """Index and step of what is executed next; None at the end of the pass, and from then on."""
        while self._next < len(self._steps):
            index = self._next
            step = self._steps[index]
            following = index + 1
            if isinstance(step, RepeatStep):
                self._left.append(step.times)
            elif isinstance(step, EndStep):
                self._left[-1] -= 1
                if self._left[-1] > 0:
                    following = (self._blocks.partner(index) or 0) + 1
                else:
                    self._left.pop()
            else:
                self._next = self._goals[following]
                return index, step
            self._next = self._goals[following]
        return None


def _goals(steps: Sequence[Step], blocks: Blocks) -> list[int]:
    """(steps + 1) From each place, the next step that does something or belongs to a block that does."""
    goals = [len(steps)] * (len(steps) + 1)
    acting = _acting(steps)
    for index in range(len(steps) - 1, -1, -1):
        partner = blocks.partner(index)
        begin, end = (index, index) if partner is None else sorted((index, partner))
        idle = isinstance(steps[index], CommentStep) or (partner is not None and acting[begin] == acting[end])
        goals[index] = goals[index + 1] if idle else index
    return goals


def _acting(steps: Sequence[Step]) -> list[int]:
    """For each place, how many steps before it do something."""
    counts: list[int] = []
    count = 0
    for step in steps:
        counts.append(count)
        count += not isinstance(step, CommentStep | RepeatStep | EndStep)
    return counts

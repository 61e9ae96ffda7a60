"""What all steps of a program share, and what one does when it runs, beside moving joints."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Protocol, Self, cast, get_args, get_type_hints

import msgspec
import numpy as np
from msgspec import Meta, inspect

from armctl.arrays import FloatArray
from armctl.errors import ProgramError
from armctl.facts import Part, Quantities, Reason
from armctl.lazy_dataclass import dataclass
from armctl.motion.blend import Leg
from armctl.motion.one_sided import ONE_SIDED, OneSided, one_sided_stops
from armctl.motion.plan import plan_joints, plan_path, plan_through
from armctl.motion.polynomial import PiecewisePolynomial
from armctl.motion.preflight import require_clear
from armctl.motion.profiles import NOWHERE, PointToPoint, ProfileName
from armctl.motion.trajectory import Trajectory
from armctl.robot import CarriedPart, Robot

# The keys of a kind of step, as files, forms, tables and scripts need them.


@dataclass(frozen=True, slots=True)
class Field:
    """What people and other programs see of one key of a step."""

    label: str
    """of its field in the form; keys with the same label share one"""
    hint: str = ""
    place: int = 50
    """among the fields of the form and the columns of a CSV, from the left"""
    head: str = ""
    """of its CSV column, with the unit; empty: the key's name"""
    choices: tuple[str, ...] = ()
    """what the form offers where the key takes any text, or may be left open"""
    left_open: str = ""
    """what the form shows of a choice that is left open: what it means then"""
    turn: Literal["", "pitch", "orientation"] = ""
    """what of the tool's turn it is about; a step says something of its pitch or of its orientation"""
    offers: Literal["", "programs", "drawings", "inputs", "outputs", "watched", "joints", "tools"] = ""
    """of a name: what the form offers, where there are any"""
    of_watched: tuple[str, ...] = ()
    """what a step has to watch for the form to show the field; empty: it is always shown"""
    touched: bool = False
    """of X, Y and Z: the form can put the place there at which the tool is"""
    a_joint: bool = False
    """of numbers: one for each joint"""
    more: bool = False
    """seldom needed: the form folds it away"""


KeyForm = Literal["number", "integer", "numbers", "text", "choice"]
_FORMS: dict[type[inspect.Type], KeyForm] = {
    inspect.LiteralType: "choice",
    inspect.FloatType: "number",
    inspect.IntType: "integer",
    inspect.VarTupleType: "numbers",
}


@dataclass(frozen=True, slots=True)
class Key:
    """One key of a kind of step."""

    name: str
    field: Field
    form: KeyForm
    choices: tuple[str, ...]
    optional: bool
    """it may be left open"""
    default: object
    """``msgspec.NODEFAULT`` where it must be given"""
    head: str
    """of its CSV column"""


@cache
def keys_of(kind: type[msgspec.Struct]) -> tuple[Key, ...]:
    """The keys of a kind of step, in the order of their fields and columns."""
    hints = get_type_hints(kind, include_extras=True)
    keys: list[Key] = []
    for one in cast("inspect.StructType", inspect.type_info(kind)).fields:
        plain, *extras = get_args(hints[one.name]) or (hints[one.name],)
        shown = next((extra for extra in extras if isinstance(extra, Field)), Field(one.name))
        types = one.type.types if isinstance(one.type, inspect.UnionType) else (one.type,)
        optional = any(isinstance(part, inspect.NoneType) for part in types)
        form = "choice" if shown.choices else _FORMS.get(type(types[0]), "text")
        choices = shown.choices or (get_args(plain) if form == "choice" else ())
        keys.append(Key(one.name, shown, form, choices, optional, one.default, shown.head or one.name))
    return tuple(sorted(keys, key=lambda key: key.field.place))


def literal(value: object) -> str:
    """A value as Python writes it; of the plain types only: a subclass may show itself as anything."""
    match value:
        case bool() | int() | None:
            return repr(value)
        case float():
            return repr(float(value))
        case list() | tuple():
            return f"[{', '.join(map(literal, cast('Sequence[object]', value)))}]"
        case _:
            return repr(str(value))


LONGEST_WAIT_S = 86_400
WIDEST_BLEND_MM = 1000
FASTEST = "Empty: as fast as the limits allow."
"""hint of a time and of a speed"""
Seconds = Annotated[float, Meta(ge=0, le=LONGEST_WAIT_S)]
_BLEND_HINT = "How far from its end the tool may turn off to the next step."


@dataclass(frozen=True, slots=True)
class Senses:
    """What the board measures and sees at one moment."""

    quantities: Mapping[str, Quantities]
    """by title of a joint, and by its name; the gripper's name is ``gripper``"""
    inputs: Mapping[str, float]
    """by name: 0, 1, or a share"""
    edges: Mapping[str, int] = field(default_factory=dict[str, int])
    """by name of a digital input, how often it has changed since the program began, or was waited for"""
    counters: Mapping[str, int] = field(default_factory=dict[str, int])
    """by name, what the program has counted in this pass; 0 where it has not"""
    confirmed: bool = False
    """a person has pressed OK to the message that waits"""

    @classmethod
    def of(
        cls,
        robot: Robot,
        quantities: Mapping[str, Quantities],
        inputs: Mapping[str, float],
        edges: Mapping[str, int] | None = None,
        counters: Mapping[str, int] | None = None,
    ) -> Senses:
        """What a board says of an arm; ``quantities`` by title, as it tells them."""
        names = {joint.title: joint.name for joint in robot.joints}
        if robot.gripper is not None:
            names[robot.gripper.title] = "gripper"
        named = {names[title]: one for title, one in quantities.items() if title in names}
        return cls({**named, **quantities}, inputs, edges or {}, counters or {})


@dataclass(frozen=True, slots=True)
class Until:
    """What a step waits for."""

    what: str
    """in words: "the load of Elbow above 40 %\""""
    holds: Callable[[Senses], bool]
    """whether it has come; asked once a tick, so it must be quick"""
    longest_s: float
    """the program ends with an error where it has not come by then"""
    goes_on: bool = False
    """… or goes on, and the log says so"""
    uses: str = ""
    """name of an input whose edges count as seen when this is over"""
    by_person: bool = False
    """a person brings it about, by OK to the message of the step"""

    def __post_init__(self) -> None:
        if not self.longest_s > 0.0:
            raise ProgramError(
                f"waiting for {self.what}: at most {self.longest_s:g} s is no time; more than 0"
            )


class Question(Protocol):
    """What a step asks at the moment it runs: it decides which step comes next."""

    @property
    def uses(self) -> str:
        """Name of an input whose edges count as seen where it holds; empty: none."""
        ...

    def holds(self, senses: Senses) -> bool:
        """The answer."""
        ...


class Counting(Protocol):
    """What becomes of a counter."""

    @property
    def adds(self) -> bool:
        """It adds; else it sets."""
        ...

    @property
    def counter(self) -> str:
        """Its name."""
        ...

    def after(self, value: int) -> int:
        """What it is after ``value``."""
        ...


@dataclass(frozen=True, slots=True)
class Effect:
    """What a step does; of one that moves joints only ``says`` counts."""

    wait_s: float | None = None
    """the joints stand so long"""
    opening: float | None = None
    """where the gripper goes, 0..1; the joints stand meanwhile"""
    part: CarriedPart | None = None
    """what is between its jaws from then on; None: nothing"""
    until: Until | None = None
    """the joints stand until this holds"""
    output: tuple[str, float] | None = None
    """the output that is switched, and to what; the joints stand while that is done"""
    percent: float | None = None
    """speed of the steps after it, on top of the operator's override"""
    asks: Question | None = None
    """which step comes next is decided when this one runs; the joints stand until then"""
    counts: Counting | None = None
    """the counter that changes"""
    tool: str = ""
    """name of the tool that is on from then on; the joints stand while it is changed; empty: as before"""
    message: str = ""
    """what the person is told when it begins: on all pages, on the terminal, in the log; empty: nothing"""
    says: str = ""
    """what the log says when it begins; empty: nothing"""

    @property
    def stands(self) -> bool:
        """The joints stand while it lasts."""
        holding = (self.wait_s, self.opening, self.until, self.output, self.asks, self.tool or None)
        return any(one is not None for one in holding)


class Step(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="do", kw_only=True):
    """What all steps share; in the file, ``do`` names the kind."""

    acts: ClassVar[bool] = True
    """it is executed; comments and most markers of blocks are not"""
    divides: ClassVar[bool] = False
    """it divides a block: what is behind it runs if what is ahead of it does not"""
    closes: ClassVar[bool] = False
    """it ends a block"""
    words: ClassVar[str] = ""
    """its values for the list, as a format of the step ``{0}``"""
    call: ClassVar[tuple[str, ...]] = ()
    """the method of ``Arm`` that does the same, and the keys that are its arguments"""
    button: ClassVar[tuple[str, ...]] = ()
    """group and name by which it is put on the list, and the keys that need a value then; empty: not alone"""
    handles: ClassVar[bool] = False
    """it takes a part, or lets it go: by the gripper, or by an output"""
    icon: ClassVar[str] = "step"
    """name of its picture in the list (``ui/tabs/manual/program_row.py``)"""
    note: Annotated[str, Field("Note", place=99)] = ""

    @property
    def kind(self) -> str:
        """What ``do`` says in the file."""
        return str(self.__struct_config__.tag)

    @property
    def title(self) -> str:
        """Its kind as the menu of new steps names it: in the list, on the terminal."""
        group, label, *_ = self.button or ("", self.kind)
        return label.removeprefix(f"{group} ").lower()

    @property
    def effect(self) -> Effect:
        """What it does besides moving joints."""
        return Effect()

    @property
    def calls(self) -> str:
        """The program that it runs, as it names it; empty: none."""
        return ""

    @property
    def parts(self) -> Sequence[tuple[Part, Step]]:
        """The steps that it is made of, in order, each with what it is for; empty: it is one itself."""
        return ()

    @property
    def in_cell(self) -> bool:
        """Its points are given in the frame of a cell of a grid."""
        return False

    def moved(self, T: FloatArray) -> Step:
        """The same in another frame, in which that of its points is at ``T`` (4, 4) [mm]."""
        return self

    def describe(self) -> str:
        """Its values in words, for the list."""
        return self.words.format(self)

    def found_from(self, folder: Path) -> Self:
        """The same where the files that it names are looked for in a folder: that of its program."""
        return self

    def seen_from(self, folder: Path) -> Self:
        """The same as a program in a folder names its files."""
        return self

    def check(self, robot: Robot) -> None:
        """Raise what can be refused without planning; the ranges of its values are checked already."""

    def script(self) -> str:
        """The call of ``Arm`` that does the same, as Python; a ProgramError where there is none."""
        if not self.call:
            raise ProgramError(f"no call of Arm does what a {self.kind!r} step does")
        name, *keys = self.call
        return f"{name}({self._arguments(keys)})"

    def _arguments(self, names: Sequence[str]) -> str:
        """Keys as arguments. One that is as by default is left out; the only one needed has no name."""
        defaults = {key.name: key.default for key in keys_of(type(self))}
        needed = [name for name in names if defaults.get(name) is msgspec.NODEFAULT]
        parts: list[str] = []
        for name in names:
            value: object = getattr(self, name)
            if needed == [name]:
                parts.append(literal(value))
            elif value != defaults.get(name):
                parts.append(f"{name}={literal(value)}")
        return ", ".join(parts)


class BlockStep(Step, frozen=True, kw_only=True):
    """What begins a block, which an ``end`` ends. One that asks does so ahead of each pass.

    Its ``script`` is what is ahead of the block.
    """

    again: ClassVar[bool] = True
    """it is a loop; else it runs once or not at all"""
    scoped: ClassVar[bool] = False
    """it runs once, and the speed that its steps set ends with it"""

    def cell(self, number: int) -> tuple[float, float, float] | None:
        """Where a pass has its cell, X, Y, Z in its frame [mm]; ``number`` from 0. None: it has none."""
        return None

    @property
    def passes(self) -> int | None:
        """How often the block runs, or with a question at most; None: no bound."""
        raise NotImplementedError


class MotionStep(Step, frozen=True, kw_only=True):
    """What all moving steps share: each has a path of the joints, planned alone or as a leg of a blend."""

    leads_tool: ClassVar[bool] = False
    """the tool is led along a path; else each joint goes to its goal"""

    duration_s: Annotated[Seconds | None, Field("Duration s", FASTEST, 9)] = None
    """None: as fast as the limits allow"""
    blend_mm: Annotated[
        float, Meta(ge=0, le=WIDEST_BLEND_MM), Field("Blend mm", _BLEND_HINT, 10, more=True)
    ] = 0.0
    """how far from its end the tool may begin to turn off towards the next step; 0: it stops there"""

    def moved(self, T: FloatArray) -> MotionStep:
        """As of any step."""
        return self

    @property
    def _law(self) -> ProfileName | OneSided:
        """Of a motion that leads each joint to its goal, over time."""
        return "cubic"

    @property
    def _tool_speed(self) -> float | None:
        """Largest speed of the tool [m/s]; None: as fast as the joints can."""
        return None

    def _goal(self) -> str:
        """Where it leads to, in words."""
        raise NotImplementedError

    def describe(self) -> str:
        """Where it leads to, duration, law and blend radius."""
        seconds = "" if self.duration_s is None else f" in {self.duration_s:g} s"
        law = "" if self._law == "cubic" else f", {self._law}"
        blend = f", blend {self.blend_mm:g} mm" if self.blend_mm else ""
        return f"{self._goal()}{seconds}{law}{blend}"

    def end(self, robot: Robot, start: FloatArray | None = None) -> FloatArray | None:
        """Where it ends, (n,) [rad], as it is commanded, as far as known without ``path``; raises as that."""
        return None

    def left_out(self, robot: Robot, start: FloatArray) -> Sequence[Reason]:
        """What its motion from ``start`` (n,) [rad] leaves out of what it asks for; raises as ``path``."""
        return ()

    def path(self, robot: Robot, start: FloatArray) -> PiecewisePolynomial | None:
        """The joints' path q(s) from ``start`` (n,) [rad], straight to the end; None where it goes nowhere.

        What comes to the end from one side may turn round ahead of it: there the path has a corner.
        UnreachableError: no solution, or the arm cannot follow. MotionRefusedError: outside the limits.
        """
        end, law = self.end(robot, start), self._law
        if end is None:
            return None
        stops = one_sided_stops(robot, start, end, law) if law in ONE_SIDED else [start, end]
        if len(stops) == 2 and np.abs(end - start).max() <= NOWHERE:
            return None
        pieces = np.array([(here, there - here) for here, there in pairwise(stops)])
        return PiecewisePolynomial(np.arange(float(len(stops))), pieces)

    def leg(self, robot: Robot, start: FloatArray) -> Leg | None:
        """It as a leg of a blend, in which it has no law of its own; None: nowhere. Raises as ``path``."""
        path = self.path(robot, start)
        if path is None:
            return None
        cap = math.inf if self._tool_speed is None else self._tool_speed
        if self.duration_s:
            cap = min(cap, (path.high - path.low) / self.duration_s)
        return Leg(path, self.blend_mm / 1000, cap)

    def plan_leg(self, robot: Robot, leg: Leg, *, checked: bool = True) -> Trajectory:
        """Its motion along the path of ``leg``, from rest to rest; ``checked`` as in ``plan_joints``."""
        start, seconds = leg.path(leg.path.low), self.duration_s
        if self.leads_tool:
            speed = self._tool_speed
            return plan_path(robot, start, leg.path, speed=speed, duration_s=seconds, checked=checked)
        law = self._law
        if law not in ONE_SIDED:
            return plan_joints(robot, start, leg.path(leg.path.high), seconds, law, checked=checked)
        stops = [leg.path(s) for s in range(int(leg.path.high) + 1)]
        trajectory = plan_through(robot, stops, seconds)
        if checked:
            require_clear(robot, trajectory)
        return trajectory

    def plan(self, robot: Robot, start: FloatArray, *, checked: bool = True) -> Trajectory:
        """Its motion by itself, from rest at ``start`` (n,) [rad] to rest; raises as ``path``."""
        leg = self.leg(robot, start)
        if leg is None:
            return PointToPoint.lasting(start, start, self.duration_s or 0.0)
        return self.plan_leg(robot, leg, checked=checked)

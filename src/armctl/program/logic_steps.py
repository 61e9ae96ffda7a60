"""Steps that decide which steps run: alternatives, loops with a condition, counters, other programs."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from armctl.errors import ProgramError
from armctl.program.base_steps import BlockStep, Effect, Field, Step
from armctl.program.signal_steps import CONDITION, ConditionStep

MOST_REPEATS = 1_000_000
LARGEST_COUNT = 1_000_000_000
_LONGEST_NAME = 200
_CALLED_HINT = "The name of its file, as seen from the folder of this one."
_CounterName = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]
_Count = Annotated[int, Meta(ge=-LARGEST_COUNT, le=LARGEST_COUNT)]


class RepeatStep(BlockStep, frozen=True, kw_only=True, tag="repeat"):
    """Run the steps as far as the matching ``end`` several times."""

    icon: ClassVar = "loop"
    acts: ClassVar[bool] = False
    words: ClassVar = "{0.times} times"
    button: ClassVar = ("Decide and repeat", "Repeat", "times")

    times: Annotated[int, Meta(ge=1, le=MOST_REPEATS), Field("Times")]

    @property
    def passes(self) -> int:
        """The times."""
        return self.times

    def script(self) -> str:
        """A ``for``."""
        return f"for _ in range({self.times}):"


class _AskingStep(ConditionStep, BlockStep, frozen=True, kw_only=True):
    """What ``if`` and ``while`` share: a block, and what it asks."""

    @property
    def effect(self) -> Effect:
        """The question."""
        return Effect(asks=self.condition)

    def describe(self) -> str:
        """The condition."""
        return str(self.condition)


class IfStep(_AskingStep, frozen=True, kw_only=True, tag="if"):
    """Run the steps as far as ``else`` or ``end`` if something holds; those behind ``else`` if not."""

    again: ClassVar[bool] = False
    icon: ClassVar = "branch"
    button: ClassVar = ("Decide and repeat", "If", *CONDITION)

    @property
    def passes(self) -> int:
        """Once, if at all."""
        return 1

    def script(self) -> str:
        """An ``if``."""
        return f"if {self.condition.script()}:"


class ElseStep(Step, frozen=True, kw_only=True, tag="else"):
    """The steps as far as ``end`` run if the condition of the ``if`` did not hold."""

    icon: ClassVar = "branch"
    acts: ClassVar[bool] = False
    divides: ClassVar[bool] = True
    button: ClassVar = ("Decide and repeat", "Else")


class WhileStep(_AskingStep, frozen=True, kw_only=True, tag="while"):
    """Run the steps as far as ``end`` again and again, as long as something holds ahead of each pass."""

    icon: ClassVar = "loop"
    button: ClassVar = ("Decide and repeat", "While", *CONDITION)

    most: Annotated[
        Annotated[int, Meta(ge=1, le=MOST_REPEATS)] | None,
        Field("At most", "Passes; empty: as long as it holds.", 64),
    ] = None
    """passes after which it goes on behind ``end``; None: no bound"""

    @property
    def passes(self) -> int | None:
        """The bound."""
        return self.most

    def describe(self) -> str:
        """The condition, and the bound."""
        return f"{self.condition}{'' if self.most is None else f', at most {self.most} times'}"

    def script(self) -> str:
        """A ``while``, or with a bound a ``for`` that is left."""
        if self.most is None:
            return f"while {self.condition.script()}:"
        return f"for _ in range({self.most}):\n    if not {self.condition.script()}:\n        break"


class EndStep(Step, frozen=True, kw_only=True, tag="end"):
    """End of the block that the last open ``repeat``, ``if`` or ``while`` began."""

    icon: ClassVar = "end"
    acts: ClassVar[bool] = False
    closes: ClassVar[bool] = True
    words: ClassVar = "of the block"


class CountStep(Step, frozen=True, kw_only=True, tag="count"):
    """Add to a counter, or set it. Each pass of a program begins with all counters at 0."""

    icon: ClassVar = "count"
    button: ClassVar = ("Decide and repeat", "Count", "counter", "add")

    counter: Annotated[_CounterName, Field("Counter", "Its name: any word.", 60)]
    add: Annotated[_Count | None, Field("Add", "What is added to it.", 61)] = None
    to: Annotated[_Count | None, Field("Set to", "Instead of adding.", 62)] = None

    @property
    def effect(self) -> Effect:
        """What becomes of the counter."""
        return Effect(counts=self)

    @property
    def adds(self) -> bool:
        """It adds; else it sets."""
        return self.to is None

    def after(self, value: int) -> int:
        """What the counter is then."""
        return value + (self.add or 0) if self.to is None else self.to

    def describe(self) -> str:
        """The counter, and what becomes of it."""
        return f"{self.counter} {f'+ {self.add}' if self.to is None else f'= {self.to}'}"

    def check(self, robot: object) -> None:
        """Refuse to do both, or nothing."""
        if (self.add is None) == (self.to is None):
            raise ProgramError(f"counter {self.counter}: say what to add, or what to set it to")

    def script(self) -> str:
        """A variable."""
        changed = f"+= {self.add}" if self.to is None else f"= {self.to}"
        return f"{self.counter}_count {changed}"


class CallStep(Step, frozen=True, kw_only=True, tag="call"):
    """Run another program, once, from where the arm is; then go on here.

    It is a file of its own, found from the folder of the program that calls it. Counters are shared with it;
    the speed that it sets ends with it.
    """

    icon: ClassVar = "call"
    words: ClassVar = "{0.program}"
    button: ClassVar = ("Program", "Call", "program")

    program: Annotated[
        str,
        Meta(min_length=1, max_length=_LONGEST_NAME),
        Field("Program", _CALLED_HINT, 40, offers="programs"),
    ]

    @property
    def calls(self) -> str:
        """The name."""
        return self.program

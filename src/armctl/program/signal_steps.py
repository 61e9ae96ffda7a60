"""Steps about inputs and outputs of the board, and about what it measures."""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta

from armctl.errors import ProgramError
from armctl.facts.commands import NotDigital, UnknownName
from armctl.program.base_steps import LONGEST_WAIT_S, Effect, Field, Step, Until, literal
from armctl.program.conditions import COUNTER, MEASURED, Comparison, Condition, Otherwise, Trigger
from armctl.robot import Robot
from armctl.robot.tools import grippers

SignalName = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]*$")]
SignalNameOrNone = Annotated[str, Meta(pattern=r"^([a-z][a-z0-9_]*)?$")]
_VALUE = Field("Value", "Of an input or output: 0 or 1, or a share.", 62)
_WATCH_HINT = "An input, load, temperature, voltage or current of a joint, or counter."
LongestWait = Annotated[float, Meta(gt=0, le=LONGEST_WAIT_S)]
AtTimeout = Annotated[Otherwise, Field("At time-out", "What the program does then.", 65)]
"""of every step that waits for something that may not come"""


class SetStep(Step, frozen=True, kw_only=True, tag="set"):
    """Switch an output of the board: a lamp, a valve, a pump. The arm stands meanwhile."""

    icon: ClassVar = "output"
    words: ClassVar = "{0.output} = {0.value:g}"
    call: ClassVar = ("set_output", "output", "value")
    button: ClassVar = ("In and out", "Set output", "output")

    output: Annotated[SignalName, Field("Output", "Its name in the robot file.", 60, offers="outputs")]
    value: Annotated[float, Meta(ge=0, le=1), _VALUE] = 1.0
    """1 is on, 0 off; of a PWM output a share"""

    @property
    def effect(self) -> Effect:
        """The output, and its value."""
        return Effect(output=(self.output, self.value))

    def check(self, robot: Robot) -> None:
        """Refuse an output that the arm has not, the gripper's own, and a share of a digital one."""
        found = robot.signals.output(self.output)
        if found is None:
            known = tuple(one.name for one in robot.signals.outputs)
            raise ProgramError(UnknownName("output", self.output, known, robot.name))
        if any(one.output == self.output for one in grippers(robot)):
            raise ProgramError(f"output {self.output} is the gripper's: use a gripper step")
        if found.kind == "digital" and self.value not in (0, 1):
            raise ProgramError(NotDigital(self.output, self.value))

    def script(self) -> str:
        """``set_output``, which calls its first argument otherwise."""
        return f"set_output({literal(self.output)}, {literal(self.value)})"


CONDITION = ("watch", "joint", "counter", "compare", "value")
"""keys of a condition that need a value as it is put on the list"""


class ConditionStep(Step, frozen=True, kw_only=True):
    """What steps with a condition share: its keys."""

    watch: Annotated[
        SignalName,
        Field("Watch", _WATCH_HINT, 60, offers="watched"),
    ]
    """name of an input; ``load`` [%], ``temperature`` [°C], ``voltage`` [V], ``current`` [A]; ``counter``"""
    joint: Annotated[
        SignalNameOrNone,
        Field("Joint", "Whose load, temperature …", 61, offers="joints", of_watched=MEASURED),
    ] = ""
    """name of the joint, or ``gripper``; of a quantity only"""
    counter: Annotated[SignalNameOrNone, Field("Counter", "Its name.", 60, of_watched=(COUNTER,))] = ""
    """name of the counter that a ``count`` step changes; with watch = "counter" only"""
    compare: Annotated[Comparison, Field("Compare", "Above or below: of numbers.", 61)] = "equals"
    value: Annotated[float, _VALUE] = 1.0
    """of an input 0 or 1, of an analog one a share 0 ... 1"""
    trigger: Annotated[
        Trigger,
        Field("Trigger", "level: as it is; edge: that it becomes so, also while the arm moves.", 63),
    ] = "level"
    """edge: it must have become so since the program began, or since the last wait for this input"""

    @property
    def condition(self) -> Condition:
        """What it says."""
        return Condition(**{key: getattr(self, key) for key in Condition.__struct_fields__})

    def check(self, robot: Robot) -> None:
        """Refuse a condition that the arm cannot look at."""
        self.condition.check(robot)


class WaitForStep(ConditionStep, frozen=True, kw_only=True, tag="wait-for"):
    """Stand until an input has a value, or a quantity of a joint is above or below one."""

    icon: ClassVar = "input"
    call: ClassVar = ("wait_for", "watch", "value", "timeout_s", "joint", "compare", "trigger", "otherwise")
    button: ClassVar = ("In and out", "Wait until", *CONDITION, "timeout_s")

    timeout_s: Annotated[LongestWait, Field("Time-out s", "At most so long.", 64)]
    otherwise: AtTimeout = "stop"
    """what the program does where it has not come by then"""

    @property
    def effect(self) -> Effect:
        """What is waited for."""
        it = self.condition
        return Effect(until=Until(str(it), it.holds, self.timeout_s, self.otherwise == "go on", it.uses))

    def describe(self) -> str:
        """The condition, and the time."""
        return f"{self.condition}, at most {self.timeout_s:g} s, then {self.otherwise}"

"""What steps wait for or ask: an input of the board, or what it measures of a joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

import msgspec

from armctl.decoding import must_be
from armctl.errors import ProgramError
from armctl.program.base_steps import Senses, literal
from armctl.robot import Robot
from armctl.robot.tools import grippers

Comparison = Literal["equals", "above", "below"]
Trigger = Literal["level", "edge"]
"""level: as it is now; edge: that it has become so since the program began, or since the last wait for it"""
Measured = Literal["load", "temperature", "voltage", "current"]
Otherwise = Literal["stop", "go on"]
"""what becomes of a program where it has not come in time"""
_SIGNS = {"equals": "=", "above": ">", "below": "<"}
_UNITS: dict[Measured, str] = {"load": "%", "temperature": "°C", "voltage": "V", "current": "A"}
MEASURED: tuple[Measured, ...] = get_args(Measured)
COUNTER = "counter"
"""watches a counter of the program"""
GRIPPER = "gripper"
"""names the gripper where a joint is named"""


class Condition(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """An input or a counter that has a value, or a quantity of a joint above or below one."""

    watch: str
    """name of an input, or ``load`` [%], ``temperature`` [°C], ``voltage`` [V], ``current`` [A] of a joint

    or ``counter``"""
    joint: str = ""
    """name of the joint, or ``gripper``; of a quantity only"""
    counter: str = ""
    """name of the counter; of a counter only"""
    compare: Comparison = "equals"
    value: float = 1.0
    """of an input 0 or 1, of an analog one a share 0 ... 1"""
    trigger: Trigger = "level"

    def __str__(self) -> str:
        """``button = 1``, ``load of elbow > 40 %``, ``counter parts < 3``."""
        if self.watch == COUNTER:
            return f"{self.watch} {self.counter} {_SIGNS[self.compare]} {self.value:g}"
        if self.watch not in MEASURED:
            edge = "edge to " if self.trigger == "edge" else ""
            return f"{self.watch} {_SIGNS[self.compare]} {edge}{self.value:g}"
        return f"{self.watch} of {self.joint} {_SIGNS[self.compare]} {self.value:g} {_UNITS[self.watch]}"

    def holds(self, senses: Senses) -> bool:
        """Whether it holds now; what is not known does not."""
        seen = self._seen(senses)
        if seen is None:
            return False
        if self.trigger == "edge":
            return senses.edges.get(self.watch, 0) >= (1 if seen == self.value else 2)
        if self.compare == "equals":
            return seen == self.value
        return seen > self.value if self.compare == "above" else seen < self.value

    def check(self, robot: Robot) -> None:
        """Refuse what the arm has not, and what can never hold."""
        signal = robot.signals.input(self.watch)
        if (self.watch == COUNTER) != bool(self.counter):
            raise ProgramError(
                f'watch = "{COUNTER}" and the name of a counter go together: give both, or none'
            )
        if self.watch == COUNTER:
            if self.joint or self.trigger == "edge":
                raise ProgramError(f"counter {self.counter} has no joint and no edge: leave them out")
            return
        if self.watch in MEASURED:
            self._check_quantity(robot)
            return
        if signal is None:
            inputs = [one.name for one in robot.signals.inputs]
            raise ProgramError(
                f"{robot.name} has no input {self.watch!r}: watch {must_be((*inputs, *MEASURED, COUNTER))}"
                + ("" if inputs else "; inputs are told in the robot file ([[inputs]])")
            )
        if self.joint:
            raise ProgramError(f"input {self.watch} belongs to no joint: leave joint out")
        if not 0 <= self.value <= 1:
            raise ProgramError(f"input {self.watch} is 0 ... 1, never {self.value:g}")
        if signal.kind == "analog":
            if self.compare == "equals" or self.trigger == "edge":
                raise ProgramError(f"input {self.watch} is analog: compare it above or below a share 0 ... 1")
        elif self.compare != "equals" or self.value not in (0, 1):
            raise ProgramError(f"input {self.watch} is digital: it equals 0 or 1")

    def _check_quantity(self, robot: Robot) -> None:
        names = [*robot.joint_names, *([GRIPPER] if grippers(robot) else [])]
        if self.joint not in names:
            raise ProgramError(f"{self.watch} of which joint? joint {must_be(names)}, not {self.joint!r}")
        if self.compare == "equals" or self.trigger == "edge":
            raise ProgramError(f"{self.watch} wavers: compare it above or below a value")

    def foreseen(self, counters: Mapping[str, int]) -> bool | None:
        """Whether it holds with these counters; None: that is known only when it is asked."""
        return self.holds(Senses({}, {}, counters=counters)) if self.watch == COUNTER else None

    @property
    def uses(self) -> str:
        """Name of an input whose edges count as seen where it has held; empty: none."""
        return "" if self.watch in (*MEASURED, COUNTER) else self.watch

    def script(self) -> str:
        """The same of an ``Arm`` called ``arm``, as Python; a ProgramError where that has no words for it."""
        if self.watch in MEASURED or self.trigger == "edge":
            raise ProgramError(
                f"a Python script can ask for the level of an input or for a counter, not: {self}"
            )
        seen = f"{self.counter}_count" if self.watch == COUNTER else f"arm.inputs[{literal(self.watch)}]"
        sign = "==" if self.compare == "equals" else _SIGNS[self.compare]
        return f"{seen} {sign} {literal(self.value)}"

    def _seen(self, senses: Senses) -> float | None:
        if self.watch == COUNTER:
            return senses.counters.get(self.counter, 0)
        if self.watch not in MEASURED:
            return senses.inputs.get(self.watch)
        found = senses.quantities.get(self.joint)
        if found is None:
            return None
        load = None if found.load is None else 100 * abs(found.load)
        told = (load, found.temperature_c, found.voltage_v, found.current_a)
        return dict(zip(MEASURED, told, strict=True))[self.watch]

"""Inputs and outputs of a board beside those of the joints: buttons, lamps, valves, a vacuum pump."""

from __future__ import annotations

from typing import Literal

from armctl.lazy_dataclass import dataclass

InputKind = Literal["digital", "pull-up", "analog"]
OutputKind = Literal["digital", "pwm"]
Then = Literal["keep", "off", "on"]
"""what becomes of an output"""
Moment = Literal["stop", "release", "fault", "end"]
"""at STOP, at Release, at a fault, at the end of a program"""
MOST_SIGNALS = 32
"""no arm has more inputs, nor more outputs"""
ON = 0.5
"""a value above is on"""


@dataclass(frozen=True, slots=True)
class Input:
    """Something that the board looks at. Its value is 0 or 1, of an analog one a share 0 ... 1."""

    name: str
    """in programs and commands"""
    title: str
    """as it is shown"""
    channel: int
    """the Maestro's channel, the Arduino's pin"""
    kind: InputKind = "digital"
    active_low: bool = False
    """it is 1 where its pin is low"""
    debounce_s: float = 0.0
    """a change counts once it has lasted so long"""

    def value(self, level: float) -> float:
        """Its value where its pin is at a level 0 ... 1; the same the other way round."""
        return 1.0 - level if self.active_low else level


@dataclass(frozen=True, slots=True)
class Output:
    """Something that the board switches, or with PWM drives by a share."""

    name: str
    title: str
    channel: int
    kind: OutputKind = "digital"
    active_low: bool = False
    """it is on where its pin is low"""
    at_stop: Then = "keep"
    at_release: Then = "keep"
    at_fault: Then = "keep"
    at_end: Then = "keep"

    def value(self, level: float) -> float:
        """Its value where its pin is at a level 0 ... 1; the same the other way round."""
        return 1.0 - level if self.active_low else level

    def goes(self, moment: Moment) -> float | None:
        """What it is switched to at some moment; None: it keeps its value."""
        then: dict[Moment, Then] = {
            "stop": self.at_stop, "release": self.at_release, "fault": self.at_fault, "end": self.at_end,
        }  # fmt: skip
        return {"keep": None, "off": 0.0, "on": 1.0}[then[moment]]


@dataclass(frozen=True, slots=True)
class Signals:
    """All inputs and outputs of an arm beside its joints."""

    inputs: tuple[Input, ...] = ()
    outputs: tuple[Output, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.inputs or self.outputs)

    @property
    def at_rest(self) -> dict[int, float]:
        """By channel, the level 0 ... 1 of each input while nobody presses anything."""
        return {one.channel: one.value(0.0) for one in self.inputs}

    def input(self, name: str) -> Input | None:
        """The input of a name; None: there is none."""
        return next((one for one in self.inputs if one.name == name), None)

    def output(self, name: str) -> Output | None:
        """The output of a name; None: there is none."""
        return next((one for one in self.outputs if one.name == name), None)


NO_SIGNALS = Signals()

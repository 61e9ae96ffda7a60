"""Spare pins of an encoder board, named as inputs and outputs (firmware/README.md)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypedDict

from armctl.errors import BoardError
from armctl.hardware.encoder.messages import CHANGES, SPARE_PINS
from armctl.robot.signals import ON, Input, Output, Signals


def check_pins(signals: Signals) -> None:
    """Refuse what the board has not (``BoardError``)."""
    for one in (*signals.inputs, *signals.outputs):
        if one.channel not in SPARE_PINS:
            raise BoardError(
                f"{one.title} is on pin {one.channel}: an encoder board has its pins {SPARE_PINS[0]} … "
                f"{SPARE_PINS[-1]} free; change the robot file"
            )


class PinReading(TypedDict):
    """What a ``Readback`` says of them, by name."""

    inputs: Mapping[str, float]
    outputs: Mapping[str, float]
    changes: Mapping[str, int]


class SparePins:
    """The pins of one arm, and how often each had changed at the last reading."""

    def __init__(self, signals: Signals) -> None:
        self._signals = signals
        self.sent_at: int | None = None
        """after how many restarts of the board they were told to it; None: not yet"""
        self._seen: dict[str, int] = {}

    @property
    def configuration(self) -> list[str]:
        """The lines that tell the board what each is, and what an output does when the host is lost.

        A new output is off.
        """
        inputs = [f"PIN {one.channel} {_use(one)}" for one in self._signals.inputs]
        return [*inputs, *(_output_line(one) for one in self._signals.outputs)]

    @property
    def kept(self) -> list[str]:
        """The lines after which outputs stay as they are when the host is lost."""
        return [f"PIN {one.channel} out keep" for one in self._signals.outputs]

    def request(self, name: str, value: float) -> str:
        """The line that switches an output. ``BoardError``: there is none of that name."""
        output = self._signals.output(name)
        if output is None:
            raise BoardError(f"the encoder board was told of no output {name!r}")
        return f"SET {output.channel} {int(value > ON)}"

    def read(self, changes: Sequence[int], *, known: bool) -> PinReading:
        """Levels and changes since the last reading, from a status. ``known``: the board knows its pins."""
        found = PinReading(inputs={}, outputs={}, changes={})
        if not known:
            self._seen.clear()
            return found
        counts = dict(zip(SPARE_PINS, changes, strict=True))
        found["inputs"] = {one.name: float(counts[one.channel] % 2) for one in self._signals.inputs}
        found["outputs"] = {one.name: float(counts[one.channel] % 2) for one in self._signals.outputs}
        now = {one.name: counts[one.channel] for one in self._signals.inputs}
        found["changes"] = {
            name: (count - self._seen[name]) % CHANGES for name, count in now.items() if name in self._seen
        }
        self._seen = now
        return found


def _use(one: Input) -> str:
    return "up" if one.kind == "pull-up" else "in"


def _output_line(one: Output) -> str:
    return f"PIN {one.channel} out {_at_loss(one)} {int(one.value(0.0) > ON)}"


def _at_loss(one: Output) -> str:
    value = one.goes("fault")
    return "keep" if value is None else "high" if one.value(value) > ON else "low"

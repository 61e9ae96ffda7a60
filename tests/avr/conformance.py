"""The lines that both suites of conformance talk over, and the tables of their checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from tests.avr.avr import Avr

from armctl.hardware import ByteModel


class Line(Protocol):
    """A serial line to a board, with time in the caller's hand."""

    def exchange(self, data: bytes, seconds: float) -> bytes:
        """Send ``data``, let ``seconds`` of the board's time pass and return what it has sent meanwhile."""
        ...


Check = Callable[[Line], None]


def checks(module: Mapping[str, object]) -> tuple[Check, ...]:
    """The functions of a module that take a line and nothing else, in the order of the file."""
    signature = {"line": "Line", "return": "None"}
    return tuple(one for one in module.values() if getattr(one, "__annotations__", None) == signature)


class AvrLine:
    """The line of a simulated CPU that has just got its power."""

    def __init__(self, avr: Avr) -> None:
        self._avr = avr

    def exchange(self, data: bytes, seconds: float) -> bytes:
        self._avr.write(data)
        self._avr.run_for(seconds)
        return self._avr.read()


class ModelLine:
    """The line of a Python model; its time passes in small steps, as on a pty."""

    def __init__(self, model: ByteModel, step_s: float) -> None:
        self._model, self._step_s = model, step_s
        self._now = 50.0

    def exchange(self, data: bytes, seconds: float) -> bytes:
        said = self._model.advance(self._now) + self._model.feed(data)
        for _ in range(round(seconds / self._step_s)):
            self._now += self._step_s
            said += self._model.advance(self._now)
        return said

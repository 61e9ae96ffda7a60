"""The spare pins of a simulated encoder board."""

from __future__ import annotations

from collections.abc import Mapping

from armctl.hardware.encoder.messages import CHANGES, SPARE_PINS, RefusedRequest, RequestWords, within
from armctl.hardware.encoder.simulated_axis import TICK_S
from armctl.lazy_dataclass import dataclass
from armctl.robot.signals import ON

_FIRST, _LAST = SPARE_PINS[0], SPARE_PINS[-1]

_NEWS_TICKS = round(0.01 / TICK_S)


@dataclass
class _SparePin:
    use: str = "off"
    at_loss: str = "keep"
    level: int = 0
    """that it drives"""
    changes: int = 0

    def reads(self, level: float | None) -> int:
        """What it reads where ``level`` is connected to it; None: nothing is."""
        match self.use:
            case "off":
                return 0
            case "out":
                return self.level
            case _:
                return int(self.use == "up") if level is None else int(level > ON)


class SpareBank:
    """All of them, as after a start: none is in use."""

    def __init__(self, levels: Mapping[int, float]) -> None:
        """``levels``: what is connected, by pin."""
        self._levels = levels
        self._pins = {number: _SparePin() for number in SPARE_PINS}
        self._lost = self._news = False
        self._told_ago = 0

    def __str__(self) -> str:
        """Their changes, as the board tells them."""
        return "".join(f"{one:x}" for one in self.changes)

    @property
    def changes(self) -> tuple[int, ...]:
        """How often each has changed, as the status has it."""
        return tuple(pin.changes % CHANGES for pin in self._pins.values())

    def obey(self, command: str, words: RequestWords) -> None:
        """A ``PIN`` or ``SET`` line; refused as the firmware does."""
        number = within(words.number("ARGS pin missing"), (_FIRST, _LAST), f"RANGE pin {_FIRST} {_LAST}")
        pin = self._pins[number]
        if command == "PIN":
            self._use(pin, number, words)
            return
        level = words.number("ARGS 0 or 1 missing")
        words.end()
        within(level, (0, 1), "RANGE 0 1")
        if pin.use != "out":
            raise RefusedRequest("NOTOUT")
        pin.level = level

    def _use(self, pin: _SparePin, number: int, words: RequestWords) -> None:
        use = words.take()
        if use not in ("off", "in", "up", "out"):
            raise RefusedRequest("ARGS off in up out")
        at_loss = words.take()
        if at_loss is not None and (at_loss not in ("keep", "low", "high") or use != "out"):
            raise RefusedRequest("ARGS keep low high, of an output")
        level = within(words.number_or(words.take()), (0, 1), "RANGE 0 1") if at_loss and words.rest else 0
        words.end()
        pin.at_loss = at_loss or "keep"
        if pin.use != use:
            pin.use, pin.level = use, level
            pin.changes = pin.reads(self._levels.get(number))

    def sample(self, *, lost: bool) -> bool:
        """A control tick; whether inputs have changed that are to be told now.

        ``lost``: the host has been silent for too long.
        """
        for number, pin in self._pins.items():
            changed = pin.reads(self._levels.get(number)) != pin.changes % 2
            pin.changes += changed
            self._news |= changed and pin.use != "out"
        for pin in self._pins.values() if lost and not self._lost else ():
            if pin.use == "out" and pin.at_loss != "keep":
                pin.level = int(pin.at_loss == "high")
        self._lost, self._told_ago = lost, self._told_ago + 1
        if not self._news or self._told_ago < _NEWS_TICKS:
            return False
        self._news, self._told_ago = False, 0
        return True

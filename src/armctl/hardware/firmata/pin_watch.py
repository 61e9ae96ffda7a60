"""What the host last sent to each pin, and what the board says to that."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from armctl.hardware.firmata.codec import LARGEST_PULSE_US, SMALLEST_PULSE_US, PinMode
from armctl.hardware.firmata.replies import PinState

_CERTAIN = 2
"""answers carry no checksum: one alone does not prove that a pin is on or off"""
_GIVEN_UP = 1.4
"""times the timeout: after that no answer is expected any more"""


@dataclass(slots=True)
class _Question:
    """A pin state that was asked for: when, and what the answer should be."""

    at: float
    on: bool
    pulse_us: int | None
    told: bool = False
    """that there is no answer; one that comes later still belongs to this question, not to the next"""


@dataclass(slots=True)
class _Pin:
    on: bool = False
    pulse_us: int | None = None
    """last sent, or found; None: off, or set to degrees by somebody else"""
    doubtful: bool = False
    """the board was seen with another value: what was sent last must be sent again"""
    asked: _Question | None = None
    contradictions: int = 0


class PinWatch:
    """Book of the configured pins.

    The board answers a pin state query with the pin's mode and the value last written. Queries go
    out a few at a time and in turn; each answer is compared with what had been sent when it was asked.

    Args:
        states: what the board said of each configured pin.
    """

    def __init__(self, states: Iterable[PinState] = ()) -> None:
        self._pins: dict[int, _Pin] = {}
        for state in sorted(states, key=lambda state: state.pin):
            on = state.mode == PinMode.SERVO
            self._pins[state.pin] = _Pin(on, _pulse(state.value) if on else None)
        self._turn: list[int] = list(self._pins)

    @property
    def positions(self) -> dict[int, float | None]:
        """The pulse width [µs] last sent to each pin; None where it is off or not known."""
        return {
            number: None if pin.pulse_us is None else float(pin.pulse_us)
            for number, pin in self._pins.items()
        }

    @property
    def powered(self) -> bool:
        """Whether any pin sends pulses."""
        return any(pin.on for pin in self._pins.values())

    def carry_on(self, earlier: PinWatch) -> tuple[int, ...]:
        """Take over what an earlier book says was sent; return the pins that were on then and are not now.

        What was sent counts, not the value that the board told: its answer may be to an earlier question.
        """
        were_on = {number: pin for number, pin in earlier._pins.items() if pin.on and number in self._pins}
        for number, pin in were_on.items():
            if self._pins[number].on:
                self._pins[number].pulse_us = pin.pulse_us
                self._pins[number].doubtful = pin.doubtful
        return tuple(number for number in were_on if not self._pins[number].on)

    def is_on(self, pin: int) -> bool:
        """Whether a configured pin sends pulses."""
        return self._pins[pin].on

    def needs(self, pin: int, pulse_us: int) -> bool:
        """Whether a setpoint has to be sent, or is what the board has already."""
        return self._pins[pin].doubtful or self._pins[pin].pulse_us != pulse_us

    def to_repeat(self) -> dict[int, int]:
        """What must be sent again, because the board was seen with something else."""
        return {
            number: pin.pulse_us
            for number, pin in self._pins.items()
            if pin.doubtful and pin.pulse_us is not None
        }

    def sent(self, pulses: Mapping[int, int]) -> None:
        """Note what was sent [µs] by pin; a pin that was off is on now."""
        for number, pulse_us in pulses.items():
            pin = self._pins[number]
            if not pin.on:
                pin.contradictions = 0
            pin.on, pin.pulse_us, pin.doubtful = True, pulse_us, False

    def released(self) -> None:
        """Note that every pin is off."""
        for number in self._pins:
            self._pins[number] = _Pin()

    def ask(self, count: int, now: float) -> tuple[int, ...]:
        """The next pins to ask about, at most ``count``, none that has not answered yet."""
        waiting = [number for number in self._turn if self._pins[number].asked is None]
        chosen = waiting[:count]
        for number in chosen:
            pin = self._pins[number]
            pin.asked = _Question(now, pin.on, pin.pulse_us)
        self._turn = [number for number in self._turn if number not in chosen] + chosen
        return tuple(chosen)

    def overdue(self, now: float, timeout_s: float) -> tuple[int, ...]:
        """The pins that have not answered for ``timeout_s``, once; a little later they may be asked again."""
        late: list[int] = []
        for number, pin in self._pins.items():
            question = pin.asked
            if question is None or now - question.at <= timeout_s:
                continue
            if not question.told:
                question.told = True
                late.append(number)
            elif now - question.at > _GIVEN_UP * timeout_s:
                pin.asked = None
        return tuple(late)

    def answered(self, state: PinState) -> str | None:
        """Take an answer; words where it is not what it should be, None where it is or was not asked."""
        pin = self._pins.get(state.pin)
        if pin is None or pin.asked is None:
            return None
        asked, pin.asked = pin.asked, None
        on = state.mode == PinMode.SERVO
        if on != asked.on:
            pin.contradictions += 1
            return (
                f"pin {state.pin} is {'still on' if on else 'no longer on'} at the board, though armctl "
                f"{'switched it off' if on else 'did not switch it off'}"
            )
        pin.contradictions = 0
        if not on or asked.pulse_us is None or state.value == asked.pulse_us:
            return None
        # Sent again at once, unless the next setpoint overtakes it.
        pin.doubtful = pin.on
        return (
            f"pin {state.pin} had {state.value} instead of the {asked.pulse_us} µs last sent: bytes were "
            "lost or garbled on the line; sent again. Check the USB cable"
        )

    def switched_off(self) -> tuple[int, ...]:
        """The pins that the board has off for certain while they should be on."""
        return tuple(
            number for number, pin in self._pins.items() if pin.on and pin.contradictions >= _CERTAIN
        )


def _pulse(value: int) -> int | None:
    """A value of a servo pin as a pulse width [µs]; None for degrees and for none yet."""
    return value if SMALLEST_PULSE_US <= value <= LARGEST_PULSE_US else None

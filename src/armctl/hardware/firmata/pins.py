"""The configured pins of a Firmata board and what each may be sent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from armctl.errors import BoardError
from armctl.hardware.driver import ChannelSettings, ChannelTable
from armctl.hardware.firmata import codec
from armctl.hardware.firmata.codec import LARGEST_PULSE_US, SCALE, SMALLEST_PULSE_US, PinMode, PinState

MOST_SERVOS = 16
"""16 setpoints of 6 bytes are 96 of the 115 bytes that 57600 baud carry in a servo frame of 20 ms"""


def pin_table(settings: Sequence[ChannelSettings], servo_pins: Sequence[int]) -> ChannelTable:
    """The configured pins, pulse widths in µs, where they are among the board's ``servo_pins``."""
    if len(settings) > MOST_SERVOS:
        raise BoardError(
            f"{len(settings)} servos: at 57600 baud a Firmata board can be sent {MOST_SERVOS} setpoints "
            "in each servo frame; put the others on a second board"
        )

    def check(one: ChannelSettings) -> None:
        if one.channel not in servo_pins:
            raise BoardError(
                f"pin {one.channel} cannot drive a servo on this board; the pins that can: "
                f"{_ranges(servo_pins)}; change the robot's servo map"
            )
        if not SCALE.holds_range(one, SMALLEST_PULSE_US, LARGEST_PULSE_US):
            raise BoardError(
                f"pin {one.channel}: {one.minimum:g} … {one.maximum:g} µs is no range for a servo on a "
                f"Firmata board; it must lie within {SMALLEST_PULSE_US} … {LARGEST_PULSE_US} µs, the smaller "
                f"number first (the sketch takes anything below {SMALLEST_PULSE_US} as degrees)"
            )

    return ChannelTable(SCALE, settings, check)


def _ranges(pins: Sequence[int]) -> str:
    """Numbers in words: ``2 … 13, 22``."""
    parts: list[tuple[int, int]] = []
    for pin in sorted(pins):
        if parts and parts[-1][1] == pin - 1:
            parts[-1] = (parts[-1][0], pin)
        else:
            parts.append((pin, pin))
    return (
        ", ".join(f"{first} … {last}" if last > first else f"{first}" for first, last in parts)
        or "none at all"
    )


# What the host last sent to each pin, and what the board says to that.

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


# Switching servos on so that their first pulse is already the right one.

_MOST_ON_FRESH_BOARD = 12
"""so many fit into the 32 ms in which a timer that has just been started sends no pulse"""
_TRANSMIT_BUFFER = 64
_RECEIVE_BUFFER = 63
_REPORT_FRAME = 5
_QUESTION = codec.firmware_query()
_SERVO_BYTES = len(codec.servo_config(0, 0, 0)) + len(codec.servo_write(0, codec.SMALLEST_PULSE_US))


@dataclass(frozen=True, slots=True)
class FirstPulse:
    """A servo to be switched on: pin, first pulse, and the range of pulses that it may ever be sent [µs]."""

    pin: int
    pulse_us: int
    range_us: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Burst:
    """Bytes to be written in one go, and how many the board answers."""

    request: bytes
    answer_length: int


class Attacher:
    """Makes the bytes that switch servos on.

    An attached servo sends 1500 µs, or the width last sent on its pin, until a write says otherwise.
    That write is 6 bytes: 1 ms on the line, in which a servo frame begins in one of thirty cases.

    On a board that has just started there is time: the timer starts with the first servo, counts from
    zero and sends nothing until it has wrapped round. Later, the sketch is kept from looking: it is
    first asked for its name, as often as it takes to fill its transmit buffer, and while it waits for
    that to drain, attach and write both come in. It then carries them out back to back, within 0.1 ms.
    (What is left: about one first pulse in two hundred, of servos that are not the first to be on.)

    Args:
        firmware_name: what the sketch answers when it is asked.
        fresh: whether the board has driven no servo since it started.
    """

    def __init__(self, firmware_name: str, *, fresh: bool) -> None:
        self._report_length = _REPORT_FRAME + 2 * len(firmware_name)
        self._fresh = fresh

    @property
    def most_at_once(self) -> int:
        """How many servos the next burst may switch on."""
        if self._fresh:
            return _MOST_ON_FRESH_BOARD
        count = 1
        while self._needed(count + 1) <= self._allowed(count + 1):
            count += 1
        return count

    def burst(self, servos: Sequence[FirstPulse]) -> Burst:
        """Attach up to ``most_at_once`` servos, each with its first pulse right behind."""
        request = b"".join(
            codec.servo_config(one.pin, *codec.servo_limits(*one.range_us))
            + codec.servo_write(one.pin, one.pulse_us)
            for one in servos
        )
        if self._fresh:
            self._fresh = False
            return Burst(request, 0)
        count = min(self._needed(len(servos)), self._allowed(len(servos)))
        return Burst(_QUESTION * count + request, self._report_length * count)

    def _needed(self, servos: int) -> int:
        """How many questions hold the sketch until all bytes of so many servos have come in.

        It begins to answer after the first one, and is held until all but a buffer full has gone out.
        """
        gained = self._report_length - len(_QUESTION)
        return -(-(_TRANSMIT_BUFFER + 1 + _SERVO_BYTES * servos - len(_QUESTION)) // gained)

    def _allowed(self, servos: int) -> int:
        """How many questions leave room in the receive buffer, the first one being taken out at once."""
        return (_RECEIVE_BUFFER - _SERVO_BYTES * servos) // len(_QUESTION) + 1

"""Setpoints and questions on their way to the pins of a Firmata board, and what it says of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from armctl.hardware.driver import ChannelTable
from armctl.hardware.firmata import BAUD, LARGEST_PULSE_US, SMALLEST_PULSE_US, codec
from armctl.hardware.firmata.codec import PinMode, PinState

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
    reported: bool = False
    """that there is no answer; one that comes later still belongs to this question, not to the next"""


@dataclass(slots=True)
class _Pin:
    on: bool = False
    pulse_us: int | None = None  # last sent, or found; None: off, or set to degrees by another program
    doubtful: bool = False  # the board was seen with another value: what was sent last must be sent again
    asked: _Question | None = None
    contradictions: int = 0


class PinWatch:
    """What was sent to the configured pins, compared with what the board says of them.

    An answer is compared with what had been sent when it was asked. ``states``: the pins at the beginning.
    """

    def __init__(self, states: Iterable[PinState] = ()) -> None:
        self._pins: dict[int, _Pin] = {}
        for state in sorted(states, key=lambda state: state.pin):
            on = state.mode == PinMode.SERVO
            # Degrees, or no value yet, are no pulse width.
            known = on and SMALLEST_PULSE_US <= state.value <= LARGEST_PULSE_US
            self._pins[state.pin] = _Pin(on, state.value if known else None)
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

    @property
    def switched_off(self) -> tuple[int, ...]:
        """The pins that the board has off for certain while they should be on."""
        return tuple(
            number for number, pin in self._pins.items() if pin.on and pin.contradictions >= _CERTAIN
        )

    def due(self, wanted: Mapping[int, int]) -> tuple[dict[int, int], dict[int, int]]:
        """What the board has not got, or must be sent again [µs]: on pins that are on, and off."""
        on: dict[int, int] = {}
        off: dict[int, int] = {}
        for number, pin in self._pins.items():
            pulse_us = wanted.get(number, pin.pulse_us if pin.doubtful else None)
            if pulse_us is not None and (pin.doubtful or pulse_us != pin.pulse_us):
                (on if pin.on else off)[number] = pulse_us
        return on, off

    def carry_on(self, earlier: PinWatch) -> tuple[int, ...]:
        """Take over what an earlier watch says was sent; return the pins that were on then and are not now.

        What was sent counts, not the value that the board told: its answer may be to an earlier question.
        """
        were_on = {number: pin for number, pin in earlier._pins.items() if pin.on and number in self._pins}
        for number, pin in were_on.items():
            if self._pins[number].on:
                self._pins[number].pulse_us = pin.pulse_us
                self._pins[number].doubtful = pin.doubtful
        return tuple(number for number in were_on if not self._pins[number].on)

    def sent(self, pulses: Mapping[int, int]) -> None:
        """Note what was sent [µs] by pin; a pin that was off is on now."""
        for number, pulse_us in pulses.items():
            pin = self._pins[number]
            if not pin.on:
                pin.contradictions = 0
            pin.on, pin.pulse_us, pin.doubtful = True, pulse_us, False

    def released(self) -> None:
        """Note that every pin is off."""
        self._pins = {number: _Pin() for number in self._pins}

    def ask(self, count: int, now: float) -> tuple[int, ...]:
        """The next pins to ask about, at most ``count``, none that has not answered yet."""
        chosen = [number for number in self._turn if self._pins[number].asked is None][:count]
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
            if not question.reported:
                question.reported = True
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


# Switching servos on so that their first pulse is already the right one.

_MOST_ON_FRESH_BOARD = 12
"""so many fit into the 32 ms in which a timer that has just been started sends no pulse"""
_TRANSMIT_BUFFER = 64
_RECEIVE_BUFFER = 63
_REPORT_FRAME = 5
_SERVO_BYTES = len(codec.servo_config(0, 0, 0)) + len(codec.servo_write(0, SMALLEST_PULSE_US))


class Attacher:
    """Makes the bytes that switch servos on.

    An attached servo sends 1500 µs, or the width last sent on its pin, until a write says otherwise.
    That write is 6 bytes: 1 ms on the line, in which a servo frame begins in one of thirty cases.

    On a board that has just started (``fresh``) there is time: the timer starts with the first servo,
    counts from zero and sends nothing until it has wrapped round. Later, the sketch is kept from looking:
    it is first asked for its name, as often as it takes to fill its transmit buffer, and while it waits
    for that to drain, attach and write both come in. It then carries them out back to back, within 0.1 ms.
    (What is left: about one first pulse in two hundred, of servos that are not the first to be on.)
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

    def burst(self, pulses: Mapping[int, int], table: ChannelTable) -> tuple[bytes, int]:
        """Bytes that attach up to ``most_at_once`` servos at pulses [µs] by pin; the length of the answer."""
        request = b"".join(
            codec.servo_config(pin, *codec.servo_limits(*table.whole_range(pin)))
            + codec.servo_write(pin, pulse_us)
            for pin, pulse_us in pulses.items()
        )
        count = 0 if self._fresh else min(self._needed(len(pulses)), self._allowed(len(pulses)))
        self._fresh = False
        return codec.FIRMWARE_QUERY * count + request, self._report_length * count

    def _needed(self, servos: int) -> int:
        """How many questions hold the sketch until all bytes of so many servos have come in.

        It begins to answer after the first one, and is held until all but a buffer full has gone out.
        """
        gained = self._report_length - len(codec.FIRMWARE_QUERY)
        return -(-(_TRANSMIT_BUFFER + 1 + _SERVO_BYTES * servos - len(codec.FIRMWARE_QUERY)) // gained)

    def _allowed(self, servos: int) -> int:
        """How many questions leave room in the receive buffer, the first one being taken out at once."""
        return (_RECEIVE_BUFFER - _SERVO_BYTES * servos) // len(codec.FIRMWARE_QUERY) + 1


# No faster than the line carries: the system and the USB adapter take far more, and setpoints only get old.

SERVO_FRAME_S = 0.020
BYTE_S = 10 / BAUD  # 8N1: start bit, eight data bits, stop bit
_FRAME_BYTES = 0.9 * SERVO_FRAME_S / BYTE_S
_ROUNDING_SLACK = 1e-6
_QUERY_BYTES = len(codec.pin_state_query(0))
_MOST_QUERIES = 8
"""their answers of 7 bytes fit into the board's 64-byte transmit buffer: it never has to wait for it"""
_ROUND_S = 0.75 * SERVO_FRAME_S
"""shortest time between two rounds of questions; a loop of 20 ms is now and then early"""


class SetpointStream:
    """Keeps the newest setpoints until the line is free for them; ``attacher`` switches pins on."""

    def __init__(self, send: Callable[[bytes], None], now: Callable[[], float], attacher: Attacher) -> None:
        self._send_bytes, self._now, self._attacher = send, now, attacher
        self._busy_until = 0.0
        self._pending: dict[int, int] = {}
        self._asked_at = -_ROUND_S

    def put(self, pulses: Mapping[int, int]) -> None:
        """Have pulse widths [µs] by pin sent with the next ``flush``."""
        self._pending.update(pulses)

    def clear(self) -> None:
        """Forget what has not been sent."""
        self._pending.clear()

    def send(self, data: bytes, answer_length: int = 0) -> None:
        """Send at once."""
        self._send_bytes(data)
        # Both directions of the line work at once: the longer one counts.
        length = max(len(data), answer_length)
        self._busy_until = max(self._busy_until, self._now()) + length * BYTE_S

    def flush(self, table: ChannelTable, watch: PinWatch) -> None:
        """Send the newest setpoints that the board has not got, once the line is free for them."""
        # A round of questions may be in front of them, or reading before writing would cost a frame.
        if self._backlog(self._now()) > _MOST_QUERIES * _QUERY_BYTES + _ROUNDING_SLACK:
            return
        setpoints, off = watch.due(self._pending)
        first = dict(itertools.islice(off.items(), self._attacher.most_at_once))
        self._pending = {pin: pulse_us for pin, pulse_us in off.items() if pin not in first}
        request, answer_length = b"".join(itertools.starmap(codec.servo_write, setpoints.items())), 0
        if first:
            attach, answer_length = self._attacher.burst(first, table)
            request += attach
        if request:
            self.send(request, answer_length)
            watch.sent(setpoints | first)

    def ask_next(self, watch: PinWatch) -> None:
        """Ask for as many pin states as the line has room for in this servo frame, in turn."""
        now = self._now()
        if now - self._asked_at < _ROUND_S:
            return
        room = max(0.0, _FRAME_BYTES - self._backlog(now) + _ROUNDING_SLACK)
        pins = watch.ask(min(_MOST_QUERIES, int(room) // _QUERY_BYTES), now)
        if pins:
            self._asked_at = now
            self.send(b"".join(map(codec.pin_state_query, pins)))

    def _backlog(self, now: float) -> float:
        """How many of the bytes sent so far have not gone out yet."""
        return max(0.0, self._busy_until - now) / BYTE_S

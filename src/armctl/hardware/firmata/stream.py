"""Setpoints and questions on their way to the pins of a Firmata board, and what it says of them."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from armctl.hardware.driver import ChannelTable
from armctl.hardware.firmata import BAUD, LARGEST_PULSE_US, SMALLEST_PULSE_US, codec
from armctl.hardware.firmata.codec import PinMode, PinState

# What the host last sent to each pin, and what the board says to that.

_CERTAIN = 2
"""answers carry no checksum: one alone does not prove that a pin is on or off"""
_ATTACH_ATTEMPTS = 3
_STRAYS_WITHIN_S = 10.0
_LONG_LOSS_S = 0.1
"""what is lost for longer than this shows as a step of the arm"""
_LOST = "bytes were lost or garbled on the line"


@dataclass(slots=True)
class _Question:
    """A pin state that was asked for: when, and what the answer should be."""

    pin: int
    at: float
    on: bool = False
    pulse_us: int | None = None


@dataclass(slots=True)
class _Pin:
    on: bool = False
    pulse_us: int | None = None  # last sent, or found; None: off, or set to degrees by another program
    sent_at: float = -math.inf
    doubtful: bool = False  # the board was seen with another value: what was sent last must be sent again
    held_us: int | None = None  # the value that the board was seen with then
    step_us_per_s: float = math.inf  # how fast it is brought from there to where it should be
    asked: _Question | None = None
    contradictions: int = 0
    seen_on: bool = False  # the board has said that it is on, since it was switched on
    attempts: int = 0  # to switch it on
    agreed: _Question | None = None  # the last answer that was right
    strayed: int = 0  # how often the board had another value though nothing had been sent
    strayed_at: float = -math.inf


class PinWatch:
    """What was sent to the configured pins, compared with what the board says of them.

    An answer is compared with what had been sent when it was asked. Answers come in the order of the
    questions, so a question that is overtaken by the answer to a later one is lost. ``states``: the pins at
    the beginning. ``steps_us_per_s``: by pin, how fast it may be brought back to where it should be.
    """

    def __init__(
        self, states: Iterable[PinState] = (), steps_us_per_s: Mapping[int, float | None] | None = None
    ) -> None:
        self._pins: dict[int, _Pin] = {}
        steps = steps_us_per_s or {}
        for state in sorted(states, key=lambda state: state.pin):
            on = state.mode == PinMode.SERVO
            # Degrees, or no value yet, are no pulse width.
            pulse_us = _possible(state.value) if on else None
            step = steps.get(state.pin) or math.inf
            self._pins[state.pin] = _Pin(on, pulse_us, step_us_per_s=step, seen_on=on, attempts=int(on))
        self._turn: list[int] = list(self._pins)
        self._open: deque[_Question] = deque()
        self._waiting_since: float | None = None
        self.asked = self.lost = 0
        """questions that were put, and those that got no answer, since the caller set them to 0"""

    @property
    def positions(self) -> dict[int, float | None]:
        """The pulse width [µs] last sent to each pin; None where it is off or not known."""
        return {
            number: float(pin.pulse_us) if pin.on and pin.pulse_us is not None else None
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

    @property
    def never_on(self) -> tuple[int, ...]:
        """Those of them that the board never had on."""
        return tuple(number for number in self.switched_off if not self._pins[number].seen_on)

    @property
    def strayed(self) -> tuple[int, ...]:
        """The pins that somebody else has set for certain."""
        return tuple(number for number, pin in self._pins.items() if pin.strayed >= _CERTAIN)

    @property
    def open_questions(self) -> int:
        """How many have not been answered yet."""
        return len(self._open)

    def silent_s(self, now: float) -> float:
        """For how long the board has left questions unanswered, all of them."""
        return 0.0 if self._waiting_since is None else now - self._waiting_since

    def oldest_s(self, now: float) -> float:
        """How long ago the oldest question was put that is not answered yet."""
        return now - self._open[0].at if self._open else 0.0

    def due(self, wanted: Mapping[int, int], now: float) -> tuple[dict[int, int], dict[int, int]]:
        """What the board has not got, or must be sent again [µs]: on pins that are on, and off.

        A pin that was seen with another value is brought to the right one no faster than it may move.
        """
        on: dict[int, int] = {}
        off: dict[int, int] = {}
        for number, pin in self._pins.items():
            pulse_us = wanted.get(number, pin.pulse_us if pin.doubtful else None)
            if pulse_us is None or not (pin.doubtful or pulse_us != pin.pulse_us):
                continue
            if pin.on and pin.held_us is not None:
                step = pin.step_us_per_s * min(now - pin.sent_at, SERVO_FRAME_S)
                if abs(pulse_us - pin.held_us) > step:
                    pulse_us = pin.held_us + round(math.copysign(max(step, 1.0), pulse_us - pin.held_us))
            (on if pin.on else off)[number] = pulse_us
        return on, off

    def carry_on(self, earlier: PinWatch) -> tuple[tuple[int, ...], tuple[str, ...]]:
        """Take over what an earlier watch says was sent.

        Returns the pins that were on then and are not now, and what is to be said of those that are on and
        have another value than the one last sent: they are brought there.
        """
        gone: list[int] = []
        words: list[str] = []
        for number, was in earlier._pins.items():
            pin = self._pins.get(number)
            if pin is None or not was.on:
                continue
            if not pin.on and was.seen_on:
                gone.append(number)
            elif not pin.on:  # it never was: it is to be switched on again
                pin.pulse_us, pin.doubtful, pin.attempts = was.pulse_us, True, was.attempts
            else:
                held_us, pin.pulse_us, pin.sent_at = pin.pulse_us, was.pulse_us, was.sent_at
                pin.doubtful, pin.held_us, pin.strayed = was.doubtful, was.held_us, was.strayed
                if was.pulse_us is not None and held_us != was.pulse_us:
                    pin.doubtful, pin.held_us = True, held_us
                    words.append(_another(number, held_us, was.pulse_us))
        return tuple(gone), tuple(words)

    def sent(self, pulses: Mapping[int, int], now: float, wanted: Mapping[int, int] | None = None) -> None:
        """Note what was sent [µs] by pin; a pin that was off is on now. ``wanted``: where it is to go."""
        for number, pulse_us in pulses.items():
            pin = self._pins[number]
            if not pin.on:
                pin.contradictions, pin.seen_on = 0, False
                pin.attempts += 1
            goal = (pulses if wanted is None else wanted).get(number, pin.pulse_us)
            # On the way there it is sent again and again, each time from where it is by then.
            pin.doubtful = goal is not None and goal != pulse_us
            pin.held_us = pulse_us if pin.doubtful else None
            pin.on, pin.pulse_us, pin.sent_at = True, goal if pin.doubtful else pulse_us, now

    def released(self) -> None:
        """Note that every pin is off."""
        self._pins = {number: _Pin(step_us_per_s=pin.step_us_per_s) for number, pin in self._pins.items()}
        self._open.clear()
        self._waiting_since = None

    def ask(self, count: int, now: float) -> tuple[int, ...]:
        """The next pins to ask about, at most ``count``, none that has not answered yet."""
        chosen = [number for number in self._turn if self._pins[number].asked is None][:count]
        for number in chosen:
            pin = self._pins[number]
            # On its way to where it should be it may have any value in between.
            pin.asked = _Question(number, now, pin.on, None if pin.doubtful else pin.pulse_us)
            self._note(pin.asked)
        self._turn = [number for number in self._turn if number not in chosen] + chosen
        return tuple(chosen)

    def ask_marker(self, marker: int, now: float) -> int:
        """Ask about a pin that is not configured: its answer shows what else is lost."""
        self._note(_Question(marker, now))
        return marker

    def _note(self, question: _Question) -> None:
        self._open.append(question)
        self.asked += 1
        if self._waiting_since is None:
            self._waiting_since = question.at

    def answered(self, state: PinState, now: float) -> str | None:
        """Take an answer; words where it is not what it should be, None where it is or was not asked."""
        if all(question.pin != state.pin for question in self._open):
            return None
        words: str | None = None
        while (question := self._open.popleft()).pin != state.pin:
            self.lost += 1
            if question.pin in self._pins:
                self._pins[question.pin].asked = None
            if now - question.at > _LONG_LOSS_S and words is None:
                words = (
                    f"the board did not get what was sent {1000 * (now - question.at):.0f} ms ago: setpoints "
                    "may be lost, which shows as a step of the arm; check the USB cable"
                )
        self._waiting_since = now if self._open else None
        pin = self._pins.get(state.pin)
        if pin is None or pin.asked is not question:
            return words
        pin.asked = None
        return self._compared(state, pin, question) or words

    def _compared(self, state: PinState, pin: _Pin, asked: _Question) -> str | None:
        on = state.mode == PinMode.SERVO
        if on != asked.on:
            pin.contradictions += 1
            if not on and not pin.seen_on:
                if pin.on and pin.contradictions >= _CERTAIN and pin.attempts < _ATTACH_ATTEMPTS:
                    pin.on, pin.doubtful, pin.held_us, pin.contradictions = False, True, None, 0
                return None
            return (
                f"pin {state.pin} is {'still on' if on else 'no longer on'} at the board, though armctl "
                f"{'switched it off' if on else 'did not switch it off'}"
            )
        pin.contradictions = 0
        pin.seen_on = on
        if not on or asked.pulse_us is None:
            return None
        if state.value == asked.pulse_us:
            pin.agreed = asked
            return None
        # Sent again at once, unless the next setpoint overtakes it.
        pin.doubtful = pin.on
        told_us = _possible(state.value)
        pin.held_us = told_us if pin.pulse_us == asked.pulse_us else None
        agreed = pin.agreed
        if state.value > LARGEST_PULSE_US:
            agreed = None  # nobody sets that: the answer is garbled
        if agreed is not None and agreed.pulse_us == asked.pulse_us and agreed.at >= pin.sent_at:
            pin.strayed = 1 + (pin.strayed if asked.at - pin.strayed_at < _STRAYS_WITHIN_S else 0)
            pin.strayed_at, pin.agreed = asked.at, None
            unit = "°" if told_us is None else " µs"
            return (
                f"pin {state.pin} went from {asked.pulse_us} µs to {state.value}{unit}, which armctl did not "
                f"send: another program writes to this board, or {_LOST}; brought back"
            )
        return _another(state.pin, told_us, asked.pulse_us)


def _possible(value: int) -> int | None:
    """A value that the board has told, where it can be a pulse width; None: garbled, or set as degrees."""
    return value if SMALLEST_PULSE_US <= value <= LARGEST_PULSE_US else None


def _another(pin: int, held_us: int | None, pulse_us: int) -> str:
    return (
        f"pin {pin} had {'no pulse width' if held_us is None else held_us} instead of the {pulse_us} µs last "
        f"sent: {_LOST}; sent again. Check the USB cable"
    )


# Switching servos on so that their first pulse is already the right one.

_MOST_ON_FRESH_BOARD = 12
"""so many fit into the 32 ms in which a timer that has just been started sends no pulse"""
_TRANSMIT_BUFFER = 64
_RECEIVE_BUFFER = 63
_REPORT_FRAME = 5
_HELD_S = 0.5
"""after that an answer that has not come is lost: the line takes 25 ms, and late bytes have come by then"""
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

    While it is held, its receive buffer has no room for anything else: until all its answers have come
    (``holding``) nothing more is sent. Bytes that come late, and then together, would overflow it.
    """

    def __init__(self, firmware_name: str, *, fresh: bool) -> None:
        self._report_length = _REPORT_FRAME + 2 * len(firmware_name)
        self._fresh = fresh
        self._awaited = 0
        self._held_until = -math.inf

    def holding(self, now: float) -> bool:
        """Whether the sketch may still be held."""
        return self._awaited > 0 and now < self._held_until

    def answered(self) -> None:
        """The sketch told its name."""
        self._awaited = max(0, self._awaited - 1)

    @property
    def most_at_once(self) -> int:
        """How many servos the next burst may switch on."""
        if self._fresh:
            return _MOST_ON_FRESH_BOARD
        count = 1
        while self._needed(count + 1) <= self._allowed(count + 1):
            count += 1
        return count

    def burst(self, pulses: Mapping[int, int], table: ChannelTable, now: float) -> tuple[bytes, int]:
        """Bytes that attach up to ``most_at_once`` servos at pulses [µs] by pin; the length of the answer."""
        request = b"".join(
            codec.servo_config(pin, *codec.servo_limits(*table.whole_range(pin)))
            + codec.servo_write(pin, pulse_us)
            for pin, pulse_us in pulses.items()
        )
        count = 0 if self._fresh else min(self._needed(len(pulses)), self._allowed(len(pulses)))
        self._fresh = False
        self._awaited, self._held_until = count, now + _HELD_S
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
_WRITE_BYTES = len(codec.servo_write(0, SMALLEST_PULSE_US))
_MOST_QUERIES = 8
"""their answers of 7 bytes fit into the board's 64-byte transmit buffer: it never has to wait for it"""
_OVERDUE_S = 0.03
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

    @property
    def waiting(self) -> bool:
        """Whether something is still to be sent: a setpoint, or a pin that is to be switched on."""
        return bool(self._pending)

    def clear(self) -> None:
        """Forget what has not been sent."""
        self._pending.clear()

    def told_name(self) -> None:
        """The sketch told its name, which it is asked for to hold it."""
        self._attacher.answered()

    def send(self, data: bytes, answer_length: int = 0) -> None:
        """Send at once."""
        self._send_bytes(data)
        # Both directions of the line work at once: the longer one counts.
        length = max(len(data), answer_length)
        self._busy_until = max(self._busy_until, self._now()) + length * BYTE_S

    def flush(self, table: ChannelTable, watch: PinWatch) -> None:
        """Send the newest setpoints that the board has not got, once the line is free for them."""
        now = self._now()
        # A round of questions may be in front of them, or reading before writing would cost a frame.
        backlog = self._backlog(now)
        full = backlog + _WRITE_BYTES * len(self._pending) > SERVO_FRAME_S / BYTE_S
        if backlog > _MOST_QUERIES * _QUERY_BYTES + _ROUNDING_SLACK or (full and backlog > _ROUNDING_SLACK):
            return
        if self._attacher.holding(now):
            return
        setpoints, off = watch.due(self._pending, now)
        wanted, self._pending = self._pending, off
        request, answer_length = b"".join(itertools.starmap(codec.servo_write, setpoints.items())), 0
        # Answers that are still to come would fill the transmit buffer, and hold the sketch too early.
        if off and not watch.open_questions:
            first = dict(itertools.islice(off.items(), self._attacher.most_at_once))
            attach, answer_length = self._attacher.burst(first, table, now)
            request += attach
            self._pending = {pin: pulse_us for pin, pulse_us in off.items() if pin not in first}
            watch.sent(first, now)
        if request:
            self.send(request, answer_length)
            watch.sent(setpoints, now, wanted)

    def ask_next(self, watch: PinWatch, marker: Callable[[], int]) -> None:
        """Ask for as many pin states as the line has room for in this servo frame, in turn.

        Never more than the board can answer without waiting for its transmit buffer. Where the last answers
        are overdue, a ``marker`` is asked, a pin that drives no servo: its answer shows what is lost.
        """
        now = self._now()
        if now - self._asked_at < _ROUND_S or self._attacher.holding(now):
            return
        room = int(max(0.0, _FRAME_BYTES - self._backlog(now) + _ROUNDING_SLACK)) // _QUERY_BYTES
        if watch.oldest_s(now) > _OVERDUE_S:
            pins = (watch.ask_marker(marker(), now),) if room else ()
        elif self._pending:  # pins that are to be switched on once no answer is open
            pins = ()
        else:
            pins = watch.ask(max(0, min(_MOST_QUERIES - watch.open_questions, room)), now)
        if pins:
            self._asked_at = now
            self.send(b"".join(map(codec.pin_state_query, pins)))

    def _backlog(self, now: float) -> float:
        """How many of the bytes sent so far have not gone out yet."""
        return max(0.0, self._busy_until - now) / BYTE_S

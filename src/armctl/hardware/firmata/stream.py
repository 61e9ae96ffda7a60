"""Setpoints and questions on their way to the pins of a Firmata board, and how servos are switched on."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence

from armctl.hardware.driver import ChannelTable
from armctl.hardware.firmata import BYTE_S, SERVO_FRAME_S, SMALLEST_PULSE_US, codec
from armctl.hardware.firmata.codec import PinMode
from armctl.hardware.firmata.pin_watch import PinWatch

# Switching servos on so that their first pulse can only be the right one.

_TRANSMIT_BUFFER = 64
_RECEIVE_BUFFER = 63
_REPORT_FRAME = 5
_HELD_S = 0.5
"""after that an answer that has not come is lost: the line takes 25 ms, and late bytes have come by then"""
_SHARED_SERVOS = (2, 4)
"""the first version of the sketch whose pins share its servos"""
_LED_PIN = 13
"""its LED blinks whenever an Arduino starts: whatever is connected there has seen pulses before"""
_SETTING_BYTES = len(codec.servo_config(0, 0, 0)) + len(codec.servo_write(0, SMALLEST_PULSE_US))
_PREPARING_BYTES = _SETTING_BYTES + len(codec.pin_mode(0, PinMode.OUTPUT))


class Attacher:
    """Makes the bytes that switch servos on.

    An attached servo sends the width that the sketch keeps for it, 1500 µs at first, until a write says
    otherwise; and only a servo that is attached can be written to. So the width is brought there before:

    - Up to version 2.3 each pin has a servo of its own. While all are off, each one is attached, written
      to and detached (``prepare``). No pulse begins meanwhile: the library sets a timer that drives no
      servo to 0 when one is attached, and its interrupt comes at the earliest after the shortest pulse,
      544 µs. For that the bytes of a pin must be obeyed within 0.3 ms, and the sketch is kept from looking
      until they are there: it is first asked for its name, as often as it takes to fill its transmit
      buffer, and waits for that to drain.
    - Later versions give a servo that was freed to the pin that is attached next, with the width that it
      had. So ``spare``, a pin that drives no servo, is attached, written to and detached ahead of each.

    While the sketch is held, its receive buffer has no room for anything else: until all its answers have
    come (``holding``) nothing more is sent. Bytes that come late, and then together, would overflow it.
    """

    def __init__(self, firmware_name: str, version: tuple[int, int], spare: int | None) -> None:
        self._report_length = _REPORT_FRAME + 2 * len(firmware_name)
        self._spare = spare if version >= _SHARED_SERVOS else None
        self._awaited = 0
        self._held_until = -math.inf

    def holding(self, now: float) -> bool:
        """Whether the sketch may still be held."""
        return self._awaited > 0 and now < self._held_until

    def answered(self) -> None:
        """The sketch told its name."""
        self._awaited = max(0, self._awaited - 1)

    @property
    def needs_preparing(self) -> bool:
        """Whether pins have to be prepared while all of them are off."""
        return self._spare is None

    @property
    def most_prepared_at_once(self) -> int:
        """How many pins one ``prepare`` is good for."""
        count = 1
        while self._needed(_PREPARING_BYTES * (count + 1)) <= self._allowed(_PREPARING_BYTES * (count + 1)):
            count += 1
        return count

    def prepare(self, pulses: Mapping[int, int], table: ChannelTable, now: float) -> tuple[bytes, int]:
        """Bytes that leave pins off and let the sketch keep pulses [µs] by pin; length of the answer."""
        request = b"".join(
            _setting(pin, pulse_us, table, pin) + codec.pin_mode(pin, PinMode.OUTPUT)
            for pin, pulse_us in pulses.items()
        )
        return self._held(request, now)

    def attach(
        self, pin: int, pulse_us: int, table: ChannelTable, now: float, *, kept: bool
    ) -> tuple[bytes, int]:
        """Bytes that switch a pin on at a pulse [µs]; the length of the answer.

        ``kept``: the sketch keeps that width for it. If it does not, and others are on, a frame may begin
        between the two messages: the sketch is held, so that they are 0.1 ms apart (one case in 200).
        """
        request = _setting(pin, pulse_us, table, pin)
        if self._spare is not None:
            spare = _setting(self._spare, pulse_us, table, pin)
            off = codec.pin_mode(self._spare, PinMode.OUTPUT) + codec.pin_low(self._spare)
            return spare + off + request, 0
        return (request, 0) if kept else self._held(request, now)

    def _held(self, request: bytes, now: float) -> tuple[bytes, int]:
        count = min(self._needed(len(request)), self._allowed(len(request)))
        self._awaited, self._held_until = count, now + _HELD_S
        return codec.FIRMWARE_QUERY * count + request, self._report_length * count

    def _needed(self, length: int) -> int:
        """How many questions hold the sketch until so many bytes have come in.

        It begins to answer after the first one, and is held until all but a buffer full has gone out.
        """
        gained = self._report_length - len(codec.FIRMWARE_QUERY)
        return -(-(_TRANSMIT_BUFFER + 1 + length - len(codec.FIRMWARE_QUERY)) // gained)

    def _allowed(self, length: int) -> int:
        """How many questions leave room in the receive buffer, the first one being taken out at once."""
        return (_RECEIVE_BUFFER - length) // len(codec.FIRMWARE_QUERY) + 1


def spare_pin(servo_pins: Sequence[int], used: Sequence[int]) -> int | None:
    """A pin that drives no servo and may be pulsed: that of the LED, else the last one that is free."""
    free = [pin for pin in servo_pins if pin not in used]
    return _LED_PIN if _LED_PIN in free else max(free, default=None)


def _setting(pin: int, pulse_us: int, table: ChannelTable, like: int) -> bytes:
    """Attach a pin, with the limits of ``like``, and write to it."""
    return codec.servo_config(pin, *codec.servo_limits(*table.whole_range(like))) + codec.servo_write(
        pin, pulse_us
    )


# No faster than the line carries: the system and the USB adapter take far more, and setpoints only get old.

_FRAME_BYTES = 0.9 * SERVO_FRAME_S / BYTE_S
_ROUNDING_SLACK = 1e-6
_QUERY_BYTES = len(codec.pin_state_query(0))
_WRITE_BYTES = len(codec.servo_write(0, SMALLEST_PULSE_US))
_MOST_QUERIES = 8
"""their answers of 7 bytes fit into the board's 64-byte transmit buffer: it never has to wait for it"""
_OVERDUE_S = 0.03
_LOST_S = 0.15
"""while pins wait to be switched on, an answer that took so long is lost; a marker is one more question"""
_SETPOINT_S = 0.1
"""so long a setpoint may wait, a few servo frames"""
_ATTACH_S = 0.5
"""so long a pin may wait to be switched on: for answers that are late, and while others are prepared"""
_ROUND_S = 0.75 * SERVO_FRAME_S
"""shortest time between two rounds of questions; a loop of 20 ms is now and then early"""


class SetpointStream:
    """Keeps the newest setpoints until the line is free for them; ``attacher`` switches pins on.

    What has waited for too long is dropped: the board may have been silent meanwhile, or the line blocked.
    What gets through after a while would be one large step of the arm, or a servo that comes on unasked.
    """

    def __init__(self, send: Callable[[bytes], None], now: Callable[[], float], attacher: Attacher) -> None:
        self._send_bytes, self._now, self.attacher = send, now, attacher
        self._busy_until = 0.0
        self._pending: dict[int, int] = {}
        self._since: dict[int, float] = {}
        """since when a pin waits for what it has not been sent"""
        self._expired: set[int] = set()
        self.first: Mapping[int, int] = {}
        """the widths [µs] by pin with which pins that are off will be switched on, as far as is known"""
        self._asked_at = -_ROUND_S

    def put(self, pulses: Mapping[int, int]) -> None:
        """Have pulse widths [µs] by pin sent with the next ``flush``."""
        self._pending.update(pulses)
        now = self._now()
        for pin in pulses:
            self._since.setdefault(pin, now)

    @property
    def waiting(self) -> bool:
        """Whether something is still to be sent: a setpoint, or a pin that is to be switched on."""
        return bool(self._pending)

    def clear(self) -> None:
        """Forget what has not been sent."""
        self._pending.clear()
        self._since.clear()

    def drop(self, watch: PinWatch, *, all_of_it: bool = False) -> None:
        """Drop what has waited for too long, or all that waits; ``take_expired`` tells it."""
        now = self._now()
        for pin, since in list(self._since.items()):
            if all_of_it or now - since > (_SETPOINT_S if watch.is_on(pin) else _ATTACH_S):
                self._pending.pop(pin, None)
                del self._since[pin]
                watch.dropped(pin)
                self._expired.add(pin)

    def take_expired(self) -> tuple[int, ...]:
        """The pins of which something was dropped since this was asked last."""
        expired, self._expired = tuple(sorted(self._expired)), set()
        return expired

    def told_name(self) -> None:
        """The sketch told its name, which it is asked for to hold it."""
        self.attacher.answered()

    def send(self, data: bytes, answer_length: int = 0) -> None:
        """Send at once."""
        self._send_bytes(data)
        # Both directions of the line work at once: the longer one counts.
        length = max(len(data), answer_length)
        self._busy_until = max(self._busy_until, self._now()) + length * BYTE_S

    def flush(self, table: ChannelTable, watch: PinWatch) -> None:
        """Send the newest setpoints that the board has not got, once the line is free for them."""
        now = self._now()
        self.drop(watch)
        # A round of questions may be in front of them, or reading before writing would cost a frame.
        backlog = self._backlog(now)
        full = backlog + _WRITE_BYTES * len(self._pending) > SERVO_FRAME_S / BYTE_S
        if backlog > _MOST_QUERIES * _QUERY_BYTES + _ROUNDING_SLACK or (full and backlog > _ROUNDING_SLACK):
            return
        if self.attacher.holding(now) or watch.stalls(now):
            return
        setpoints, off = watch.due(self._pending, now)
        wanted, self._pending = self._pending, off
        self._since = {pin: self._since.get(pin, now) for pin in off}
        request = b"".join(itertools.starmap(codec.servo_write, setpoints.items()))
        watch.sent(setpoints, now, wanted)
        attach, answer_length = self._switch_on(off, table, watch, now) if off else (b"", 0)
        if request or attach:
            self.send(request + attach, answer_length)

    def _switch_on(
        self, off: Mapping[int, int], table: ChannelTable, watch: PinWatch, now: float
    ) -> tuple[bytes, int]:
        """The bytes for the next pin that is to be switched on, or that prepare it; length of the answer."""
        attacher = self.attacher
        if attacher.needs_preparing and not watch.powered:
            first = {pin: us for pin, us in {**self.first, **off}.items() if not watch.keeps(pin, us)}
            if first:
                if watch.open_questions:  # their answers would fill the transmit buffer too early
                    return b"", 0
                first = dict(itertools.islice(first.items(), attacher.most_prepared_at_once))
                watch.prepared(first)
                self._since = dict.fromkeys(off, now)  # they wait for each other, not for the line
                return attacher.prepare(first, table, now)
        request, answer_length = b"", 0
        for pin, pulse_us in tuple(off.items()):
            kept = not attacher.needs_preparing or watch.keeps(pin, pulse_us)
            if not kept and (request or watch.open_questions):
                break
            more, answer_length = attacher.attach(pin, pulse_us, table, now, kept=kept)
            if len(request + more) > _RECEIVE_BUFFER:
                break
            request += more
            del self._pending[pin], self._since[pin]
            watch.sent({pin: pulse_us}, now)
            if not kept:
                break
        return request, answer_length

    def ask_next(self, watch: PinWatch, marker: Callable[[], int]) -> None:
        """Ask for as many pin states as the line has room for in this servo frame, in turn.

        Never more than the board can answer without waiting for its transmit buffer. Where the last answers
        are overdue, a ``marker`` is asked, a pin that drives no servo: its answer shows what is lost.
        """
        now = self._now()
        if now - self._asked_at < _ROUND_S or self.attacher.holding(now):
            return
        room = int(max(0.0, _FRAME_BYTES - self._backlog(now) + _ROUNDING_SLACK)) // _QUERY_BYTES
        if self._pending and watch.oldest_s(now) <= _LOST_S:  # pins are switched on once no answer is open
            pins = ()
        elif watch.oldest_s(now) > (_LOST_S if self._pending else _OVERDUE_S):
            pins = (watch.ask_marker(marker(), now),) if room else ()
            if not watch.confirmed:  # somebody waits for them
                pins += watch.ask(max(0, min(_MOST_QUERIES - watch.open_questions, room - 1)), now)
        else:
            pins = watch.ask(max(0, min(_MOST_QUERIES - watch.open_questions, room)), now)
        if pins:
            self._asked_at = now
            self.send(b"".join(map(codec.pin_state_query, pins)))

    def _backlog(self, now: float) -> float:
        """How many of the bytes sent so far have not gone out yet."""
        return max(0.0, self._busy_until - now) / BYTE_S

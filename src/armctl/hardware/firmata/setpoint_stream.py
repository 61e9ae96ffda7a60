"""Setpoints and questions on their way to a Firmata board, no faster than the line carries them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

from armctl.hardware.firmata import codec
from armctl.hardware.firmata.attacher import Attacher, FirstPulse
from armctl.hardware.firmata.pace import LinePace
from armctl.hardware.firmata.pin_table import PinTable
from armctl.hardware.firmata.pin_watch import PinWatch

SERVO_FRAME_S = 0.020
_LINE_SHARE = 0.9
_QUERY_BYTES = len(codec.pin_state_query(0))
_MOST_QUERIES = 8
"""their answers of 7 bytes fit into the board's 64-byte transmit buffer: it never has to wait for it"""
_ROUND_S = 0.75 * SERVO_FRAME_S
"""shortest time between two rounds of questions; a loop of 20 ms is now and then early"""


class SetpointStream:
    """Keeps the newest setpoints until the line is free for them.

    Args:
        send: writes to the line.
        now: the clock [s].
        attacher: switches pins on.
    """

    def __init__(self, send: Callable[[bytes], None], now: Callable[[], float], attacher: Attacher) -> None:
        self._send_bytes, self._now, self._attacher = send, now, attacher
        self._pace = LinePace(SERVO_FRAME_S, _LINE_SHARE)
        self._pending: dict[int, int] = {}
        self._asked_at = -_ROUND_S

    def put(self, pulses: Mapping[int, int]) -> None:
        """Have pulse widths [µs] by pin sent with the next ``flush``."""
        self._pending.update(pulses)

    def clear(self) -> None:
        """Forget what has not been sent."""
        self._pending.clear()

    def send(self, data: bytes, answer_length: int = 0) -> None:
        """Send at once, on the line's account."""
        self._send_bytes(data)
        # Both directions of the line work at once: the longer one counts.
        self._pace.charge(max(len(data), answer_length), self._now())

    def flush(self, table: PinTable, watch: PinWatch) -> None:
        """Send the newest setpoints that the board has not got, once the line is free for them."""
        # A round of questions may be in front of them, or reading before writing would cost a frame.
        if self._pace.waiting(self._now()) > _MOST_QUERIES * _QUERY_BYTES:
            return
        wanted = watch.to_repeat() | self._pending
        due = {pin: pulse for pin, pulse in sorted(wanted.items()) if watch.needs(pin, pulse)}
        setpoints = {pin: pulse for pin, pulse in due.items() if watch.is_on(pin)}
        off = [pin for pin in due if pin not in setpoints]
        first, later = off[: self._attacher.most_at_once], off[self._attacher.most_at_once :]
        self._pending = {pin: due[pin] for pin in later}
        request, answer_length = b"".join(itertools.starmap(codec.servo_write, setpoints.items())), 0
        if first:
            servos = [FirstPulse(pin, due[pin], table.range_us(pin)) for pin in first]
            burst = self._attacher.burst(servos)
            request, answer_length = request + burst.request, burst.answer_length
        if request:
            self.send(request, answer_length)
            watch.sent(setpoints | {pin: due[pin] for pin in first})

    def ask_next(self, watch: PinWatch) -> None:
        """Ask for as many pin states as the line has room for in this servo frame, in turn."""
        now = self._now()
        if now - self._asked_at < _ROUND_S:
            return
        count = min(_MOST_QUERIES, self._pace.room(now) // _QUERY_BYTES)
        pins = watch.ask(count, now)
        if pins:
            self._asked_at = now
            self.send(b"".join(map(codec.pin_state_query, pins)))

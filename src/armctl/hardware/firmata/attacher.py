"""Switching servos on so that their first pulse is already the right one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armctl.hardware.firmata import codec

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

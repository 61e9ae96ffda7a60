"""Switching servos on so that their first pulse is already the right one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armctl.hardware.firmata import codec

MOST_AT_ONCE = 3
"""their bytes and the questions' fit into the board's receive buffer of 64 bytes"""

_TRANSMIT_BUFFER = 64
_RECEIVE_BUFFER = 63
_REPORT_FRAME = 5


@dataclass(frozen=True, slots=True)
class Attachment:
    """A servo to be switched on: pin, first pulse, and the range of pulses that it may ever be sent [µs]."""

    pin: int
    pulse_us: int
    range_us: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Burst:
    """Bytes to be written in one go, and how many the board answers."""

    request: bytes
    answer_length: int


def attach(attachments: Sequence[Attachment], firmware_name: str) -> Burst:
    """Attach up to ``MOST_AT_ONCE`` servos, each with its first pulse width right behind.

    An attached servo gets its next pulse at once, 1500 µs or the width last sent there. The write that
    says otherwise is 6 bytes, 1 ms on the line, and in one of thirty cases a servo frame begins in
    between. So the sketch is kept from looking: it is first asked for its name, as often as it takes to
    fill its transmit buffer, and while it waits for that to drain, attach and write both come in. It
    then carries them out back to back, in a few ten µs.
    """
    request = b"".join(
        codec.servo_config(one.pin, *codec.servo_limits(*one.range_us))
        + codec.servo_write(one.pin, one.pulse_us)
        for one in attachments
    )
    question = codec.firmware_query()
    report_length = _REPORT_FRAME + 2 * len(firmware_name)
    # The answers that do not fit into the buffer must last for as long as the request takes to come in.
    count = -(-(_TRANSMIT_BUFFER + 1 + len(request)) // (report_length - len(question)))
    count = min(count, (_RECEIVE_BUFFER - len(request)) // len(question))
    return Burst(question * count + request, report_length * count)

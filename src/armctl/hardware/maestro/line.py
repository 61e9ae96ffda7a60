"""Requests to a Maestro and its answers over one transport, kept in step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from armctl.errors import BoardProtocolError, BoardTimeoutError
from armctl.hardware.maestro import codec
from armctl.hardware.maestro.codec import Framing, MaestroErrors, error_words
from armctl.hardware.transport import Transport

MISUNDERSTOOD = MaestroErrors.SERIAL_PROTOCOL | MaestroErrors.SERIAL_CRC

SILENT_ADVICE = (
    'set the serial mode to "USB Dual Port" in the Maestro Control Center (Serial Settings): in the '
    'factory\'s "UART, detect baud rate" the board silently ignores commands over USB. Check also that this '
    "is the command port (…-if00)"
)
_FIRST_ANSWER_TIMEOUT_S = 1.0
"""Long: a board without CRC that is only late would take the CRC byte that follows for an error."""
_CRC_ANSWER_TIMEOUT_S = 0.25
_QUIET_S = 0.02
_LONGEST_RESYNC = 5


class MaestroLine:
    """A transport with a Maestro at the other end.

    Args:
        transport: the open line; this object closes it.
        framing: form of the commands. ``probe`` finds out whether the board wants CRCs; asked for here,
            they are insisted on.
        timeout_s: how long an answer may take.
    """

    def __init__(self, transport: Transport, framing: Framing, timeout_s: float) -> None:
        self._transport = transport
        self._framing = framing
        self._timeout_s = timeout_s

    @property
    def name(self) -> str:
        """The line as the user named it."""
        return self._transport.name

    def close(self) -> None:
        """Close the transport; never raises."""
        self._transport.close()

    @property
    def framing(self) -> Framing:
        """Form of the commands; after ``probe`` with the CRC setting of the board."""
        return self._framing

    def probe(self) -> MaestroErrors:
        """Find out whether a Maestro answers, and whether it wants CRCs; return the errors it had kept.

        Neither question can be an error to a Maestro, and an error is what would switch its outputs
        off: Get Errors without a CRC is complete to a board with CRC off, and unfinished to one with CRC
        on; the CRC byte is sent only where no answer came, and finishes it. A board in another serial mode
        ignores both (guide, section 5.a).

        Raises:
            BoardTimeoutError: nobody answers; the message says what to set on the board.
            BoardProtocolError: somebody answers, but not as a Maestro does, or it does not check CRCs that
                were asked for.
        """
        self._transport.discard_input()
        plain = replace(self._framing, crc=False)
        question = codec.get_errors(plain)
        self._transport.write(question)
        reply = self._transport.read(codec.ERRORS_REPLY_LENGTH, _FIRST_ANSWER_TIMEOUT_S)
        found = plain
        if not reply:
            found = replace(self._framing, crc=True)
            self._transport.write(codec.get_errors(found)[len(question) :])
            reply = self._transport.read(codec.ERRORS_REPLY_LENGTH, _CRC_ANSWER_TIMEOUT_S)
        if not reply:
            raise BoardTimeoutError(f"{self.name}: no answer; {SILENT_ADVICE}")
        earlier = self._decode_errors(reply)
        if self._framing.crc and not found.crc:
            raise BoardProtocolError(
                f"{self.name}: commands with CRC were asked for, but the board does not check them; tick "
                '"Enable CRC" in the Maestro Control Center (Serial Settings), or ask for none'
            )
        self._framing = found
        _, ours = self.read([0])
        if ours & MISUNDERSTOOD:
            raise BoardProtocolError(
                f"{self.name}: the board answers but misunderstands ({'; '.join(error_words(ours))}); "
                "is anything else connected to this line, or its baud rate another one?"
            )
        return earlier

    def set_limits(self, limits: Sequence[tuple[int, int, int]]) -> MaestroErrors:
        """Set (channel, speed, acceleration) limits in the board's units; return what it says to them."""
        request = b"".join(
            codec.set_speed(channel, speed, self._framing)
            + codec.set_acceleration(channel, acceleration, self._framing)
            for channel, speed, acceleration in limits
        )
        reply = self._exchange(request + codec.get_errors(self._framing), codec.ERRORS_REPLY_LENGTH)
        return self._decode_errors(reply)

    def set_targets(self, quarters: Mapping[int, int], *, multiple: bool) -> None:
        """Send targets [quarter µs] by channel in one write."""
        self._transport.write(codec.set_targets(quarters, self._framing, multiple=multiple))

    def read(self, channels: Sequence[int]) -> tuple[dict[int, float | None], MaestroErrors]:
        """Positions [µs] of ``channels`` and the error register, in one burst each way.

        Raises:
            BoardTimeoutError: no answer, or half of one.
            BoardProtocolError: an answer that no Maestro can give.
        """
        request = b"".join(codec.get_position(channel, self._framing) for channel in channels)
        length = codec.POSITION_REPLY_LENGTH * len(channels)
        reply = self._exchange(request + codec.get_errors(self._framing), length + codec.ERRORS_REPLY_LENGTH)
        errors = self._decode_errors(reply[length:])
        replies = (reply[at : at + codec.POSITION_REPLY_LENGTH] for at in range(0, length, 2))
        return dict(zip(channels, map(self._decode_position, replies), strict=True)), errors

    def _exchange(self, request: bytes, count: int) -> bytes:
        """Send a request and return its answer of ``count`` bytes."""
        # Nothing speaks unasked on this line: whatever is there belongs to an earlier request.
        self._transport.discard_input()
        self._transport.write(request)
        reply = self._transport.read(count, self._timeout_s)
        if len(reply) < count:
            self._resync()
            raise BoardTimeoutError(
                f"{self.name}: the board answered {len(reply)} of {count} bytes within "
                f"{self._timeout_s * 1000:.0f} ms; check the cable and the board's power supply"
            )
        return reply

    def _resync(self) -> None:
        """Wait until the line is quiet: the rest of a late answer must not be taken for the next one."""
        for _ in range(_LONGEST_RESYNC):
            if not self._transport.read(256, _QUIET_S):
                return

    def _decode_errors(self, reply: bytes) -> MaestroErrors:
        try:
            return codec.decode_errors(reply)
        except BoardProtocolError as error:
            raise self._garbled(error) from error

    def _decode_position(self, reply: bytes) -> float | None:
        try:
            return codec.decode_position(reply)
        except BoardProtocolError as error:
            raise self._garbled(error) from error

    def _garbled(self, error: BoardProtocolError) -> BoardProtocolError:
        self._resync()
        return BoardProtocolError(f"{self.name}: {error}")

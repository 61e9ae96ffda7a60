"""The driver for Pololu's Maestro boards on their USB command port (or any other line to one)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware.driver import BoardIdentity, ChannelSettings, ChannelTable, Readback, Source
from armctl.hardware.maestro import codec
from armctl.hardware.maestro.codec import (
    COMPACT,
    MAX_CHANNEL,
    MAX_TARGET,
    QUARTERS_PER_US,
    SCALE,
    SILENT_ADVICE,
    Framing,
    MaestroErrors,
    MaestroModel,
    acceleration_to_units,
    error_words,
    speed_to_units,
    us_to_quarters,
)
from armctl.hardware.transport import Connection, PortInfo, Transport

_MISUNDERSTOOD = MaestroErrors.SERIAL_PROTOCOL | MaestroErrors.SERIAL_CRC
WATCHDOG_NOTE = (
    "the board's own watchdog is not verified: armctl cannot see whether a serial timeout is set. If this "
    'computer or the cable fails, the servos keep their last position for ever, unless "Timeout" is set on '
    "the device (Maestro Control Center, Serial Settings; 0.5 s is a good value) and each channel's "
    '"On startup or error" says where to go then'
)
UNKNOWN_MODEL_NOTE = (
    "the model could not be told from the port: channels above 5 are not checked, and only commands that "
    "all Maestros know are used"
)


class MaestroDriver:
    """A Maestro behind the ``Driver`` protocol. Units are µs, µs/s and µs/s².

    The Maestro's answers carry no checksum: a garbled position that is still a possible one cannot
    be told from a true one. Commands can be protected (``framing`` with ``crc``).

    Args:
        connection: where the board is.
        model: which member of the family; None: as the USB listing says.
        framing: compact or Pololu form. Whether the board wants CRCs is found out when it is opened (asked
            for here, they are insisted on).
        timeout_s: how long a readback may take.
    """

    def __init__(
        self,
        connection: Connection,
        *,
        model: MaestroModel | None = None,
        framing: Framing = COMPACT,
        timeout_s: float = 0.1,
    ) -> None:
        self._connection = connection
        self._asked_model = self._model = model
        self._framing = framing
        self._timeout_s = timeout_s
        self._opened: MaestroLine | None = None
        self._table = ChannelTable(SCALE)
        self._unreported = MaestroErrors(0)

    def open(self) -> BoardIdentity:
        """Open the line and make sure that a Maestro answers; every output stays as it is."""
        self.close()
        self._forget()
        transport, info = self._connection.open()
        self._model = self._asked_model or _listed_model(info)
        line = self._opened = MaestroLine(transport, self._framing, self._timeout_s)
        try:
            earlier = line.probe()
        except BoardError:
            self.close()
            raise
        notes = [] if self._connection.simulated else [WATCHDOG_NOTE]
        if self._model is None:
            notes.append(UNKNOWN_MODEL_NOTE)
        return BoardIdentity(
            kind=self._model.label if self._model else "Pololu Maestro, model unknown",
            port=line.name,
            serial_number=info.serial_number if info else None,
            simulated=self._connection.simulated,
            notes=tuple(notes),
            earlier=tuple(
                f"before armctl connected, the board had reported: {words}" for words in error_words(earlier)
            ),
        )

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        """Set speed and acceleration limits on the board and remember the ranges. Moves nothing."""
        table = channel_table(channels, self._model)
        line = self._maestro
        errors = line.set_limits(
            [
                (one.channel, speed_to_units(one.speed), acceleration_to_units(one.acceleration))
                for one in table.settings
            ]
        )
        if errors & _MISUNDERSTOOD:
            raise BoardProtocolError(
                f"{line.name}: the board did not accept the channel settings "
                f"({'; '.join(error_words(errors))}); has it as many channels as the robot file uses?"
            )
        self._forget()
        self._unreported = errors
        self._table = table

    def write(self, setpoints: Mapping[int, float]) -> None:
        """Send setpoints [µs] in one write; nothing where one of them is refused."""
        quarters = {channel: self._table.admit(channel, pulse) for channel, pulse in setpoints.items()}
        self._send_targets(quarters)

    def read(self) -> Readback:
        """Read the transmitted pulse widths [µs] and the board's error register, which clears it."""
        positions, errors = self._maestro.read(self._table.channels)
        errors |= self._unreported
        self._unreported = MaestroErrors(0)
        return Readback(positions, Source.TRANSMITTED, error_words(errors))

    def stop(self) -> None:
        """Hold every channel that is on at the pulse width that the board transmits now."""
        try:
            positions, errors = self._maestro.read(self._table.channels)
        except (BoardTimeoutError, BoardProtocolError):
            positions, errors = self._maestro.read(self._table.channels)
        self._unreported |= errors
        # A channel that something else put outside its configured range is held there, not moved.
        self._send_targets(
            {channel: us_to_quarters(pulse) for channel, pulse in positions.items() if pulse is not None}
        )

    def home(self) -> None:
        """A servo knows its angle: there is nothing to look for."""
        raise BoardError("a Maestro's servos need no homing")

    def release(self) -> None:
        """Switch the pulses of every configured channel off: the arm drops."""
        self._send_targets(dict.fromkeys(self._table.channels, 0))

    def close(self) -> None:
        """Close the line; never raises. The outputs stay as they are."""
        if self._opened is not None:
            self._opened.close()
            self._opened = None

    @property
    def _maestro(self) -> MaestroLine:
        if self._opened is None:
            raise BoardError("the Maestro is not connected; connect first")
        return self._opened

    def _forget(self) -> None:
        """Know nothing any more of the board's channels: it may be another one, or freshly started."""
        self._table = ChannelTable(SCALE)
        self._unreported = MaestroErrors(0)

    def _send_targets(self, quarters: Mapping[int, int]) -> None:
        line = self._maestro
        if quarters:
            line.set_targets(quarters, multiple=self._model is not None and self._model.has_multiple_targets)


def _listed_model(info: PortInfo | None) -> MaestroModel | None:
    """The model by its USB number.

    The serial protocol has no way to ask: a Get Position of channel 6 would tell a Micro from a Mini, but
    to a Micro it is an error, and an error sends all its channels home.
    """
    return None if info is None else MaestroModel.from_label(info.kind)


# The configured channels of a Maestro.


def channel_table(settings: Sequence[ChannelSettings], model: MaestroModel | None) -> ChannelTable:
    """The configured channels, pulse widths in µs, where ``model`` (None: unknown) has them."""
    last = model.channels - 1 if model is not None else MAX_CHANNEL
    board = f"a {model.label}" if model is not None else "the largest Maestro"

    def check(one: ChannelSettings) -> None:
        if not 0 <= one.channel <= last:
            raise BoardError(
                f"channel {one.channel}: {board} has channels 0 … {last}; change the robot's servo map"
            )
        if not SCALE.holds_range(one, 1, MAX_TARGET):
            raise BoardError(
                f"channel {one.channel}: {one.minimum:g} … {one.maximum:g} µs is no range for a servo; it "
                f"must lie within {SCALE.step:g} … {MAX_TARGET / QUARTERS_PER_US:g} µs, the smaller "
                "number first"
            )

    return ChannelTable(SCALE, settings, check)


# Requests to a Maestro and its answers, kept in step.

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
        if ours & _MISUNDERSTOOD:
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

"""The driver for Pololu's Maestro boards on any line to one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import TypeVar

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.facts import Unanswered
from armctl.hardware.driver import Abilities, BoardIdentity, ChannelSettings, ChannelTable, Readback, Source
from armctl.hardware.maestro import (
    FIRST_DIGITAL_CHANNEL,
    FULL_SCALE,
    HIGH_FROM,
    QUARTERS_PER_US,
    SCALE,
    SILENT_ADVICE,
    MaestroModel,
    codec,
)
from armctl.hardware.maestro.codec import MAX_CHANNEL, MAX_TARGET, REPLY_LENGTH, MaestroErrors, error_words
from armctl.hardware.transport import Connection, Transport
from armctl.robot.signals import ON, Signals

_WRITES = 25
"""so often an output may be written until it reads what it was told"""
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


class MaestroDriver(Abilities):
    """A Maestro behind the ``Driver`` protocol. Units are µs, µs/s and µs/s².

    The Maestro's answers carry no checksum: a garbled position that is still a possible one cannot
    be told from a true one. Commands carry one where the board is set to want it.

    ``model``: None for what the USB listing says; ``timeout_s``: how long a readback may take.
    """

    def __init__(
        self, connection: Connection, *, model: MaestroModel | None = None, timeout_s: float = 0.1
    ) -> None:
        self._connection = connection
        self._asked_model = self._model = model
        self._timeout_s = timeout_s
        self._transport: Transport | None = None
        self._opened: MaestroLine | None = None
        self._table, self._unreported = ChannelTable(SCALE), MaestroErrors(0)
        self._signals = Signals()
        self._unsure: dict[str, tuple[bool, int]] = {}
        """outputs that do not read yet what they were told, by name: whether high, and how often written"""

    def open(self) -> BoardIdentity:
        """Open the line and make sure that a Maestro answers; every output stays as it is."""
        self.close()
        self._table, self._unreported = ChannelTable(SCALE), MaestroErrors(0)
        self._unsure.clear()
        transport, info = self._connection.open()
        # The serial protocol cannot tell the model: a Get Position of channel 6 would tell a Micro from a
        # Mini, but to a Micro it is an error, and an error sends all its channels home.
        listed = None if info is None else MaestroModel.from_label(info.kind)
        model = self._model = self._asked_model or listed
        self._transport = transport
        multiple = model is not None and model.has_multiple_targets
        line = self._opened = MaestroLine(transport, self._timeout_s, multiple=multiple)
        try:
            earlier = line.probe()
        except BoardError:
            self.close()
            raise
        notes = [] if self._connection.simulated else [WATCHDOG_NOTE]
        if model is None:
            notes.append(UNKNOWN_MODEL_NOTE)
        return BoardIdentity(
            kind=model.label if model else "Pololu Maestro, model unknown",
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
        errors = line.insist(lambda: line.set_limits(table.settings))
        if errors & _MISUNDERSTOOD:
            raise BoardProtocolError(
                f"{line.name}: the board did not accept the channel settings "
                f"({'; '.join(error_words(errors))}); has it as many channels as the robot file uses?"
            )
        self._table, self._unreported = table, errors

    def write(self, setpoints: Mapping[int, float]) -> None:
        """Send setpoints [µs] in one write; nothing where one of them is refused."""
        quarters = {channel: self._table.admit(channel, pulse) for channel, pulse in setpoints.items()}
        self._send_targets(quarters)

    def read(self) -> Readback:
        """Read the transmitted pulse widths [µs] and the board's error register, which clears it.

        Where no answer comes it asks once more, before the next setpoint: no setpoint is sent unseen, so one
        lost answer need not halt the arm. An output that does not read what it was told is told again;
        ``BoardError`` where that does not help.
        """
        line, now = self._maestro, self._connection.now
        asked_before, asked_at = line.asked, now()
        every = (*self._signals.inputs, *self._signals.outputs)
        channels = (*self._table.channels, *(one.channel for one in every))
        try:
            told, errors = line.read(channels, _FIRST_TRY * self._timeout_s)
        except (BoardTimeoutError, BoardProtocolError):
            told, errors = line.read(channels)
            line.settled = False
        # Get Position of an input tells its voltage, of an output what it was set to.
        quarters = {one.name: codec.us_to_quarters(us) if (us := told[one.channel]) else 0 for one in every}
        outputs = {one.name: quarters[one.name] >= HIGH_FROM for one in self._signals.outputs}
        if self._unsure:
            self._insist_on(outputs)
        errors |= self._unreported
        self._unreported = MaestroErrors(0)
        asked = line.asked - asked_before
        words = error_words(errors) if errors else ()
        return Readback(
            {channel: told[channel] for channel in self._table.channels},
            Source.TRANSMITTED,
            words,
            warnings={
                one.channel: f"it reads {quarters[one.name]}, and an input {FULL_SCALE} at most: {_SET_MODE}"
                for one in self._signals.inputs
                if quarters[one.name] > FULL_SCALE
            },
            asked=asked,
            lost=asked - 1,
            delay_s=now() - asked_at,
            inputs={
                one.name: _level(quarters[one.name], analog=one.kind == "analog")
                for one in self._signals.inputs
            },
            outputs={name: float(high) for name, high in outputs.items()},
        )

    def use_signals(self, signals: Signals) -> None:
        """Remember them: only the Maestro Control Center sets what a channel is. Outputs stay as they are."""
        check_signals(signals, self._model)
        self._signals = signals

    def set_output(self, name: str, value: float) -> None:
        """High: a target of 1500 µs, which a channel that is set for a servo stands in the middle at."""
        output = self._signals.output(name)
        if output is None:
            raise BoardError(f"the Maestro was told of no output {name!r}")
        self._unsure[name] = value > ON, 1
        self._send_targets({output.channel: HIGH_FROM if value > ON else 0})

    def stop(self) -> None:
        """Hold every channel that is on at the pulse width that the board transmits now."""
        line = self._maestro
        positions, errors = line.insist(lambda: line.read(self._table.channels))
        self._unreported |= errors
        # A channel that something else put outside its configured range is held there, not moved.
        self._send_targets(
            {channel: codec.us_to_quarters(us) for channel, us in positions.items() if us is not None}
        )

    def home(self) -> None:
        """A servo knows its angle: there is nothing to look for."""
        raise BoardError("a Maestro's servos need no homing")

    def release(self) -> None:
        """Switch the pulses of every configured channel off: the arm drops."""
        self.release_channels(self._table.channels)

    def release_channels(self, channels: Sequence[int]) -> None:
        """The same of some of them: a target of 0 ends the pulses of one channel."""
        self._send_targets(dict.fromkeys(channels, 0))

    def close(self) -> None:
        """Close the line; never raises. The outputs stay as they are."""
        if self._transport is not None:
            self._transport.close()
        self._transport = self._opened = None

    @property
    def _maestro(self) -> MaestroLine:
        if self._opened is None:
            raise BoardError("the Maestro is not connected; connect first")
        return self._opened

    def _insist_on(self, outputs: Mapping[str, bool]) -> None:
        """Write outputs again that read something else than they were told: nothing confirms a write."""
        again: dict[int, int] = {}
        for name, (high, times) in list(self._unsure.items()):
            output = self._signals.output(name)
            if output is None or outputs[name] == high:
                del self._unsure[name]
                continue
            if times >= _WRITES:
                raise BoardError(
                    f"{output.title}: the board did not switch channel {output.channel} though told {times} "
                    f'times; is its mode "Output" in the Maestro Control Center? Check the cable, then '
                    "connect again"
                )
            self._unsure[name] = high, times + 1
            again[output.channel] = HIGH_FROM if high else 0
        self._send_targets(again)

    def _send_targets(self, quarters: Mapping[int, int]) -> None:
        line = self._maestro
        if quarters:
            line.set_targets(quarters)


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


_SET_MODE = 'set the mode of this channel to "Input" in the Maestro Control Center (Channel Settings)'


def check_signals(signals: Signals, model: MaestroModel | None) -> None:
    """Refuse channels that ``model`` (None: unknown) has not, or that cannot measure a voltage."""
    last = MAX_CHANNEL if model is None else model.channels - 1
    for one in (*signals.inputs, *signals.outputs):
        if one.channel > last:
            raise BoardError(
                f"{one.title} is on channel {one.channel}: the board has channels 0 … {last}; change the "
                "robot file, or use a larger Maestro"
            )
        if one.kind == "analog" and one.channel >= FIRST_DIGITAL_CHANNEL:
            raise BoardError(
                f"{one.title} is on channel {one.channel}: a Maestro measures voltages on channels 0 … "
                f"{FIRST_DIGITAL_CHANNEL - 1} only; the others are digital"
            )


def _level(reading: int, *, analog: bool) -> float:
    """What an input reads, 0 ... 1."""
    share = min(1.0, reading / FULL_SCALE)
    return share if analog else float(share > ON)


# Requests to a Maestro and its answers, kept in step.

_FIRST_ANSWER_TIMEOUT_S = 1.0
"""Long: a board without CRC that is only late would take the CRC byte that follows for an error."""
_CRC_ANSWER_TIMEOUT_S = 0.25
_QUIET_S = 0.015
_LONGEST_RESYNC = 5
_FIRST_TRY = 0.2
"""of the time that an answer may take: a tick in which one is lost and asked for again is not late (60 ms)"""
_ATTEMPTS = 3

Answer = TypeVar("Answer")


class MaestroLine:
    """A transport with a Maestro at the other end, which answers within ``timeout_s``.

    ``multiple``: it is known to take Set Multiple Targets.
    """

    def __init__(self, transport: Transport, timeout_s: float, *, multiple: bool = False) -> None:
        self.name = transport.name
        self._transport = transport
        self._timeout_s, self._multiple = timeout_s, multiple
        self.crc = False  # whether the board wants CRCs, known after ``probe``
        self.asked = 0  # how many times the board was asked for something
        self.settled = True  # else the answer to an earlier question may still come

    def probe(self) -> MaestroErrors:
        """Find out whether a Maestro answers, and whether it wants CRCs; return the errors it had kept.

        Neither question can be an error to a Maestro, and an error is what would switch its outputs
        off: Get Errors without a CRC is complete to a board with CRC off, and unfinished to one with CRC
        on; the CRC byte is sent only where no answer came, and finishes it. A board in another serial mode
        ignores both (guide, section 5.a). ``BoardTimeoutError`` without an answer, ``BoardProtocolError``
        where it is not a Maestro's.
        """
        self._transport.discard_input()
        self._transport.write(codec.command(codec.Opcode.GET_ERRORS))
        reply = self._transport.read(REPLY_LENGTH, _FIRST_ANSWER_TIMEOUT_S)
        self.crc = not reply
        if not reply:
            self._transport.write(codec.command(codec.Opcode.GET_ERRORS, crc=True)[-1:])
            reply = self._transport.read(REPLY_LENGTH, _CRC_ANSWER_TIMEOUT_S)
        if not reply:
            raise BoardTimeoutError(f"{self.name}: no answer; {SILENT_ADVICE}")
        _, earlier = self._decode((), reply)
        _, ours = self.insist(lambda: self.read([0]))
        if ours & _MISUNDERSTOOD:
            raise BoardProtocolError(
                f"{self.name}: the board answers but misunderstands ({'; '.join(error_words(ours))}); "
                "is anything else connected to this line, or its baud rate another one?"
            )
        return earlier

    def set_limits(self, settings: Sequence[ChannelSettings]) -> MaestroErrors:
        """Set the channels' speed and acceleration limits; return what the board says to them."""
        request = b"".join(
            codec.command(codec.Opcode.SET_SPEED, one.channel, codec.speed_to_units(one.speed), crc=self.crc)
            + codec.command(
                codec.Opcode.SET_ACCELERATION,
                one.channel,
                codec.acceleration_to_units(one.acceleration),
                crc=self.crc,
            )
            for one in settings
        )
        _, errors = self._exchange(request, ())
        return errors

    def set_targets(self, quarters: Mapping[int, int]) -> None:
        """Send targets [quarter µs] by channel in one write."""
        self._transport.write(codec.set_targets(quarters, crc=self.crc, multiple=self._multiple))

    def read(
        self, channels: Sequence[int], timeout_s: float | None = None
    ) -> tuple[dict[int, float | None], MaestroErrors]:
        """Positions [µs] of ``channels`` and the error register, in one burst each way."""
        return self._exchange(
            b"".join(codec.command(codec.Opcode.GET_POSITION, one, crc=self.crc) for one in channels),
            channels,
            timeout_s,
        )

    def insist(self, ask: Callable[[], Answer]) -> Answer:
        """What ``ask`` returns, asked again a few times where no good answer comes."""
        for _ in range(_ATTEMPTS - 1):
            with suppress(BoardTimeoutError, BoardProtocolError):
                return ask()
        return ask()

    def _exchange(
        self, request: bytes, channels: Sequence[int], timeout_s: float | None = None
    ) -> tuple[dict[int, float | None], MaestroErrors]:
        """Send a request and Get Errors; take the positions of ``channels`` and the errors."""
        self.asked += 1
        timeout_s = self._timeout_s if timeout_s is None else timeout_s
        # Nothing speaks unasked on this line: whatever is there belongs to an earlier request.
        if not self.settled:
            self._resync()
        self._transport.discard_input()
        self._transport.write(request + codec.command(codec.Opcode.GET_ERRORS, crc=self.crc))
        count = REPLY_LENGTH * (len(channels) + 1)
        reply = self._transport.read(count, timeout_s)
        if len(reply) < count:
            self._resync()
            what = f"{self.name}: the board answered {len(reply)} of {count} bytes within"
            check = "the cable and the board's power supply"
            raise BoardTimeoutError(Unanswered(f"{what} {timeout_s * 1000:.0f} ms", check))
        return self._decode(channels, reply)

    def _decode(self, channels: Sequence[int], reply: bytes) -> tuple[dict[int, float | None], MaestroErrors]:
        length = REPLY_LENGTH * len(channels)
        try:
            errors = codec.decode_errors(reply[length:])
            replies = (reply[at : at + REPLY_LENGTH] for at in range(0, length, REPLY_LENGTH))
            return dict(zip(channels, map(codec.decode_position, replies), strict=True)), errors
        except BoardProtocolError as error:
            self._resync()
            raise BoardProtocolError(f"{self.name}: {error}") from error

    def _resync(self) -> None:
        """Wait until the line is quiet: the rest of a late answer must not be taken for the next one."""
        self.settled = True
        for _ in range(_LONGEST_RESYNC):
            if not self._transport.read(256, _QUIET_S):
                return

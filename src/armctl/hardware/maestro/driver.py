"""The driver for Pololu's Maestro boards on their USB command port (or any other line to one)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware.driver import BoardIdentity, ChannelScale, ChannelSettings, Readback, Source
from armctl.hardware.maestro.codec import (
    COMPACT,
    MAX_CHANNEL,
    MAX_TARGET,
    QUARTERS_PER_US,
    Framing,
    MaestroErrors,
    acceleration_to_units,
    error_words,
    speed_to_units,
    us_to_quarters,
)
from armctl.hardware.maestro.line import MISUNDERSTOOD, MaestroLine
from armctl.hardware.ports import AcceptBoard, BoardPort, MaestroModel, PortInfo, any_board, list_ports
from armctl.hardware.transport import Transport

# The configured channels of a Maestro and what each may be sent.

SCALE = ChannelScale("channel", "µs", QUARTERS_PER_US)


class ChannelTable:
    """Settings by channel, checked once, and the last gate before the wire.

    Args:
        settings: what each channel may do; pulse widths in µs.
        model: the board, None when unknown.

    Raises:
        BoardError: a channel that the board has not, twice the same one, or a range that cannot be.
    """

    def __init__(self, settings: Sequence[ChannelSettings], model: MaestroModel | None) -> None:
        last = model.channels - 1 if model is not None else MAX_CHANNEL
        board = f"a {model.label}" if model is not None else "the largest Maestro"
        self._settings: dict[int, ChannelSettings] = {}
        for one in settings:
            if not 0 <= one.channel <= last:
                raise BoardError(
                    f"channel {one.channel}: {board} has channels 0 … {last}; change the robot's servo map"
                )
            if one.channel in self._settings:
                raise BoardError(
                    f"channel {one.channel} is configured twice; give each joint a channel of its own"
                )
            _check_range(one)
            self._settings[one.channel] = one

    @property
    def settings(self) -> tuple[ChannelSettings, ...]:
        """The settings, by channel number."""
        return tuple(self._settings[channel] for channel in self.channels)

    @property
    def channels(self) -> tuple[int, ...]:
        """The configured channels, lowest first."""
        return tuple(sorted(self._settings))

    def admit(self, channel: int, pulse_us: float) -> int:
        """The setpoint [µs] in quarter µs, as near as the range allows, if it may be sent at all.

        Raises:
            BoardError: not configured, not finite, or outside the range.
        """
        return SCALE.admit(self._settings, channel, pulse_us)


def _check_range(settings: ChannelSettings) -> None:
    bounds = (settings.minimum, settings.maximum)
    if all(map(math.isfinite, bounds)) and 0.0 < settings.minimum:
        lowest, highest = SCALE.whole_range(settings)
        if lowest <= highest <= MAX_TARGET:
            return
    raise BoardError(
        f"channel {settings.channel}: {settings.minimum:g} … {settings.maximum:g} µs is no range for a "
        f"servo; it must lie within 0.25 … {MAX_TARGET / QUARTERS_PER_US:g} µs, the smaller number first"
    )


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
        line: port name (device, pty, ``socket://host:port``), or what opens the transport.
        model: which member of the family; None: as the USB listing says.
        framing: compact or Pololu form. Whether the board wants CRCs is found out when it is opened (asked
            for here, they are insisted on).
        simulated: whether a simulated board is at the other end, for the identity only.
        ports: the listing of serial ports.
        accept: judges the board by its serial number, once the port is open and before it is spoken to.
        timeout_s: how long a readback may take.
    """

    def __init__(
        self,
        line: str | Callable[[], Transport],
        *,
        model: MaestroModel | None = None,
        framing: Framing = COMPACT,
        simulated: bool = False,
        ports: Callable[[], Sequence[PortInfo]] = list_ports,
        accept: AcceptBoard = any_board,
        timeout_s: float = 0.1,
    ) -> None:
        self._asked_model = model
        self._model = model
        self._framing = framing
        self._simulated = simulated
        self._port = BoardPort(line, ports, accept, simulated=simulated)
        self._timeout_s = timeout_s
        self._opened: MaestroLine | None = None
        self._table = ChannelTable((), None)
        self._unreported = MaestroErrors(0)

    def open(self) -> BoardIdentity:
        """Open the line and make sure that a Maestro answers; every output stays as it is.

        Raises:
            PortError: the port cannot be opened, or is the wrong one.
            BoardTimeoutError: nobody answers; the message says what to set on the board.
            BoardProtocolError: somebody answers, but not as this Maestro should.
        """
        self.close()
        self._forget()
        self._port.look_up()
        transport, info = self._port.open()
        self._model = self._asked_model or _listed_model(info)
        line = self._opened = MaestroLine(transport, self._framing, self._timeout_s)
        try:
            earlier = line.probe()
        except BoardError:
            self.close()
            raise
        notes = [] if self._simulated else [WATCHDOG_NOTE]
        if self._model is None:
            notes.append(UNKNOWN_MODEL_NOTE)
        return BoardIdentity(
            kind=self._model.label if self._model else "Pololu Maestro, model unknown",
            port=line.name,
            serial_number=info.serial_number if info else None,
            simulated=self._simulated,
            notes=tuple(notes),
            earlier=tuple(
                f"before armctl connected, the board had reported: {words}" for words in error_words(earlier)
            ),
        )

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        """Set speed and acceleration limits on the board and remember the ranges. Moves nothing.

        Raises:
            BoardError: settings that this board cannot have; nothing has been sent then.
            BoardProtocolError: the board did not accept them.
        """
        table = ChannelTable(channels, self._model)
        line = self._maestro
        errors = line.set_limits(
            [
                (one.channel, speed_to_units(one.speed), acceleration_to_units(one.acceleration))
                for one in table.settings
            ]
        )
        if errors & MISUNDERSTOOD:
            raise BoardProtocolError(
                f"{line.name}: the board did not accept the channel settings "
                f"({'; '.join(error_words(errors))}); has it as many channels as the robot file uses?"
            )
        self._forget()
        self._unreported = errors
        self._table = table

    def write(self, setpoints: Mapping[int, float]) -> None:
        """Send setpoints [µs] in one write.

        Raises:
            BoardError: a setpoint is not finite or outside its channel's range (nothing has been sent
                then), or the line is gone.
        """
        quarters = {channel: self._table.admit(channel, pulse) for channel, pulse in setpoints.items()}
        self._send_targets(quarters)

    def read(self) -> Readback:
        """Read the transmitted pulse widths [µs] and the error register of the board, which clears it.

        Raises:
            BoardTimeoutError: no answer, or half of one.
            BoardProtocolError: an answer that no Maestro can give.
        """
        positions, errors = self._maestro.read(self._table.channels)
        errors |= self._unreported
        self._unreported = MaestroErrors(0)
        return Readback(positions, Source.TRANSMITTED, error_words(errors))

    def stop(self) -> None:
        """Hold every channel that is on at the pulse width that the board transmits now.

        Raises:
            BoardError: the positions cannot be read, also not at a second attempt; or the line is gone.
        """
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
        self._table = ChannelTable((), None)
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

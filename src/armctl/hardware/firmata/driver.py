"""The driver for hobby servos on an Arduino with StandardFirmata."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.facts import Unanswered
from armctl.facts.english_commands import numbered
from armctl.hardware.driver import (
    Abilities,
    BoardIdentity,
    ChannelSettings,
    ChannelTable,
    Readback,
    Source,
    switch_off,
)
from armctl.hardware.firmata import HOW_TO_LOAD, SCALE, codec, pin_table
from armctl.hardware.firmata.codec import (
    AnalogReport,
    BoardText,
    CapabilityReport,
    DigitalReport,
    FirmwareReport,
    Malformed,
    PinMode,
    PinState,
    Reply,
)
from armctl.hardware.firmata.line import FirmataLine
from armctl.hardware.firmata.pin_watch import PinWatch
from armctl.hardware.firmata.signals import FirmataSignals
from armctl.hardware.firmata.stream import Attacher, SetpointStream, spare_pin
from armctl.hardware.transport import Connection, Transport
from armctl.robot.signals import Signals

WATCHDOG_NOTE = (
    "StandardFirmata has no watchdog: if this computer or the cable fails, the servos keep their last "
    "position for ever; have a switch for the servos' supply within reach"
)
COMMANDED_NOTE = "hobby servos tell nothing back: positions are what armctl commanded, not where the arm is"

_ASK_DEVICE_AFTER_S = 2.5
_ASK_OTHERS_AFTER_S = 0.2
_RELEASE_ATTEMPTS = 2
_CABLE_AND_SUPPLY = "the cable and the board's power supply"
_ASK_ATTEMPTS = 3
_LAST_ATTEMPTS = 3
"""so often an output is written where nothing is asked any more"""
_SILENT_PART = 0.5
"""of the time that an answer may take: so long without any, and no setpoint is sent"""


class FirmataDriver(Abilities):
    """An Arduino with StandardFirmata behind the ``Driver`` protocol. Channels are pins, units µs.

    Setpoints are streamed: what has changed goes out at once when the line is idle, else the newest as
    soon as it is, or never where that takes too long. Pins that are off are switched on one in each call of
    ``write`` or ``read``, and count as on once the board has said so twice. The board knows no speed or
    acceleration limits, so those of ``ChannelSettings`` are left to whoever makes the setpoints.

    ``timeout_s``: how long a pin may leave a question unanswered. ``ask_after_s``: how long a board is left
    alone after opening, before it is asked who it is; None: as a Mega needs that restarts when its port is
    opened, or shorter for a pty or a socket.
    """

    def __init__(
        self, connection: Connection, timeout_s: float = 0.25, ask_after_s: float | None = None
    ) -> None:
        self._connection = connection
        self._now = connection.now
        self._timeout_s = timeout_s
        self._ask_after_s = ask_after_s
        self._transport: Transport | None = None
        self._opened: FirmataLine | None = None
        self._servo_pins: tuple[int, ...] = ()
        self._markers: tuple[int, ...] = ()
        self._forget()

    def open(self) -> BoardIdentity:
        """Open the line and wait until the sketch answers; a Mega restarts, its servos go off."""
        self.close()
        self._forget()
        transport, info = self._connection.open()
        self._transport = transport
        line = self._opened = FirmataLine(transport, self._now)
        ask_after_s = self._ask_after_s
        if ask_after_s is None:
            ask_after_s = _ASK_DEVICE_AFTER_S if self._connection.restarts_board else _ASK_OTHERS_AFTER_S
        try:
            board = line.identify(ask_after_s)
        except BoardError:
            self.close()
            raise
        firmware, capabilities = board.firmware, board.capabilities
        self._capabilities = capabilities
        self._servo_pins = servo_pins = capabilities.pins_with(PinMode.SERVO)
        self._markers = tuple(pin for pin in range(len(capabilities.pins)) if pin not in servo_pins)
        if not self._markers:
            self.close()
            raise BoardProtocolError(
                f"{line.name}: the board claims that every pin can drive a servo, which no StandardFirmata "
                f"does; {HOW_TO_LOAD}"
            )
        self._sketch = firmware.name, (firmware.major, firmware.minor)
        name = firmware.name.removesuffix(".ino") or "a Firmata sketch without a name"
        return BoardIdentity(
            kind=f"Arduino with {name} {firmware.major}.{firmware.minor}",
            port=line.name,
            serial_number=info.serial_number if info else None,
            simulated=self._connection.simulated,
            notes=(COMMANDED_NOTE,) if self._connection.simulated else (WATCHDOG_NOTE, COMMANDED_NOTE),
        )

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        """Remember the pins' ranges and find out which of them are on. Moves nothing, emits no pulse."""
        line = self._firmata
        table = pin_table(channels, self._servo_pins)
        self._take(line.receive())
        states = self._sure_states(table.channels)
        if missing := [pin for pin in table.channels if pin not in states]:
            raise self._not_told(missing)
        watch = PinWatch(states.values(), {one.channel: one.speed for one in table.settings})
        gone, words = watch.carry_on(self._watch)
        if gone:
            raise line.lose(_switched_off(gone))
        self._words += words
        self._stream.drop(watch, all_of_it=True)
        self._stream.attacher = self._attacher(table)
        self._signals.doubt()
        self._stream.first = {
            one.channel: table.admit(one.channel, one.first)
            for one in table.settings
            if one.first is not None
        }
        self._table, self._watch, self._unsure = table, watch, False

    def write(self, setpoints: Mapping[int, float]) -> None:
        """Send setpoints [µs] in one write, or keep them for the next call while the line is busy."""
        admitted = {pin: self._table.admit(pin, pulse_us) for pin, pulse_us in setpoints.items()}
        self._take(self._firmata.receive())
        self._stream.put(admitted)
        self._unsure |= self._silent
        if not self._unsure:
            self._stream.flush(self._table, self._watch)

    def read(self) -> Readback:
        """Take the answers that have come and ask anew, without waiting for the new ones.

        Positions are what was sent to the pins that are on. What the board says of them is compared with
        it; a value that was lost on the line is sent again, and reported. An answer that is lost is counted;
        where none comes any more (``BoardTimeoutError``), no setpoint is sent until the board has said what
        it has: what gets through after a while would be one large step of the arm.
        """
        line = self._firmata
        self._take(line.receive())
        self._unsure |= self._silent
        if self._unsure and not self._silent:
            self.configure(self._table.settings)
        watch = self._watch
        if not self._unsure:
            self._stream.flush(self._table, watch)
            self._send_signals()
        self._stream.ask_next(watch, self._next_marker)
        if self._malformed:
            raw = self._malformed[0].raw
            self._malformed.clear()
            what = f"{line.name}: the board sent {raw[:12].hex(' ')}, which is no whole message"
            raise BoardProtocolError(Unanswered(what, "the USB cable"))
        if self._silent:
            what = f"{line.name}: no answer for {1000 * watch.silent_s(self._now()):.0f} ms"
            raise BoardTimeoutError(Unanswered(what, _CABLE_AND_SUPPLY))
        words, self._words = tuple(dict.fromkeys(self._words)), []
        asked, watch.asked, lost, watch.lost = watch.asked, 0, watch.lost, 0
        delays = [one for one in (watch.delay_s, self._delay_s) if one is not None]
        watch.delay_s = self._delay_s = None
        waiting = self._stream.waiting
        return Readback(
            watch.positions,
            Source.COMMANDED,
            words,
            powered=True if watch.on_at_no_width and watch.confirmed and not waiting else None,
            asked=asked,
            lost=lost,
            delay_s=max(delays, default=None),
            expired=self._stream.take_expired(),
            sent=not waiting,
            inputs=self._signals.inputs,
            outputs=self._signals.outputs,
        )

    def use_signals(self, signals: Signals) -> None:
        """Set the pins up, and see that the sketch has their modes; outputs keep the level that they have.

        An input that is not reported yet is not among those of ``read``.
        """
        found = FirmataSignals(signals, self._capabilities, self._table.channels)
        found.carry_on(self._signals)
        self._signals = found
        self._markers = tuple(pin for pin in self._markers if pin not in found.modes)
        self._stream.attacher = self._attacher(self._table)
        pins = tuple(found.modes)
        states = self._sure_states(pins)
        if hidden := found.stale(states):
            self._stream.send(found.hide(hidden))
            self._sure_states(pins)  # takes the sketch some rounds, in which it sees that they are hidden
            states = {pin: state for pin, state in states.items() if pin not in hidden}
        for _ in range(_ASK_ATTEMPTS):
            if request := found.set_up(states):
                self._stream.send(request)
            states = self._sure_states(pins)
            if found.is_set_up(states):
                if not found.settled:
                    self._stream.send(found.report())
                    self._sure_states(pins)  # what is reported comes ahead of the last of these answers
                    found.settle()
                return
        raise self._not_told(
            [pin for pin, mode in found.modes.items() if pin not in states or states[pin].mode != mode]
        )

    def set_output(self, name: str, value: float) -> None:
        """Drive a pin at a level; it is told again until the sketch says that it has it.

        Where the arm was given up for what the board said, and the line still works, it is told at once.
        """
        output = self._signals.signals.output(name)
        if output is None:
            raise BoardError(f"the Arduino was told of no output {name!r}")
        line = self._firmata
        if line.lost:
            line.send_at_last(_LAST_ATTEMPTS * self._signals.put(output, value, pull_up=False))
            return
        self._pin_writes += self._signals.put(output, value)
        self._take(line.receive())
        self._send_signals()

    def stop(self) -> None:
        """Hold: the board goes on with what it was sent last, so all there is to do is to send no more.

        Pins that were to be switched on stay off.
        """
        self._stream.drop(self._watch, all_of_it=True)
        self._watch.give_up()
        self._stream.take_expired()  # nobody asks for it any more
        self._take(self._firmata.receive())

    def home(self) -> None:
        """A servo knows its angle: there is nothing to look for."""
        raise BoardError("hobby servos need no homing")

    def release(self) -> None:
        """Detach every configured pin (it stays low, as after the board's reset): the arm drops."""
        line = self._firmata
        self._stream.clear()
        self._take(line.receive())
        # The sketch gives a freed servo to the pin attached next, with the last width it sent. Freed
        # highest first and attached lowest first, each pin gets its own again.
        # A sketch from 2.5 on leaves a pin high that it frees in the middle of a pulse.
        pins = self._table.channels[::-1]
        request = b"".join(codec.pin_mode(pin, PinMode.OUTPUT) + codec.pin_low(pin) for pin in pins)

        def off(_: Sequence[int]) -> Sequence[int]:
            self._stream.send(request)  # all of them each time: their order counts
            states = self._sure_states(self._table.channels)
            left = [pin for pin, state in states.items() if state.mode != PinMode.SERVO]
            return [pin for pin in self._table.channels if pin not in left]

        switch_off(line.name, "board", "pin", self._table.channels, _RELEASE_ATTEMPTS, off)
        self._watch.released()

    def close(self) -> None:
        """Close the line; never raises. The servos go on with what they were sent last."""
        if self._transport is not None:
            self._transport.close()
        self._transport = self._opened = None

    @property
    def _firmata(self) -> FirmataLine:
        if self._opened is None:
            raise BoardError("the Arduino is not connected; connect first")
        return self._opened

    def _forget(self) -> None:
        """Know nothing any more of the board's pins: it may be another one, or freshly started."""
        self._table = ChannelTable(SCALE)
        self._watch = PinWatch()
        self._unsure = False
        """the board has been silent, and what it got of the last setpoints is not known"""
        self._sketch: tuple[str, tuple[int, int]] = "", (0, 0)
        """its name and version"""
        self._delay_s: float | None = None
        """the longest that an answer to ``_ask_states`` took since the last reading"""
        self._stream = SetpointStream(self._send, self._now, Attacher(*self._sketch, None))
        self._capabilities = CapabilityReport(())
        self._signals = FirmataSignals(Signals(), self._capabilities)
        self._pin_writes = b""
        """to outputs, which wait until the sketch is not held"""
        self._words: list[str] = []
        self._malformed: list[Malformed] = []

    def _attacher(self, table: ChannelTable) -> Attacher:
        """What switches servos on; the pin that it may pulse is none of the arm's."""
        return Attacher(*self._sketch, spare_pin(self._servo_pins, (*table.channels, *self._signals.modes)))

    def _send_signals(self) -> None:
        """Send what is due to inputs and outputs, unless the sketch is held: its buffer would overflow."""
        now = self._now()
        if self._stream.attacher.holding(now):
            return
        data, self._pin_writes = self._pin_writes + self._signals.due(now), b""
        if data:
            self._stream.send(data)

    def _send(self, data: bytes) -> None:
        self._firmata.send(data)

    def _take(self, replies: Sequence[Reply]) -> None:
        """Take note of what the board sent; ``read`` tells of it."""
        for reply in replies:
            if isinstance(reply, PinState | DigitalReport | AnalogReport):
                self._signals.take(reply)
            if isinstance(reply, PinState):
                words = self._watch.answered(reply, self._now())
                if words is not None:
                    self._words.append(words)
            elif isinstance(reply, FirmwareReport):
                self._stream.told_name()
            elif isinstance(reply, BoardText):
                self._words.append(f"the sketch says: {reply.text}")
            elif isinstance(reply, Malformed):
                self._malformed.append(reply)
        if never := self._watch.never_on:
            raise self._firmata.lose(
                f"{numbered('pin', never)} did not switch on in several attempts: bytes get lost on the "
                "line; check the USB cable, then connect again"
            )
        if gone := self._watch.switched_off:
            raise self._firmata.lose(_switched_off(gone))
        if strayed := self._watch.strayed:
            raise self._firmata.lose(
                f"{numbered('pin', strayed)} was set by something else, more than once: another program "
                "writes to this board; close it, then connect again"
            )

    @property
    def _silent(self) -> bool:
        """Whether the board leaves everything unanswered."""
        return self._watch.silent_s(self._now()) > _SILENT_PART * self._timeout_s

    def _next_marker(self) -> int:
        """A pin that drives no servo; not the same again, whose answer may come late, too."""
        marker, *others = self._markers
        self._markers = (*others, marker)
        return marker

    def _not_told(self, pins: Sequence[int]) -> BoardTimeoutError:
        what = (
            f"{self._firmata.name}: the board did not tell the state of {numbered('pin', pins)} within "
            f"{self._timeout_s * 1000:.0f} ms, though asked {_ASK_ATTEMPTS} times"
        )
        return BoardTimeoutError(Unanswered(what, _CABLE_AND_SUPPLY))

    def _sure_states(self, pins: Sequence[int]) -> dict[int, PinState]:
        """The states of ``pins`` that two answers agree on; what does not come in time is missing."""
        states: dict[int, PinState] = {}
        before: dict[int, PinState] = {}
        for _ in range(1 + _ASK_ATTEMPTS):
            told = self._ask_states([pin for pin in pins if pin not in states])
            states |= {pin: state for pin, state in told.items() if before.get(pin) == state}
            before |= told
            if len(states) == len(pins):
                break
        return states

    def _ask_states(self, pins: Sequence[int]) -> dict[int, PinState]:
        """The states of ``pins``, asked for now; what does not come in time is missing.

        Answers do not say to which question they belong, but come in order. So the first question is
        about a pin that drives no servo, of which nothing else asks: what comes after its answer is new.
        """
        states: dict[int, PinState] = {}
        if not pins:
            return states
        marker = self._next_marker()
        asked_at = self._now()
        self._stream.send(b"".join(map(codec.pin_state_query, (marker, *pins))))
        in_step = False
        for reply in self._firmata.listen(self._timeout_s):
            if not isinstance(reply, PinState):
                self._take((reply,))
            elif reply.pin == marker:
                in_step = True
                self._delay_s = max(self._delay_s or 0.0, self._now() - asked_at)
            elif in_step and reply.pin in pins:
                states[reply.pin] = reply
                if len(states) == len(pins):
                    break
        return states


def _switched_off(pins: Sequence[int]) -> str:
    return (
        f"the board no longer drives {numbered('pin', pins)}, and the arm may have dropped: either it "
        "restarted (reset button, or its supply broke down) and its report was lost, or another program "
        "switched them off; check the supply, then connect again"
    )

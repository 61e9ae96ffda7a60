"""The driver for hobby servos on a PCA9685."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from armctl.errors import BoardError, BoardProtocolError, BoardTimeoutError
from armctl.hardware.driver import (
    Abilities,
    BoardIdentity,
    ChannelSettings,
    ChannelTable,
    Readback,
    Source,
    switch_off,
)
from armctl.hardware.pca9685 import CHANNELS, SCALE, STEPS, Pca9685Options, channel_table
from armctl.hardware.pca9685.chip import (
    WIRES,
    ArduinoLine,
    ChipLine,
    fetch,
    identify,
    open_chip,
    unanswered,
)
from armctl.hardware.pca9685.outputs import Outputs
from armctl.hardware.pca9685.registers import (
    ASLEEP,
    FULL_OFF,
    RUNNING,
    TOTEM_POLE,
    ChipRegister,
    Mode1,
    RegisterBlock,
    blocks,
    decode,
    prescale,
    pulse,
    step_us,
    transfers,
)
from armctl.hardware.transport import Connection, Transport

WATCHDOG_NOTE = (
    "a PCA9685 has no watchdog: if this computer or the cable fails, it goes on sending the last pulses for "
    "ever, and the servos hold; have a switch for their supply, or for the chip's pin /OE, within reach"
)
OSCILLATOR_NOTE = (
    "the chip's clock is off by several percent, and so is every pulse: measure one, and give oscillator_mhz "
    "in [board] (the board's page says how)"
)
_STARTED_ANEW = (
    "the PCA9685 has started anew: it lost its power (VCC), and its pulses are off; check its supply and "
    "the wires"
)
_SET_UP_ANEW = "another program has set the PCA9685 up in another way; close it, then connect again"

_LATE_S = 0.05
"""an answer behind an Arduino takes 10 … 20 ms; after so long it is lost"""
_ATTEMPTS = 2
_SURE = 3
"""answers have no checksum: so many in a row that say the same are believed"""
_FRAME_S = 0.020
_MODE = RegisterBlock(ChipRegister.MODE1, 1)
_ASK_DEVICE_AFTER_S, _ASK_OTHERS_AFTER_S = 2.5, 0.2
"""how long an Arduino is left alone that restarts when its port is opened, and any other"""


class Pca9685Driver(Abilities):
    """A PCA9685 behind the ``Driver`` protocol; units are µs.

    Positions are what the chip's registers hold, which is what it transmits: a step that is the nearest one
    to a setpoint is told as that setpoint. It knows no speed limits, so those of ``ChannelSettings`` are left
    to whoever makes the setpoints.

    Over a bus of this computer it is read and written at once. Behind an Arduino one question a tick is on
    the line, and what it says is a few ticks old; a setpoint that got lost is written again.

    ``timeout_s``: how long an answer may take that is waited for, and the line be silent until no setpoint is
    sent.
    """

    def __init__(
        self, connection: Connection, options: Pca9685Options | None = None, timeout_s: float = 0.1
    ) -> None:
        self._connection, self._now = connection, connection.now
        self._options = options or Pca9685Options()
        self._timeout_s = timeout_s
        self._transport: Transport | None = None
        self._opened: ChipLine | None = None
        self._forget()

    def open(self) -> BoardIdentity:
        """Open the line and make sure that a PCA9685 answers; every output stays as it is."""
        self.close()
        self._forget()
        transport, info = self._connection.open()
        self._transport = transport
        restarts = self._connection.restarts_board
        ask_after_s = _ASK_DEVICE_AFTER_S if restarts else _ASK_OTHERS_AFTER_S
        try:
            line = open_chip(transport, self._options.address, self._now, self._timeout_s, ask_after_s)
            found = identify(line, self._timeout_s)
        except BoardError:
            self.close()
            raise
        self._opened = line
        kind = f"PCA9685 at {line.address:#x}"
        if isinstance(line, ArduinoLine):
            kind += f" behind an Arduino with {line.firmware.name.removesuffix('.ino')}"
        wanted = prescale(self._options)
        had = found[ChipRegister.PRE_SCALE]
        earlier: list[str] = []
        if not found[ChipRegister.MODE1] & Mode1.SLEEP and had != wanted:
            hz = 1e6 / (STEPS * step_us(had, self._options.oscillator_mhz))
            earlier.append(
                f"another program had set the PCA9685 to {hz:.0f} pulses a second; while any of its channels "
                "is on that stays"
            )
        return BoardIdentity(
            kind=kind,
            port=line.name,
            serial_number=info.serial_number if info else None,
            simulated=self._connection.simulated,
            notes=() if self._connection.simulated else (WATCHDOG_NOTE, OSCILLATOR_NOTE),
            earlier=tuple(earlier),
        )

    def configure(self, channels: Sequence[ChannelSettings]) -> None:
        """Wake the chip and set its frequency, unless it sends pulses: those are taken over as they are."""
        line = self._chip
        channel_table(channels, STEPS * step_us(prescale(self._options), self._options.oscillator_mhz))
        mode = Mode1(self._fetch(_MODE)[0])
        if not mode & Mode1.AUTO_INCREMENT:
            line.write(ChipRegister.MODE1, bytes(((mode | Mode1.AUTO_INCREMENT) & ~Mode1.RESTART,)))
        every = self._pulses(tuple(range(CHANNELS)))
        on = not mode & Mode1.SLEEP and any(steps is not None for steps in every.values())
        had = self._fetch(RegisterBlock(ChipRegister.PRE_SCALE, 1))[0]
        wanted = prescale(self._options)
        outputs = self._fetch(RegisterBlock(ChipRegister.MODE2, 1))[0]
        if not on and (mode, had, outputs) != (RUNNING, wanted, TOTEM_POLE):
            self._set_up(wanted)
            had, every = wanted, dict.fromkeys(every)
        size_us = step_us(had, self._options.oscillator_mhz)
        table = channel_table(channels, STEPS * size_us)
        self._check_line(table)
        before, self._outputs = self._outputs, Outputs(table, size_us, self._now)
        self._outputs.take_over(before, every)
        self._questions = [_MODE, *blocks(table.channels, line.most_read)]
        self._asked_at, self._heard_at, self._asleep = None, self._now(), False

    def write(self, setpoints: Mapping[int, float]) -> None:
        """Send setpoints [µs] that have changed; nothing where one of them is refused."""
        self._outputs.put(setpoints)
        if not self._asleep:
            self._send(self._outputs.due())

    def read(self) -> Readback:
        """Read registers back. A chip that has started anew has no pulses, and says why.

        Where no answer comes it asks once more: ``BoardTimeoutError`` after that.
        """
        line = self._chip
        self._count, self._lost, self._delay_s = 0, 0, None
        if line.answers_at_once:
            for block in self._questions:
                if self._asleep and block is not _MODE:
                    break
                self._ask(block)
                if not self._take(self._timeout_s):
                    self._lost += 1
                    self._ask(block)
                    if not self._take(self._timeout_s):
                        raise unanswered(line, self._answer)
        else:
            self._read_in_turn()
        if not self._asleep:
            self._send(self._outputs.due())
        outputs = self._outputs
        positions = dict.fromkeys(outputs.positions) if self._asleep else outputs.positions
        return Readback(
            positions,
            Source.TRANSMITTED,
            (_STARTED_ANEW,) if self._asleep else (),
            on={channel: pulse_us is not None for channel, pulse_us in positions.items()},
            asked=self._count,
            lost=self._lost,
            delay_s=self._delay_s,
            expired=outputs.take_expired(),
        )

    def stop(self) -> None:
        """Hold: the chip goes on with what it was sent last, so all there is to do is to send no more.

        It is asked for its mode: a line that is gone shows.
        """
        self._outputs.stop()
        self._ask(_MODE)

    def home(self) -> None:
        """A servo knows its angle: there is nothing to look for."""
        raise BoardError("hobby servos need no homing")

    def release(self) -> None:
        """Switch the pulses of every configured channel off: the arm drops."""
        self.release_channels(self._outputs.table.channels)

    def release_channels(self, channels: Sequence[int]) -> None:
        """The same of some of them, read back. ``BoardTimeoutError``: the chip does not confirm it."""
        line = self._chip
        self._outputs.released(channels)
        self._asked_at = None
        switch_off(line.name, "PCA9685", "channel", channels, _ATTEMPTS, self._off)

    def _off(self, channels: Sequence[int]) -> Sequence[int]:
        """Switch channels off; those that are still on, as far as is known."""
        self._transfer(dict.fromkeys(channels, FULL_OFF))
        try:
            held = self._pulses(tuple(sorted(channels)))
        except BoardTimeoutError:
            return channels
        self._outputs.read(held, {}, self._now())
        return [channel for channel in channels if held.get(channel) is not None]

    def close(self) -> None:
        """Close the line; never raises. The chip goes on sending what it was sent last."""
        if self._transport is not None:
            self._transport.close()
        self._transport = self._opened = None

    @property
    def _chip(self) -> ChipLine:
        if self._opened is None:
            raise BoardError("the PCA9685 is not connected; connect first")
        return self._opened

    def _forget(self) -> None:
        self._outputs = Outputs(ChannelTable(SCALE), 1.0, self._now)
        self._questions: list[RegisterBlock] = []
        self._asked_at: float | None = None
        """when the question was put that is open; None: none is"""
        self._block = _MODE
        self._sent: dict[int, int | None] = {}
        self._answer: bytes | None = None
        self._heard_at = 0.0
        """when the last answer came"""
        self._asleep = False
        """the chip has started anew"""
        self._odd = 0
        """readings in a row of a MODE1 that armctl has not set"""
        self._count, self._lost = 0, 0
        self._delay_s: float | None = None

    def _set_up(self, wanted: int) -> None:
        """Set the frequency, which only a chip that sleeps takes; with every pulse off, and then wake it."""
        line = self._chip
        steps = (
            (ChipRegister.MODE1, bytes((ASLEEP,))),
            (ChipRegister.ALL_LED, FULL_OFF),
            (ChipRegister.PRE_SCALE, bytes((wanted,))),
            (ChipRegister.MODE2, bytes((TOTEM_POLE,))),
            (ChipRegister.MODE1, bytes((RUNNING,))),
        )
        found = (0, 0, 0)
        for _ in range(_ATTEMPTS):
            for register, data in steps:
                line.write(register, data)
            registers = (ChipRegister.MODE1, ChipRegister.MODE2, ChipRegister.PRE_SCALE)
            found = tuple(self._fetch(RegisterBlock(one, 1))[0] for one in registers)
            if found == (RUNNING, TOTEM_POLE, wanted):
                return
        if found[0] & Mode1.EXTCLK:
            raise BoardProtocolError(
                f"{line.name}: the PCA9685 waits for an external clock, which a garbled command or another "
                "program has switched on; only a power cut undoes that: cut its VCC, then connect again"
            )
        raise BoardProtocolError(
            f"{line.name}: the PCA9685 did not take its settings (it has {bytes(found).hex(' ')}, not "
            f"{bytes((RUNNING, TOTEM_POLE, wanted)).hex(' ')}); check {WIRES}: long wires "
            "want stronger pull-ups"
        )

    def _check_line(self, table: ChannelTable) -> None:
        """Refuse more channels than the line of an Arduino carries in a servo frame."""
        line = self._chip
        if isinstance(line, ArduinoLine):
            needed = line.seconds(dict.fromkeys(table.channels, FULL_OFF))
            if needed > _FRAME_S:
                raise BoardError(
                    f"{line.name}: setpoints of {len(table.channels)} servos take {1000 * needed:.0f} ms on "
                    f"the line of an Arduino, and are due every {1000 * _FRAME_S:.0f} ms; put neighbouring "
                    "joints on neighbouring channels, or use the I²C bus of a Raspberry Pi"
                )

    def _fetch(self, block: RegisterBlock) -> bytes:
        return fetch(self._chip, block.register, block.count, self._timeout_s)

    def _pulses(self, channels: tuple[int, ...]) -> dict[int, int | None]:
        """The steps of each channel's pulse, asked for now."""
        held: dict[int, int | None] = {}
        for block in blocks(channels, self._chip.most_read):
            held |= _decoded(block, self._fetch(block))
        return held

    def _send(self, steps: Mapping[int, int]) -> None:
        self._transfer({channel: pulse(one) for channel, one in steps.items()})

    def _transfer(self, pulses: Mapping[int, bytes]) -> None:
        for register, data in transfers(pulses, self._chip.most_written):
            if not self._chip.write(register, data):
                self._lost += 1  # reading it back shows whether the chip is there

    def _ask(self, block: RegisterBlock) -> None:
        self._sent, self._asked_at, self._block = self._outputs.sent(), self._now(), block
        self._count += 1
        self._chip.ask(block.register, block.count)

    def _take(self, wait_s: float) -> bool:
        """Take the answer to the open question; False where it is not there, or not good."""
        self._answer = answer = self._chip.answer(wait_s)
        if not answer or self._asked_at is None:
            return False
        asked_at, self._asked_at = self._asked_at, None
        self._heard_at = self._now()
        self._delay_s = self._heard_at - asked_at
        if self._block is _MODE:
            return self._note_mode(Mode1(answer[0]))
        self._outputs.read(_decoded(self._block, answer), self._sent, asked_at)
        return True

    def _note_mode(self, mode: Mode1) -> bool:
        """Whether MODE1 is as armctl has set it, or as after power-up; else ask again: it may be garbled."""
        self._asleep = bool(mode & Mode1.SLEEP)
        if self._asleep or mode & Mode1.AUTO_INCREMENT:
            self._odd = 0
            return True
        self._odd += 1
        if self._odd >= _SURE:
            raise BoardError(f"{self._chip.name}: {_SET_UP_ANEW}")
        return False

    def _read_in_turn(self) -> None:
        """Take the answer to the last question, and put the next one, or this one again."""
        now = self._now()
        if self._asked_at is not None and not self._take(0.0):
            if self._answer is None and now - self._asked_at <= _LATE_S:
                return
            self._lost += 1
            self._ask(self._block)
        elif self._questions:
            self._ask(self._questions[0])
            self._questions = [*self._questions[1:], self._questions[0]]
        if now - self._heard_at > self._timeout_s:
            raise unanswered(self._chip, self._answer)


def _decoded(block: RegisterBlock, answer: bytes) -> dict[int, int | None]:
    """The steps of the pulses in a block of registers."""
    size = len(answer) // len(block.channels)
    return {
        channel: decode(answer[size * place : size * (place + 1)])
        for place, channel in enumerate(block.channels)
    }

"""A simulated Maestro: the board's behaviour behind its command port, byte for byte."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from armctl.errors import InputError
from armctl.hardware.maestro.codec import DEFAULT_DEVICE_NUMBER, Opcode
from armctl.hardware.maestro.error_register import MaestroErrors
from armctl.hardware.maestro.packet_parser import Packet, PacketParser
from armctl.hardware.maestro.simulated_channel import ChannelConfig, SimulatedChannel
from armctl.hardware.maestro.units import quarters_to_us
from armctl.hardware.maestro_models import MaestroModel

SERVO_PERIOD_S = 0.020
_TIMEOUT_UNIT_S = 0.010
_TIME_SLACK_S = 1e-9  # a tick that is due at 0.1 must not wait because five times 0.02 is a little less
_MINI_SSC_NEUTRAL = 6000  # factory settings: 1500 µs, and 476.25 µs to either side
_MINI_SSC_STEP = 15  # quarter µs, 1905 / 127


class SerialMode(Enum):
    """How the board uses its ports (guide, section 5.a)."""

    USB_DUAL_PORT = "USB Dual Port"
    USB_CHAINED = "USB Chained"
    UART_FIXED = "UART, fixed baud rate"
    UART_DETECT_BAUD = "UART, detect baud rate"  # as it leaves the factory

    @property
    def takes_usb_commands(self) -> bool:
        """Whether commands on the USB command port do anything at all."""
        return self in (SerialMode.USB_DUAL_PORT, SerialMode.USB_CHAINED)


@dataclass(frozen=True, slots=True)
class MaestroSettings:
    """The settings in the board's own memory; the defaults are the factory's, but for the serial mode.

    Args:
        serial_mode: USB Dual Port here, because with the factory's mode no USB client can do anything.
        device: device number of the Pololu form.
        crc: whether commands must carry a CRC-7.
        timeout_units: serial timeout in 10 ms units; 0 switches it off.
        channels: settings of single channels; the factory's for all others.
    """

    serial_mode: SerialMode = SerialMode.USB_DUAL_PORT
    device: int = DEFAULT_DEVICE_NUMBER
    crc: bool = False
    timeout_units: int = 0
    channels: Mapping[int, ChannelConfig] | None = None


@dataclass(frozen=True, slots=True)
class ReceivedCommand:
    """A command that the board took, and when."""

    time: float
    opcode: Opcode
    data: bytes
    raw: bytes


class SimulatedMaestro:
    """A Maestro of any size, its channels all servos at the factory's 20 ms period.

    The user script and the Mini's PWM output are not modelled: their commands are protocol errors.

    Args:
        model: which member of the family.
        settings: what the Maestro Control Center would have stored on it.
        log_length: how many received commands are kept.
    """

    def __init__(
        self,
        model: MaestroModel = MaestroModel.MICRO_6,
        settings: MaestroSettings | None = None,
        log_length: int = 10_000,
    ) -> None:
        self.model = model
        self.settings = settings or MaestroSettings()
        self._configs = dict(self.settings.channels or {})
        for channel in self._configs:
            self._check_channel(channel)
        self._log: deque[ReceivedCommand] = deque(maxlen=log_length)
        self._now = 0.0
        self._powered_at: float | None = None
        self.reset()

    def reset(self) -> None:
        """Start anew, as after a power cut: what is not in the board's settings is lost."""
        self._channels = [
            SimulatedChannel(self._configs.get(number, ChannelConfig()))
            for number in range(self.model.channels)
        ]
        self._parser = PacketParser(
            device=self.settings.device,
            crc=self.settings.crc,
            multiple_targets=self.model.has_multiple_targets,
        )
        self._errors = MaestroErrors(0)
        self._ticks = 0
        # A board that never heard of time starts at the first time it hears of.
        self._powered_at = self._now if self._powered_at is not None else None
        self._heard_at: float | None = self._powered_at

    def advance(self, now: float) -> bytes:
        """Let time pass up to ``now`` [s]. A Maestro never speaks unasked."""
        if self._powered_at is None:
            self._now = self._powered_at = self._heard_at = now
        timeout_s = self.settings.timeout_units * _TIMEOUT_UNIT_S
        if timeout_s and self._heard_at is not None and now >= self._heard_at + timeout_s - _TIME_SLACK_S:
            self._run_ticks(self._heard_at + timeout_s)
            self._heard_at = None  # once is enough: the bit stays, the channels are home
            self._raise(MaestroErrors.SERIAL_TIMEOUT)
        self._run_ticks(now)
        return b""

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the USB command port and return the answers."""
        if not self.settings.serial_mode.takes_usb_commands:
            return b""
        reply = bytearray()
        for byte in data:
            for event in self._parser.push(byte):
                if isinstance(event, Packet):
                    reply += self._obey(event)
                else:
                    self._raise(event)
        return bytes(reply)

    @property
    def log(self) -> tuple[ReceivedCommand, ...]:
        """The commands taken, oldest first."""
        return tuple(self._log)

    @property
    def errors(self) -> MaestroErrors:
        """The error register, without clearing it."""
        return self._errors

    def target_us(self, channel: int) -> float | None:
        """The target [µs] after clamping to the channel's range; None when off."""
        return quarters_to_us(self._channel(channel).target) or None

    def position_us(self, channel: int) -> float | None:
        """The transmitted pulse width [µs]; None when off."""
        return quarters_to_us(self._channel(channel).position) or None

    def speed_units(self, channel: int) -> int:
        """The speed limit in 0.25 µs / 10 ms; 0: none."""
        return self._channel(channel).speed

    def acceleration_units(self, channel: int) -> int:
        """The acceleration limit in 0.25 µs / 10 ms / 80 ms; 0: none."""
        return self._channel(channel).acceleration

    def _run_ticks(self, until: float) -> None:
        if self._powered_at is None or until <= self._now:
            return
        self._now = until
        due = math.floor((until - self._powered_at + _TIME_SLACK_S) / SERVO_PERIOD_S)
        while self._ticks < due and any(channel.moving for channel in self._channels):
            for channel in self._channels:
                channel.tick()
            self._ticks += 1
        self._ticks = max(self._ticks, due)

    def _raise(self, error: MaestroErrors) -> None:
        self._errors |= error
        for channel in self._channels:
            channel.go_home()

    def _obey(self, packet: Packet) -> bytes:
        reply = self._execute(packet.opcode, packet.data)
        if reply is None:
            self._raise(MaestroErrors.SERIAL_PROTOCOL)
            return b""
        self._heard_at = self._now
        self._log.append(ReceivedCommand(self._now, packet.opcode, packet.data, packet.raw))
        return reply

    def _execute(self, opcode: Opcode, data: bytes) -> bytes | None:
        """The answer to a complete command (mostly empty); None when its values make no sense."""
        match opcode:
            case Opcode.GET_ERRORS:
                errors, self._errors = self._errors, MaestroErrors(0)
                return int(errors).to_bytes(2, "little")
            case Opcode.GET_MOVING_STATE:
                return b"\x01" if self._says_moving() else b"\x00"
            case Opcode.GO_HOME:
                for channel in self._channels:
                    channel.go_home()
                return b""
            case Opcode.MINI_SSC:
                return self._mini_ssc(data[0], data[1])
            case Opcode.SET_MULTIPLE_TARGETS:
                return self._set_targets(
                    data[1], [_value(data[at : at + 2]) for at in range(2, len(data), 2)]
                )
            case Opcode.SET_TARGET:
                return self._set_targets(data[0], [_value(data[1:])])
            case _:
                return self._channel_command(opcode, data)

    def _channel_command(self, opcode: Opcode, data: bytes) -> bytes | None:
        if data[0] >= self.model.channels:
            return None
        channel = self._channels[data[0]]
        if opcode is Opcode.GET_POSITION:
            return channel.position.to_bytes(2, "little")
        value = _value(data[1:])
        if opcode is Opcode.SET_SPEED:
            channel.speed = value
        elif value > 0xFF:  # one byte in the board's memory
            return None
        else:
            channel.acceleration = value
        return b""

    def _set_targets(self, first: int, targets: list[int]) -> bytes | None:
        if not targets or first + len(targets) > self.model.channels:
            return None
        for channel, target in zip(self._channels[first:], targets, strict=False):
            channel.set_target(target)
        return b""

    def _mini_ssc(self, servo: int, value: int) -> bytes:
        # Numbers above the board's channels belong to another board on the same line.
        if servo < self.model.channels:
            self._channels[servo].set_target(_MINI_SSC_NEUTRAL + _MINI_SSC_STEP * (value - 127))
        return b""

    def _says_moving(self) -> bool:
        # The Micro may say 0 while it moves. The model always does: nobody may lean on the answer.
        return self.model.has_multiple_targets and any(channel.moving for channel in self._channels)

    def _channel(self, channel: int) -> SimulatedChannel:
        self._check_channel(channel)
        return self._channels[channel]

    def _check_channel(self, channel: int) -> None:
        if not 0 <= channel < self.model.channels:
            raise InputError(
                f"channel {channel}: a {self.model.label} has channels 0 … {self.model.channels - 1}"
            )


def _value(data: bytes) -> int:
    """14 bits from two data bytes, low one first."""
    return data[0] | data[1] << 7

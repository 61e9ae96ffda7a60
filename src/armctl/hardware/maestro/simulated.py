"""A simulated Maestro: the board's behaviour behind its command port, byte for byte."""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from enum import Enum

from armctl.errors import InputError
from armctl.hardware.board_type import SimulatedPins
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.maestro import (
    DEFAULT_DEVICE_NUMBER,
    FACTORY_MAXIMUM_US,
    FACTORY_MINIMUM_US,
    FIRST_DIGITAL_CHANNEL,
    FULL_SCALE,
    QUARTERS_PER_US,
    MaestroModel,
)
from armctl.hardware.maestro.codec import (
    MAX_ACCELERATION,
    MAX_TARGET,
    MaestroErrors,
    Opcode,
    Packet,
    PacketParser,
    us_to_quarters,
)
from armctl.lazy_dataclass import dataclass
from armctl.robot.signals import ON, Signals

# One servo channel of a simulated Maestro: where its pulse width stands and how it moves.

# Eighths of a µs make every ramp exact in integers: at the board's 20 ms period a speed unit
# (0.25 µs / 10 ms) is 4 eighths a period, an acceleration unit (0.25 µs / 10 ms / 80 ms) 1 eighth a period².
_EIGHTHS_PER_QUARTER = 2
_EIGHTHS_PER_SPEED_UNIT = 4


class HomeMode(Enum):
    """What a channel does at start-up and on an error (guide, section 4.b)."""

    OFF = "off"
    IGNORE = "ignore"
    GO_TO = "go to"


class ChannelMode(Enum):
    """What a channel is set to (guide, section 4.b)."""

    SERVO = "servo"
    INPUT = "input"
    OUTPUT = "output"


@dataclass(frozen=True, slots=True)
class ChannelConfig:
    """A channel's settings in the board's own memory. Targets are clamped to its range."""

    mode: ChannelMode = field(default=ChannelMode.SERVO, kw_only=True)
    minimum_us: float = FACTORY_MINIMUM_US
    maximum_us: float = FACTORY_MAXIMUM_US
    home: HomeMode = HomeMode.OFF
    home_us: float | None = None

    def __post_init__(self) -> None:
        """Refuse a range upside down and a home that is missing or outside the range."""
        if not 0.0 < self.minimum_us < self.maximum_us <= MAX_TARGET / QUARTERS_PER_US:
            raise InputError(
                f"channel range {self.minimum_us} … {self.maximum_us} µs is no range of a Maestro"
            )
        if self.home is HomeMode.GO_TO and (
            self.home_us is None or not self.minimum_us <= self.home_us <= self.maximum_us
        ):
            raise InputError(
                f"home {self.home_us} µs is outside the channel's {self.minimum_us} … {self.maximum_us} µs"
            )


class SimulatedChannel:
    """Speed and acceleration ramps, once per servo period, in the board's integers.

    A channel that is off has no position, so its first target takes effect at once whatever its
    limits; so does every target when neither limit is set.
    """

    def __init__(self, config: ChannelConfig) -> None:
        self._config = config
        self._lowest = us_to_quarters(config.minimum_us)
        self._highest = us_to_quarters(config.maximum_us)
        self._position = 0  # eighths of a µs, 0: off
        self._velocity = 0  # eighths of a µs per period
        self.target = 0
        """where it goes [quarter µs], after clamping to its range; 0: off"""
        self.speed = 0
        """limit in 0.25 µs / 10 ms; 0: none"""
        self.acceleration = 0
        """limit in 0.25 µs / 10 ms / 80 ms; 0: none"""
        if config.home is HomeMode.GO_TO:
            self.go_home()

    @property
    def position(self) -> int:
        """The pulse it sends [quarter µs]; 0: none."""
        return self._position // _EIGHTHS_PER_QUARTER

    @property
    def moving(self) -> bool:
        """Whether a limit still keeps it from standing at its target."""
        return self._velocity != 0 or self._position != self.target * _EIGHTHS_PER_QUARTER

    @property
    def mode(self) -> ChannelMode:
        """What it is set to."""
        return self._config.mode

    def set_target(self, quarters: int) -> None:
        """Take a new target [quarter µs]; 0 stops the pulses at once. An output is high from 6000 on."""
        if self.mode is ChannelMode.INPUT:
            return
        if quarters == 0:
            self.target = self._position = self._velocity = 0
            return
        self.target = min(self._highest, max(self._lowest, quarters))
        if self._position == 0 or not (self.speed or self.acceleration):
            self._position = self.target * _EIGHTHS_PER_QUARTER
            self._velocity = 0

    def go_home(self) -> None:
        """Do what an error or Go Home does to this channel."""
        if self._config.home is not HomeMode.IGNORE:
            home_us = self._config.home_us if self._config.home is HomeMode.GO_TO else None
            self.set_target(us_to_quarters(home_us) if home_us is not None else 0)

    def tick(self) -> None:
        """One servo period (20 ms)."""
        if not self.moving:
            return
        error = self.target * _EIGHTHS_PER_QUARTER - self._position
        direction = 1 if error > 0 or (error == 0 and self._velocity > 0) else -1
        velocity = direction * self._next_velocity(abs(error), direction * self._velocity)
        position = self._position + velocity
        lowest, highest = self._lowest * _EIGHTHS_PER_QUARTER, self._highest * _EIGHTHS_PER_QUARTER
        # Only a limit that was lowered in mid-motion can lead here; the range holds all the same.
        self._position = min(highest, max(lowest, position))
        # A target that was moved back in mid-motion is passed at speed, not stopped at.
        arrived = self._position == self.target * _EIGHTHS_PER_QUARTER and (
            not self.acceleration or abs(velocity) <= self.acceleration
        )
        self._velocity = 0 if arrived or self._position != position else velocity

    def _next_velocity(self, distance: int, velocity: int) -> int:
        """As fast as the limits and the braking distance allow; ``velocity`` < 0: away from the target."""
        wanted = distance
        if self.speed:
            wanted = min(wanted, self.speed * _EIGHTHS_PER_SPEED_UNIT)
        if not self.acceleration:
            return wanted
        wanted = min(wanted, velocity + self.acceleration)
        if wanted > 0:
            wanted = _fastest_that_stops(wanted, distance, self.acceleration)
        return max(wanted, velocity - self.acceleration)


def _fastest_that_stops(candidate: int, distance: int, deceleration: int) -> int:
    """The largest velocity up to ``candidate`` from which the channel still stops within ``distance``."""

    def too_far(velocity: int) -> bool:
        steps = velocity // deceleration  # until it stands, the present period included
        return velocity * (steps + 1) - deceleration * steps * (steps + 1) // 2 > distance

    return bisect.bisect_left(range(candidate + 1), True, lo=1, key=too_far) - 1


SERVO_PERIOD_S = 0.020
_TIMEOUT_UNIT_S = 0.010
_TIME_SLACK_S = 1e-9  # a tick that is due at 0.1 must not wait because five times 0.02 is a little less
_MINI_SSC_NEUTRAL = 6000  # factory settings: 1500 µs, and 476.25 µs to either side
_MINI_SSC_STEP = 15  # quarter µs, 1905 / 127


@dataclass(frozen=True, slots=True)
class MaestroSettings:
    """The settings in the board's own memory; the defaults are the factory's, but for the serial mode."""

    takes_usb: bool = True  # not in a UART mode, as it leaves the factory (guide, section 5.a)
    device: int = DEFAULT_DEVICE_NUMBER  # of the Pololu form
    crc: bool = False  # whether commands must carry a CRC-7
    timeout_units: int = 0  # serial timeout [10 ms]; 0: none
    channels: Mapping[int, ChannelConfig] | None = None  # the factory's for all others


class SimulatedMaestro(SimulatedPins):
    """A Maestro of any size, its channels servos at the factory's 20 ms period, inputs or outputs.

    It has no user script: one that is started runs, does nothing, and runs until it is stopped. The Mini's
    PWM output is a number.
    The newest ``log_length`` commands taken are kept in ``log``, oldest first.
    """

    def __init__(
        self,
        model: MaestroModel = MaestroModel.MICRO_6,
        settings: MaestroSettings | None = None,
        log_length: int = 10_000,
    ) -> None:
        super().__init__()
        self.model = model
        self.settings = settings or MaestroSettings()
        for channel in self.settings.channels or {}:
            self._check_channel(channel)
        self._log: deque[Packet] = deque(maxlen=log_length)
        self._now = 0.0
        self._powered_at: float | None = None
        self.reset()

    def reset(self) -> None:
        """Start anew, as after a power cut: what is not in the board's settings is lost."""
        configs = self.settings.channels or {}
        self._channels = [
            SimulatedChannel(configs.get(number, ChannelConfig())) for number in range(self.model.channels)
        ]
        self._parser = PacketParser(
            device=self.settings.device,
            crc=self.settings.crc,
            mini=self.model.has_multiple_targets,
        )
        self.errors = MaestroErrors(0)
        """the error register; read here, it is not cleared"""
        self.script_runs = False
        self.pwm = (0, 0)
        """what a Mini's PWM output was told: on time and period [1/48 µs]"""
        self._ticks = 0
        # A new board is switched on by the first ``advance``.
        self._powered_at = self._now if self._powered_at is not None else None
        self._last_command_at: float | None = self._powered_at

    def advance(self, now: float) -> bytes:
        """Let time pass up to ``now`` [s]. A Maestro never speaks unasked."""
        if self._powered_at is None:
            self._now = self._powered_at = self._last_command_at = now
        timeout_s = self.settings.timeout_units * _TIMEOUT_UNIT_S
        due = None if self._last_command_at is None else self._last_command_at + timeout_s
        if timeout_s and due is not None and now >= due - _TIME_SLACK_S:
            self._run_ticks(due)
            self._last_command_at = None  # once is enough: the bit stays, the channels are home
            self._raise(MaestroErrors.SERIAL_TIMEOUT)
        self._run_ticks(now)
        return b""

    def feed(self, data: bytes) -> bytes:
        """Take bytes from the USB command port and return the answers."""
        if not self.settings.takes_usb:
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
    def log(self) -> tuple[Packet, ...]:
        """The commands taken, oldest first."""
        return tuple(self._log)

    def target_us(self, channel: int) -> float | None:
        """The target [µs] after clamping to the channel's range; None when off."""
        return self.channel(channel).target / QUARTERS_PER_US or None

    def position_us(self, channel: int) -> float | None:
        """The transmitted pulse width [µs]; None when off."""
        return self.channel(channel).position / QUARTERS_PER_US or None

    def channel(self, channel: int) -> SimulatedChannel:
        """A channel by its number; ``InputError`` where the board has none."""
        self._check_channel(channel)
        return self._channels[channel]

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
        """Note an error, which sends every channel home; so does Go Home, without one."""
        self.errors |= error
        for channel in self._channels:
            channel.go_home()

    def _obey(self, packet: Packet) -> bytes:
        reply = self._execute(packet.opcode, packet.data)
        if reply is None:
            self._raise(MaestroErrors.SERIAL_PROTOCOL)
            return b""
        self._last_command_at = self._now
        self._log.append(replace(packet, time=self._now))
        return reply

    def _execute(self, opcode: Opcode, data: bytes) -> bytes | None:
        """The answer to a complete command (mostly empty); None when its values make no sense."""
        match opcode:
            case Opcode.GET_ERRORS:
                errors, self.errors = self.errors, MaestroErrors(0)
                return int(errors).to_bytes(2, "little")
            case Opcode.GET_MOVING_STATE:
                # The Micro may say 0 while it moves. This one always does: no client may rely on it.
                moving = self.model.has_multiple_targets and any(one.moving for one in self._channels)
                return b"\x01" if moving else b"\x00"
            case Opcode.GO_HOME:
                self._raise(MaestroErrors(0))
            case Opcode.STOP_SCRIPT:
                self.script_runs = False
            case Opcode.RESTART_SCRIPT | Opcode.RESTART_SCRIPT_WITH_PARAMETER:
                self.script_runs = True
            case Opcode.GET_SCRIPT_STATUS:
                return b"\x00" if self.script_runs else b"\x01"
            case Opcode.SET_PWM:
                self.pwm = (_value(data[:2]), _value(data[2:]))
            case Opcode.MINI_SSC:
                # Numbers above the board's channels belong to another board on the same line.
                target = _MINI_SSC_NEUTRAL + _MINI_SSC_STEP * (data[1] - 127)
                if data[0] < self.model.channels:
                    self._channels[data[0]].set_target(target)
            case Opcode.SET_MULTIPLE_TARGETS:
                first, targets = data[1], [_value(data[at : at + 2]) for at in range(2, len(data), 2)]
                if not targets or first + len(targets) > self.model.channels:
                    return None
                for channel, target in zip(self._channels[first:], targets, strict=False):
                    channel.set_target(target)
            case _:
                return self._channel_command(opcode, data)
        return b""

    def _channel_command(self, opcode: Opcode, data: bytes) -> bytes | None:
        if data[0] >= self.model.channels:
            return None
        channel = self._channels[data[0]]
        if opcode is Opcode.GET_POSITION:
            return self._reading(data[0]).to_bytes(2, "little")
        value = _value(data[1:])
        if opcode is Opcode.SET_TARGET:
            channel.set_target(value)
        elif opcode is Opcode.SET_SPEED:
            channel.speed = value
        elif value > MAX_ACCELERATION:  # one byte in the board's memory
            return None
        else:
            channel.acceleration = value
        return b""

    def _reading(self, number: int) -> int:
        """What Get Position answers: of an input its voltage."""
        if self._channels[number].mode is not ChannelMode.INPUT:
            return self._channels[number].position
        level = self.levels.get(number, 0.0)
        return round(FULL_SCALE * (level if number < FIRST_DIGITAL_CHANNEL else float(level > ON)))

    def _check_channel(self, channel: int) -> None:
        if not 0 <= channel < self.model.channels:
            raise InputError(
                f"channel {channel}: a {self.model.label} has channels 0 … {self.model.channels - 1}"
            )


def _value(data: bytes) -> int:
    """14 bits from two data bytes, low one first."""
    return data[0] | data[1] << 7


def simulated_maestro(
    channels: Sequence[ChannelSettings] = (),
    model: MaestroModel | None = None,
    settings: MaestroSettings | None = None,
    signals: Signals | None = None,
) -> SimulatedMaestro:
    """A Maestro (None: the smallest that fits) with the ranges of ``channels``; ``settings`` win."""
    settings, signals = settings or MaestroSettings(), signals or Signals()
    configs = {one.channel: ChannelConfig(one.minimum, one.maximum) for one in channels}
    configs |= {one.channel: ChannelConfig(mode=ChannelMode.INPUT) for one in signals.inputs}
    configs |= {one.channel: ChannelConfig(mode=ChannelMode.OUTPUT) for one in signals.outputs}
    configs |= dict(settings.channels or {})
    if model is None:
        model = MaestroModel.with_channels(max(configs, default=0) + 1)
    return SimulatedMaestro(model, replace(settings, channels=configs))

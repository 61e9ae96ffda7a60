"""One servo channel of a simulated Maestro: where its pulse width stands and how it moves."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from armctl.errors import InputError
from armctl.hardware.maestro.units import MAX_TARGET, QUARTERS_PER_US, us_to_quarters

FACTORY_MINIMUM_US = 992.0
FACTORY_MAXIMUM_US = 2000.0

# Eighths of a µs make every ramp exact in integers: at the board's 20 ms period a speed unit
# (0.25 µs / 10 ms) is 4 eighths a period, an acceleration unit (0.25 µs / 10 ms / 80 ms) 1 eighth a period².
_EIGHTHS_PER_QUARTER = 2
_EIGHTHS_PER_SPEED_UNIT = 4


class HomeMode(Enum):
    """What a channel does at start-up and on an error (guide, section 4.b)."""

    OFF = "off"
    IGNORE = "ignore"
    GO_TO = "go to"


@dataclass(frozen=True, slots=True)
class ChannelConfig:
    """A channel's settings in the board's own memory, as the Maestro Control Center writes them.

    Args:
        minimum_us: shortest pulse; shorter targets become this one.
        maximum_us: longest pulse; longer targets become this one.
        home: what it does at start-up and on an error.
        home_us: where to, with ``HomeMode.GO_TO``.
    """

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
        self._target = 0  # quarter µs, 0: off
        self._position = 0  # eighths of a µs, 0: off
        self._velocity = 0  # eighths of a µs per period
        self.speed = 0
        self.acceleration = 0
        if config.home is HomeMode.GO_TO and config.home_us is not None:
            self.set_target(us_to_quarters(config.home_us))

    @property
    def target(self) -> int:
        """Where it goes [quarter µs], after clamping to its range; 0: off."""
        return self._target

    @property
    def position(self) -> int:
        """The pulse it sends [quarter µs]; 0: none."""
        return self._position // _EIGHTHS_PER_QUARTER

    @property
    def moving(self) -> bool:
        """Whether a limit still keeps it from standing at its target."""
        return self._velocity != 0 or self._position != self._target * _EIGHTHS_PER_QUARTER

    def set_target(self, quarters: int) -> None:
        """Take a new target [quarter µs]; 0 stops the pulses at once."""
        if quarters == 0:
            self._target = self._position = self._velocity = 0
            return
        self._target = min(self._highest, max(self._lowest, quarters))
        if self._position == 0 or not (self.speed or self.acceleration):
            self._position = self._target * _EIGHTHS_PER_QUARTER
            self._velocity = 0

    def go_home(self) -> None:
        """Do what an error or Go Home does to this channel."""
        if self._config.home is HomeMode.OFF:
            self.set_target(0)
        elif self._config.home is HomeMode.GO_TO and self._config.home_us is not None:
            self.set_target(us_to_quarters(self._config.home_us))

    def tick(self) -> None:
        """One servo period (20 ms)."""
        if not self.moving:
            return
        error = self._target * _EIGHTHS_PER_QUARTER - self._position
        direction = 1 if error > 0 or (error == 0 and self._velocity > 0) else -1
        velocity = direction * self._next_velocity(abs(error), direction * self._velocity)
        position = self._position + velocity
        lowest, highest = self._lowest * _EIGHTHS_PER_QUARTER, self._highest * _EIGHTHS_PER_QUARTER
        # Only a limit that was lowered in mid-motion can lead here; the range holds all the same.
        self._position = min(highest, max(lowest, position))
        # A target that was moved back in mid-motion is passed at speed, not stopped at.
        arrived = self._position == self._target * _EIGHTHS_PER_QUARTER and (
            not self.acceleration or abs(velocity) <= self.acceleration
        )
        self._velocity = 0 if arrived or self._position != position else velocity

    def _next_velocity(self, distance: int, velocity: int) -> int:
        """The velocity towards the target: as fast as the limits and the braking distance allow.

        ``velocity`` is negative while the channel still moves away from a target behind it.
        """
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
    low, high = 0, candidate
    while low < high:
        middle = (low + high + 1) // 2
        if _braking_distance(middle, deceleration) <= distance:
            low = middle
        else:
            high = middle - 1
    return low


def _braking_distance(velocity: int, deceleration: int) -> int:
    """What is covered while slowing down to zero, the present period included."""
    steps = velocity // deceleration
    return velocity * (steps + 1) - deceleration * steps * (steps + 1) // 2

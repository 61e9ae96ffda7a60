"""From joint angles to pulse widths and back: the only place that knows both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from armctl.errors import InputError

FloatArray = NDArray[np.float64]
_FIRST_US, _MIDDLE_US, _LAST_US = 600.0, 1500.0, 2400.0
_HELD, _HELD_US_PER_RAD = 1e-6, 573.0
"""a joint with less room than this does not move [rad]; its map only needs some scale"""


@dataclass(frozen=True, slots=True)
class ServoMap:
    """One affine map a joint, and one for the gripper: pulse [µs] = zero + scale · angle [rad]."""

    channels: tuple[int, ...]
    zero_us: FloatArray
    """(n,) pulse at 0 rad"""
    us_per_rad: FloatArray
    """(n,) signed"""
    pulse_min_us: FloatArray
    pulse_max_us: FloatArray
    gripper_channel: int | None = None
    gripper_closed_us: float = 0.0
    gripper_open_us: float = 0.0

    @classmethod
    def stand_in(cls, limits: FloatArray) -> ServoMap:
        """A map for a simulated board where the robot file gives none: channel i is joint i.

        Each joint's limits (n, 2) [rad] lie on 600 … 2400 µs; a held joint stays at 1500 µs.
        """
        low, high = limits.T
        held = high - low < _HELD
        scale = np.where(held, _HELD_US_PER_RAD, (_LAST_US - _FIRST_US) / np.where(held, 1.0, high - low))
        zero = np.where(held, _MIDDLE_US, _FIRST_US) - scale * low
        return cls(
            channels=tuple(range(len(limits))),
            zero_us=zero,
            us_per_rad=scale,
            pulse_min_us=np.where(held, _MIDDLE_US - 1.0, _FIRST_US),
            pulse_max_us=np.where(held, _MIDDLE_US + 1.0, _LAST_US),
        )

    def pulses(self, q: FloatArray) -> dict[int, float]:
        """Pulse width [µs] a channel for joint angles ``q`` (n,) [rad]."""
        return dict(zip(self.channels, (self.zero_us + self.us_per_rad * q).tolist(), strict=True))

    def gripper_pulse(self, opening: float) -> dict[int, float]:
        """Pulse of the gripper's channel for an opening of 0 (closed) to 1 (open)."""
        if self.gripper_channel is None:
            raise InputError("this arm has no gripper")
        return {
            self.gripper_channel: self.gripper_closed_us
            + (self.gripper_open_us - self.gripper_closed_us) * opening
        }

    def angles(self, pulses_us: Mapping[int, float | None]) -> FloatArray:
        """Joint angles (n,) [rad] of pulse widths; NaN where a channel is off or not reported."""
        pulses = [pulses_us.get(channel) for channel in self.channels]
        known = np.array([np.nan if pulse is None else pulse for pulse in pulses], dtype=np.float64)
        return (known - self.zero_us) / self.us_per_rad

    def opening(self, pulses_us: Mapping[int, float | None]) -> float | None:
        """Gripper opening 0..1 of pulse widths; None where it is off, unknown or not there."""
        pulse = None if self.gripper_channel is None else pulses_us.get(self.gripper_channel)
        if pulse is None:
            return None
        return (pulse - self.gripper_closed_us) / (self.gripper_open_us - self.gripper_closed_us)

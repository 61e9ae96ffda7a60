"""Feetech's SCS servos (SCS0009, SCS15 and their kin), as far as they differ from STS.

Words begin with the upper byte, there are 1024 steps over 300°, no offset, and no limit of the torque besides
that in the EEPROM. Each servo is read by itself.

Sources: Feetech's memory table of the SCS series; the vendor's SDK (``scscl``).
"""

from __future__ import annotations

from types import MappingProxyType

from armctl.hardware.bus.driver import BusDriver
from armctl.hardware.bus.make import Block
from armctl.hardware.bus.table import ControlTable, Register, Sign
from armctl.hardware.driver import Abilities
from armctl.hardware.feetech import SCS_STEPS as STEPS
from armctl.hardware.feetech.make import TELEMETRY, FeetechMake, kept_settings

RANGE_DEG = 300.0
_MAGNITUDE = Sign.MAGNITUDE
TABLE = ControlTable(
    (
        *kept_settings(STEPS - 1),
        Register("protection_torque", 37, 1, kept=True, high=100, unit="%"),
        Register("protection_time", 38, 1, kept=True, high=254, unit="s", scale=0.04),
        Register("overload_torque", 39, 1, kept=True, high=100, unit="%"),
        Register("torque", 40, 1, high=2),
        Register("goal_position", 42, 2, high=STEPS - 1, unit="steps"),
        Register("goal_time", 44, 2, high=9999, unit="ms"),
        Register("goal_speed", 46, 2, unit="steps/s", sign=_MAGNITUDE),
        Register("lock", 48, 1, high=1),
        Register("present_position", 56, 2, unit="steps", writable=False),
        Register("present_speed", 58, 2, unit="steps/s", sign=_MAGNITUDE, writable=False),
        *TELEMETRY,
    ),
    "big",
)
FACTORY = MappingProxyType(
    {
        "firmware_major": 3,
        "firmware_minor": 5,
        "big_endian": 1,
        "model": 1284,
        "id": 1,
        "status_level": 1,
        "lowest": 0,
        "highest": STEPS - 1,
        "hottest": 80,
        "most_voltage": 90,
        "least_voltage": 45,
        "most_torque": 1000,
        "unloading": 36,
        "led_alarm": 37,
        "p_gain": 15,
        "d_gain": 15,
        "start_force": 30,
        "forward_dead_zone": 1,
        "backward_dead_zone": 1,
        "protection_torque": 20,
        "protection_time": 100,
        "overload_torque": 80,
    }
)
"""as such servos come; but for their limits, 20 … 1003"""
SCS = FeetechMake(
    "Feetech SCS servo bus",
    TABLE,
    MappingProxyType({1284: "SCS0009"}),
    steps_per_turn=STEPS * 360 / RANGE_DEG,
    last_step=STEPS - 1,
    telemetry=Block(40, 27),
    sync_reads=False,
    wakes_locked=False,
)


class ScsDriver(BusDriver):
    """Servos whose torque is whole or off: Release switches it off at once."""

    limit_torque = Abilities.limit_torque
    scale_torque = Abilities.scale_torque

"""What the driver of a bus knows of each servo."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from armctl.hardware.bus.make import Telemetry
from armctl.hardware.servos import ServoSettings

DOUBTED = 3
"""readings in a row without an answer after which a servo is sent no more goals"""


@dataclass
class KnownServo:
    """What the driver knows of one servo."""

    id: int
    settings: ServoSettings | None = None
    seen: Telemetry = field(default_factory=Telemetry)
    seen_at: float = 0.0
    missed: int = 0
    gone: bool = False
    """whether it has not answered for some time"""
    asked_at: float = 0.0
    """when it was looked for last, where it is gone"""
    restarts_until: float = 0.0
    """so long it may be gone because it was told to start anew"""
    doubted: int | None = None
    """a position that is too far from the one before to be believed without another"""
    on: bool = False
    """whether armctl has switched it on, or found it on"""
    goal: int | None = None
    """the last goal that was sent [steps]"""
    wanted: int | None = None
    """the goal that it is on its way to [steps]"""
    sent_at: float = 0.0
    torque: float = 1.0
    went_off: bool = False
    """whether its torque went off by itself"""
    gave_way: bool = False
    """whether it gave way to an overload, and holds where it stands now"""
    yielded_at: float = -math.inf
    """when a gripper did so last, which goes on"""

    @property
    def let_go(self) -> bool:
        """Whether it does not hold any more what it was told to."""
        return self.went_off or self.gave_way or bool(self.seen.refuses)

    @property
    def takes_goals(self) -> bool:
        """Whether a goal would only move it: it would switch on one that is limp, or has started anew."""
        return self.on and not (self.went_off or self.seen.refuses or self.gone) and self.missed < DOUBTED

"""From joint angles to what a board is told, and back: the only place that knows both."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from armctl.arrays import ArrayRecord, FloatArray
from armctl.errors import InputError
from armctl.lazy_dataclass import dataclass
from armctl.robot.deflection import Deflection

DEFAULT_BOARD = "maestro"
"""the kind of board of an arm whose file names none"""
FLATTEST_PER_DEG = 0.001
"""the least scale of a joint that an output moves [output a degree]"""
_FIRST_US, _MIDDLE_US, _LAST_US = 600.0, 1500.0, 2400.0
_HELD, _HELD_US_PER_RAD = 1e-6, 573.0
"""a joint with less room than this does not move [rad]; its map only needs some scale"""


@dataclass(frozen=True, slots=True)
class Mirror:
    """A second output of a joint, such as the other one of two servos that turn it from both sides.

    It follows the joint's first output, whatever a calibration says of that: output = zero + ratio · first.
    """

    joint: int
    """index of the joint"""
    channel: int
    zero: float
    """output where the first one is at 0"""
    ratio: float
    """how far it goes with a unit of the first one, signed"""

    def output(self, first: float) -> float:
        """Its output where the first one is at ``first``."""
        return self.zero + self.ratio * first


@dataclass(frozen=True, slots=True, eq=False)
class OutputMap(ArrayRecord):
    """One affine map a joint, and one for the gripper: output = zero + per_rad · angle.

    The angle is the one to be set so that the arm, which gives way (``deflection``), comes to stand where it
    is wanted. An output is a pulse width [µs] on a servo board, and a position [encoder counts] on an encoder
    board.
    """

    unit: str
    """of an output, as a user reads it"""
    channels: tuple[int, ...]
    """of each joint: the Maestro's channel, the Arduino's pin, the encoder board's axis"""
    zero: FloatArray
    """(n,) output at 0 rad"""
    per_rad: FloatArray
    """(n,) signed"""
    low: FloatArray
    """(n,) smallest output that is safe"""
    high: FloatArray
    """(n,) largest one"""
    gripper_channel: int | None = None
    gripper_closed: float = 0.0
    gripper_open: float = 0.0
    homed: bool = False
    """Outputs count from where homing ends, at 0; which are safe follows from the joint's limits."""
    lowest: float = -math.inf
    """no output of this board, the gripper's neither, is below"""
    highest: float = math.inf
    """… or above"""
    turn: float | None = None
    """outputs after which the position of a servo begins anew at 0; None: it never does"""
    table: str = "servo"
    """what a robot file calls the table of a joint's output"""
    key: str = "us"
    """the unit in the keys of that table"""
    range_key: str = "pulse_us"
    """the key of the safe outputs in that table"""
    mirrors: tuple[Mirror, ...] = ()
    """further outputs of joints; ``channels`` has the first one of each joint"""
    deflection: Deflection | None = None
    """how the arm gives way, as it was calibrated; None: not known, it is taken as rigid"""

    @classmethod
    def stand_in(cls, limits: FloatArray, *, gripper: bool) -> OutputMap:
        """Servos for a simulated board where the robot file gives none: channel i is joint i, then a gripper.

        Each joint's limits (n, 2) [rad], and the gripper closed and open, lie on 600 … 2400 µs; a held joint
        stays at 1500 µs.
        """
        low, high = limits.T
        held = high - low < _HELD
        scale = np.where(held, _HELD_US_PER_RAD, (_LAST_US - _FIRST_US) / np.where(held, 1.0, high - low))
        zero = np.where(held, _MIDDLE_US, _FIRST_US) - scale * low
        return cls(
            unit="µs",
            channels=tuple(range(len(limits))),
            zero=zero,
            per_rad=scale,
            low=np.where(held, _MIDDLE_US - 1.0, _FIRST_US),
            high=np.where(held, _MIDDLE_US + 1.0, _LAST_US),
            gripper_channel=len(limits) if gripper else None,
            gripper_closed=_FIRST_US,
            gripper_open=_LAST_US,
        )

    def outputs(self, q: FloatArray) -> dict[int, float]:
        """The first output of each joint by channel that brings the links to ``q`` (n,) [rad]."""
        if self.deflection is not None:
            q = self.deflection.setpoint(q)
        return dict(zip(self.channels, (self.zero + self.per_rad * q).tolist(), strict=True))

    def mirrored(self, first: Mapping[int, float]) -> dict[int, float]:
        """Further outputs by channel of the joints whose first outputs these are."""
        known = ((one, first.get(self.channels[one.joint])) for one in self.mirrors)
        return {one.channel: one.output(value) for one, value in known if value is not None}

    def gripper_output(self, opening: float) -> dict[int, float]:
        """Output of the gripper's channel for an opening of 0 (closed) to 1 (open)."""
        if self.gripper_channel is None:
            raise InputError("this arm has no gripper")
        way = self.gripper_open - self.gripper_closed
        return {self.gripper_channel: self.gripper_closed + way * opening}

    def angles(self, outputs: Mapping[int, float | None], *, measured: bool = False) -> FloatArray:
        """Joint angles (n,) [rad] of outputs by channel; NaN where one is off or not reported.

        ``measured``: the outputs are what encoders read, not what was sent.
        """
        known = np.array([outputs.get(channel) for channel in self.channels], dtype=np.float64)  # None: NaN
        told = (known - self.zero) / self.per_rad
        return told if self.deflection is None else self.deflection.angles(told, measured=measured)

    def disagreement(self, mirror: Mirror, outputs: Mapping[int, float | None]) -> float:
        """How far a further output of a joint is from where the first one says it is [rad]; 0: not known."""
        first, own = outputs.get(self.channels[mirror.joint]), outputs.get(mirror.channel)
        if first is None or own is None:
            return 0.0
        return abs((own - mirror.output(first)) / (mirror.ratio * float(self.per_rad[mirror.joint])))

    def opening(self, outputs: Mapping[int, float | None]) -> float | None:
        """Gripper opening 0..1 of outputs by channel; None where it is off, unknown or not there."""
        value = None if self.gripper_channel is None else outputs.get(self.gripper_channel)
        if value is None:
            return None
        return (value - self.gripper_closed) / (self.gripper_open - self.gripper_closed)

"""A Scorbot-like arm for the encoder board: what hangs on the simulated Mega's pins.

Motors, gears, encoders, switches, friction, gravity and stops are computed in ``plant.c``, in step with
the CPU; this is its description and its view from a test.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from tests.avr.avr import Avr
from tests.avr.building import library
from tests.avr.mega import PINS

AXES = 6


@dataclass(frozen=True)
class Motor:
    """One motor with its gear and the joint of its axis, in encoder counts and shares of full drive."""

    full_speed: float = 5000.0
    """Without friction, at full drive [counts/s]."""
    time_constant: float = 0.05
    static_friction: float = 0.72
    """A drive of about 200/255 breaks it away."""
    kinetic_friction: float = 0.3
    load: float = 0.0
    """Gravity with the joint level; it pulls the counts down."""
    load_period: float = 40_000.0
    stops: tuple[float, float] = (-20_000.0, 20_000.0)
    """Of the joint. Counts begin where the joint stands at power-on."""
    switch: tuple[float, float] = (0.0, 0.0)
    """Where the joint presses its home switch; nowhere if both are equal."""
    start: float = 0.0
    motor_sign: int = 1


SCORBOT = (
    Motor(load=0.0, stops=(-18_000, 26_000), switch=(1500, 1700)),  # waist
    Motor(load=0.15, stops=(-6_000, 12_000), switch=(900, 1100)),  # shoulder
    Motor(load=0.1, stops=(-26_000, 5_000), switch=(-700, -500)),  # elbow: the wrong side of its switch
    Motor(static_friction=0.6, stops=(-4_500, 4_000), switch=(150, 350)),  # pitch: begins on the switch
    Motor(static_friction=0.6, stops=(-5_500, 5_500), switch=(500, 700)),  # roll
    Motor(static_friction=0.5, full_speed=3000, stops=(-1_000, 800)),  # gripper: no switch
)
"""Starts as an arm is found: each joint somewhere else about its switch. Axes 3 and 4 are a pair."""

SCATTERED = {3: 100.0, 4: 100.0}
"""Where the motors of SCORBOT begin, if not at 0: the wrist's on the pitch switch."""

_NEAR_STOPS = (
    (-23_000, 23_000),
    (-8_500, 11_500),
    (-26_000, 5_000),
    (-4_500, 4_000),
    (-5_500, 5_500),
    (-60, 1_800),
)

NEAR_HOME = tuple(
    replace(motor, switch=(60, 260) if motor.switch[1] > motor.switch[0] else motor.switch, stops=stops)
    for motor, stops in zip(SCORBOT, _NEAR_STOPS, strict=True)
)
"""The same arm just short of every switch, for tests that are not about homing."""


class _Axis(ctypes.Structure):
    """``axis_t`` of plant.c."""

    _fields_ = (
        *((name, ctypes.c_uint16) for name in ("duty", "top", "control", "direction")),
        *((name, ctypes.c_uint8) for name in ("control_mask", "direction_mask")),
        *((name, ctypes.c_uint8) for name in ("pin_a", "pin_b", "pin_switch")),
        ("motor_sign", ctypes.c_int8),
        *((name, ctypes.c_double) for name in ("full_speed", "time_constant", "static_friction")),
        *((name, ctypes.c_double) for name in ("kinetic_friction", "load", "load_period")),
        *((name, ctypes.c_double) for name in ("low_stop", "high_stop", "switch_low", "switch_high")),
        *((name, ctypes.c_uint8) for name in ("blocked", "torn_a", "torn_b", "switch_stuck")),
        *((name, ctypes.c_uint32) for name in ("lost_edges", "lost_pulses")),
        ("position", ctypes.c_double),
        ("speed", ctypes.c_double),
        ("shown", ctypes.c_int32),
        *((name, ctypes.c_uint8) for name in ("hidden", "level_a", "losing")),
        ("way", ctypes.c_double),
        ("drive", ctypes.c_double),
        ("backward", ctypes.c_uint8),
        ("idle_steps", ctypes.c_uint32),
        ("hot_turns", ctypes.c_uint32),
    )


_PWM = {
    5: (0x98, 0x96, 0x90, 0x80),  # OC3A
    2: (0x9A, 0x96, 0x90, 0x20),  # OC3B
    3: (0x9C, 0x96, 0x90, 0x08),  # OC3C
    6: (0xA8, 0xA6, 0xA0, 0x80),  # OC4A
    7: (0xAA, 0xA6, 0xA0, 0x20),  # OC4B
    8: (0xAC, 0xA6, 0xA0, 0x08),  # OC4C
}
"""Data addresses of duty, top and control, and the bit there, by pin (datasheet, register summary)."""
_PORT = {"C": 0x28, "H": 0x102}
_ENABLE = 9


@dataclass(frozen=True)
class Wires:
    """The Arduino's pins of one axis (firmware/README.md, wiring)."""

    pwm: int
    direction: int
    a: int
    b: int
    switch: int


WIRES = (
    Wires(pwm=5, direction=37, a=21, b=20, switch=22),
    Wires(pwm=2, direction=36, a=19, b=18, switch=23),
    Wires(pwm=3, direction=35, a=62, b=63, switch=24),
    Wires(pwm=6, direction=34, a=64, b=65, switch=25),
    Wires(pwm=7, direction=33, a=66, b=67, switch=26),
    Wires(pwm=8, direction=32, a=68, b=69, switch=27),
)


@dataclass
class Plant:
    """The arm on a simulated Mega's pins, from now on and over its resets; ``motors``: one an axis.

    ``pair``: the axes of a differential pair; the first joint is the sum of both motors, the second their
    difference.
    """

    avr: Avr
    motors: Sequence[Motor] = SCORBOT
    pair: tuple[int, int] | None = (3, 4)
    starts: Mapping[int, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Wire it."""
        self.axes = (_Axis * AXES)(
            *(
                _axis(motor, wires, self.starts.get(axis, motor.start))
                for axis, (motor, wires) in enumerate(zip(self.motors, WIRES, strict=True))
            )
        )
        shim, self._library = ctypes.CDLL(str(library("shim"))), ctypes.CDLL(str(library("plant")))
        shim.sim_avr.restype, shim.sim_avr.argtypes = ctypes.c_void_p, (ctypes.c_void_p,)
        new = self._library.plant_new
        new.restype = ctypes.c_void_p
        new.argtypes = (ctypes.c_void_p, ctypes.c_void_p, *(ctypes.c_int,) * 4)
        self._library.plant_free.argtypes = (ctypes.c_void_p,)
        sum_axis, difference_axis = self.pair or (-1, -1)
        register, mask = _port(_ENABLE)
        self._handle = new(
            shim.sim_avr(self.avr.handle), self.axes, sum_axis, difference_axis, register, mask
        )

    def joint(self, axis: int) -> float:
        """Where a joint is [counts since power-on]."""
        if self.pair and axis in self.pair:
            a, b = (self.axes[motor].position for motor in self.pair)
            return a + b if axis == self.pair[0] else a - b
        return self.axes[axis].position

    def counts(self, axis: int) -> int:
        """What the encoders show of a joint [counts since power-on]."""
        if self.pair and axis in self.pair:
            a, b = (self.axes[motor].shown for motor in self.pair)
            return a + b if axis == self.pair[0] else a - b
        return self.axes[axis].shown

    @property
    def way(self) -> float:
        """What all motors have turned so far [counts, without sign]."""
        return sum(axis.way for axis in self.axes)

    @property
    def speed(self) -> float:
        """That of the fastest motor [counts/s]."""
        return max(abs(axis.speed) for axis in self.axes)

    @property
    def hot_turns(self) -> int:
        """How often a bridge was told to change its direction while it was driving."""
        return sum(axis.hot_turns for axis in self.axes)

    @property
    def powered(self) -> bool:
        """Whether the bridges are enabled."""
        return bool(self.avr.pin(PINS[_ENABLE]))

    def close(self) -> None:
        """Give the memory back, after the simulator's."""
        if self._handle:
            self._library.plant_free(self._handle)
            self._handle = None


def changed(motors: Sequence[Motor], axis: int, **values: Any) -> tuple[Motor, ...]:
    """The same arm with one motor different."""
    return tuple(replace(motor, **values) if number == axis else motor for number, motor in enumerate(motors))


_SHARED = {name for name, _ in _Axis._fields_}


def _axis(motor: Motor, wires: Wires, start: float) -> _Axis:
    duty, top, control, control_mask = _PWM[wires.pwm]
    direction, direction_mask = _port(wires.direction)
    return _Axis(
        duty=duty,
        top=top,
        control=control,
        control_mask=control_mask,
        direction=direction,
        direction_mask=direction_mask,
        pin_a=_pin(wires.a),
        pin_b=_pin(wires.b),
        pin_switch=_pin(wires.switch),
        **{name: value for name, value in vars(motor).items() if name in _SHARED},
        low_stop=motor.stops[0],
        high_stop=motor.stops[1],
        switch_low=motor.switch[0],
        switch_high=motor.switch[1],
        position=start,
        shown=int(start),
    )


def _pin(arduino: int) -> int:
    port, bit = PINS[arduino]
    return 8 * (ord(port) - ord("A")) + int(bit)


def _port(arduino: int) -> tuple[int, int]:
    port, bit = PINS[arduino]
    return _PORT[port], 1 << int(bit)

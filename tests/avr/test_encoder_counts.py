"""The encoder firmware counts every edge, or says how many it has not."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import pytest
from tests.avr.avr import Edge
from tests.avr.building import ROOT, run
from tests.avr.conftest import MakeArm
from tests.avr.encoder_arm import EncoderArm
from tests.avr.mega import PINS
from tests.avr.plant import AXES, NEAR_HOME, WIRES

LOST, LATE = 32, 32
MOST_LOST = 4
"""edges that an axis may lose since homing (``config.h``)"""
FASTEST = 6000


class Truth:
    """Where the joints really are, in the counts that they had when this was made."""

    def __init__(self, arm: EncoderArm) -> None:
        self.arm = arm
        self._zero = [arm.plant.counts(axis) - count for axis, count in enumerate(arm.now().counts)]

    def drift(self, counts: Sequence[int]) -> list[int]:
        return [abs(self.arm.plant.counts(axis) - self._zero[axis] - counts[axis]) for axis in range(AXES)]


def test_a_thousand_lost_edges_are_told_or_the_home_is_gone(make_arm: MakeArm) -> None:
    """One by one on every motor, too seldom for a torn wire; the homes are found again in between."""
    arm = make_arm()
    injected, silent, told = 0, 0, 0
    while injected < 1000:
        arm.events.clear()
        arm.home()
        assert arm.ask("EN 0") == "ok"
        truth = Truth(arm)
        for number in range(84):
            for axis in arm.plant.axes:
                axis.lost_edges = 1
                axis.position += 8.0 if number < 42 else -8.0
                injected += 1
            arm.run(0.034)
            now = arm.now()
            for axis, drift in enumerate(truth.drift(now.counts)):
                homed = bool(now.homed >> axis & 1)
                silent += homed and drift > 2 * now.lost[axis]
                told += homed and drift > 0
        assert now.homed == 0
        assert now.mode == "T" and not arm.plant.powered
        assert arm.ask("CLR") == "ok"
    assert silent == 0
    assert told >= 2 * 4 * MOST_LOST


@pytest.fixture
def running(homed: EncoderArm) -> EncoderArm:
    """The base in the middle of a long way, at 2800 counts/s."""
    assert homed.ask("CFG 0 vmax=2800") == "err MOVING motors are on"
    return under_way(homed)


def under_way(homed: EncoderArm) -> EncoderArm:
    homed.post("P -9000 - - - - - 1000")
    go_on(homed, 0.4)
    assert homed.plant.axes[0].speed < -2500
    return homed


def go_on(arm: EncoderArm, seconds: float) -> None:
    """Let time pass as a host that talks to the board."""
    end = arm.avr.now + seconds
    arm.run_until(lambda: arm.avr.now >= end, seconds + 0.1)


def test_one_lost_edge_in_motion_is_told_and_five_are_too_many(running: EncoderArm) -> None:
    for lost in range(1, MOST_LOST + 1):
        running.plant.axes[0].lost_edges = 1
        go_on(running, 0.04)
        now = running.now()
        assert (now.mode, now.homed, now.lost[0]) == ("N", 0x3F, lost)
    running.plant.axes[0].lost_edges = 1
    running.run(0.03)
    assert running.events[-1] == "trip 0 LOST"
    now = running.now()
    assert (now.mode, now.homed, now.faults[0], now.lost[0]) == ("T", 0x3E, LOST, MOST_LOST + 1)
    assert not running.plant.powered
    assert running.ask("EN 1") == "err FAULT latched"
    assert running.ask("CLR") == "ok"
    running.events.clear()
    assert running.ask("HOME 0") == "ok"
    running.run_until(lambda: "home done" in running.events, 20)
    assert (running.now().homed, running.now().lost[0]) == (0x3F, 0)


def test_a_pulse_of_one_channel_that_is_missing_at_speed_is_told(homed: EncoderArm) -> None:
    """The counts go back and forth once and are 4 behind: no edge came twice at once."""
    truth = Truth(homed)
    running = under_way(homed)
    running.plant.axes[0].lost_pulses = 1
    go_on(running, 0.1)
    assert running.now().lost[0] == 2
    running.avr.write(b"!")
    running.run_until(lambda: "held" in running.events, 2)
    go_on(running, 0.2)
    assert 3 <= truth.drift(running.now().counts)[0] <= 5
    assert running.now().mode == "B"


def test_turning_round_and_being_hit_lose_nothing(running: EncoderArm) -> None:
    for goal in (-3000, -6000, -4000):
        assert running.ask(f"P {goal} - - - - - 300") == "ok"
        go_on(running, 0.4)
    running.plant.axes[0].speed = -running.plant.axes[0].speed
    go_on(running, 0.05)
    running.post("P -9000 - - - - - 1000")
    go_on(running, 0.4)
    running.plant.axes[0].blocked = 1
    running.run_until(lambda: running.status[-1].mode == "T", 1)
    assert running.now().lost == (0,) * AXES
    assert running.now().homed == 0x3F


def test_an_edge_lost_by_a_motor_of_a_pair_concerns_both_joints(homed: EncoderArm) -> None:
    homed.plant.axes[3].lost_edges = 1
    assert homed.ask("P - - - -40 - - 100") == "ok"
    homed.run(0.3)
    assert homed.now().lost == (0, 0, 0, 1, 1, 0)
    homed.events.clear()
    assert homed.ask("HOME 3") == "ok"
    homed.run_until(lambda: "home done" in homed.events, 20)
    assert homed.now().lost == (0, 0, 0, 0, 1, 0)
    assert homed.now().homed == 0x3F


# How fast.


def test_six_axes_at_the_highest_speed_there_is(make_arm: MakeArm) -> None:
    """Their edges one by one, in closed loop, with a host that streams: all counted, no control left out."""
    motors = [
        replace(motor, full_speed=11_000, time_constant=0.03, stops=(-90_000, 90_000), load=0.0)
        for motor in NEAR_HOME
    ]
    motors[5] = replace(motors[5], stops=(-60, 90_000))
    arm = make_arm(motors, pair=None)
    assert arm.ask("PAIR NONE") == "ok"
    for axis in range(AXES):
        assert arm.ask(f"CFG {axis} vmax={FASTEST + 1}") == f"err RANGE vmax {FASTEST + 1} 1 {FASTEST}"
        assert arm.ask(f"CFG {axis} hv={FASTEST + 1}") == f"err RANGE hv {FASTEST + 1} 1 {FASTEST}"
        assert arm.ask(f"CFG {axis} min=-60000 max=60000 vmax={FASTEST} amax=40000") == "ok"
        assert arm.ask(f"CFG {axis} ferr=8000 kp=600 ki=200 kd=6 brk=180 hv=800") == "ok"
    arm.home()
    truth, fastest = Truth(arm), 0.0
    for goal in (6000, 0):
        goals = [-goal] * 5 + [goal]
        for step in range(60):
            arm.post(arm.setpoints(goals) if step % 2 else arm.setpoints(goals, 900))
            arm.run(0.02)
            fastest = max(fastest, min(abs(axis.speed) for axis in arm.plant.axes))
    arm.run(0.1)
    now = arm.now()
    assert FASTEST < fastest < 1.2 * FASTEST
    assert (now.mode, now.homed, now.flags, now.faults) == ("N", 0x3F, 0, (0,) * AXES)
    assert now.lost == (0,) * AXES
    assert max(truth.drift(now.counts)) <= 2, "the moment of asking"
    assert abs(now.ms / 1000 - arm.avr.now) < 0.02


def spin(arm: EncoderArm, axis: int, counts_a_second: float, seconds: float) -> list[Edge]:
    """The edges of an encoder that somebody turns upward, however fast."""
    start, spacing = arm.avr.cycle + 100 * axis, arm.avr.clock_hz / counts_a_second
    arm.plant.axes[axis].blocked = 1
    a, b = PINS[WIRES[axis].a], PINS[WIRES[axis].b]
    pins = [(a, 1), (b, 1), (a, 0), (b, 0)]
    begin = arm.plant.axes[axis].shown & 3
    return [
        Edge(start + round(edge * spacing), *pins[(begin + edge) & 3])
        for edge in range(round(seconds * counts_a_second))
    ]


def test_an_axis_that_is_spun_is_braked_at_any_speed(make_arm: MakeArm) -> None:
    """More than 16 bits of velocity: the control pulls against it, not along with it."""
    arm = make_arm()
    assert arm.ask("CFG 0 kp=0 ki=0 kd=100 brk=0 ferr=30000 inv=0 minv=0") == "ok"
    assert arm.ask("EN 1") == "ok"
    arm.avr.schedule(spin(arm, 0, 40_000, 0.3))
    drives: list[float] = []
    for _ in range(28):
        arm.run(0.01)
        drives.append(arm.plant.axes[0].drive)
    assert arm.plant.powered
    assert max(drives[1:]) < 0
    arm.run(0.1)
    assert arm.now().counts[0] == 12_000


def test_a_board_without_time_says_so_and_keeps_time(make_arm: MakeArm) -> None:
    """Two encoders spun so fast that control ticks are left out: silence still counts in seconds."""
    arm = make_arm()
    for axis in (0, 1):
        assert arm.ask(f"CFG {axis} kp=0 ki=0 kd=100 brk=0 ferr=30000") == "ok"
    assert arm.ask("EN 1") == "ok"
    silent_since = arm.avr.now
    edges = spin(arm, 0, 46_000, 0.6) + spin(arm, 1, 46_000, 0.6)
    arm.avr.schedule(sorted(edges))
    arm.avr.watch("H6")
    arm.run(0.51)
    off = [edge for edge in arm.avr.edges() if not edge.level]
    assert off and 0.35 < off[0].cycle / arm.avr.clock_hz - silent_since <= 0.5
    arm.run(0.3)
    now = arm.now()
    assert now.flags & LATE
    assert abs(now.ms / 1000 - arm.avr.now) < 0.02
    assert arm.ask("CLR") == "ok"
    assert arm.now().flags == 0


def test_time_goes_on_when_the_ticks_begin_anew(make_arm: MakeArm) -> None:
    """After 97 days; a host would take a clock that goes back for a restart."""
    symbols = run(["avr-nm", "-S", str(ROOT / "build" / "firmware" / "encoder.elf")]).splitlines()
    (at, size) = next(
        (int(start, 16) & 0xFFFF, int(length, 16))
        for start, length, *_, name in (line.split() for line in symbols if len(line.split()) == 4)
        if "controller" in name and "Controller" not in name
    )
    arm = make_arm()

    def words() -> dict[int, int]:
        data = bytes(arm.avr.data(at + offset) for offset in range(size))
        return {offset: int.from_bytes(data[offset : offset + 4], "little") for offset in range(size - 3)}

    ticks = set(range(size - 3))
    for _ in range(3):
        arm.run(0.25)
        passed, found = round(arm.avr.now * 512), words()
        ticks = {offset for offset in ticks if abs(found[offset] - passed) <= 10}
    (place,) = ticks
    for offset, byte in enumerate((0xFFFFFFFF - 100).to_bytes(4, "little")):
        arm.avr.set_data(at + place + offset, byte)
    times: list[int] = []
    for _ in range(20):
        times.append(arm.now().ms)
        arm.run(0.02)
    assert all(15 <= later - earlier <= 40 for earlier, later in itertools.pairwise(times)), times

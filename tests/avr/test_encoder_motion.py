"""The encoder firmware moves a simulated arm: how exactly, and what it refuses."""

from __future__ import annotations

import itertools

import pytest
from tests.avr.building import ROOT, run
from tests.avr.conftest import MakeArm
from tests.avr.encoder_arm import EncoderArm, sealed
from tests.avr.plant import AXES, NEAR_HOME, changed

COUNTS_PER_DEG = (141.8888, 113.5555, 113.5555, 27.9, 27.9)
GRIPPER_SPAN = 1600
PERIOD_S = 0.02
RAM_END = 0x2200
PAINT = 0xA5


def smooth(share: float) -> float:
    """Rises from 0 to 1 with velocity and acceleration 0 at both ends (quintic)."""
    return share**3 * (10 - 15 * share + 6 * share**2)


def stream(arm: EncoderArm, goal: list[int], seconds: float) -> list[float]:
    """Stream a motion as a host does; the largest distance of each joint from its setpoint [counts].

    A setpoint is due when the board has had its 20 ms for it.
    """
    status = arm.now()
    begin = list(status.counts)
    zero = [arm.plant.joint(axis) - status.counts[axis] for axis in range(AXES)]
    worst = [0.0] * AXES
    steps = round(seconds / PERIOD_S)
    for step in range(1, steps + 1):
        setpoints = [round(a + (b - a) * smooth(step / steps)) for a, b in zip(begin, goal, strict=True)]
        arm.post(arm.setpoints(setpoints))
        arm.run(PERIOD_S)
        for axis, setpoint in enumerate(setpoints):
            worst[axis] = max(worst[axis], abs(arm.plant.joint(axis) - zero[axis] - setpoint))
    return worst


def test_follows_a_trajectory_of_tens_of_degrees(make_arm: MakeArm) -> None:
    arm = make_arm()
    arm.home()
    answered = len(arm.answers)
    for angles, gripper, seconds in (
        ((60, -40, -60, -70, 80), 1000, 6.0),  # at most 18, 12, 18, 21, 24 deg/s
        ((-30, 30, -100, 60, -90), 200, 9.0),  # 19, 15, 8, 27, 35 deg/s
    ):
        goal = [round(deg * scale) for deg, scale in zip(angles, COUNTS_PER_DEG, strict=True)] + [gripper]
        worst = stream(arm, goal, seconds)
        for axis, scale in enumerate(COUNTS_PER_DEG):
            assert worst[axis] / scale <= 1.0, f"axis {axis}: {worst[axis] / scale:.2f} deg behind"
        assert worst[5] / GRIPPER_SPAN <= 0.02

        for _ in range(5):  # it is there, and stays
            assert arm.ask("PING") == "ok"
            arm.run(0.1)
        assert max(abs(a - b) for a, b in zip(arm.now().counts, goal, strict=True)) <= 1
        standing = arm.plant.way
        arm.run(0.3)
        assert arm.plant.way - standing < 1.0
    refused = [answer for answer in arm.answers[answered:] if " err " in answer]
    assert not refused
    assert arm.now().mode == "N"


def test_a_jump_becomes_a_trapezoid(make_arm: MakeArm) -> None:
    """One setpoint far away: the joint keeps to its velocity and acceleration."""
    arm = make_arm()
    assert arm.ask("CFG 0 vmax=1000 amax=2000") == "ok"
    arm.home()
    begin = arm.plant.joint(0)
    assert arm.ask("P 3000 - - - - - 1") == "ok"
    places = [begin]
    for step in range(400):
        if step % 20 == 0:
            arm.post("PING")
        arm.run(0.01)
        places.append(arm.plant.joint(0))
    speeds = [(b - a) / 0.05 for a, b in zip(places[::5], places[5::5], strict=False)]
    assert max(speeds) == pytest.approx(1000, rel=0.1)
    assert max(places) - begin <= 3015
    # v / a = 0.5 s to full speed and as much to rest: 3000 counts take 3.5 s.
    assert places[-1] - begin == pytest.approx(3000, abs=2)
    assert places[330] - begin < 2990
    rise = next(index for index, speed in enumerate(speeds) if speed > 900) * 0.05
    assert 0.35 <= rise <= 0.65


@pytest.mark.parametrize(("axis", "largest"), [(0, 210), (3, 180), (5, 150)])
def test_no_motor_gets_more_drive_than_it_may_have(make_arm: MakeArm, axis: int, largest: int) -> None:
    """Homing, a jump, and against something in its way: seen on the pins, tick by tick."""
    arm = make_arm()
    motor = arm.plant.axes[axis]
    seen = [0.0]

    def look() -> bool:
        seen.append(abs(motor.drive))
        return arm.now().mode == "T" if motor.blocked else "home done" in arm.events

    assert arm.ask(f"CFG {axis} dmax={largest}") == "ok"
    assert arm.ask(f"HOME {axis}") == "ok"
    arm.run_until(look, 60)
    assert arm.ask("P " + " ".join("600" if one == axis else "-" for one in range(AXES)) + " 1000") == "ok"
    for _ in range(150):
        arm.run(0.01)
        look()
        arm.post("PING")
    assert arm.now().counts[axis] == pytest.approx(600, abs=2)
    motor.blocked = 1
    assert arm.ask("P " + " ".join("700" if one == axis else "-" for one in range(AXES)) + " 500") == "ok"
    arm.run_until(look, 5)
    assert arm.events[-1] == f"trip {axis} STALL"
    assert max(seen) == pytest.approx(largest / 255, abs=0.002)


def test_the_control_runs_512_times_a_second(make_arm: MakeArm) -> None:
    """Measured on the pin that is high while the control runs, with all axes moving."""
    arm = make_arm()
    arm.home()
    arm.ask("P -2000 -2000 -2000 -500 500 800 1000")
    arm.avr.edges()
    arm.avr.watch("B6")
    arm.run(0.5)
    edges = arm.avr.edges()
    rises = [edge.cycle for edge in edges if edge.level]
    gaps = [b - a for a, b in itertools.pairwise(rises)]
    assert arm.avr.clock_hz * (len(rises) - 1) / (rises[-1] - rises[0]) == pytest.approx(512, rel=1e-4)
    assert max(gaps) < arm.avr.clock_hz / 500  # none was left out
    busy = [b.cycle - a.cycle for a, b in itertools.pairwise(edges) if a.level]
    assert max(busy) < 0.75 * arm.avr.clock_hz / 512


def test_the_stack_stays_far_from_the_variables(make_arm: MakeArm) -> None:
    """The deepest it gets, with all interrupts inside each other, seen by the bytes it has overwritten."""
    symbols = run(["avr-nm", str(ROOT / "build" / "firmware" / "encoder.elf")])
    (variables_end,) = (int(line[:8], 16) & 0xFFFF for line in symbols.splitlines() if line.endswith(" _end"))
    arm = make_arm()
    free = range(variables_end, RAM_END - 200)
    for address in free:
        arm.avr.set_data(address, PAINT)
    arm.home()
    for number in range(40):
        arm.avr.write(b"?" + b"\xaa" * 90 + b"\n")
        setpoints = arm.setpoints((-20 * number, -20 * number, -20 * number, -5 * number, 0, 10 * number))
        for command in ("SHOW 0", "CFG 0 kp=1", "GET", setpoints):
            arm.ask(command)
    untouched = next(address for address in free if arm.avr.data(address) != PAINT) - variables_end
    assert untouched > 4096


def test_refuses_motion_before_homing(make_arm: MakeArm) -> None:
    arm = make_arm()
    assert arm.ask("P 100 - - - - -") == "err OFF"
    assert arm.ask("EN 1") == "ok"
    for axis in range(AXES):
        setpoints = " ".join("100" if other == axis else "-" for other in range(AXES))
        assert arm.ask(f"P {setpoints}") == f"err NOTHOMED {axis}"
    arm.run(0.3)
    assert arm.plant.way == 0.0

    assert arm.ask("HOME 0") == "ok"
    assert arm.ask("P 100 - - - - -") == "err BUSY homing"
    arm.run_until(lambda: "home done" in arm.events, 20)
    assert arm.ask("P 100 - - - - -") == "ok"
    assert arm.ask("P 100 100 - - - -") == "err NOTHOMED 1"


def test_refuses_setpoints_beyond_the_soft_limits(make_arm: MakeArm) -> None:
    arm = make_arm()
    assert arm.ask("CFG 0 min=-500 max=400") == "ok"
    arm.home()
    rested = arm.plant.joint(1)
    assert arm.ask("P 401 -500 - - - -") == "err LIMIT 0 401 -500 400"
    assert arm.ask("P -501 - - - - -") == "err LIMIT 0 -501 -500 400"
    arm.run(0.2)
    assert arm.plant.joint(1) == rested, "a refused line moved another axis"
    assert arm.ask("P 400 - - - - -") == "ok"
    arm.run_until(lambda: arm.now().counts[0] >= 399, 1)


def test_a_stream_that_breaks_off_stays_inside_the_soft_limits(make_arm: MakeArm) -> None:
    """At full speed when its last setpoint is the limit itself: the joint has slowed down by then."""
    arm = make_arm()
    assert arm.ask("CFG 0 min=-9000 max=600 amax=4000") == "ok"
    arm.home()
    assert arm.ask("P -5000 - - - - - 1000") == "ok"
    arm.run_until(lambda: arm.now().counts[0] <= -4999, 6)
    zero = arm.plant.joint(0) - arm.now().counts[0]
    highest = -5000.0
    for setpoint in [*range(-5000, 600, 50), 600, *[None] * 60]:
        arm.post("PING" if setpoint is None else f"P {setpoint} - - - - -")
        arm.run(PERIOD_S)
        highest = max(highest, arm.plant.joint(0) - zero)
    assert highest <= 600 + 30  # 780 counts are what it takes to slow down; the motor swings a little
    assert arm.now().mode == "N"
    assert arm.now().counts[0] == pytest.approx(600, abs=2)


def test_turns_round_at_the_highest_speed_there_is(make_arm: MakeArm) -> None:
    """From 5,000 counts/s one way to as much the other."""
    fast = changed(NEAR_HOME, 0, full_speed=12_000, time_constant=0.02, stops=(-100_000, 100_000))
    arm = make_arm(fast)
    assert arm.ask("CFG 0 min=-50000 max=50000 vmax=6000 amax=20000 ferr=3000") == "ok"
    arm.home()
    step = 100
    farthest = setpoint = 0
    for number in range(120):
        setpoint += -step if number < 60 else step
        arm.post(f"P {setpoint} - - - - -")
        arm.run(PERIOD_S)
        farthest = min(farthest, *(status.counts[0] for status in arm.status[-1:]))
    assert arm.now().mode == "N"
    assert farthest > -60 * step - 1000  # v^2 / 2a is 625 counts
    arm.run_until(lambda: abs(arm.now().counts[0]) < 20, 2)


def test_differential_wrist_moves_one_joint_alone(make_arm: MakeArm) -> None:
    arm = make_arm()
    arm.home()
    a, b = arm.plant.axes[3].position, arm.plant.axes[4].position
    assert arm.ask("P - - - -600 - - 500") == "ok"
    arm.run_until(lambda: arm.now().counts[3] <= -599, 3)
    arm.run(0.2)
    assert arm.plant.axes[3].position - a == pytest.approx(-300, abs=3)
    assert arm.plant.axes[4].position - b == pytest.approx(-300, abs=3)
    assert arm.now().counts[4] == pytest.approx(0, abs=1)


@pytest.fixture
def moving(make_arm: MakeArm) -> EncoderArm:
    """An arm in the middle of a motion of all its axes."""
    arm = make_arm()
    arm.home()
    assert arm.ask("P -6000 -4000 -5000 -900 900 1500 1000") == "ok"
    arm.run(0.35)
    assert arm.plant.speed > 1000
    return arm


def test_motors_are_off_in_half_a_second_of_silence(moving: EncoderArm) -> None:
    moving.post("PING")
    moving.run(0.01)
    silent_since = moving.avr.now
    moving.avr.edges()
    moving.avr.watch("H6")  # the bridges' enable
    moving.run(0.5)
    (off,) = moving.avr.edges()
    assert off.level == 0
    assert 0.35 < off.cycle / moving.avr.clock_hz - silent_since <= 0.5
    assert moving.plant.speed == 0.0
    assert moving.events[-1] == "watchdog"
    status = moving.now()
    assert (status.mode, status.flags & 1) == ("O", 1)
    assert status.homed == 0x3F
    way = moving.plant.way
    assert moving.ask("P 0 0 0 0 0 0") == "err OFF"
    moving.run(0.2)
    assert moving.plant.way == way, "it moved again by itself"


def test_0x18_switches_the_motors_off_at_once(moving: EncoderArm) -> None:
    moving.avr.edges()
    moving.avr.watch("H6")
    sent = moving.avr.now
    moving.avr.write(b"\x18")
    moving.run(0.1)
    (off,) = moving.avr.edges()
    assert off.cycle / moving.avr.clock_hz - sent < 0.0005
    assert all(axis.drive == 0.0 for axis in moving.plant.axes)
    moving.run(0.3)
    assert moving.plant.speed == 0.0
    assert moving.events[-1] == "stopped"
    status = moving.now()
    assert (status.mode, status.flags) == ("O", 8)


@pytest.mark.parametrize("stop", [b"\x18", b"!"])
@pytest.mark.parametrize("command", ["EN 1", "HOME"])
def test_a_stop_overtakes_the_lines_before_it(make_arm: MakeArm, command: str, stop: bytes) -> None:
    """The motors do not go on by a line that was on its way when the host said stop."""
    arm = make_arm()
    arm.avr.watch("H6")
    for number in range(1, 12):  # their answers take longer than they do
        arm.avr.write(sealed(f"{number} SHOW 0"))
    arm.avr.write(sealed(f"12 {command}") + stop)
    arm.run(0.5)
    assert arm.answers[-1] == "12 err OFF stopped"
    assert not arm.avr.edges(), "the motors were switched on"
    assert arm.ask("EN 1") == "ok"


def test_the_watchdog_s_braking_is_not_ended_by_an_enable(moving: EncoderArm) -> None:
    """An `ok` would say that the motors stay on."""
    moving.run_until(lambda: moving.status[-1].mode == "B", 1, ping_s=10)
    assert moving.ask("EN 1") == "err HOLD braking"
    moving.run(0.15)
    assert not moving.plant.powered
    assert moving.ask("EN 1") == "ok"


def test_0x18_acts_in_the_middle_of_a_line(moving: EncoderArm) -> None:
    moving.avr.write(b"77 P 0 0 0")
    moving.avr.write(b"\x18")
    moving.run(0.005)
    assert not moving.plant.powered


def test_hold_stops_inside_the_acceleration_and_stays(moving: EncoderArm) -> None:
    moving.avr.write(b"!")
    moving.run(0.01)
    assert moving.plant.speed > 500, "it was stopped dead"
    moving.run_until(lambda: "held" in moving.events, 1)
    moving.run(0.1)
    assert moving.now().mode == "B"
    assert moving.plant.powered
    assert moving.ask("P 0 0 0 0 0 0") == "err HOLD"
    assert moving.ask("HOME") == "err HOLD"
    assert moving.ask("PING") == "ok"
    moving.run(0.3)
    way = moving.plant.way
    assert moving.ask("PING") == "ok"
    moving.avr.write(b"~")
    moving.run(0.3)
    assert moving.now().mode == "N"
    assert moving.plant.way - way < 12, "nothing moves by a release"
    assert moving.ask("P -6000 - - - - - 500") == "ok"

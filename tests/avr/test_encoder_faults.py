"""The encoder firmware switches the motors off when the arm does not do what it is told."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from tests.avr.conftest import MakeArm
from tests.avr.encoder_arm import EncoderArm
from tests.avr.plant import NEAR_HOME, changed

STALL, FOLLOW, ENCODER, LIMIT = 1, 2, 4, 16


def slow_stream(arm: EncoderArm, axis: int, counts_a_step: int, until: Callable[[], bool]) -> float:
    """Move one axis on and on until something is so, or 3 s have passed; how long that took [s]."""
    begin = arm.avr.now
    setpoint = arm.now().counts[axis]
    while not until() and arm.avr.now < begin + 3:
        setpoint += counts_a_step
        arm.post("P " + " ".join(str(setpoint) if other == axis else "-" for other in range(6)))
        arm.run(0.02)
    return arm.avr.now - begin


def tripped(arm: EncoderArm) -> bool:
    return bool(arm.status) and arm.status[-1].mode == "T"


@pytest.mark.parametrize("axis", [0, 2, 3, 5])
def test_a_blocked_joint_is_a_stall(homed: EncoderArm, axis: int) -> None:
    homed.plant.axes[axis].blocked = 1
    took = slow_stream(homed, axis, 5, lambda: tripped(homed))
    assert homed.events[-1] == f"trip {axis} STALL"
    assert took < 1.5
    assert homed.now().faults[axis] == STALL
    assert not homed.plant.powered
    assert homed.now().homed == 0x3F, "the encoders still know where the arm is"
    assert homed.ask("EN 1") == "err FAULT latched"
    assert homed.ask("P 0 0 0 0 0 0") == "err FAULT latched"

    homed.plant.axes[axis].blocked = 0
    assert homed.ask("CLR") == "ok"
    assert homed.ask("EN 1") == "ok"
    assert homed.now().faults[axis] == 0
    assert slow_stream(homed, axis, 5, lambda: homed.now().counts[axis] > 200) < 3


def test_a_joint_that_is_hit_is_a_following_error(homed: EncoderArm) -> None:
    """Blocked at speed: the setpoint runs away before the stall's time is over."""
    homed.post("P -6000 - - - - - 1000")
    homed.run(0.3)
    homed.plant.axes[0].blocked = 1
    homed.run_until(lambda: tripped(homed), 1)
    assert homed.events[-1] == "trip 0 FOLLOW"
    assert homed.now().faults[0] == FOLLOW


@pytest.mark.parametrize(
    ("axis", "wire"),
    [(0, "torn_a"), (1, "torn_b"), (2, "torn_b"), (3, "torn_a"), (4, "torn_b"), (5, "torn_a")],
)
def test_a_torn_encoder_wire_in_motion(homed: EncoderArm, axis: int, wire: str) -> None:
    homed.post("P -6000 -4000 -5000 -900 300 1500 1000")
    homed.run(0.3)
    at = homed.plant.axes[axis].position
    setattr(homed.plant.axes[axis], wire, 1)
    homed.run_until(lambda: tripped(homed), 1)
    assert homed.events[-1] == f"trip {axis} ENCODER"
    assert homed.now().faults[axis] == ENCODER
    assert not homed.plant.powered
    assert abs(homed.plant.axes[axis].position - at) < 600, "it ran away"
    lost = {axis, 7 - axis} if axis in (3, 4) else {axis}
    assert homed.now().homed == 0x3F & ~sum(1 << one for one in lost)
    assert homed.ask("CLR") == "ok"
    assert homed.ask("EN 1") == "ok"
    assert homed.ask("P 0 0 0 0 0 0") == f"err NOTHOMED {min(lost)}"


def test_an_encoder_that_was_never_there(make_arm: MakeArm) -> None:
    """The joint turns, nothing is counted: off before it has gone far."""
    arm = make_arm(changed(NEAR_HOME, 0, switch=(0, 0)))
    arm.plant.axes[0].torn_a = arm.plant.axes[0].torn_b = 1
    assert arm.ask("HOME 0") == "ok"
    arm.run_until(lambda: tripped(arm), 5)
    assert arm.events[-1] == "trip 0 ENCODER"
    assert not arm.plant.powered


def test_a_motor_wired_the_wrong_way_does_not_run_away(make_arm: MakeArm) -> None:
    arm = make_arm(changed(NEAR_HOME, 1, motor_sign=-1, load=0.9, static_friction=0.3))
    assert arm.ask("EN 1") == "ok"
    arm.run_until(lambda: tripped(arm), 3)
    assert arm.events[-1] == "trip 1 FOLLOW"
    assert abs(arm.plant.joint(1)) < 1500


def test_pushed_beyond_a_soft_limit(make_arm: MakeArm) -> None:
    arm = make_arm()
    assert arm.ask("CFG 0 min=-500 max=300 ferr=200") == "ok"
    arm.home()
    assert arm.ask("P 300 - - - - - 500") == "ok"
    arm.run_until(lambda: arm.now().counts[0] >= 299, 2)
    arm.plant.axes[0].load = -1.5
    arm.run_until(lambda: tripped(arm), 1)
    assert arm.events[-1] == "trip 0 LIMIT"
    assert arm.now().faults[0] == LIMIT


def test_gravity_is_held_without_a_fault(make_arm: MakeArm) -> None:
    """A load beyond friction: control holds it, and does not let it creep."""
    arm = make_arm(changed(NEAR_HOME, 1, load=0.4, static_friction=0.25, kinetic_friction=0.15))
    assert arm.ask("CFG 1 brk=70") == "ok"
    arm.home()
    assert arm.ask("P - -500 - - - - 500") == "ok"
    for _ in range(20):
        arm.ask("PING")
        arm.run(0.1)
    assert arm.now().mode == "N"
    assert arm.now().counts[1] == pytest.approx(-500, abs=2)


def test_a_motor_of_a_pair_is_watched_though_its_joint_is_not_used(make_arm: MakeArm) -> None:
    """Axis 4 is not homed, but its motor turns joint 3."""
    arm = make_arm()
    assert arm.ask("CFG 4 hord=0") == "ok"
    assert arm.ask("HOME 3") == "ok"
    arm.run_until(lambda: "home done" in arm.events, 20)
    assert arm.ask("P - - - -2000 - - 1000") == "ok"
    arm.run(0.3)
    arm.plant.axes[4].torn_b = 1
    arm.run_until(lambda: tripped(arm), 1)
    assert arm.events[-1] == "trip 4 ENCODER"
    assert arm.now().homed == 0


@pytest.mark.parametrize("key", ["inv", "minv"])
def test_a_motor_of_a_pair_the_other_way_unhomes_both_joints(homed: EncoderArm, key: str) -> None:
    assert homed.ask("EN 0") == "ok"
    assert homed.ask(f"CFG 3 {key}=0") == "ok"
    assert homed.now().homed == 0b111111
    assert homed.ask(f"CFG 3 {key}=1") == "ok"
    assert homed.now().homed == 0b100111


def test_the_switch_of_a_pair_concerns_one_joint(homed: EncoderArm) -> None:
    assert homed.ask("EN 0") == "ok"
    assert homed.ask("CFG 4 hdir=-1") == "ok"
    assert homed.now().homed == 0b101111


def test_a_torn_encoder_wire_while_the_motors_are_off(homed: EncoderArm) -> None:
    """The arm sinks and nobody counts it."""
    assert homed.ask("EN 0") == "ok"
    homed.plant.axes[1].load = 1.0
    homed.run(0.2)
    assert homed.now().homed == 0x3F, "counted, the home holds"
    homed.plant.axes[1].torn_a = 1
    homed.run(0.5)
    assert homed.now().homed == 0x3F & ~2
    assert homed.now().mode == "O"

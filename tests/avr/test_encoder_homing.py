"""The encoder firmware finds its homes, on a simulated arm."""

from __future__ import annotations

import pytest
from tests.avr.conftest import MakeArm
from tests.avr.plant import AXES, NEAR_HOME, SCATTERED, SCORBOT, changed

EVERY_AXIS = 0x3F


def test_homes_all_axes_from_anywhere(make_arm: MakeArm) -> None:
    arm = make_arm(SCORBOT, starts=SCATTERED)
    arm.home()

    status = arm.now()
    assert (status.mode, status.homed, status.faults) == ("N", EVERY_AXIS, (0,) * AXES)
    # The gripper first, the base last: the default order. The elbow began beyond its switch.
    assert arm.events == ["homed 5", "homed 1", "homed 2", "homed 3", "homed 4", "homed 0", "home done"]
    for axis, motor in enumerate(SCORBOT):
        home = motor.switch[0] if axis != 5 else motor.stops[0]
        assert status.counts[axis] == pytest.approx(0, abs=1)
        assert arm.plant.counts(axis) - status.counts[axis] == pytest.approx(home, abs=1)


def test_the_same_home_every_time(make_arm: MakeArm) -> None:
    arm = make_arm()
    homes: list[list[int]] = []
    for _ in range(3):
        arm.home()
        counts = arm.now().counts
        homes.append([arm.plant.counts(axis) - counts[axis] for axis in range(AXES)])
        assert arm.ask(arm.setpoints((-150, -90, -200, -70, -120, 300), 500)) == "ok"
        arm.run_until(lambda: arm.now().counts[0] < -148, 2)
        arm.events.clear()
    for axis in range(5):
        assert max(home[axis] for home in homes) - min(home[axis] for home in homes) <= 1


def test_the_order_is_configurable(make_arm: MakeArm) -> None:
    arm = make_arm()
    for axis, order in enumerate((1, 0, 3, 2, 2, 0)):
        assert arm.ask(f"CFG {axis} hord={order}") == "ok"
    arm.home()
    assert arm.events == ["homed 0", "homed 3", "homed 4", "homed 2", "home done"]
    assert arm.now().homed == 0b011101
    assert arm.plant.axes[1].way == 0
    assert arm.plant.axes[5].way == 0


def test_one_axis_alone_and_another_edge_count(make_arm: MakeArm) -> None:
    arm = make_arm()
    assert arm.ask("CFG 0 hpos=500") == "ok"
    assert arm.ask("HOME 0") == "ok"
    arm.run_until(lambda: "home done" in arm.events, 20)
    status = arm.now()
    assert status.homed == 1
    assert status.counts[0] == pytest.approx(500, abs=1)
    assert arm.plant.counts(0) - status.counts[0] == pytest.approx(NEAR_HOME[0].switch[0] - 500, abs=1)


def test_reversed_wires_are_set_right_by_the_settings(make_arm: MakeArm) -> None:
    arm = make_arm(changed(NEAR_HOME, 0, motor_sign=-1))
    assert arm.ask("CFG 0 minv=1") == "ok"
    assert arm.ask("HOME 0") == "ok"
    arm.run_until(lambda: "home done" in arm.events, 20)


def test_a_switch_that_opens_when_pressed(make_arm: MakeArm) -> None:
    """Normally closed: seen by the board it is pressed everywhere but between the two edges."""
    arm = make_arm(changed(NEAR_HOME, 0, switch=(-30_000, 60)))
    arm.run(0.05)
    assert arm.now().switches & 1
    assert arm.ask("CFG 0 sinv=1") == "ok"
    arm.run(0.05)
    assert not arm.now().switches & 1
    assert arm.ask("HOME 0") == "ok"
    arm.run_until(lambda: "home done" in arm.events, 20)
    assert arm.plant.counts(0) - arm.now().counts[0] == pytest.approx(60, abs=1)


def test_homing_is_no_faster_than_the_joint_may_be(make_arm: MakeArm) -> None:
    arm = make_arm(changed(NEAR_HOME, 0, switch=(1500, 1700)))
    assert arm.ask("CFG 0 vmax=400 hv=3000") == "ok"
    assert arm.ask("HOME 0") == "ok"
    fastest = 0.0
    while "home done" not in arm.events:
        arm.ask("PING")
        arm.run(0.02)
        fastest = max(fastest, arm.plant.speed)
        assert arm.avr.now < 60
    assert fastest < 900  # control overshoots its speed when it breaks away


def failed(make_arm: MakeArm, axis: int, seconds: float = 60, **motor: object) -> list[str]:
    """The events of homing one axis of an arm that cannot be homed."""
    arm = make_arm(changed(NEAR_HOME, axis, **motor))
    assert arm.ask(f"CFG {axis} min=-800 max=800") == "ok"
    assert arm.ask(f"HOME {axis}") == "ok"
    arm.run_until(lambda: arm.now().mode != "H", seconds)
    status = arm.now()
    assert (status.mode, status.homed) == ("T", 0)
    assert not arm.plant.powered
    assert status.faults[axis] == 8
    assert arm.ask("HOME") == "err FAULT latched"
    assert arm.ask("CLR") == "ok"
    assert arm.now().mode == "O"
    return arm.events


def test_no_switch_between_two_stops(make_arm: MakeArm) -> None:
    events = failed(make_arm, 0, switch=(0, 0), stops=(-300, 400))
    assert events == ["home failed 0 notfound", "trip 0 HOMING"]


def test_no_switch_and_no_stop(make_arm: MakeArm) -> None:
    """It gives up after a little more than the whole range."""
    assert failed(make_arm, 0, switch=(0, 0)) == ["home failed 0 notfound", "trip 0 HOMING"]


def test_a_switch_that_stays_pressed(make_arm: MakeArm) -> None:
    events = failed(make_arm, 0, switch=(-20_000, 20_000))
    assert events == ["home failed 0 stuck", "trip 0 HOMING"]


def test_a_motor_that_turns_the_wrong_way(make_arm: MakeArm) -> None:
    arm = make_arm(changed(NEAR_HOME, 0, motor_sign=-1))
    assert arm.ask("HOME 0") == "ok"
    arm.run_until(lambda: "trip 0 FOLLOW" in arm.events, 5)
    assert abs(arm.plant.joint(0)) < 600
    assert not arm.plant.powered

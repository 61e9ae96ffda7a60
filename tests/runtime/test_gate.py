from __future__ import annotations

import numpy as np
import pytest
from tests.runtime.kit import ROBOT

from armctl.errors import MotionRefusedError
from armctl.runtime.gate import Gate

HOME = ROBOT.pose("home")


@pytest.fixture
def gate() -> Gate:
    gate = Gate(ROBOT, longest_s=0.04)
    gate.jump(HOME, 0.0)
    return gate


def turned(joint: int, degrees: float) -> np.ndarray:
    q = HOME.copy()
    q[joint] += np.radians(degrees)
    return q


def test_a_step_as_large_as_the_speed_limit_allows_is_admitted(gate: Gate) -> None:
    q = turned(0, 60 * 0.02)
    admitted, opening = gate.admit(q, None, 0.02)
    assert np.array_equal(admitted, q)
    assert opening is None
    assert np.array_equal(gate.q, q)


def test_a_larger_step_is_refused_and_leaves_no_trace(gate: Gate) -> None:
    with pytest.raises(
        MotionRefusedError,
        match=r"Base: a step of 1\.201° in 20\.0 ms, its speed limit allows 1\.200°",
    ):
        gate.admit(turned(0, 1.201), None, 0.02)
    assert np.array_equal(gate.q, HOME)


def test_a_long_silence_earns_no_jump(gate: Gate) -> None:
    gate.admit(turned(0, 2.4), None, 100.0)  # two periods' worth
    with pytest.raises(MotionRefusedError, match=r"in 40\.0 ms, its speed limit allows 2\.400°"):
        gate.admit(turned(0, 2.4 + 2.41), None, 200.0)


def test_a_step_against_the_clock_is_refused(gate: Gate) -> None:
    gate.admit(turned(0, 1), None, 1.0)
    with pytest.raises(MotionRefusedError, match=r"in 0\.0 ms"):
        gate.admit(turned(0, 1.1), None, 0.5)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_refused(gate: Gate, value: float) -> None:
    q = HOME.copy()
    q[3] = value
    with pytest.raises(MotionRefusedError, match="not 5 finite angles"):
        gate.admit(q, None, 0.02)
    with pytest.raises(MotionRefusedError, match="not 5 finite angles"):
        gate.jump(q, 0.02)
    with pytest.raises(MotionRefusedError, match="outside 0 … 100 %"):
        gate.admit(None, value, 0.02)


def test_the_limits_hold_for_the_first_setpoint_too(gate: Gate) -> None:
    gate.forget()
    with pytest.raises(MotionRefusedError, match=r"Elbow: -91\.20° is outside -84\.36° … 95\.07°"):
        gate.jump(np.radians([0, 90, -91.2, 0, 0]), 0.0)
    assert gate.q is None


def test_without_power_nothing_is_admitted(gate: Gate) -> None:
    gate.forget()
    with pytest.raises(MotionRefusedError, match="enable first"):
        gate.admit(HOME, None, 0.02)


def test_what_was_sent_last_is_not_sent_again(gate: Gate) -> None:
    assert gate.admit(HOME, None, 0.02) == (None, None)


def test_the_gripper_has_its_own_range_and_speed(gate: Gate) -> None:
    with pytest.raises(MotionRefusedError, match="Gripper: nobody knows how far open it is"):
        gate.admit(None, 0.5, 0.0)
    gate.adopt_opening(0.5, 0.0)
    assert gate.admit(None, 0.54, 0.02) == (None, 0.54)  # 200 %/s
    assert gate.admit(None, 0.54, 0.04) == (None, None)
    with pytest.raises(MotionRefusedError, match=r"Gripper: a step of 5\.00 % in 20\.0 ms, .* 4\.00 %"):
        gate.admit(None, 0.59, 0.04)
    with pytest.raises(MotionRefusedError, match=r"Gripper: 110 % is outside"):
        gate.admit(None, 1.1, 0.04)
    assert gate.opening == 0.54


def test_all_or_nothing(gate: Gate) -> None:
    with pytest.raises(MotionRefusedError, match="Gripper"):
        gate.admit(turned(0, 1), 2.0, 0.02)
    assert np.array_equal(gate.q, HOME)
    assert gate.opening is None

"""A whole session of armctl with an arm whose Mega runs the image that others built, in real time."""

from __future__ import annotations

import threading
from pathlib import Path
from statistics import median

import pytest
from tests.avr.conftest import MakeAvr
from tests.avr.mega import PINS, PulseMeter
from tests.avr.serve import served

import armctl
from armctl.runtime.clock import MonotonicClock

PATIENCE_S = 60.0


def test_an_arm_is_enabled_moved_and_released_over_a_port(make_avr: MakeAvr, tmp_path: Path) -> None:
    avr, clock = make_avr("firmata"), MonotonicClock()
    with (
        served(avr, clock.now, tmp_path / "mega") as server,
        armctl.Arm.open("abaas", port=f"firmata:{server.port}") as arm,
    ):
        arm.enable()
        arm.go_joints([-60, 80, -70, 30, 20])
        arm.gripper(50)
        wanted = arm.robot.output_map
        assert wanted is not None
        expected = wanted.outputs(arm.snapshot.q_command)
        with server.inspect():
            meter = PulseMeter(avr, tuple(expected))
        widths: dict[int, list[float]] = {pin: [] for pin in expected}
        deadline = clock.now() + PATIENCE_S
        while min(map(len, widths.values())) < 7 and clock.now() < deadline:
            clock.wait_until(clock.now() + 0.05, threading.Event())
            with server.inspect():
                for pulse in meter.take():
                    widths[pulse.pin].append(pulse.width_us)
        assert {pin: median(seen) for pin, seen in widths.items()} == pytest.approx(expected, abs=4.5)
        arm.release()
        with server.inspect():
            meter.take()
            avr.run_for(0.1)
            assert meter.take() == []
            assert [avr.pin(PINS[pin]) for pin in expected] == [0] * len(expected)

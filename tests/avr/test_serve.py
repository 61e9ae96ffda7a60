"""A real image behind a pty in real time: what developers and browser sessions open."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

import pytest
from tests.avr.avr import AvrError
from tests.avr.building import IMAGES, ROOT
from tests.avr.conftest import MakeAvr
from tests.avr.mega import PINS, PulseMeter
from tests.avr.serve import served

import armctl
from armctl.errors import BoardError
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.firmata.driver import FirmataDriver
from armctl.hardware.transport import Connection, SerialTransport
from armctl.protocol import MonotonicClock

PATIENCE_S = 60.0


def test_armctl_s_driver_opens_the_real_image_s_port(make_avr: MakeAvr, tmp_path: Path) -> None:
    avr = make_avr("firmata")
    clock = MonotonicClock()
    with served(avr, clock.now, tmp_path / "mega") as server:
        driver = FirmataDriver(Connection(server.port, clock.now))
        assert driver.open().kind == "Arduino with StandardFirmata 2.3"
        driver.configure([ChannelSettings(44, 544, 2400)])
        with server.inspect():
            meter = PulseMeter(avr, (44,))
        driver.write({44: 1234})
        widths: list[float] = []
        deadline = clock.now() + PATIENCE_S
        while not widths and clock.now() < deadline:
            clock.wait_until(clock.now() + 0.02, threading.Event())
            driver.read()  # which sends what waits
            with server.inspect():
                widths = [pulse.width_us for pulse in meter.take()]
        driver.release()
        with server.inspect():
            assert avr.pin(PINS[44]) == 0
        driver.close()
    assert widths[0] == pytest.approx(1234, abs=15)  # of one pulse: it may wait for a byte's interrupt


def test_a_crash_breaks_the_line_and_fails_the_one_who_served_it(make_avr: MakeAvr) -> None:
    with (
        pytest.raises(AvrError, match="crashed"),
        served(make_avr("known"), MonotonicClock().now) as server,
    ):
        line = SerialTransport(server.port, baud=57_600)
        line.read(1, 0.1)
        line.write(b"t")
        with pytest.raises(BoardError):
            for _ in range(100):
                line.read(1, PATIENCE_S / 100)
        line.close()


def test_the_runner_serves_until_it_is_interrupted(tmp_path: Path) -> None:
    with runner(IMAGES["known"](), tmp_path / "mega") as process:
        line = SerialTransport(str(tmp_path / "mega"), baud=57_600)
        line.read(1, 0.1)
        line.write(b"a")
        assert line.read(1, PATIENCE_S) == b"b"
        line.close()
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, err) == (0, "")
    assert "s simulated" in out


def test_the_runner_s_exit_status_tells_of_a_crash(tmp_path: Path) -> None:
    with runner(IMAGES["known"](), tmp_path / "mega") as process:
        line = SerialTransport(str(tmp_path / "mega"), baud=57_600)
        line.read(1, 0.1)
        line.write(b"j")
        _, err = process.communicate(timeout=PATIENCE_S)
        line.close()
    assert process.returncode == 1
    assert "known.hex: the simulated CPU crashed" in err


@contextmanager
def runner(image: Path, link: Path) -> Generator[subprocess.Popen[str]]:
    """``python -m tests.avr.serve``, from when it says that it serves."""
    command = [sys.executable, "-m", "tests.avr.serve", str(image), "--link", str(link)]
    with subprocess.Popen(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=dict(os.environ)
    ) as process:
        try:
            assert process.stdout is not None
            assert str(link) in process.stdout.readline()
            yield process
        finally:
            if process.poll() is None:
                process.kill()


def test_an_arm_is_enabled_moved_and_released_over_a_port(make_avr: MakeAvr, tmp_path: Path) -> None:
    avr, clock = make_avr("firmata"), MonotonicClock()
    with (
        served(avr, clock.now, tmp_path / "mega") as server,
        armctl.Arm.open("abaas", port=f"firmata:{server.port}") as arm,
    ):
        arm.enable("rest")
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

"""A program that runs is ended from outside: the arm is stopped, and the command says so."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from armctl.cli.main import REFUSED
from armctl.cli.options import end_event, ends_like_ctrl_c
from armctl.hardware.boards import channel_settings
from armctl.hardware.maestro.codec import Opcode, set_targets, us_to_quarters
from armctl.hardware.maestro.simulated import SimulatedMaestro, simulated_maestro
from armctl.hardware.simulation import BoardServer
from armctl.program import MoveStep, Program, save_program
from armctl.protocol import MonotonicClock
from armctl.robot import load_robot

ENDS = (signal.SIGTERM, signal.SIGHUP)
# `armctl` with a driver that does not take a board on a busy computer for one that has gone, and with
# signals as a terminal has them: a process whose parent ignores one (`nohup`, `&`) is born ignoring it.
PATIENT = """
import signal, sys
from armctl.cli.main import run
from armctl.hardware.maestro.driver import MaestroDriver
MaestroDriver.__init__.__kwdefaults__["timeout_s"] = 5.0
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
sys.exit(run(sys.argv[1:]))
"""


@pytest.fixture(autouse=True)
def handlers_kept() -> Iterator[None]:
    """Whatever a test installs is taken away again; closed terminals count, also under ``nohup``."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, *ENDS)}
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", [signal.SIGINT, *ENDS])
def test_the_event_is_set(number: signal.Signals) -> None:
    ended = end_event()
    os.kill(os.getpid(), number)
    assert ended.wait(10)


def test_a_second_signal_interrupts_what_does_not_end() -> None:
    ended = end_event()
    ended.patient = False
    os.kill(os.getpid(), signal.SIGTERM)
    assert ended.wait(10) and ended.came
    with pytest.raises(KeyboardInterrupt):
        os.kill(os.getpid(), signal.SIGTERM)
        threading.Event().wait(10)
    ended.patient = True
    os.kill(os.getpid(), signal.SIGTERM)
    assert ended.wait(10)


@pytest.mark.parametrize("number", ENDS)
def test_they_count_as_ctrl_c_and_no_longer_than_asked(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), ends_like_ctrl_c():
        os.kill(os.getpid(), number)
        threading.Event().wait(10)
    assert signal.getsignal(number) is before


def test_a_closed_terminal_that_shall_not_matter_does_not() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    end_event()
    with ends_like_ctrl_c():
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def base_targets(server: BoardServer[SimulatedMaestro]) -> list[tuple[float, int]]:
    """What the board was told of channel 0: when [s], and what [quarter µs]."""
    with server.inspect() as board:
        log = board.log
    sent = [entry for entry in log if entry.opcode is Opcode.SET_TARGET and entry.data[0] == 0]
    return [(entry.time, entry.data[1] | entry.data[2] << 7) for entry in sent]


def swing(server: BoardServer[SimulatedMaestro]) -> int:
    """How far apart the targets so far are."""
    values = [value for _, value in base_targets(server)]
    return max(values, default=0) - min(values, default=0)


def speed(targets: list[tuple[float, int]], at: float, over_s: float) -> float:
    """Mean speed in the time before ``at``: of a busy computer single steps say nothing."""
    time, value = np.array(targets).T
    now, before = np.interp([at, at - over_s], time, value)
    return float(abs(now - before) / over_s)


@pytest.mark.parametrize(
    "numbers",
    [
        (signal.SIGTERM,),
        (signal.SIGHUP,),
        (signal.SIGINT,) * 3,  # somebody who is impatient
        (signal.SIGHUP, signal.SIGHUP, signal.SIGTERM),  # a desktop that ends its session
    ],
)
def test_a_run_that_is_ended_slows_down_first(tmp_path: Path, numbers: tuple[signal.Signals, ...]) -> None:
    """A computer that stands still for 60 ms breaks the stream off by itself: hence several runs."""
    for attempt in range(5):
        targets = ended_run(tmp_path / f"board{attempt}", tmp_path / "swing.toml", numbers)
        fastest = max((speed(targets, time, 0.2) for time, _ in targets[1:]), default=0.0)
        if targets and speed(targets, targets[-1][0], 0.04) < fastest / 3:
            return
    pytest.fail(f"five runs ended abruptly, the last with {targets[-10:]}")


def ended_run(link: Path, program: Path, numbers: tuple[signal.Signals, ...]) -> list[tuple[float, int]]:
    """What the board was told by an endless run that was ended in the middle of a motion.

    Nothing where the computer was so busy that the run rightly refused to begin.
    """
    robot = load_robot("uzuner")
    there, back = (MoveStep(joints_deg=(angle, 90, -80, -40, 0)) for angle in (90, -90))
    save_program(Program(robot="uzuner", steps=(there, back)), program)
    with BoardServer(
        simulated_maestro(channels=channel_settings(robot)), MonotonicClock().now, link=link
    ) as server:
        with server.inspect() as model:  # its pulses are on already: the arm is taken over where it stands
            for channel, pulse_us in robot.output_map.outputs(robot.pose("rest")).items():
                model.feed(set_targets({channel: us_to_quarters(pulse_us)}))
            model.feed(set_targets({5: us_to_quarters(1500.0)}))
        words = ("run", str(program), "--port", str(link), "--forever")
        child = subprocess.Popen([sys.executable, "-c", PATIENT, *words], stderr=subprocess.PIPE, text=True)
        with child as process:  # and waits for it, also when it had to be killed
            try:
                pause = threading.Event()
                for _ in range(6000):
                    if process.poll() is not None or swing(server) > 2000:
                        break
                    pause.wait(0.01)
                for number in numbers:
                    process.send_signal(number)
                    pause.wait(0.03)  # each comes to another place of the way out
                _, said = process.communicate(timeout=30)
            finally:
                process.kill()
        targets = base_targets(server)
    if "the line is too slow" in said:
        return []
    assert (process.returncode, said.splitlines()[-1]) == (REFUSED, "armctl: interrupted")
    return targets

"""The two processes end, die and freeze, each alone: what becomes of the other, and of the arm."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.process.kit import HOME, ROBOT

from armctl.arm import Arm
from armctl.boards import UNNUMBERED
from armctl.errors import BoardError, PortError, StateError
from armctl.facts import State
from armctl.hardware.boards import channel_settings
from armctl.hardware.encoder.messages import Mode
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard, simulated_encoder_board
from armctl.hardware.simulation import BoardServer
from armctl.motion import plan_joints
from armctl.process import Link, registry, start_arm
from armctl.process.host import Host
from armctl.process.lines import LocalLine
from armctl.protocol import Connect, Enable, Follow, MonotonicClock, MoveJoints, SetSpeed
from armctl.robot import load_robot
from armctl.system import start_apart

SCORBOT = load_robot("scorbot")
AWAY = ROBOT.pose("home") + np.array([1.2, 0, 0, 0, 0])
OWNER = """
import sys, threading
from armctl import Arm
arm = Arm.open(*sys.argv[1:3])
pause = threading.Event()
while any(not axis.homed for axis in arm.snapshot.homing):
    pause.wait(0.01)
arm.enable()
arm.set_speed(5)
motion = arm.go_pose("home", wait=False)
print("moves", flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the arm processes of a test have their sockets."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    folder = registry.runtime_folder()
    assert folder is not None
    return folder


PATIENCE_S = 40.0


def until(condition: Callable[[], bool], what: str) -> None:
    """Wait for another process."""
    pause, now = threading.Event(), MonotonicClock.now
    end = now() + PATIENCE_S
    while not condition():
        assert now() < end, f"{PATIENCE_S} s in vain: {what}"
        pause.wait(0.01)


def the_only_one(folder: Path) -> registry.Note:
    ((_, note),) = registry.running(folder)
    return note


@contextmanager
def owner(
    robot: str, port: str, connected: Callable[[], None] = lambda: None
) -> Iterator[subprocess.Popen[str]]:
    """A program that drives an arm and moves it; of motors with encoders once they are homed."""
    process = subprocess.Popen(
        [sys.executable, "-c", OWNER, robot, port], text=True, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    assert process.stdout is not None
    with process:
        try:
            connected()
            assert process.stdout.readline() == "moves\n"
            yield process
        finally:
            process.kill()


@pytest.fixture
def board() -> Iterator[BoardServer[SimulatedEncoderBoard]]:
    board = simulated_encoder_board(channel_settings(SCORBOT), SCORBOT.board_settings.axes)
    with BoardServer(board, MonotonicClock.now) as server:
        yield server


@pytest.fixture
def moving() -> Iterator[Link]:
    """An arm process of its own on the simulated board, whose arm moves for a while."""
    link = start_arm(ROBOT, name="test")
    try:
        set_off(link)
        yield link
    finally:
        link.close()


def set_off(link: Link) -> None:
    for command in (Connect("sim"), Enable(ROBOT.pose("home")), SetSpeed(0.05)):
        link.submit(command).result(10)
    link.submit(MoveJoints(AWAY)).accepted.result(10)
    until(lambda: link.snapshot.state is State.MOVING, "it moves")


def test_an_arm_that_would_drop_is_held_for_who_takes_it_over(
    folder: Path, board: BoardServer[SimulatedEncoderBoard]
) -> None:
    port = board.port

    def home() -> None:  # at once
        until(lambda: any(note.port == port for _, note in registry.running(folder)), "its port is noted")
        with board.inspect() as model:
            for axis in model.axes:
                axis.homed = True

    with owner("scorbot", port, home) as program, Host(SCORBOT) as second:
        ((address, note),) = registry.running(folder)
        with pytest.raises(PortError, match=rf"{port}: the arm process {note.pid} .*Scorbot.*Arm.connect"):
            second.submit(Connect(port)).result(10)
        with pytest.raises(BoardError, match="only an arm that was left can be taken over"):
            Link(LocalLine(address, note.secret, adopts=True))
        program.kill()
        until(lambda: the_only_one(folder).orphaned, "it is held")
        with pytest.raises(PortError, match=rf"the arm process {note.pid} .*take it over.*kill {note.pid}"):
            second.submit(Connect(port)).result(10)
    assert (folder / f"arm-{note.pid}.json").stat().st_mode & 0o777 == 0o600
    other = registry.likeness(load_robot("scorbot"), UNNUMBERED, 40.0, "")
    assert registry.orphans(folder, other, port) == []
    with Arm.open("scorbot", port) as arm:
        assert the_only_one(folder).pid == note.pid
        until(lambda: arm.snapshot.state is State.HOLDING, "it stands")
        assert any("library is gone without a word" in event.text for event in arm.snapshot.events)
        arm.enable()
        with board.inspect() as model:
            assert model.mode is Mode.ON
    assert list(folder.iterdir()) == []


def test_where_nothing_drops_the_arm_process_ends_with_its_program(folder: Path) -> None:
    with owner("uzuner", "sim") as program:
        assert the_only_one(folder).port == ""
        program.kill()
        until(lambda: not list(folder.iterdir()), "the arm process has ended")


def test_the_arm_process_is_of_our_session_but_not_of_our_group(folder: Path) -> None:
    """Ctrl-C at our terminal is not for it; and Linux shares the processors out session by session."""
    with closing(start_arm(ROBOT)):
        pid = the_only_one(folder).pid
        assert os.getsid(pid) == os.getsid(0)
        assert os.getpgid(pid) == pid != os.getpgid(0)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_signal_ends_the_arm_process_in_order(folder: Path, moving: Link, number: signal.Signals) -> None:
    os.kill(the_only_one(folder).pid, number)
    until(lambda: moving.ended, "the link knows")
    assert moving.snapshot.cause == (
        "the arm process ended, and STOP does not reach the arm; the simulated board is gone with it. "
        "Connect again"
    )
    assert list(folder.iterdir()) == []


HANGS = """
import threading
from armctl.runtime import dispatch

def hangs(*_):
    threading.Event().wait()

dispatch.checked_trajectory = hangs
"""


def test_an_arm_process_ends_though_a_plan_hangs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    (tmp_path / "sitecustomize.py").write_text(HANGS)
    monkeypatch.syspath_prepend(tmp_path)
    started: list[subprocess.Popen[bytes]] = []

    def noted(*args: Any) -> subprocess.Popen[bytes]:
        started.append(start_apart(*args))
        return started[0]

    monkeypatch.setattr("armctl.process.start.start_apart", noted)
    link = start_arm(ROBOT, name="test")
    for command in (Connect("sim"), Enable(HOME)):
        link.submit(command).result(10)
    link.submit(Follow(plan_joints(ROBOT, HOME, AWAY)))
    until(lambda: link.snapshot.busy, "it is being planned")
    os.kill(the_only_one(folder).pid, signal.SIGTERM)
    until(lambda: started[0].poll() is not None, "it has ended")
    assert started[0].returncode == 0
    link.close()


def test_a_killed_arm_process_is_told_and_refuses(folder: Path, moving: Link) -> None:
    os.kill(the_only_one(folder).pid, signal.SIGKILL)
    until(lambda: moving.snapshot.unreachable, "the link knows")
    assert moving.snapshot.state is State.FAULT
    assert "killed by signal 9" in moving.snapshot.cause
    for ticket in (moving.stop(), moving.submit(SetSpeed(1.0))):
        with pytest.raises(StateError, match="killed by signal 9"):
            ticket.result(20)
    assert list(folder.iterdir()) != []
    start_arm(ROBOT).close()
    assert list(folder.iterdir()) == []  # what a killed one leaves is swept


@pytest.fixture
def real_gap_of_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those that are started now stop as the product does where nothing ran for a while."""
    monkeypatch.setenv("ARMCTL_REAL_GAP", "1")


def test_a_frozen_arm_process_is_told_and_goes_on_by_holding(
    folder: Path, real_gap_of_processes: None, moving: Link
) -> None:
    pid = the_only_one(folder).pid
    os.kill(pid, signal.SIGSTOP)
    try:
        until(lambda: moving.snapshot.unreachable, "the link knows")
        assert "STOP does not reach the arm" in moving.snapshot.cause
        asked = moving.submit(MoveJoints(HOME))  # waits in the socket
    finally:
        os.kill(pid, signal.SIGCONT)
    until(lambda: not moving.snapshot.unreachable, "it answers again")
    until(lambda: moving.snapshot.state is State.HOLDING, "it holds")
    with pytest.raises(StateError, match=r"nothing ran for .* s before it could begin; ask for it again"):
        asked.result(20)
    assert np.abs(moving.snapshot.q_command - AWAY).max() > 0.5  # and did not go on


def test_a_frozen_program_stops_its_arm() -> None:
    """Without ``beats`` the link is silent, as that of a page server whose loop hangs."""
    link = start_arm(ROBOT, name="console", beats=False)
    try:
        set_off(link)
        until(lambda: link.snapshot.state is State.HOLDING, "it stands")
        assert np.abs(link.snapshot.q_command - AWAY).max() > 0.5  # its motion takes half a minute
        assert any("no sign of life" in event.text for event in link.snapshot.events)
    finally:
        link.close()

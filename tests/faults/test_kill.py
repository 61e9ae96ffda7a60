"""Either process is killed at random moments: files stay whole, the other one goes on in order."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from armctl.calibration import CalibrationStore
from armctl.documents import has_ended
from armctl.hardware.boards import channel_settings
from armctl.hardware.maestro.codec import Opcode, set_targets
from armctl.hardware.maestro.simulated import simulated_maestro
from armctl.hardware.simulation import BoardServer
from armctl.program import load_program
from armctl.protocol import MonotonicClock
from armctl.robot import load_robot

MOMENTS = 200 if os.environ.get("ARMCTL_LONG") else 2
ROBOT = load_robot("uzuner")
NOW = MonotonicClock.now
_SURVIVOR_S = 1.0
_CHANNELS = ROBOT.output_map.channels


class Killed:
    """A board that outlives everybody, and the program of ``killed_client.py`` that moves its arm."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environment = dict(os.environ, PYTHONUNBUFFERED="1")
        for name in ("STATE", "CONFIG", "DATA"):
            self.environment[f"XDG_{name}_HOME"] = str(folder / name.lower())
        self.environment["XDG_RUNTIME_DIR"] = str(folder / "run")
        (folder / "run").mkdir(mode=0o700)
        self.board = BoardServer(
            simulated_maestro(channels=channel_settings(ROBOT)), NOW, link=folder / "board"
        )
        self.client: subprocess.Popen[str] | None = None
        self.arm = ""
        self.before: dict[str, object] | None = None
        """the last pose on the disk when the program began"""

    def begin(self) -> None:
        """Start the program, and wait until its arm is there."""
        self.before = self.pose() if [*self.folder.glob("state/armctl/last-pose/*.json")] else None
        script = Path(__file__).with_name("killed_client.py")
        self.client = subprocess.Popen(
            [sys.executable, script, str(self.folder / "board"), str(self.folder)],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.environment,
        )  # fmt: skip
        self.arm = self.line("arm")[0]
        self.line("connected")

    def line(self, kind: str) -> list[str]:
        """The words of the next line of that kind."""
        assert self.client is not None and self.client.stdout is not None
        patience = threading.Timer(60.0, self.client.kill)  # else this would wait for ever
        patience.start()
        for line in self.client.stdout:
            if line.split()[0] == kind:
                patience.cancel()
                return line.split()[1:]
        patience.cancel()
        assert self.client.stderr is not None
        raise AssertionError(f"no {kind}: {self.client.stderr.read()}")

    def end(self) -> None:
        """Whatever still runs ends now."""
        if self.client is not None:
            self.client.kill()
            self.client.communicate()
            self.gone(self.arm)

    def gone(self, process: str) -> None:
        """Wait until a process has ended."""
        for _ in range(2000):
            if has_ended(process) or zombie(process):
                return
            threading.Event().wait(0.01)
        os.kill(int(process), signal.SIGKILL)
        raise AssertionError(f"process {process} goes on")

    def last_target(self) -> float:
        """When the board was told to move last [s]."""
        with self.board.inspect() as board:
            return max((one.time for one in board.log if one.opcode is Opcode.SET_TARGET), default=0.0)

    def where(self) -> np.ndarray:
        """Where the board holds the joints [rad]; NaN: off."""
        with self.board.inspect() as board:
            values = {channel: board.position_us(channel) for channel in _CHANNELS}
        return ROBOT.output_map.angles(values)

    def switch_off(self) -> None:
        with self.board.inspect() as board:
            board.feed(set_targets(dict.fromkeys((*_CHANNELS, 5), 0)))

    def pose(self) -> dict[str, object]:
        """The last pose on the disk; it is whole."""
        (path,) = (self.folder / "state" / "armctl" / "last-pose").glob("*.json")
        return json.loads(path.read_bytes())

    def assert_files_whole(self) -> None:
        if (path := self.folder / "program.toml").exists():
            program = load_program(path)
            assert len(program.steps) == 200
            assert len(set(program.steps)) == 1
        versions = CalibrationStore(self.folder / "config" / "armctl" / "calibrations").versions(
            "uzuner", "killed"
        )
        assert [one.problem for one in versions if one.problem] == []


def zombie(process: str) -> bool:
    """It has ended, and the one that started it has not asked yet."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return not Path(f"/proc/{process}").exists()


@pytest.fixture
def killed(tmp_path: Path) -> Iterator[Killed]:
    one = Killed(tmp_path)
    with one.board:
        try:
            yield one
        finally:
            one.end()


def assert_the_arm_is_left_in_order(killed: Killed, at: float) -> None:
    """The client is gone: the arm stops, holds, and its process ends and says so on the disk."""
    killed.gone(killed.arm)
    assert killed.last_target() - at <= _SURVIVOR_S
    stands = killed.where()
    if not np.isnan(stands).any():
        pose = killed.pose()
        # One that had not been enabled yet has seen nothing: what the one before has left stays.
        assert pose["ended"] in ("closed", "released") or pose == killed.before, pose
        if pose["ended"] == "closed":
            assert np.abs(np.degrees(stands) - np.array(pose["joints_deg"])).max() < 1.0


def assert_the_client_is_told(killed: Killed, at: float, how: str) -> None:
    """The arm process is gone: its link says so within a second, and the board holds."""
    words = killed.line("fault")
    assert float(words[0]) - at <= _SURVIVOR_S
    told = " ".join(words[1:])
    assert how in told, told
    assert "STOP does not reach the arm; the pulses stay as they were" in told
    assert told.endswith("Connect again")


def test_killed_at_random_moments(killed: Killed) -> None:
    chance = random.Random(13)
    ended: list[object] = []
    for moment in range(MOMENTS):
        if chance.random() < 0.3:
            killed.switch_off()
        killed.begin()
        threading.Event().wait(chance.uniform(0.0, 1.0) ** 2 * 4.0)
        at, wall = NOW(), time.time()
        if moment % 2:
            assert killed.client is not None
            killed.client.kill()
            assert_the_arm_is_left_in_order(killed, at)
        else:
            os.kill(int(killed.arm), signal.SIGKILL)
            assert_the_client_is_told(killed, wall, "the arm process ended (killed by signal 9)")
            assert killed.last_target() <= at + 0.1
            stands = killed.where()
            if (killed.folder / "state" / "armctl" / "last-pose").exists() and not np.isnan(stands).any():
                pose = killed.pose()
                ended.append(pose["ended"])
                if not pose["moving"]:  # the next start may be told that the arm stands there
                    assert np.abs(np.degrees(stands) - np.array(pose["joints_deg"])).max() < 1.0, pose
        killed.end()
        killed.assert_files_whole()
    assert set(ended) <= {"moving", "enabling", "", "closed", "released"}
    old = set((killed.folder / "run").rglob("arm-*"))
    killed.begin()  # and still it starts
    assert not [path for path in old if path.exists()]
    killed.line("moving")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_program_that_is_ended_leaves_its_arm_in_order(killed: Killed, number: int) -> None:
    killed.begin()
    killed.line("moving")
    at = NOW()
    assert killed.client is not None
    killed.client.send_signal(number)
    assert_the_arm_is_left_in_order(killed, at)
    assert killed.pose()["ended"] == "closed"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_an_arm_process_that_is_told_to_end_stops_first(killed: Killed, number: int) -> None:
    killed.begin()
    killed.line("moving")
    at = time.time()
    os.kill(int(killed.arm), number)
    assert_the_client_is_told(killed, at, "the arm process")
    assert killed.pose()["ended"] == "closed"
    assert np.abs(np.degrees(killed.where()) - np.array(killed.pose()["joints_deg"])).max() < 1.0

"""The last pose is on disk when it is needed, and a disk that takes nothing disturbs no motion."""

from __future__ import annotations

import json
import threading
from pathlib import Path

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, TEST, TICK, Rig, fails, make_rig

from armctl.errors import BoardError
from armctl.facts import State
from armctl.hardware import BoardIdentity
from armctl.protocol import (
    Connect,
    Disconnect,
    Enable,
    Jog,
    MoveGripper,
    MoveJoints,
    Pause,
    Release,
    Resume,
)
from armctl.runtime import PoseFolder, last_pose

HOME = ROBOT.pose("home")


def opened(folder: Path, serial: str | None = "A1", simulated: bool = False) -> Rig:
    """A controller as a program starts it, connected to a board."""
    rig = make_rig(poses=PoseFolder(folder, ROBOT))
    identity = BoardIdentity("board", "/dev/ttyACM0", serial, simulated)
    rig.driver.open = lambda: identity  # type: ignore[method-assign]
    rig.do(Connect("/dev/ttyACM0")).result(0)
    return rig


def held(folder: Path) -> Rig:
    rig = opened(folder)
    rig.finishes(Enable(HOME, 0.25))
    return rig


def ended(rig: Rig) -> None:
    """What was handed to the writer is on the disk, though the program was not closed."""
    rig.controller._core.poses._folder.close()


def written(folder: Path) -> list[dict[str, object]]:
    return [json.loads(path.read_bytes()) for path in sorted(folder.glob("*.json"))]


@pytest.mark.parametrize("end", ["closed", "disconnected", "released", "fault", "", "moving"])
def test_the_next_start_knows_where_the_arm_was_and_how_it_ended(tmp_path: Path, end: str) -> None:
    rig = held(tmp_path)
    assert rig.now.last_pose is not None
    match end:
        case "closed":
            rig.controller.close()
        case "disconnected":
            rig.do(Disconnect())
        case "released":
            rig.do(Release())
        case "fault":
            rig.driver.fail["read"] = BoardError("unplugged")
            rig.tick()
            assert rig.now.state is State.FAULT
        case "moving":
            rig.run(6)
            rig.do(MoveJoints(HOME + 0.2, duration_s=20))
            rig.run(11)
    ended(rig)
    last = opened(tmp_path).now.last_pose
    assert (last.ended, last.gripper, last.moving) == (end, 0.25, end == "moving")
    if end == "moving":
        assert np.abs(last.q - rig.now.q_command).max() < 0.5 * 0.2 / 20 * 3  # half a second old at most
    else:
        np.testing.assert_allclose(last.q, HOME, atol=1e-6)
    assert abs(last.at - rig.now.events[-1].stamp) < 60


def test_it_reads_as_a_sentence(tmp_path: Path) -> None:
    rig = held(tmp_path)
    rig.driver.fail["read"] = BoardError("unplugged")
    rig.tick()
    ended(rig)
    again = opened(tmp_path)
    assert str(again.now.last_pose).startswith("last seen at 0.0, 90.0, −80.0, −40.0, 0.0° on 20")
    assert str(again.now.last_pose).endswith("; then a fault ended it")
    again.refuses(
        Enable(), r"nobody knows where the arm is \(last seen at .* fault ended it\): pulses are off"
    )


def test_the_same_board_again_keeps_what_is_known(tmp_path: Path) -> None:
    rig = held(tmp_path)
    rig.do(Release())
    rig.do(Disconnect())
    rig.do(Connect("/dev/ttyACM0"))
    assert rig.now.last_pose.ended == "released"


def test_each_arm_and_board_has_its_own(tmp_path: Path) -> None:
    ended(held(tmp_path))
    assert opened(tmp_path, "B2").now.last_pose is None
    assert opened(tmp_path, None).now.last_pose is None
    (record,) = written(tmp_path)
    assert (record["robot"], record["board"]) == ("uzuner", "A1")


def test_of_a_simulated_board_nothing_is_kept(tmp_path: Path) -> None:
    rig = opened(tmp_path, None, simulated=True)
    rig.finishes(Enable())
    rig.controller.close()
    assert rig.now.last_pose is None
    assert list(tmp_path.iterdir()) == []


def test_it_is_written_rarely(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    saved: list[float] = []
    save = PoseFolder.save
    monkeypatch.setattr(PoseFolder, "save", lambda *args: (saved.append(rig.clock.now()), save(*args))[1])
    rig = opened(tmp_path)
    rig.finishes(Enable(HOME))
    assert len(saved) == 2  # as its servos come on, and once they are on
    for _ in range(round(12 / TICK)):  # led to and fro for 12 s
        rig.do(Jog(np.array([0.2 if rig.clock.now() % 2 < 1 else -0.2, 0, 0, 0, 0])))
    assert np.diff(saved[3:]) == pytest.approx(0.5, abs=1.5 * TICK)
    rig.rests()
    count = len(saved)
    assert count in (27, 28)  # as it began, twice a second, at its end
    rig.run(20)
    assert len(saved) == count


class SlowDisk:
    """A disk that takes what is written when it is told to."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.goes_on = threading.Event()
        self.goes_on.set()
        write = last_pose.write_atomically

        def written(*args: object, **options: object) -> None:
            assert self.goes_on.wait(20.0)
            write(*args, **options)

        monkeypatch.setattr(last_pose, "write_atomically", written)


def test_no_setpoint_goes_out_before_the_disk_says_that_the_arm_moves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = SlowDisk(monkeypatch)
    rig = held(tmp_path)
    for begin in (
        lambda: rig.do(MoveJoints(HOME + 0.1)),
        lambda: rig.do(Jog(np.array([1.0, 0, 0, 0, 0]))),
        lambda: rig.do(MoveGripper(0.8)),
    ):
        rig.rests()
        rig.run(2.0)
        folder, rig.poses = rig.poses, None
        disk.goes_on.clear()
        begin()
        rig.sends_nothing(0.5)
        assert json.loads(next(tmp_path.glob("*.json")).read_bytes())["moving"] is False
        disk.goes_on.set()
        assert folder is not None and folder.wait(20.0)
        assert json.loads(next(tmp_path.glob("*.json")).read_bytes())["moving"] is True
        count = len(rig.driver.writes)
        begin()
        rig.run(0.1)
        assert len(rig.driver.writes) > count
        rig.poses = folder
        rig.run(3.0)


def test_a_paused_arm_stands_and_goes_on_only_once_the_disk_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = SlowDisk(monkeypatch)
    rig = held(tmp_path)
    rig.do(MoveJoints(HOME + 0.2, duration_s=5))
    rig.run(1.0)
    rig.do(Pause())
    rig.until(lambda snapshot: snapshot.state is State.PAUSED)
    rig.tick()
    assert (rig.now.last_pose.moving, rig.now.last_pose.q.tolist()) == (False, rig.now.q_command.tolist())
    rig.poses = None
    disk.goes_on.clear()
    rig.do(Resume())
    rig.sends_nothing(0.5)
    disk.goes_on.set()


def test_a_stop_does_not_wait_for_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = SlowDisk(monkeypatch)
    rig = held(tmp_path)
    rig.poses = None
    disk.goes_on.clear()
    moving = rig.do(MoveJoints(HOME + 0.1))
    rig.run(0.2)
    assert rig.now.state is State.MOVING
    rig.controller.stop(TEST)
    rig.tick()
    assert rig.now.state is State.HOLDING
    fails(moving.finished, "was stopped by test")
    disk.goes_on.set()


def test_a_disk_that_hangs_keeps_no_motion_for_longer_than_a_second(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = SlowDisk(monkeypatch)
    rig = held(tmp_path)
    rig.poses = None
    disk.goes_on.clear()
    rig.do(MoveJoints(HOME + 0.1))
    rig.sends_nothing(0.9)
    rig.rests()
    np.testing.assert_allclose(rig.now.q_command, HOME + 0.1)
    disk.goes_on.set()


@pytest.mark.parametrize("end", ["released", "fault"])
def test_what_ends_a_motion_in_the_middle_leaves_an_arm_that_was_moving(tmp_path: Path, end: str) -> None:
    rig = held(tmp_path)
    rig.do(MoveJoints(HOME + 0.2, duration_s=5))
    rig.run(1.0)
    if end == "released":
        rig.do(Release())
    else:
        rig.driver.fail["write"] = BoardError("unplugged")
        rig.tick()
    rig.run(1.0)
    ended(rig)
    last = opened(tmp_path).now.last_pose
    assert (last.ended, last.moving) == (end, True)
    assert "while it was moving, so it may stand elsewhere; then" in str(last)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{}",
        b"\xff\xfe",
        b"[" * 10_000,
        b" " * 20_000,
        b'{"robot":"uzuner","board":"A1","joints_deg":[0,0],"gripper":null,"at":0,"ended":""}',
        b'{"robot":"uzuner","board":"A1","joints_deg":[0,900,0,0,0],"gripper":null,"at":0,"ended":""}',
        b'{"robot":"uzuner","board":"A1","joints_deg":[0,1e999,0,0,0],"gripper":null,"at":0,"ended":""}',
        b'{"robot":"abaas","board":"A1","joints_deg":[0,90,0,0,0],"gripper":null,"at":0,"ended":""}',
        b'{"robot":"uzuner","board":"A1","joints_deg":[0,90,0,0,0],"gripper":null,"at":1e300,"ended":""}',
    ],
)
def test_a_file_that_makes_no_sense_is_no_pose(tmp_path: Path, content: bytes) -> None:
    ended(held(tmp_path))
    (path,) = tmp_path.glob("*.json")
    path.write_bytes(content)
    rig = opened(tmp_path)
    assert (rig.now.state, rig.now.last_pose) == (State.OFF, None)


def test_a_disk_that_takes_nothing_is_a_warning_and_no_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("armctl.runtime.last_pose.write_atomically", full)
        rig = held(tmp_path)
        folder = rig.controller._core.poses._folder
        ended(rig)
        rig.run(0.1)
        assert any("cannot be kept" in text and "No space left" in text for text in rig.now.warnings)
        rig.finishes(MoveJoints(HOME + 0.1))
    assert folder.problem is not None
    assert rig.now.last_pose is not None  # this program knows it all the same
    assert opened(tmp_path).now.last_pose is None


def test_a_disk_that_becomes_full_leaves_no_old_pose(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    rig = held(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr("armctl.runtime.last_pose.write_atomically", full)
        rig.finishes(MoveJoints(HOME + 0.1))
        ended(rig)
    assert opened(tmp_path).now.last_pose is None  # the arm stood there before it moved
    ended(held(tmp_path))
    assert opened(tmp_path).now.last_pose is not None


def test_a_program_that_is_killed_while_servos_come_on_leaves_where_they_went(tmp_path: Path) -> None:
    held(tmp_path).controller.close()
    rig = opened(tmp_path)
    rest = ROBOT.pose("rest")
    rig.driver.positions.clear()
    rig.do(Enable(rest, 0.5))
    rig.tick()
    assert len(rig.driver.writes) == 1  # the first servo is on
    ended(rig)
    last = opened(tmp_path).now.last_pose
    assert (last.ended, last.moving, last.q.tolist()) == ("enabling", True, pytest.approx(rest.tolist()))

"""The black box: what it holds of the last minute, when it is saved, and what is wrong with a bad file."""

from __future__ import annotations

import csv
import io
import json
import os
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.runtime.board_bench import BoardBench
from tests.runtime.kit import MIDDLE, ROBOT, TICK, Rig, make_rig, swings

from armctl.errors import BoardError, BoardTimeoutError, InputError
from armctl.facts import State
from armctl.hardware import Readback, Source
from armctl.hardware.boards import channel_settings
from armctl.hardware.maestro.driver import MaestroDriver
from armctl.hardware.maestro.simulated import SimulatedMaestro, simulated_maestro
from armctl.hardware.transport import Connection
from armctl.kinematics import Target
from armctl.program import Program
from armctl.protocol import (
    Connect,
    Enable,
    Jog,
    MoveJoints,
    MoveTo,
    Origin,
    Recording,
    RunProgram,
    read_recording,
    saved_recordings,
)
from armctl.protocol.recording import ticks_csv
from armctl.runtime.black_box import save_recording

REST, HOME = ROBOT.pose("rest"), ROBOT.pose("home")


def faulty(folder: Path) -> Rig:
    """An arm that has lost its board on the way to home; its controller is closed, so that all is saved."""
    rig = make_rig(black_boxes=folder).enable()
    rig.do(MoveJoints(HOME))
    rig.run(0.5)
    rig.driver.fail["write"] = BoardError("the cable is out")
    rig.tick()
    assert rig.now.state is State.FAULT
    rig.controller.close()
    return rig


def states(recording: Recording) -> list[str]:
    return [recording.states[int(state)] for state in recording.column("state")]


def test_a_fault_of_the_simulated_board_saves_what_led_there(tmp_path: Path) -> None:
    """The USB cable comes out in mid-motion."""
    board = simulated_maestro(channels=channel_settings(ROBOT))
    bench: BoardBench[SimulatedMaestro] = BoardBench.of(
        ROBOT,
        board,
        lambda line, _now: MaestroDriver(Connection(line, lambda: 0.0, simulated=True)),
        tmp_path,
    )
    bench.do(Connect("sim"))
    bench.do(Enable())
    bench.until(State.HOLDING)
    ticket = bench.do(MoveJoints(HOME))
    before = bench.run(0.3)
    assert before.state is State.MOVING
    bench.line.unplug()
    at = bench.until(State.FAULT)
    bench.controller.close()
    (path,) = saved_recordings(tmp_path)
    recording = read_recording(path)
    assert recording.why == f"fault: {at.cause}"
    move = recording.commands[-1]
    assert (move.who, move.what) == ("test", "MoveJoints q (0°, 90°, -80°, -40°, 0°), profile 'cubic'")
    assert move.answer in str(ticket.finished.exception(0))
    assert move.answered_s == pytest.approx(at.stamp, abs=1e-9)
    assert states(recording)[-3:] == ["moving", "moving", "fault"]
    assert recording.time_s[-1] == at.stamp
    here = np.flatnonzero(recording.time_s == before.stamp)[0]
    assert np.array_equal(recording.setpoint[here], before.q_command)
    assert np.array_equal(recording.readback[here], before.q)
    assert not np.isnan(recording.setpoint[-2]).any() and np.isnan(recording.setpoint[-1]).all()
    assert [line.text for line in recording.lines] == [event.text for event in at.events]
    assert recording.lines[-1].level == "error"
    assert recording.board.startswith("simulated Pololu")


def test_the_log_says_where_it_is_saved_and_when_it_cannot_be(tmp_path: Path) -> None:
    where, blocked = tmp_path / "saved", tmp_path / "blocked"
    blocked.write_text("no folder")
    for folder, told in ((where, "the last minute before the fault is in"), (blocked, "cannot be saved")):
        rig = faulty(folder)
        rig.controller.tick()
        texts = [event.text for event in rig.now.events if "last minute" in event.text]
        assert len(texts) == 1 and told in texts[0] and str(folder) in texts[0]
    assert len(saved_recordings(where)) == 1


def test_a_full_disk_leaves_no_half_file_and_the_arm_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    rig = make_rig(black_boxes=tmp_path).enable()
    broken = BoardTimeoutError("no answer")
    rig.driver.fail["write"] = broken
    rig.do(MoveJoints(HOME))
    rig.until(lambda s: s.state is State.FAULT)
    rig.controller._black_box.close()
    rig.driver.fail.clear()
    for command in (Connect("sim"), Enable()):
        rig.do(command).result(0)
    rig.finishes(MoveJoints(HOME))
    assert any("No space left on device" in text for text in rig.texts)
    assert list(tmp_path.iterdir()) == []


def test_who_asked_for_what_and_how_it_was_answered(holding: Rig) -> None:
    holding.refuses(Enable(REST), "enable needs the arm off")
    holding.do(MoveTo(Target.of([0.22, -0.196, 0.085], pitch=-0.5)))
    holding.controller.stop(Origin("page", "the operator's page is gone"))
    holding.rests()
    holding.do(RunProgram(Program(robot="uzuner", name="swing", steps=tuple(swings(0, 0.1)))))
    holding.controller.submit("nonsense", Origin("stranger" * 1000))  # type: ignore[arg-type]
    holding.tick()
    *_, enable, move, stop, run, nonsense = holding.controller.black_box().commands
    assert enable.answer.startswith("enable needs the arm off")
    assert move.what.startswith(
        "MoveTo target (220.0, -196.0, 85.0) mm pitch -28.6°, choose 'least-rotation'"
    )
    assert "was stopped by page" in move.answer
    assert (stop.who, stop.what) == ("page", "STOP: the operator's page is gone")
    assert [one.command for one in (enable, move, stop, run)] == ["Enable", "MoveTo", "STOP", "RunProgram"]
    assert run.what == "RunProgram program 'swing' with 1 step, loops 1, first 0"
    assert (run.answer, run.answered_s) == ("", None)
    assert (nonsense.what, len(nonsense.who)) == ("str", 400)
    assert "not a command" in nonsense.answer


def test_what_a_board_measures_is_kept_as_numbers(rig: Rig) -> None:
    back = Readback({}, Source.MEASURED, load={0: -0.25}, temperature={0: 41.5, 1: None}, voltage={1: 7.5})
    rig.driver.read = lambda: back  # type: ignore[method-assign]
    rig.do(Connect("sim")).result(0)
    rig.run(0.2)
    base, shoulder, *_ = ROBOT.joint_names
    recording = rig.controller.black_box()
    last = {name: recording.column(name)[-1] for name in recording.columns}
    assert (last[f"load {base}"], last[f"temperature_c {base}"]) == (-0.25, 41.5)
    assert last[f"voltage_v {shoulder}"] == 7.5
    assert np.isnan(
        [last[f"temperature_c {shoulder}"], last[f"current_a {base}"], last[f"load {shoulder}"]]
    ).all()


def test_what_a_gripper_measures_is_kept_too_and_all_of_it_becomes_a_table(rig: Rig) -> None:
    assert ROBOT.gripper is not None and ROBOT.outputs.gripper_channel is not None
    back = Readback({}, Source.MEASURED, temperature={ROBOT.outputs.gripper_channel: 44.0})
    rig.driver.read = lambda: back  # type: ignore[method-assign]
    rig.do(Connect("sim")).result(0)
    rig.run(0.2)
    recording = rig.controller.black_box()
    assert recording.column("temperature_c gripper")[-1] == 44.0
    head, *lines = csv.reader(io.StringIO(ticks_csv(recording)))
    assert tuple(head) == recording.columns and len(lines) == len(recording.ticks)
    told = dict(zip(head, lines[-1], strict=True))
    assert float(told["time_s"]) == pytest.approx(recording.time_s[-1])
    assert (told["temperature_c gripper"], told["load gripper"]) == ("44", "")


def test_a_minute_and_no_more_however_long_it_runs(holding: Rig) -> None:
    for _ in range(2):
        holding.do(Jog(np.array([0.1, 0, 0, 0, 0])))
        holding.run(35)
    recording = holding.controller.black_box()
    assert recording.clock_s - recording.time_s[0] == pytest.approx(60, abs=TICK)
    assert len(recording.ticks) == pytest.approx(60 / TICK, abs=2)
    assert len(recording.commands) == 1
    assert min(line.time_s for line in recording.lines) >= recording.clock_s - 60
    assert recording.ticks.nbytes < 1e6


def test_commands_that_bring_ticks_forward_take_no_time_from_it(holding: Rig) -> None:
    holding.run(1)
    first = holding.clock.now()
    for _ in range(5000):  # a client that floods: a tick each millisecond
        holding.tick(0.001)
    recording = holding.controller.black_box()
    assert recording.time_s[0] < first
    assert len(recording.ticks) < (2 * 5 + 1) / TICK + 10
    assert np.diff(recording.time_s).min() >= 0.5 * TICK - 1e-9


def test_lateness_warnings_and_gaps(holding: Rig) -> None:
    holding.do(MoveJoints(MIDDLE))
    holding.run(0.1)
    holding.tick(0.3)
    recording = holding.controller.black_box()
    assert recording.column("late_s")[-1] == pytest.approx(0.28)
    assert np.abs(recording.column("late_s")[:-1]).max() < 1e-9
    assert recording.warnings[-1].texts == holding.now.warnings != ()
    holding.run(10)
    assert holding.controller.black_box().warnings[-1].texts == ()


def test_a_jump_of_the_wall_clock_moves_nothing(holding: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    holding.run(1)
    before = holding.controller.black_box()
    monkeypatch.setattr("armctl.runtime.black_box.wall_time", lambda: time.time() - 3 * 365 * 86400)
    holding.run(1)
    after = holding.controller.black_box()
    assert np.array_equal(after.time_s[: len(before.ticks)], before.time_s)
    assert np.diff(after.time_s) == pytest.approx(TICK)
    assert (before.wall(before.clock_s) - after.wall(after.clock_s)).days == pytest.approx(3 * 365, abs=1)
    assert after.wall(after.clock_s).utcoffset() is not None


def test_faults_in_a_row_are_saved_together_and_old_files_go(tmp_path: Path) -> None:
    rig = make_rig(black_boxes=tmp_path).enable()
    for _ in range(50):  # a program that clears faults as fast as they come
        rig.driver.fail["write"] = BoardError("loose contact")
        rig.do(MoveJoints(HOME))
        rig.until(lambda s: s.state is State.FAULT)
        rig.driver.fail.clear()
        for command in (Connect("sim"), Enable()):
            rig.do(command).result(0)
    rig.controller.close()
    assert 1 <= len(saved_recordings(tmp_path)) <= 2
    recording = rig.controller.black_box()
    for number in range(30):
        (tmp_path / f"fault-20200101-0000{number:02d}-uzuner-1.zip").touch()
        (tmp_path / f"fault-20990101-0000{number:02d}-uzuner-1.zip").touch()  # from before the clock was set
    path = save_recording(recording, tmp_path)
    assert path.exists() and len(saved_recordings(tmp_path)) == 20


@pytest.mark.logs_a_defect
def test_a_defect_of_its_own_does_not_touch_the_arm(holding: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(holding.controller._black_box, "tick", lambda _: 1 / 0)
    holding.finishes(MoveJoints(MIDDLE))
    assert np.allclose(holding.now.q_command, MIDDLE)


def rewritten(path: Path, change: Callable[[dict[str, bytes]], None]) -> Path:
    with zipfile.ZipFile(path) as archive:
        found = {name: archive.read(name) for name in archive.namelist()}
    change(found)
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in found.items():
            archive.writestr(name, content)
    return path


def story(**changes: object) -> Callable[[dict[str, bytes]], None]:
    def change(found: dict[str, bytes]) -> None:
        found["black_box.json"] = json.dumps(json.loads(found["black_box.json"]) | changes).encode()

    return change


def ticks(made: Callable[[np.ndarray], np.ndarray]) -> Callable[[dict[str, bytes]], None]:
    def change(found: dict[str, bytes]) -> None:
        packed = io.BytesIO()
        np.save(packed, made(np.load(io.BytesIO(found["ticks.npy"]))))
        found["ticks.npy"] = packed.getvalue()

    return change


def claims(found: dict[str, bytes]) -> None:
    """A header that claims terabytes."""
    found["ticks.npy"] = found["ticks.npy"].replace(b"(", b"(9", 1).replace(b"}  ", b"} ", 1)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda found: found.pop("ticks.npy"), "there is no ticks.npy in it"),
        (lambda found: found.update({"black_box.json": b"{"}), "black_box.json: "),
        (lambda found: found.update({"ticks.npy": b"x" * 100}), "ticks.npy: "),
        (lambda found: found.update({"ticks.npy": bytes(17 << 20)}), "larger than 16 MiB"),
        (claims, "must be float64"),
        (story(period_s=0), r"period_s"),
        (story(wall_s=1e300), r"wall_s"),
        (story(format=2), "another version"),
        (story(titles=[]), "another version"),
        (story(columns=["time_s"]), "another version"),
        (story(states=["off"]), "a state is none"),
        (ticks(lambda rows: rows[::-1]), "do not ascend"),
        (ticks(lambda rows: rows[:, 1:]), "must be float64"),
        (ticks(lambda rows: rows.astype(np.float32)), "must be float64"),
        (ticks(lambda rows: rows[:0]), "no tick"),
        (ticks(lambda rows: rows * np.nan), "do not ascend"),
    ],
)
def test_a_bad_file_is_refused_in_words(
    tmp_path: Path, change: Callable[[dict[str, bytes]], None], told: str
) -> None:
    rig = make_rig().enable()
    rig.run(1)
    path = rewritten(save_recording(rig.controller.black_box(), tmp_path), change)
    with pytest.raises(InputError, match=told) as refusal:
        read_recording(path)
    assert str(refusal.value).startswith(f"{path}: ")


def test_what_is_no_zip_file(tmp_path: Path) -> None:
    path = tmp_path / "a.zip"
    path.write_bytes(b"PK not really")
    with pytest.raises(InputError, match="is no black box and no report"):
        read_recording(path)

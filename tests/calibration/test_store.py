"""Keeping calibrations: whole or not at all, every version, by any serial number, by several at once."""

from __future__ import annotations

import math
import multiprocessing
import os
from pathlib import Path

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from tests.calibration.kit import calibration

from armctl.calibration import (
    Calibration,
    CalibrationStore,
    JointCalibration,
    decode_calibration,
    encode_calibration,
    read_calibration,
)
from armctl.calibration.record import VERSIONS_KEPT
from armctl.errors import CalibrationError

BOARD = "00123456"


@pytest.fixture
def store(tmp_path: Path) -> CalibrationStore:
    return CalibrationStore(tmp_path / "deep" / "calibrations")


def zero_of(found: Calibration | None) -> float | None:
    return None if found is None else found.joints["elbow"].zero


def test_nothing_is_there_before_something_is_saved(store: CalibrationStore) -> None:
    assert store.load("uzuner", BOARD) is None
    assert store.versions("uzuner", BOARD) == () and store.boards() == ()
    assert not store.folder.exists()
    with pytest.raises(CalibrationError, match="uzuner on board 00123456 was never calibrated"):
        store.revert("uzuner", BOARD)


def test_what_is_saved_is_loaded_by_any_other_store(store: CalibrationStore) -> None:
    version = store.save(calibration(note="new horn"))
    again = CalibrationStore(store.folder)
    assert again.load("uzuner", BOARD) == calibration(note="new horn")
    assert (version.number, version.note, version.made) == (1, "new horn", "2025-03-01T12:00:00+01:00")
    assert again.load("uzuner", "other") is None and again.load("abaas", BOARD) is None
    assert [(one.robot, one.board) for one in again.boards()] == [("uzuner", BOARD)]


def test_reverting_goes_further_back_each_time_and_loses_nothing(store: CalibrationStore) -> None:
    for zero in (1501.0, 1502.0, 1503.0):
        store.save(calibration(zero))
    assert store.revert("uzuner", BOARD).number == 4
    assert zero_of(store.load("uzuner", BOARD)) == 1502.0
    store.revert("uzuner", BOARD)
    assert zero_of(store.load("uzuner", BOARD)) == 1501.0
    with pytest.raises(CalibrationError, match="no version before version 1"):
        store.revert("uzuner", BOARD)
    assert store.revert("uzuner", BOARD, 3).again == 3
    assert zero_of(store.load("uzuner", BOARD)) == 1503.0
    with pytest.raises(CalibrationError, match="there is no version 9; kept are 6, 5, 4, 3, 2, 1"):
        store.revert("uzuner", BOARD, 9)
    assert [zero_of(one.calibration) for one in store.versions("uzuner", BOARD)] == [
        1503.0, 1501.0, 1502.0, 1503.0, 1502.0, 1501.0,
    ]  # fmt: skip


def test_forgetting_goes_by_the_robot_file_and_can_be_undone(store: CalibrationStore) -> None:
    store.save(calibration())
    version = store.forget("uzuner", BOARD, "2025-03-02T00:00:00+00:00")
    assert version.calibration is None and version.problem is None
    assert store.load("uzuner", BOARD) is None
    store.revert("uzuner", BOARD)
    assert store.load("uzuner", BOARD) == calibration()
    store.revert("uzuner", BOARD, version.number)
    assert store.load("uzuner", BOARD) is None


def test_a_broken_file_is_named_kept_and_can_be_gone_back_from(store: CalibrationStore) -> None:
    store.save(calibration(1501.0))
    broken = store.save(calibration(1502.0)).path
    broken.write_text(broken.read_text().replace("per_deg", "per_dog"))
    with pytest.raises(CalibrationError, match=f"{broken}: .*per_dog.*armctl calibrate revert uzuner"):
        store.load("uzuner", BOARD)
    newest, older = store.versions("uzuner", BOARD)
    assert newest.calibration is None and newest.problem is not None and str(broken) in newest.problem
    assert store.boards()[0].problem is not None and store.boards()[0].board == BOARD
    with pytest.raises(CalibrationError, match="version 2 cannot be brought back"):
        store.revert("uzuner", BOARD, 2)
    store.revert("uzuner", BOARD)
    assert store.load("uzuner", BOARD) == older.calibration
    for i in range(VERSIONS_KEPT + 3):
        store.save(calibration(1600.0 + i))
    assert broken.exists()


def test_old_versions_are_thinned_out(store: CalibrationStore) -> None:
    for i in range(VERSIONS_KEPT + 5):
        store.save(calibration(1500.0 + i))
    versions = store.versions("uzuner", BOARD)
    assert len(versions) == VERSIONS_KEPT
    assert versions[0].number == VERSIONS_KEPT + 5 and zero_of(versions[0].calibration) == 1554.0


@pytest.mark.parametrize("call", ["replace", "fsync"])
def test_a_save_that_fails_leaves_what_was_there(
    store: CalibrationStore, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    store.save(calibration(1501.0))

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(*((Path, "replace") if call == "replace" else (os, "fsync")), full)
        with pytest.raises(CalibrationError, match=r"not saved; .*: No space left on device; free some"):
            store.save(calibration(1502.0))
    assert zero_of(store.load("uzuner", BOARD)) == 1501.0
    assert len([path for path in store.folder.rglob("*") if path.is_file()]) == 1
    assert store.save(calibration(1503.0)).number == 2


def test_what_a_crash_left_behind_is_passed_over(store: CalibrationStore) -> None:
    place = store.save(calibration(1501.0)).path.parent
    (place / ".000002.toml.abc.new").write_text("half a fi")
    (place / ".000002.claim").touch()
    assert zero_of(store.load("uzuner", BOARD)) == 1501.0
    assert store.save(calibration(1502.0)).number == 3
    assert zero_of(store.load("uzuner", BOARD)) == 1502.0


def _save_many(folder: str, first: int, count: int) -> None:
    store = CalibrationStore(Path(folder))
    for i in range(first, first + count):
        store.save(calibration(float(i)))


def test_two_processes_at_once_lose_nothing(store: CalibrationStore) -> None:
    start = multiprocessing.get_context("spawn")
    others = [start.Process(target=_save_many, args=(str(store.folder), first, 20)) for first in (1000, 2000)]
    for other in others:
        other.start()
    for other in others:
        other.join(60)
        assert other.exitcode == 0
    versions = store.versions("uzuner", BOARD)
    assert {zero_of(one.calibration) for one in versions} == {
        float(first + i) for first in (1000, 2000) for i in range(20)
    }
    assert len({one.number for one in versions}) == 40


odd = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=300)


@given(odd, odd)
@example("ABC", "abc")
def test_any_serial_number_has_a_place_of_its_own(
    tmp_path_factory: pytest.TempPathFactory, one: str, other: str
) -> None:
    store = CalibrationStore(tmp_path_factory.mktemp("store"))
    here = store.save(calibration(1501.0, board=one)).path.parent.name
    if other != one:
        assert store.load("uzuner", other) is None
        there = store.save(calibration(1502.0, board=other)).path.parent.name
        assert there.casefold() != here.casefold()
        assert zero_of(store.load("uzuner", other)) == 1502.0
    assert store.load("uzuner", one) == calibration(1501.0, board=one)
    for path in store.folder.rglob("*"):
        assert path.resolve().is_relative_to(store.folder.resolve()) and len(path.name) <= 60
        assert path.name.isascii() and path.name.casefold() not in ("con", "nul", "aux")


def test_a_calibration_in_the_wrong_folder_is_refused(store: CalibrationStore) -> None:
    here = store.save(calibration(board="here")).path
    there = store.save(calibration(board="there")).path
    there.write_bytes(here.read_bytes())
    with pytest.raises(CalibrationError, match="is of uzuner on board here, not of uzuner on board there"):
        store.load("uzuner", "there")


numbers = st.floats(-1e6, 1e6)
joints = st.builds(
    JointCalibration,
    zero=numbers,
    per_rad=st.floats(0.06, 1e5) | st.floats(-1e5, -0.06),
    low=st.floats(-1e6, -1.0),
    high=st.floats(0.0, 1e6),
)


@given(
    st.dictionaries(odd, joints, max_size=4),
    st.none() | st.tuples(st.floats(-1e6, 0), st.floats(1, 1e6)),
    st.text(st.characters(exclude_categories=["Cs"])),
)
def test_the_file_gives_back_what_was_written(
    joints: dict[str, JointCalibration], gripper: tuple[float, float] | None, note: str
) -> None:
    written = Calibration("uzuner", BOARD, "counts", joints, gripper, "2025-03-01", note)
    read = decode_calibration(encode_calibration(written))
    assert (read.robot, read.board, read.unit, read.note) == ("uzuner", BOARD, "counts", note)
    assert read.gripper == gripper and list(read.joints) == list(joints)
    for name, joint in joints.items():
        assert read.joints[name].per_rad == pytest.approx(joint.per_rad, rel=1e-15)
        assert msgspec.structs.replace(read.joints[name], per_rad=joint.per_rad) == joint


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("zero = 1500.0", "zero = nan", "key joints.elbow.zero: nan is no number"),
        ("low = 700.0", "low = 2400.0", "joints.elbow: low = 2400 and high = 2300 µs"),
        ("closed = 1100.0", "closed = 1900.0", "closed and open are both 1900"),
        ('unit = "µs"', "unit = 5", "unit"),
        ("format = 1", "format = 2", "format"),
        ("format = 1", 'format = 1\ncolour = "red"', "colour"),
        ('board = "00123456"', 'board = ""', "board"),
        ("zero = 1500.0", 'zero = "1500"', "key joints.*zero: must be a number"),
        ("[gripper]", "[gripper", r"line \d+, column \d+: expected"),
    ],
)
def test_a_file_that_is_wrong_says_where(tmp_path: Path, old: str, new: str, says: str) -> None:
    text = encode_calibration(calibration())
    assert old in text
    path = tmp_path / "wrong.toml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CalibrationError, match=f"{path}: .*({says})"):
        read_calibration(path)


def test_a_scale_of_nothing_and_text_that_is_none_are_not_saved(store: CalibrationStore) -> None:
    for per_rad in (0.0, -1e-9, math.degrees(0.0009)):
        dead = {"elbow": JointCalibration(1500.0, per_rad, 700.0, 2300.0)}
        with pytest.raises(CalibrationError, match=r"joints\.elbow\.per_deg = \S+: the joint would not move"):
            store.save(msgspec.structs.replace(calibration(), joints=dead))
    with pytest.raises(CalibrationError, match="text that is none"):
        store.save(calibration(board="\ud800"))
    assert store.boards() == ()

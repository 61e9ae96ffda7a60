"""Touches over a restart: the file in which they are kept, and what is refused of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armctl.calibration import (
    Calibration,
    CalibrationStore,
    KeptTouches,
    TouchedPoint,
    TouchesFile,
    TouchSheet,
)
from armctl.errors import CalibrationError
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
SHEET = TouchSheet(
    "Uzuner", "letter", np.array([(-0.05, 0.1, 0.0), (0.05, -0.1, 0.0)]), np.array((0.17, 0, 0))
)
ON_PAPER = TouchedPoint({i: 1500.25 + i for i in range(5)}, (-0.05, 0.1, 0.08), 1, (1.0, -1.0, 0.0, 1.0, 1.0))
MEASURED = TouchedPoint(
    {i: 1400.0 for i in range(5)}, (0.05, -0.1, 0.0), 2, measured=True, sent={i: 1401.5 for i in range(5)}
)


@pytest.fixture
def file(tmp_path: Path) -> TouchesFile:
    return TouchesFile(CalibrationStore(tmp_path), ROBOT, "77")


def changed(file: TouchesFile, old: str, new: str) -> None:
    text = file.path.read_text()
    assert old in text
    file.path.write_text(text.replace(old, new))


def test_what_is_kept_is_what_was_touched(file: TouchesFile) -> None:
    assert file.load() is None
    made = "2026-01-01T10:00:00+00:00"
    kept = KeptTouches(
        (ON_PAPER, MEASURED), SHEET, 0.08, 0.25, frozenset({2}), (0.012, 0.0015), used=1, made=made
    )
    file.save(kept)
    found = file.load()
    assert found is not None and found.sheet is not None
    for one, before in zip(found.touches, kept.touches, strict=True):
        assert one.point_m == pytest.approx(before.point_m)
        assert one.outputs == before.outputs and one.sent == before.sent
        assert (one.number, one.sense, one.measured) == (before.number, before.sense, before.measured)
    np.testing.assert_allclose(found.sheet.points_m, SHEET.points_m, atol=1e-12)
    np.testing.assert_allclose(found.sheet.place_m, SHEET.place_m, atol=1e-12)
    assert (found.sheet.paper, found.sheet.title) == ("letter", ROBOT.title)
    assert (found.block_m, found.load_kg, found.skipped) == (pytest.approx(0.08), 0.25, {2})
    assert found.corrected == pytest.approx(kept.corrected) and (found.used, found.made) == (1, made)

    file.save(KeptTouches((TouchedPoint(ON_PAPER.outputs, (0.2, 0.0, 0.1)),)))  # places in the base frame
    found = file.load()
    assert found is not None and found.sheet is None and found.corrected is None
    file.save(KeptTouches(()))
    assert not file.path.exists() and file.load() is None


def test_they_lie_beside_the_calibration_and_are_none_of_its_versions(
    file: TouchesFile, tmp_path: Path
) -> None:
    store = CalibrationStore(tmp_path)
    file.save(KeptTouches((ON_PAPER,), SHEET))
    assert store.load("uzuner", "77") is None and store.boards() == ()
    saved = store.save(Calibration("uzuner", "77", "µs", {}, (1100.0, 1900.0)))
    assert saved.number == 1 and saved.path.parent == file.path.parent
    assert TouchesFile(store, ROBOT, "78").load() is None


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ('robot = "uzuner"', 'robot = "abaas"', "is of abaas on board 77"),
        ("used = 1", "used = 3", "used = 3, and it has 2 touches"),
        ("crosshair = 2", "crosshair = 3", "touch 2: crosshair = 3; its sheet has 2"),
        ("crosshair = 2\n", "", "touch 2: crosshair = none"),
        ("0 = 1400.0", "9 = 1400.0", "touch 2, outputs: of the channels 9"),
        ("1500.25", "nan", "outputs.0"),
        ("0 = 1401.5\n", "", "touch 2, sent: of the channels 1"),
        ("load_kg = 0.25", "load_kg = -1.0", "load_kg"),
        ("block_mm", "block_cm", "block_cm"),
    ],
)
def test_a_file_that_is_not_of_this_arm_or_was_spoiled_is_refused_by_its_name(
    file: TouchesFile, old: str, new: str, why: str
) -> None:
    file.save(KeptTouches((ON_PAPER, MEASURED), SHEET, 0.08, 0.25, corrected=(0.01, 0.001), used=1))
    changed(file, old, new)
    with pytest.raises(CalibrationError, match=why) as refused:
        file.load()
    assert str(file.path) in str(refused.value)


def test_where_nothing_can_be_written_it_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    file = TouchesFile(CalibrationStore(tmp_path / "file"), ROBOT, "77")
    with pytest.raises(CalibrationError, match="would not survive a restart"):
        file.save(KeptTouches((ON_PAPER,), SHEET))

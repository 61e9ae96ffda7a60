"""The sheet of crosshairs: what is printed is where the fit takes the points to be."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from armctl.arrays import FloatArray
from armctl.calibration import PAPERS_MM, Paper, Touches, TouchSheet, fit_touches, reachable_at, touch_sheet
from armctl.cli.sheet import sheet as command
from armctl.errors import CalibrationError
from armctl.robot import load_robot

POINT_MM = 25.4 / 72
NEAR_MM = 0.05
Lines = list[tuple[float, float, float, float]]


def crosses(lines: Lines) -> FloatArray:
    """(k, 2) the middles of a line across and a line up that halve each other."""
    across = [
        ((a + c) / 2, b) for a, b, c, d in lines if b == d and abs(c - a) == pytest.approx(12, abs=0.05)
    ]
    up = [(a, (b + d) / 2) for a, b, c, d in lines if a == c and abs(d - b) == pytest.approx(12, abs=0.05)]
    return np.array([one for one in across if min(np.hypot(one[0] - x, one[1] - y) for x, y in up) < NEAR_MM])


def bars(lines: Lines) -> list[float]:
    return [abs(c - a) for a, b, c, d in lines if b == d and abs(c - a) > 50]


def svg_lines(text: str) -> tuple[Lines, float, float]:
    """Lines from the lower left corner [mm], and the size."""
    root = ET.fromstring(text)
    width, depth = (float(root.attrib[key].removesuffix("mm")) for key in ("width", "height"))
    assert [float(one) for one in root.attrib["viewBox"].split()] == [0, 0, width, depth]
    found: Lines = []
    for one in root.iter("{http://www.w3.org/2000/svg}line"):
        x1, y1, x2, y2 = (float(one.attrib[key]) for key in ("x1", "y1", "x2", "y2"))
        found.append((x1, round(depth - y1, 4), x2, round(depth - y2, 4)))
    return found, width, depth


def pdf_lines(content: bytes) -> tuple[Lines, float, float]:
    text = content.decode("latin-1")
    for number, place in enumerate(re.findall(r"^(\d{10}) 00000 n", text, re.M), 1):
        assert text[int(place) :].startswith(f"{number} 0 obj")
    width, depth = (float(one) * POINT_MM for one in re.findall(r"MediaBox \[0 0 (\S+) (\S+)\]", text)[0])
    (scale,) = re.findall(r"^(\S+) 0 0 \1 0 0 cm", text, re.M)
    per = float(scale) * POINT_MM
    drawn = re.findall(r"^\S+ w (\S+) (\S+) m (\S+) (\S+) l S", text, re.M)
    found = [(per * float(a), per * float(b), per * float(c), per * float(d)) for a, b, c, d in drawn]
    return found, width, depth


@pytest.mark.parametrize("name", ["so101", "uzuner"])
@pytest.mark.parametrize("paper", PAPERS_MM)
def test_what_is_printed_is_where_the_points_are(name: str, paper: Paper) -> None:
    sheet = touch_sheet(load_robot(name), paper)
    width, depth = PAPERS_MM[paper]
    x, y = 1000 * sheet.points_m[:, 0], 1000 * sheet.points_m[:, 1]
    places = np.column_stack([width / 2 - y, depth / 2 + x])
    for lines, *size in (svg_lines(sheet.svg()), pdf_lines(sheet.pdf())):
        assert size == pytest.approx([width, depth], abs=NEAR_MM)
        assert crosses(lines) == pytest.approx(places, abs=NEAR_MM)
        assert bars(lines) == pytest.approx([100.0], abs=NEAR_MM)
    assert (places > 10).all() and (places < np.array([width, depth]) - 10).all()
    expected = [str(i + 1) for i in range(len(places))]
    assert re.findall(r">(\d+)</text>", sheet.svg()) == expected
    assert re.findall(r"\((\d+)\) Tj", sheet.pdf().decode("latin-1")) == expected


@cache
def sheet_of(name: str) -> TouchSheet:
    return touch_sheet(load_robot(name))


@pytest.mark.parametrize(("name", "height_mm"), [("mearm", 60), ("eezybotarm_mk2", 80), ("uarm", 0)])
def test_an_arm_whose_hand_stays_level_gets_a_sheet_that_lies_higher(name: str, height_mm: int) -> None:
    robot, sheet = load_robot(name), sheet_of(name)
    assert 1000 * sheet.height_m == pytest.approx(height_mm)
    assert sheet.place_m[2] == pytest.approx(robot.floor_z + sheet.height_m)
    assert len(sheet.points_m) >= 10
    for point in sheet.laid_m:
        assert robot.inverse(point).success
    assert (f"{height_mm} mm high" in sheet.svg()) is (height_mm > 0)


def test_a_mearm_is_corrected_by_its_sheet() -> None:
    robot, rng = load_robot("mearm"), np.random.default_rng(1)
    off = np.radians([1.0, 2.5, -3.0])
    sheet = sheet_of("mearm")
    above = np.array([(x, y, 0.03) for x, y, _ in sheet.points_m[::3]])  # a block on some of them
    points = np.vstack([sheet.points_m, above])
    found = [robot.inverse(point + sheet.place_m + rng.normal(0.0, 0.0005, 3)) for point in points]
    there = [bool(one.success) for one in found]
    q = np.array([one.q[0] for one in found if one.success]) - off
    fit = fit_touches(robot, Touches.checked(robot, q, points[there], "sheet"))
    assert fit.correct and fit.after.rms < 0.0015 and fit.before.rms > 2 * fit.after.rms


def test_an_arm_that_reaches_no_paper_at_any_height_gets_none() -> None:
    robot = load_robot("uzuner")
    still = replace(robot, joints=tuple(replace(one, lower=1.5, upper=1.55) for one in robot.joints))
    with pytest.raises(
        CalibrationError, match="reaches 0 points of a sheet that lies on the floor"
    ) as refused:
        touch_sheet(still)
    assert "up to 200 mm above it" in str(refused.value) and "the top of a block" in str(refused.value)


def test_the_command_writes_the_sheet_and_prints_its_places(tmp_path: Path) -> None:
    out = tmp_path / "sheet.svg"
    result = CliRunner().invoke(command, ["uzuner", "--paper", "letter", "--out", str(out)])
    assert result.exit_code == 0, result.output
    points = touch_sheet(load_robot("uzuner"), "letter").points_m
    told = [[float(one) for one in row] for row in re.findall(r"x +(\S+) +y +(\S+) +z +(\S+)", result.output)]
    assert np.array(told) / 1000 == pytest.approx(points)
    assert out.read_text(encoding="utf-8").startswith("<svg")
    refused = CliRunner().invoke(command, ["uzuner", "--out", str(tmp_path / "sheet.png")])
    assert isinstance(refused.exception, CalibrationError) and ".svg or .pdf" in str(refused.exception)


@pytest.mark.parametrize("name", ["so101", "uzuner", "koch"])
def test_an_arm_whose_zeros_are_off_touches_no_part_of_itself_where_it_is_sent_to_touch(name: str) -> None:
    robot, chance = load_robot(name), np.random.default_rng(7)
    paper = touch_sheet(robot, "a4")
    touches = reachable_at(robot, paper.points_m, paper.laid_m, "sheet")
    assert len(np.unique(touches.points_m, axis=0)) >= min(10, len(paper.points_m))
    for _ in range(8):
        off = np.radians(chance.uniform(-2.0, 2.0, touches.q.shape))
        assert robot.collision.gaps(robot.body_frames(touches.q + off)).min() > 0.0

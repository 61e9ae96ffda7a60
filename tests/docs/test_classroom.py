"""The exercises of the lessons: right answers pass, wrong ones are told with a hint, open ones are open."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.calibration.touch_kit import touched, worn

from armctl.calibration import fit_touches, read_touches, touch_errors, touches_csv
from armctl.robot import load_robot

FOLDER = Path(__file__).parents[2] / "examples" / "classroom"
FORWARD = """
    a, b, c = np.cumsum(np.radians([shoulder_deg, elbow_deg, wrist_deg]))
    links = 146.05 * np.exp(1j * a) + 187.325 * np.exp(1j * b) + 100 * np.exp(1j * c)
    return links.real, 67.31 + links.imag
"""
INVERSE = """
    bend = np.arccos((x_mm**2 + y_mm**2 - UPPER_MM**2 - FORE_MM**2) / (2 * UPPER_MM * FORE_MM))
    ways = []
    for second in (bend, -bend):
        beyond = np.arctan2(FORE_MM * np.sin(second), UPPER_MM + FORE_MM * np.cos(second))
        ways.append((np.degrees(np.arctan2(y_mm, x_mm) - beyond), np.degrees(second)))
    return ways
"""
RIGHT = {
    "lesson_1": ["(330.0, 3.6, 163.0)", "'shoulder'", "33.6", FORWARD],
    "lesson_2": ["2", "142.5", "322", "(180, 0, 60)", INVERSE],
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A student's copy of the lessons."""
    return Path(shutil.copytree(FOLDER, tmp_path / "classroom"))


def run(script: Path, *arguments: str | Path) -> tuple[int, list[str]]:
    """Exit status and lines of a lesson."""
    done = subprocess.run(
        [sys.executable, script, *arguments], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.stderr == ""
    return done.returncode, done.stdout.splitlines()


def answer(script: Path, answers: list[str]) -> None:
    """Fill answers in, as a student would."""
    text = script.read_text()
    for one in answers:
        if one.startswith("\n"):
            text = text.replace('    raise NotImplementedError("write this function")\n', one[1:])
        else:
            text = re.sub(r"(?m)^([A-Z_]+) = \.\.\.$", rf"\1 = {one}", text, count=1)
    script.write_text(text)


@pytest.mark.parametrize("lesson", RIGHT)
def test_right_answers_are_right(folder: Path, lesson: str) -> None:
    answer(folder / f"{lesson}.py", RIGHT[lesson])
    status, lines = run(folder / f"{lesson}.py")
    count = len(RIGHT[lesson])
    assert lines == [*(f"{k}. right" for k in range(1, count + 1)), f"{count} of {count} are right."]
    assert status == 0


@pytest.mark.parametrize("lesson", RIGHT)
def test_wrong_answers_have_a_hint_and_no_answer_is_open(folder: Path, lesson: str) -> None:
    answer(folder / f"{lesson}.py", ["(1, 2, 3)", "12.5", "10"])
    status, lines = run(folder / f"{lesson}.py")
    assert [bool(re.fullmatch(r"\d\. not yet\. .{20,}", line)) for line in lines[:3]] == [True] * 3
    assert lines[3:-1] == [f"{k}. open" for k in range(4, len(RIGHT[lesson]) + 1)]
    assert (status, lines[-1]) == (1, f"0 of {len(RIGHT[lesson])} are right.")


def test_a_program_is_looked_at(folder: Path) -> None:
    example = (FOLDER.parent / "pick_and_place.toml").read_text()
    good = folder / "good.toml"
    good.write_text(example.replace("x_mm = 180", "x_mm = 200").replace("y_mm = 120", "y_mm = 80"))
    assert run(folder / "lesson_3.py", good) == (
        0,
        [*(f"{k}. right" for k in range(1, 6)), "5 of 5 are right."],
    )

    status, lines = run(folder / "lesson_3.py", FOLDER.parent / "pick_and_place.toml")  # to another place
    assert (status, lines[2][:10], lines[-1]) == (1, "3. not yet", "4 of 5 are right.")

    broken = folder / "broken.toml"
    broken.write_text(example.replace("z_mm = 90", "z_mm = 2000"))
    status, lines = run(folder / "lesson_3.py", broken)
    assert status == 1 and lines[0].startswith("1. not yet. ") and "step 3" in lines[0]
    assert lines[1] == "2. open"


def points(path: Path, seed: int) -> Path:
    """Ten touches of a worn arm, as the page writes them."""
    robot = load_robot("uzuner")
    plant, sheet, rng = worn(robot, seed, 1.5, encoders=False)
    path.write_text(touches_csv(touched(plant, robot, sheet, rng, (0.0, 0.08), 10), robot))
    return path


def test_touched_points_are_looked_at_and_the_arms_of_a_class_are_ranked(folder: Path) -> None:
    script, mine = folder / "lesson_4.py", points(folder / "anna.csv", 3)
    status, lines = run(script, mine)
    assert (status, lines[-1]) == (1, "0 of 5 are right.")
    robot = load_robot("uzuner")
    touches = read_touches(mine, robot, "sheet")
    fit = fit_touches(robot, touches)
    worst = int(np.argmax(np.linalg.norm(touch_errors(robot, touches), axis=1))) + 1
    before, after = (f"{1000 * size.rms:.1f}" for size in (fit.before, fit.after))
    blamed = getattr(fit.causes[0], "part")  # noqa: B009
    wrong = folder / "wrong.py"
    wrong.write_text(script.read_text())
    root = "\n    return (sum(one * one for one in distances) / len(distances)) ** 0.5\n"
    answer(script, [before, after, repr(blamed), str(worst), root])
    status, lines = run(script, mine)
    assert lines == [*(f"{k}. right" for k in range(1, 6)), "5 of 5 are right."] and status == 0
    answer(wrong, ["99", "98", "'Hand'", "11"])
    status, lines = run(wrong, mine)
    assert [bool(re.fullmatch(r"\d\. not yet\. .{20,}", line)) for line in lines[:4]] == [True] * 4
    empty = folder / "cem.csv"
    empty.write_text("x_mm\n")
    status, lines = run(script, mine, points(folder / "ben.csv", 4), empty)
    assert status == 0 and lines[0].startswith("cem: ")
    left = [float(re.findall(r"(\d+\.\d) mm", line)[0]) for line in lines[1:]]
    assert left == sorted(left) and {line.split(":")[0][3:] for line in lines[1:]} == {"anna", "ben"}

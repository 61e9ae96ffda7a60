"""Each example runs on the simulated board, and prints what it promises."""

from __future__ import annotations

import re
import runpy
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.architecture.toy_board import installed
from tests.arms import quick_arms

EXAMPLES = Path(__file__).parents[2] / "examples"
PRINTS = {
    "01_hello_arm.py": r"tool at x 200\.0, y 0\.0, z 100\.0 mm",
    "02_all_solutions.py": r"[\d,]{5,} solutions on \d branches: front elbow-down, front elbow-up",
    "03_least_energy.py": r"least-torque loads the servos \d\d% less",
    "04_jog.py": r"base turned by \d+\.\d°\ntool raised by \d+\.\d mm",
    "05_line_and_arc.py": r"tool at x 220\.0, y -60\.0, z 100\.0 mm",
    "06_published_arc.py": r"solutions  RMSE x 0\.00\d+ y 0\.00\d+",
    "07_pick_from_conveyor.py": r"^placed; tool at x 221\.4, y 160\.9, z 243\.0 mm",
    "08_program_from_csv.py": r"0 errors\nsaved: square\.toml",
    "09_calibrate.py": r"before: the tool misses by \d\d?\.\d mm\nafter: the tool misses by [01]\.\d mm",
    "10_own_robot.py": r"complete list of solutions: yes\n(?s:.*)joints at the cup",
    "11_own_criterion.py": r"spare_the_wrist: wrist joint \d+ mm high",
    "12_own_board.py": r"board: Toy board\nmeasured \[°\]: 30\.0 45\.0",
    "15_draw_a_name.py": r"^0 strokes are left out;(?s:.*)within 0\.0\d mm (?s:.*) lifted at z = 40",
    "13_measured_against_commanded.py": r"the positions are measured\nWaist +largest error \d\.\d\d°",
    "16_palletise.py": (
        r"^checked: 0 errors, 24 parts in \d+ s\nstep \d: .*\(path: step 1: cell \d+\)\n"
        r"two placed; tool at x 180, y 70, z 120 mm$"
    ),
    "17_pick_from_tray.py": (
        r"^checked: 0 errors, 6 parts in \d+ s\nasks: Put a full tray on the table\n"
        r"says: The tray is empty; tool at x 180, y 100, z 120 mm$"
    ),
    "18_in_a_frame.py": (
        r"^table at \(180, −60, 60\) mm(?s:.*)where it was: 0 errors; moved: 0 errors\nstep 2: too far by"
        r"(?s:.*)ends at x 180\.0, y -40\.0, z 100\.0 mm\n"
        r"(?s:.*)first corner again: \[180\.0, -40\.0, 120\.0\]$"
    ),
    "19_two_tools.py": (
        r"^the tip of the pen is 40 mm from that of the jaws\nchecked: 0 errors, \d+ s\n"
        r"asks: Put the pen on; on is jaws\non is pen, its tip lifted at z = 40 mm$"
    ),
    "14_button_and_lamp.py": r"^pressed\nlamp 1\nlet go: lamp 0$",
}


@pytest.fixture(autouse=True)
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A folder to write into, arms that are quick, and figures without a window."""
    from matplotlib import pyplot as plt  # a second, for who runs these

    monkeypatch.chdir(tmp_path)
    quick_arms(tmp_path, monkeypatch)
    plt.switch_backend("agg")
    yield
    plt.close("all")


def test_each_is_listed_and_tried() -> None:
    scripts = {path.name for path in EXAMPLES.glob("*.py")}
    assert scripts == set(PRINTS)
    listed = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert [path.name for path in EXAMPLES.glob("*.*") if f"]({path.name})" not in listed] == ["README.md"]


@pytest.mark.parametrize("name", PRINTS)
def test_it_runs(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with installed(tmp_path):  # as pip would install the package of example 12
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    printed = capsys.readouterr().out
    assert re.search(PRINTS[name], printed, re.MULTILINE), printed
    for picture in re.findall(r"^drawn: (\S+)$", printed, re.MULTILINE):
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")

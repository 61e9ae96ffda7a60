"""How large the rooms of the house, its files and its functions may be.

A file tells one story in at most 450 lines, a function fits on a screen. To raise a number here, say in the
commit what a user got for it.
"""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import armctl

SOURCES = Path(armctl.__file__).parent
MOST_LINES, MOST_OF_A_FUNCTION = 450, 60
FOLDERS = {
    ".": (
        18,
        3_715,
    ),  # points in a user frame; lazy_dataclass; Enable on a busy computer
    "calibration": (13, 3_060),  # touched points as a file and over a restart, the tool point
    "cli": (15, 3_200),
    "drawing": (15, 2_600),  # text is written, as outlines of its letters
    "facts": (20, 4_335),  # who stopped, why a command, a servo or a touch is refused: as data, in Turkish
    "hardware": (75, 15_640),  # telemetry in one pass; pins of the encoder board, scripts for inputs, buses
    "kinematics": (51, 13_050),  # the workspace as a shell
    "motion": (21, 6_080),  # from one side; a tick samples its path in a third of the time
    "process": (15, 3_430),  # snapshots in a third of the time; who comes as it dies is served
    "program": (
        24,
        5_490,
    ),  # pictures of steps, what a form folds away; grids; calls, pick and place, messages, user frames
    "protocol": (5, 1_260),  # what a line of the log is about
    "robot": (44, 12_180),  # tools of a URDF arm; gaps of hulls in two thirds of the time
    "runtime": (26, 6_630),  # joints let down, messages, which warnings a cause tells, tools; a jog rests
    "ui": (
        111,
        25_720,
    ),  # the view takes in a ghost that stands outside; a program that runs is followed; steps edited
}
"""files and lines, at most"""
_HOW = "make it smaller, or raise its number in test_budgets.py and say in the commit what a user got for it"


def sources() -> dict[str, str]:
    """Every file of the source, by its place."""
    files = sorted(SOURCES.rglob("*.py"))
    return {file.relative_to(SOURCES).as_posix(): file.read_text(encoding="utf-8") for file in files}


def test_no_room_grows_unseen() -> None:
    files, lines = Counter[str](), Counter[str]()
    for place, text in sources().items():
        folder, slash, _ = place.partition("/")
        files[folder if slash else "."] += 1
        lines[folder if slash else "."] += text.count("\n")
    assert set(files) == set(FOLDERS), "a new room needs a budget"
    for folder, (most_files, most_lines) in FOLDERS.items():
        size = f"{folder} has {files[folder]} files and {lines[folder]} lines"
        assert files[folder] <= most_files and lines[folder] <= most_lines, f"{size}: {_HOW}"


def test_a_file_tells_one_story() -> None:
    for place, text in sources().items():
        size = text.count("\n")
        assert size <= MOST_LINES, f"{place} has {size} lines: {_HOW}"


def test_a_function_fits_on_a_screen() -> None:
    for place, text in sources().items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno is not None:
                size = node.end_lineno - node.lineno + 1
                assert size <= MOST_OF_A_FUNCTION, f"{place} {node.name} has {size} lines; {_HOW}"

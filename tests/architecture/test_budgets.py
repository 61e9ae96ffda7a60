"""How large the rooms of the house, its files and its functions may be.

A file tells one story in at most 450 lines, a function fits on a screen. To raise a number here, say in the
commit what a user got for it; what is listed as larger may only shrink.
"""

from __future__ import annotations

import ast
from collections import Counter
from pathlib import Path

import armctl

SOURCES = Path(armctl.__file__).parent
MOST_LINES, MOST_OF_A_FUNCTION = 450, 60
FOLDERS = {
    ".": (15, 3_120),
    "calibration": (5, 1_320),
    "cli": (12, 2_500),
    "facts": (5, 1_170),
    "hardware": (31, 7_920),
    "kinematics": (51, 12_720),
    "motion": (20, 5_750),
    "process": (14, 3_350),
    "program": (10, 2_500),
    "protocol": (6, 1_130),
    "robot": (40, 11_260),
    "runtime": (24, 5_660),
    "ui": (81, 15_050),
}
"""files and lines, at most"""
LARGER_FILES = {
    "arm.py": 615,
    "process/link.py": 535,
    "process/records.py": 505,
    "program/csv.py": 490,
    "program/steps.py": 590,
    "runtime/core.py": 760,
    "ui/session.py": 465,
    "ui/tabs/forward/screen.py": 500,
    "ui/tabs/inverse/answer.py": 485,
    "ui/tabs/inverse/screen.py": 595,
    "ui/tabs/main/own_arm.py": 470,
    "ui/tabs/trajectory/screen.py": 500,
}
LARGER_FUNCTIONS = {
    "cli/serve.py serve": 77,
    "process/server.py serve_arm": 61,
    "runtime/dispatch.py _carry_out": 73,
    "ui/guard/server.py guarded_server": 75,
    "ui/tabs/main/own_arm.py __init__": 62,
}
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
    sizes = {place: text.count("\n") for place, text in sources().items()}
    for place, size in sizes.items():
        assert size <= LARGER_FILES.get(place, MOST_LINES), f"{place} has {size} lines: {_HOW}"
    needless = [place for place in LARGER_FILES if sizes.get(place, 0) <= MOST_LINES]
    assert not needless, f"these are no longer large: {needless}"


def test_a_function_fits_on_a_screen() -> None:
    found: dict[str, int] = {}
    for place, text in sources().items():
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and node.end_lineno is not None:
                size = node.end_lineno - node.lineno + 1
                if size > MOST_OF_A_FUNCTION:
                    found[f"{place} {node.name}"] = max(size, found.get(f"{place} {node.name}", 0))
    for function, size in found.items():
        assert size <= LARGER_FUNCTIONS.get(function, MOST_OF_A_FUNCTION), f"{function}: {size} lines; {_HOW}"
    needless = set(LARGER_FUNCTIONS) - set(found)
    assert not needless, f"these are no longer large: {needless}"

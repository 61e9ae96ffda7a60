"""A package that brings a board, as somebody else would install it: a module and an entry point."""

from __future__ import annotations

import importlib
import re
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from armctl.hardware.boards import GROUP, board_types
from armctl.robot import robots_folder

PACKAGE = "toyboard"
SOURCE = Path(__file__).parents[2] / "examples" / "extending" / "board.py"


@contextmanager
def toy_board(folder: Path) -> Iterator[Path]:
    """Install the toy board in ``folder`` while the context is open.

    Yields:
        a robot file of an arm that it drives: the Uzuner arm, with steps in place of pulses.
    """
    with installed(folder):
        yield robot_file(folder / "toy_arm.toml")


@contextmanager
def installed(folder: Path) -> Iterator[None]:
    """As ``toy_board``, without an arm."""
    install(folder, PACKAGE, f"toy = {PACKAGE}:ToyBoard")
    shutil.copy(SOURCE, folder / f"{PACKAGE}.py")
    sys.path.insert(0, str(folder))
    forget()
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        sys.modules.pop(PACKAGE, None)
        forget()


def install(folder: Path, package: str, entry: str) -> None:
    """Write what pip would leave behind of a package with an entry point."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{GROUP}]\n{entry}\n")


def forget() -> None:
    """Let the registry be read anew, as in a program that has just started."""
    importlib.invalidate_caches()
    board_types.cache_clear()


def robot_file(path: Path) -> Path:
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    text = re.sub(r"\[board\]\nkind = .*\n", "", text).replace("pulse_us", "range_steps")
    text = text.replace("_us =", "_steps =").replace("us_per_deg", "steps_per_deg")
    text = text.replace('name = "uzuner"', 'name = "toy_arm"', 1)
    path.write_text(text + '\n[board]\nkind = "toy"\n', encoding="utf-8")
    return path

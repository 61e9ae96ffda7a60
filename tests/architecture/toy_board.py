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
SHOULDER = "channel = 1, zero_steps = 781.795, steps_per_deg = 10, range_steps = [749, 2251]"
OTHER_SIDE = "channel = 11, zero_steps = 3218, steps_per_deg = -10, range_steps = [1749, 3251]"
TOY = f"toy = {PACKAGE}:ToyBoard"
ABLE = Path(__file__).with_name("able_board.py")


@contextmanager
def toy_board(folder: Path) -> Iterator[Path]:
    """Install the toy board in ``folder`` while the context is open.

    Yields:
        a robot file of an arm that it drives: the Uzuner arm, with steps in place of pulses.
    """
    with installed(folder):
        yield robot_file(folder / "toy_arm.toml")


@contextmanager
def able_board(folder: Path) -> Iterator[Path]:
    """As ``toy_board``, of a board with more abilities; its shoulder has two servos, one on each side."""
    with installed(folder, ABLE, f"able = {PACKAGE}:AbleBoard"):
        path = robot_file(folder / "able_arm.toml", "able")
        text = path.read_text(encoding="utf-8")
        assert SHOULDER in text
        path.write_text(text.replace(SHOULDER, f"{SHOULDER}, also = [{{ {OTHER_SIDE} }}]"), encoding="utf-8")
        yield path


@contextmanager
def installed(
    folder: Path, source: Path = SOURCE, entry: str = f"toy = {PACKAGE}:ToyBoard"
) -> Iterator[None]:
    """As ``toy_board``, without an arm."""
    install(folder, PACKAGE, entry)
    shutil.copy(source, folder / f"{PACKAGE}.py")
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


def robot_file(path: Path, kind: str = "toy") -> Path:
    text = (robots_folder() / "uzuner.toml").read_text(encoding="utf-8")
    text = re.sub(r"\[board\]\nkind = .*\n", "", text).replace("pulse_us", "range_steps")
    text = text.replace("_us =", "_steps =").replace("us_per_deg", "steps_per_deg")
    text = text.replace('name = "uzuner"', f'name = "{path.stem}"', 1)
    path.write_text(text + f'\n[board]\nkind = "{kind}"\n', encoding="utf-8")
    return path

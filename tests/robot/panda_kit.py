"""A robot file of an arm of seven joints."""

from __future__ import annotations

import functools
import tempfile
from pathlib import Path

from armctl.robot import Robot, load_robot

_ROWS = (
    (0, 0, 333), (0, -90, 0), (0, 90, 316), (82.5, 90, 0), (-82.5, -90, 384), (0, 90, 0), (88, 90, 107),
)  # fmt: skip
_LIMITS = ((-166, 166), (-101, 101), (-166, 166), (-176, -4), (-166, 166), (-1, 215), (-166, 166))


def panda_file(folder: Path) -> Path:
    """The arm's Denavit-Hartenberg rows as its maker gives them."""
    rows = "\n".join(
        f'    {{ a_mm = {a}, alpha_deg = {alpha}, d_mm = {d}, joint = "joint{i}" }},'
        for i, (a, alpha, d) in enumerate(_ROWS, 1)
    )
    joints = "\n".join(
        f'[[joints]]\nname = "joint{i}"\ntitle = "Joint {i}"\nlimit_deg = [{low}, {high}]\n'
        "speed_deg_s = 150\nacceleration_deg_s2 = 600\n"
        for i, (low, high) in enumerate(_LIMITS, 1)
    )
    file = folder / "seven.toml"
    file.write_text(
        'format = 1\nname = "seven"\ntitle = "Seven joints"\n\n[dh]\nconvention = "modified"\n'
        f"rows = [\n{rows}\n]\n\n{joints}\n[poses]\nhome = [0, -20, 0, -120, 0, 100, 40]\n"
        "rest = [0, -40, 0, -140, 0, 100, 40]\nzero = [0, 0, 0, -90, 0, 90, 0]\n"
    )
    return file


@functools.cache
def panda() -> Robot:
    """The arm itself."""
    with tempfile.TemporaryDirectory() as folder:
        return load_robot(panda_file(Path(folder)))

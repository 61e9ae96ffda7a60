"""An installed package brings its robot files with it."""

from __future__ import annotations

import tomllib
from pathlib import Path

from armctl.robot import robots_folder

ROOT = Path(__file__).parents[2]


def test_the_wheel_takes_the_robots_along() -> None:
    """Building one needs the network for its backend, so what the backend is told is read instead."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]
    assert wheel["force-include"] == {"robots": "armctl/robots"}
    assert sorted(path.suffix for path in (ROOT / "robots").iterdir()) == [".toml"] * len(
        list((ROOT / "robots").iterdir())
    )


def test_a_checkout_finds_them_beside_src() -> None:
    assert robots_folder() == ROOT / "robots"

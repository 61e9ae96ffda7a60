"""The pictures of README and docs show the tabs of today, and are small."""

from __future__ import annotations

from difflib import unified_diff

import pytest
from docs.pictures import FILM, FILM_TABS, FOLDER, PICTURES, carried, outline_of
from PIL import Image
from tests.ui.page_outline import outlines

SHOWN = {f"{name}.png": (picture.shows, picture.tabs_of) for name, picture in PICTURES.items()}
SHOWN |= {f"{FILM}.webp": (FILM_TABS, "uzuner")}
_LARGEST_KB, _LARGEST_FILM_KB = 200, 2000


@pytest.fixture(scope="module")
def tabs() -> dict[str, dict[str, str]]:
    """By arm."""
    return {robot: outlines(robot) for robot in {robot for _, robot in SHOWN.values()}}


@pytest.mark.parametrize("file", SHOWN)
def test_a_picture_is_not_older_than_what_it_shows(file: str, tabs: dict[str, dict[str, str]]) -> None:
    shows, robot = SHOWN[file]
    then, now = carried(FOLDER / file).splitlines(), outline_of(shows, tabs[robot]).splitlines()
    changed = "\n".join(unified_diff(then, now, file, "the page", n=0, lineterm=""))
    assert not changed, f"record it anew: make pictures ARGS={file.partition('.')[0]}\n{changed}"


@pytest.mark.parametrize("file", SHOWN)
def test_a_picture_is_small(file: str) -> None:
    most = _LARGEST_FILM_KB if file == f"{FILM}.webp" else _LARGEST_KB
    assert (FOLDER / file).stat().st_size <= 1000 * most


def test_the_first_picture_moves() -> None:
    with Image.open(FOLDER / f"{FILM}.webp") as film:
        assert getattr(film, "n_frames", 1) > 20


def test_every_picture_is_made_by_a_script() -> None:
    assert {path.name for path in FOLDER.iterdir() if path.suffix != ".svg"} == set(SHOWN)

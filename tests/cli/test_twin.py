"""``armctl twin``: a program becomes a page, or a line that says why not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from armctl.cli.main import DONE, REFUSED, WRONG_USAGE, run
from armctl.program import LineStep, MoveStep, Program, Step, save_program

HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))
STRETCHED = MoveStep(joints_deg=(0, 0, 0, 0, 0))
BEHIND = LineStep(x_mm=-200, y_mm=0, z_mm=120, pitch="free")
BEYOND = MoveStep(joints_deg=(300, 0, 0, 0, 0))


def call(capsys: pytest.CaptureFixture[str], program: Path, output: Path, *more: str) -> tuple[int, str, str]:
    status = run(["twin", str(program), "-o", str(output), *more])
    out, err = capsys.readouterr()
    return status, out, err


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    return program(tmp_path, HOME, STRETCHED)


def program(tmp_path: Path, *steps: Step) -> Path:
    path = tmp_path / "mine.toml"
    save_program(Program(robot="uzuner", name="mine", steps=steps), path)
    return path


def test_a_page_is_written_and_warnings_are_told(
    capsys: pytest.CaptureFixture[str], saved: Path, tmp_path: Path
) -> None:
    status, out, err = call(capsys, saved, tmp_path / "twin.html")
    assert status == DONE
    assert re.fullmatch(r".*twin\.html: mine, \d\.\d s, 0\.\d\d MB\n", out)
    assert "warning: " in err and "step 2: " in err and "singularity" in err
    assert "<title>mine</title>" in (tmp_path / "twin.html").read_text(encoding="utf-8")


def test_a_broken_program_is_shown_as_far_as_it_goes(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    status, out, err = call(capsys, program(tmp_path, HOME, BEHIND), tmp_path / "twin.html")
    assert status == REFUSED
    assert "mine, as far as step 1, " in out and "step 2: " in err


@pytest.mark.parametrize(
    ("steps", "output", "more", "says"),
    [
        ((), "twin.html", (), "mine has no steps"),
        ((BEYOND,), "twin.html", (), "step 1: .*300"),
        ((HOME,), "twin.html", ("--robot", "mico"), "for the robot 'uzuner', this one is 'mico'"),
        ((HOME,), "none/twin.html", (), "none/twin.html: cannot be written: No such file or directory"),
        ((HOME,), "", (), "cannot be written: it is a folder"),
        ((HOME,), "twin.html", ("--robot", "uzunr"), "no robot 'uzunr'; did you mean 'uzuner'"),
    ],
)
def test_what_cannot_be_is_one_line(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    steps: tuple[Step, ...],
    output: str,
    more: tuple[str, ...],
    says: str,
) -> None:
    status, out, err = call(capsys, program(tmp_path, *steps), tmp_path / output, *more)
    assert status == REFUSED and out == ""
    assert re.search(says, err) and err.count("\n") == 1
    assert not (tmp_path / "twin.html").exists()


@pytest.mark.parametrize("name", ["mine.toml", "mine", "mine.html.toml"])
def test_only_a_web_page_is_written(capsys: pytest.CaptureFixture[str], saved: Path, name: str) -> None:
    before, output = saved.read_bytes(), saved.with_name(name)
    status, out, err = call(capsys, saved, output)
    assert status == WRONG_USAGE and out == ""
    assert "--output" in err and "end in .html" in err and err.count("\n") == 1
    assert saved.read_bytes() == before
    assert list(saved.parent.iterdir()) == [saved]

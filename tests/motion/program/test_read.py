from __future__ import annotations

import pytest

from armctl.errors import ProgramError
from armctl.program import MoveStep, Program, WaitStep, encode_program, read_program, write_csv, write_script
from armctl.robot import load_robot

ROBOT = load_robot("uzuner")
PROGRAM = Program(
    robot="uzuner", name="pick", steps=(MoveStep(joints_deg=(0, 90, -80, -40, 0)), WaitStep(seconds=1))
)


def test_every_form_that_is_written_is_read_by_its_name() -> None:
    assert read_program("a.toml", encode_program(PROGRAM).encode(), ROBOT) == PROGRAM
    assert read_program("a.PY", write_script(PROGRAM).encode(), ROBOT) == PROGRAM
    assert read_program("pick.csv", write_csv(PROGRAM, ROBOT).encode(), ROBOT) == PROGRAM


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.txt", b"", r"^a\.txt: is none of \.toml, \.csv, \.py"),
        ("a.toml", b"x\n", r"^a\.toml: line 1, column 2: "),
        ("a.csv", b"x,y\n", r"^a\.csv: line 1, column 'x' has no unit"),
        ("a.py", b"import os", r"^a\.py: line 1: a script is"),
    ],
)
def test_what_is_refused_names_the_file(name: str, content: bytes, message: str) -> None:
    with pytest.raises(ProgramError, match=message):
        read_program(name, content, ROBOT)

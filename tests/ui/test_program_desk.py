from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from armctl.errors import ProgramError
from armctl.motion import Program, WaitStep, encode_program, insert, load_program
from armctl.ui.program_desk import ProgramDesk

WAIT = WaitStep(seconds=2)
BROKEN = b"""format = 1
robot = "uzuner"
[[steps]]
do = "wait"
seconds = 1
[[steps]]
do = "wait"
second = 1
"""


@pytest.fixture
def desk(tmp_path: Path) -> ProgramDesk:
    return ProgramDesk("uzuner", tmp_path / "programs")


def record(desk: ProgramDesk) -> None:
    desk.edit(lambda program: insert(program, len(program.steps), WAIT))


def test_edit_and_undo(desk: ProgramDesk) -> None:
    record(desk)
    record(desk)
    assert (len(desk.program.steps), desk.version) == (2, 2)
    desk.undo()
    assert (len(desk.program.steps), desk.version) == (1, 3)
    desk.undo()
    assert not desk.can_undo
    with pytest.raises(ProgramError, match="there is nothing to undo"):
        desk.undo()


def test_an_edit_that_fails_or_changes_nothing_is_none(desk: ProgramDesk) -> None:
    record(desk)
    with pytest.raises(ProgramError):
        desk.edit(lambda program: insert(program, 9, WAIT))
    desk.edit(lambda program: program)
    assert (len(desk.program.steps), desk.version) == (1, 1)


def test_a_hundred_changes_can_be_taken_back(desk: ProgramDesk) -> None:
    for _ in range(120):
        record(desk)
    for _ in range(100):
        desk.undo()
    assert (len(desk.program.steps), desk.can_undo) == (20, False)


def test_save_and_load(desk: ProgramDesk) -> None:
    record(desk)
    before = desk.version
    path = asyncio.run(desk.save("pick and place"))
    assert load_program(path).steps == (WAIT,)
    assert desk.version > before
    assert desk.program.name == "pick and place"
    assert desk.saved() == ["pick and place"]
    record(desk)
    asyncio.run(desk.load("pick and place"))
    assert desk.program.steps == (WAIT,)
    desk.undo()
    assert len(desk.program.steps) == 2


@pytest.mark.parametrize("name", ["", "../x", "/etc/x", ".x", "a/b", "x\n", "a" * 62, "a\\b"])
def test_a_name_that_leaves_the_folder_is_refused(desk: ProgramDesk, name: str) -> None:
    with pytest.raises(ProgramError, match="is no program name"):
        asyncio.run(desk.save(name))
    with pytest.raises(ProgramError, match="is no program name"):
        asyncio.run(desk.load(name))
    assert desk.saved() == []


def test_an_unusable_folder_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ProgramError, match="cannot be made"):
        asyncio.run(ProgramDesk("uzuner", tmp_path / "file" / "programs").save("a"))


def test_a_broken_text_names_step_and_key_and_changes_nothing(desk: ProgramDesk) -> None:
    record(desk)
    before = (desk.program, desk.version)
    with pytest.raises(ProgramError, match=r"step 2.*second"):
        desk.take_in(BROKEN)
    with pytest.raises(ProgramError, match="not a text file"):
        desk.take_in(b"\xff\xfe\x00")
    with pytest.raises(ProgramError, match="for the robot 'mico', this one is 'uzuner'"):
        desk.take_in(encode_program(Program(robot="mico", steps=(WAIT,))).encode())
    assert (desk.program, desk.version) == before


def test_it_knows_whether_the_arm_was_given_these_steps(desk: ProgramDesk) -> None:
    record(desk)
    assert not desk.as_started
    desk.start(desk.program)
    assert desk.as_started
    record(desk)
    assert not desk.as_started
    desk.undo()
    assert desk.as_started

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from armctl.errors import ProgramError
from armctl.program import EndStep, Program, RepeatStep, Step, WaitStep, load_program
from armctl.runtime import ProgramProgress
from armctl.ui.tabs.manual.shared_program import SharedProgram

WAIT = WaitStep(seconds=2)


@pytest.fixture
def desk(tmp_path: Path) -> SharedProgram:
    return SharedProgram("uzuner", tmp_path / "programs")


def record(desk: SharedProgram) -> None:
    desk.edit(program(*desk.program.steps, WAIT))


def program(*steps: Step) -> Program:
    return Program(robot="uzuner", steps=steps)


def test_edit_and_undo(desk: SharedProgram) -> None:
    record(desk)
    record(desk)
    assert (len(desk.program.steps), desk.version) == (2, 2)
    desk.undo()
    assert (len(desk.program.steps), desk.version) == (1, 3)
    desk.edit(desk.program)  # no change
    assert (len(desk.program.steps), desk.version) == (1, 3)
    for _ in range(120):
        record(desk)
    for _ in range(100):
        desk.undo()
    assert len(desk.program.steps) == 21
    with pytest.raises(ProgramError, match="there is nothing to undo"):
        desk.undo()


def test_save_and_load(desk: SharedProgram) -> None:
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
def test_a_name_that_leaves_the_folder_is_refused(desk: SharedProgram, name: str) -> None:
    with pytest.raises(ProgramError, match="is no program name"):
        asyncio.run(desk.save(name))
    with pytest.raises(ProgramError, match="is no program name"):
        asyncio.run(desk.load(name))
    assert desk.saved() == []
    desk.folder.write_text("")
    with pytest.raises(ProgramError, match="cannot be made"):
        asyncio.run(desk.save("a"))


def test_another_robots_program_and_blocks_that_do_not_match_change_nothing(desk: SharedProgram) -> None:
    record(desk)
    before = (desk.program, desk.version)
    with pytest.raises(ProgramError, match="for the robot 'mico', this one is 'uzuner'"):
        desk.put(Program(robot="mico", steps=(WAIT,)))
    with pytest.raises(ProgramError, match="step 1: this 'repeat' has no 'end'"):
        desk.edit(program(RepeatStep(times=2), WAIT))
    with pytest.raises(ProgramError, match="step 1: 'end' without a 'repeat'"):
        desk.put(program(EndStep()))
    assert (desk.program, desk.version) == before
    desk.put(program(WAIT, WAIT))
    assert (len(desk.program.steps), desk.version) == (2, 2)


def test_redo_makes_again_what_was_taken_back_until_something_else_is_edited(desk: SharedProgram) -> None:
    record(desk)
    record(desk)
    desk.undo()
    desk.undo()
    desk.undo(redo=True)
    assert len(desk.program.steps) == 1
    desk.undo(redo=True)
    assert (len(desk.program.steps), desk.version) == (2, 6)
    with pytest.raises(ProgramError, match="there is nothing to redo"):
        desk.undo(redo=True)
    desk.undo()
    record(desk)
    with pytest.raises(ProgramError, match="there is nothing to redo"):
        desk.undo(redo=True)
    desk.undo()
    assert len(desk.program.steps) == 1


def running(version: Program, coming: Program) -> ProgramProgress:
    return ProgramProgress(version.name, 0, len(version.steps), 0, None, version, coming)


def test_it_knows_how_it_stands_to_the_program_that_the_arm_runs(desk: SharedProgram) -> None:
    record(desk)
    before = desk.program
    assert desk.relation(None) is None
    assert desk.relation(running(before, before)) == "running"
    record(desk)
    assert desk.relation(running(before, before)) == "other"
    assert desk.relation(running(before, desk.program)) == "coming"
    assert desk.relation(running(desk.program, desk.program)) == "running"
    desk.undo()
    assert desk.relation(running(before, before)) == "running"

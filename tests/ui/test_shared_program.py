from __future__ import annotations

import asyncio
import multiprocessing
import os
from itertools import count
from pathlib import Path
from typing import Any, cast

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples

from armctl.errors import ProgramError
from armctl.program import EndStep, Program, RepeatStep, Step, WaitStep, load_program
from armctl.protocol import Party, ProgramProgress
from armctl.ui.tabs.manual.shared_program import Edit, SharedProgram, Unsaved, keys_after

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


def test_a_step_keeps_its_key_wherever_it_goes_and_no_key_is_used_again(desk: SharedProgram) -> None:
    me = Party("page 1", "me")
    a, b, c = (WaitStep(seconds=k) for k in (1, 2, 3))
    desk.edit(program(a, b, c), me)
    first, second, third = desk.keys
    assert len({first, second, third}) == 3
    desk.edit(program(c, a, b), me)
    assert desk.keys == [third, first, second]
    assert [desk.row(key) for key in (first, second, third)] == [1, 2, 0]
    desk.edit(program(c, WaitStep(seconds=9), b), me)  # it is edited
    assert desk.keys == [third, first, second]
    desk.edit(program(c, c, b), me)  # and again
    assert desk.keys == [third, first, second]
    desk.undo(me)
    assert desk.keys == [third, first, second]
    desk.edit(program(*desk.program.steps, b), me)
    *kept, new = desk.keys
    assert kept == [third, first, second] and new not in kept
    desk.edit(program(*desk.program.steps[1:]), me)
    assert desk.keys == [first, second, new]
    assert desk.row(third) is None and desk.row("") is None
    desk.undo(me)
    assert desk.keys[1:] == [first, second, new] and desk.keys[0] != third
    gone = [*desk.keys]
    desk.put(program(WaitStep(seconds=1), WaitStep(seconds=2)))  # another program
    assert not set(gone) & set(desk.keys)
    one = desk.keys
    desk.put(program(WaitStep(seconds=7)))
    desk.put(program(WaitStep(seconds=8)))
    assert not set(one) & set(desk.keys)


@given(st.lists(st.lists(st.integers(0, 6), max_size=8), max_size=12), st.booleans())
@settings(max_examples=examples(200))
def test_keys_are_of_the_steps_that_stay_whatever_changes(lists: list[list[int]], edited: bool) -> None:
    steps = [WaitStep(seconds=k) for k in range(7)]
    new, before, keys = map(str, count()), list[Step](), list[str]()
    for numbers in lists:
        after = [steps[number] for number in numbers]
        now = keys_after(before, keys, after, new, edited=edited)
        assert len(now) == len(set(now)) == len(after)
        of = dict(zip(keys, before, strict=True))
        others = [key for key, step in zip(now, after, strict=True) if key in of and of[key] is not step]
        assert len(others) <= edited
        for step in steps:  # of each as many stay as there are in both
            stay = sum(one is of.get(key) is step for key, one in zip(now, after, strict=True))
            assert stay == min(before.count(step), after.count(step))
        before, keys = after, now


def test_it_is_known_who_has_edited_which_row_last(desk: SharedProgram) -> None:
    me = Party("page 1", "Ada")
    desk.edit(program(WAIT, WAIT, WAIT), me)
    desk.edit(program(WAIT, WaitStep(seconds=5), WAIT), me)
    assert desk.last_edit == Edit(me, 1)
    desk.edit(program(*desk.program.steps, WAIT), me)
    assert desk.last_edit == Edit(me, 3)
    desk.undo(me)
    desk.undo(me)
    assert desk.last_edit == Edit(me, 1)
    desk.put(program(WAIT))
    assert desk.last_edit is None


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
    with pytest.raises(ProgramError, match="cannot be written"):
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


def test_a_sample_or_a_loaded_program_is_unsaved_once_it_is_changed(tmp_path: Path) -> None:
    desk = SharedProgram("uzuner", tmp_path)
    sample = program(WAIT)
    desk.put(sample, kept=True)
    assert desk.unsaved_words() is None and asyncio.run(desk.save_as_it_is()) is None
    desk.edit(program(WAIT, WAIT))
    assert desk.unsaved_words() is not None
    path = asyncio.run(desk.save_as_it_is())
    assert path == tmp_path / f"{sample.name}.toml" and desk.unsaved_words() is None
    desk.put(program(WAIT, WAIT, WAIT))  # it comes from elsewhere, as by an upload
    assert desk.unsaved_words() is not None


def test_a_program_of_another_origin_takes_the_place_of_none(tmp_path: Path) -> None:
    first, second = SharedProgram("uzuner", tmp_path), SharedProgram("uzuner", tmp_path)
    for desk, file in ((first, "untitled.toml"), (second, "untitled 2.toml")):
        desk.edit(msgspec.structs.replace(program(WAIT), name="untitled"))
        assert asyncio.run(desk.save_as_it_is()) == tmp_path / file


# What survives a crash.

FRAME = cast(Any, None)
"""a snapshot that nobody looks at"""


def desk_that_keeps(tmp_path: Path, robot: str = "uzuner") -> SharedProgram:
    return SharedProgram(robot, tmp_path / "programs", Unsaved(tmp_path / "unsaved", robot))


def kept_files(tmp_path: Path) -> list[str]:
    return sorted(path.name for path in (tmp_path / "unsaved").glob("*"))


async def settled(desk: SharedProgram, frames: int = 60) -> None:
    """Frames are drawn, and what they began is written."""
    for _ in range(frames):
        desk.keep(FRAME)
    await asyncio.gather(*asyncio.all_tasks() - {asyncio.current_task()})


def _crash_while_editing(tmp_path: str) -> None:
    async def edit() -> None:
        desk = desk_that_keeps(Path(tmp_path))
        desk.edit(program(WAIT, WAIT))
        await settled(desk)
        os._exit(9)

    asyncio.run(edit())


def test_an_unsaved_program_survives_a_crash(tmp_path: Path) -> None:
    console = multiprocessing.get_context("spawn").Process(target=_crash_while_editing, args=(str(tmp_path),))
    console.start()
    console.join()
    assert console.exitcode == 9

    async def afterwards() -> None:
        desk = desk_that_keeps(tmp_path)
        left = desk.left
        assert left is not None and ":" in left.time
        assert desk_that_keeps(tmp_path, "mico").left is None
        record(desk)
        await settled(desk)
        assert len(kept_files(tmp_path)) == 2
        await desk.answer(left, restore=True)
        assert desk.program.steps == (WAIT, WAIT)
        assert desk.left is None
        assert len(kept_files(tmp_path)) == 1, "it is kept as this console's own"
        await desk.answer(left, restore=True)  # on another page, too late
        desk.undo()
        assert desk.program.steps == (WAIT,)

    asyncio.run(afterwards())


def test_what_is_saved_or_gone_is_not_kept(tmp_path: Path) -> None:
    async def work() -> None:
        desk = desk_that_keeps(tmp_path)
        await settled(desk)
        assert kept_files(tmp_path) == []
        record(desk)
        await settled(desk, 1)
        assert kept_files(tmp_path) == [], "not with every edit"
        await settled(desk, 59)
        assert len(kept_files(tmp_path)) == 1
        await desk.save("mine")
        await settled(desk)
        assert kept_files(tmp_path) == []
        record(desk)
        await settled(desk)
        assert len(kept_files(tmp_path)) == 1
        await desk.load("mine")
        await settled(desk)
        assert kept_files(tmp_path) == []
        desk.undo()
        await settled(desk)
        assert len(kept_files(tmp_path)) == 1
        desk.edit(program())
        await settled(desk)
        assert kept_files(tmp_path) == []

    asyncio.run(work())


def test_what_was_left_is_deleted_when_nobody_wants_it_or_it_cannot_be_read(tmp_path: Path) -> None:
    folder = tmp_path / "unsaved"
    folder.mkdir()
    for number, text in ((1, "no program"), (2, 'robot = "uzuner"\n[[steps]]\ndo = "wait"\nseconds = 1\n')):
        (folder / f"uzuner-{os.getpid()}-{number}.toml").write_text(text)
        os.utime(folder / f"uzuner-{os.getpid()}-{number}.toml", (1e9 + number, 1e9 + number))

    async def work() -> None:
        desk = desk_that_keeps(tmp_path)
        assert desk.left is not None and desk.left.time.startswith("2001-09-0")
        await desk.answer(desk.left, restore=False)
        with pytest.raises(ProgramError, match=r"uzuner-.*-1\.toml: line 1"):
            await desk.answer(desk.left, restore=True)
        await desk.answer(desk.left, restore=False)
        assert desk.left is None and kept_files(tmp_path) == []
        assert not desk.program.steps

    asyncio.run(work())


def test_where_it_cannot_be_kept_that_is_said(tmp_path: Path) -> None:
    async def work() -> None:
        desk = desk_that_keeps(tmp_path)
        (tmp_path / "unsaved").write_text("in the way")
        record(desk)
        await settled(desk)
        assert desk.kept is not None and "unsaved" in str(desk.kept.problem)
        (tmp_path / "unsaved").unlink()
        record(desk)
        await settled(desk)
        assert desk.kept.problem is None and len(kept_files(tmp_path)) == 1

    asyncio.run(work())

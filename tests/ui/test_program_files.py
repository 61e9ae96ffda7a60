"""Saved programs and samples in one list: what the user saved under a sample's name stays the user's."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any, cast

import pytest
from tests.ui.page_kit import FakePage

from armctl.errors import ArmctlError
from armctl.motion.preflight import Finding
from armctl.program import CallStep, Program, WaitStep, check_program
from armctl.program.files import SAMPLES
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.program_run import ProgramFiles
from armctl.ui.tabs.manual.shared_program import SharedProgram

ROBOT = load_robot("uzuner")
SQUARE = "sample - square"
GROUP = "Chosen one"


class FilesPage(FakePage):
    """A page whose right to operate ends after so many questions for it."""

    def __init__(self, server: GuardedServer, folder: Path) -> None:
        super().__init__(server, ROBOT, ROBOT.pose("home"))
        self.program = SharedProgram("uzuner", folder)
        self.allowed = 99
        cast(Any, self.console).shared = {SharedProgram: self.program}.__getitem__

    def require_operator(self) -> None:
        self.allowed -= 1
        if self.allowed < 0:
            raise ArmctlError("this page is watching")


async def nothing_found() -> list[Finding]:
    return []


def test_a_saved_program_goes_before_the_sample_of_its_name(server: GuardedServer, tmp_path: Path) -> None:
    page = FilesPage(server, tmp_path)
    mine = Program(robot="uzuner", name=SQUARE, steps=(WaitStep(seconds=2),))
    page.program.put(mine)
    asyncio.run(page.program.save(SQUARE))
    page.program.put(Program(robot="uzuner"))
    files = ProgramFiles(page.session, nothing_found)
    offered = files._saved.options
    assert offered[0] == SQUARE and sorted(offered) == sorted(SAMPLES)
    files._saved.value = SQUARE
    page.press(GROUP, "Load")
    assert page.program.program == mine


def test_a_sample_is_loaded_only_by_who_still_operates(server: GuardedServer, tmp_path: Path) -> None:
    page = FilesPage(server, tmp_path)
    files = ProgramFiles(page.session, nothing_found)
    files._saved.value = SQUARE
    page.allowed = 1  # another page takes control while the sample is made
    with pytest.raises(ArmctlError, match="watching"):
        page.press(GROUP, "Load")
    assert page.program.program.steps == ()
    page.allowed = 99
    page.press(GROUP, "Load")
    assert page.program.program.name == SQUARE


def test_a_program_that_calls_another_says_how_to_bring_it(server: GuardedServer, tmp_path: Path) -> None:
    page = FilesPage(server, tmp_path)

    async def check() -> list[Finding]:
        return check_program(await page.program.linked(), ROBOT, start=ROBOT.pose("home"))

    ProgramFiles(page.session, check)
    calls = Program(robot="uzuner", name="main", steps=(WaitStep(seconds=1), CallStep(program="grip")))
    page.program.put(calls)
    (one,) = asyncio.run(check())
    assert one.step == 1 and "no saved program is called 'grip'" in one.what and "Upload its file" in one.what
    page.program.put(Program(robot="uzuner", steps=(WaitStep(seconds=2),)))
    asyncio.run(page.program.save("grip"))
    page.program.put(calls)
    assert asyncio.run(check()) == []
    assert page.program.callable == ["grip"] and page.program.program.called == ()
    linked = asyncio.run(page.program.linked())
    page.program.library.path("grip").write_text("broken")
    assert asyncio.run(page.program.linked(linked.called)) == linked  # as it was read before
    (one,) = asyncio.run(check())
    assert "cannot be read" in one.what

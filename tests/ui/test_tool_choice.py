"""Which tool is on: chosen in Main, and the pages follow it once nothing moves."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
from tests.robot.test_tools import arm_with_tools
from tests.ui.page_kit import FakePage, snapshot_of
from tests.ui.test_robot_choice import PAGE, SIMULATED, FakeController, Rig

from armctl.calibration import CalibrationStore
from armctl.errors import StateError
from armctl.program import Program, WaitStep
from armctl.protocol import SetTool
from armctl.robot import Robot, load_robot
from armctl.ui import CalibrationInForce, Console, RobotChoice, RobotSwitch
from armctl.ui.enabling import enable_note
from armctl.ui.guard import GuardedServer
from armctl.ui.robot_switch import EQUIPPED, RobotChange
from armctl.ui.tabs.calibration.tool_tip import TipTouches
from armctl.ui.tabs.main.tool_choice import ON, STILL, ToolChoice
from armctl.ui.tabs.manual.shared_program import SharedProgram


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    return arm_with_tools(tmp_path)


def chosen(server: GuardedServer, robot: Robot, **now: Any) -> tuple[FakePage, ToolChoice]:
    page = FakePage(server, robot, robot.pose("home"))
    vars(page.snapshot).update({"tool": "jaws", "tool_unconfirmed": False, "board": None} | now)
    return page, ToolChoice(page.session)


def test_another_tool_is_on_once_the_operator_says_so(server: GuardedServer, robot: Robot) -> None:
    page, choice = chosen(server, robot)
    assert page.reads(ON) is not None and "Felt pen" in str(vars(choice)["_list"].options)
    vars(choice)["_list"].value = "Felt pen"
    page.refresh(choice)
    assert not page.sent and "tip 0.0, 0.0, 110.0 mm from the flange; 0.04 kg; nothing grips" in page.html
    assert "On now: <b>Jaws</b>" in page.html
    page.press(ON)
    assert page.sent == [SetTool("pen")]
    vars(page.snapshot).update(busy=True)
    with pytest.raises(StateError, match="only while the arm stands"):
        page.press(ON)


def test_a_page_asks_which_tool_is_on(server: GuardedServer, robot: Robot) -> None:
    page, choice = chosen(server, robot, tool_unconfirmed=True)
    page.refresh(choice)
    assert vars(choice)["_on"].label == STILL and "which tool is on? Say so before Enable" in page.html
    vars(choice)["_list"].value = "Cup"
    page.refresh(choice)
    assert vars(choice)["_on"].label == ON and "turned" in page.html and "grips: Cup" in page.html
    now = replace(snapshot_of(robot), board=SIMULATED, tool_unconfirmed=True)
    assert "say so in Main" in enable_note(now, robot.board)


def test_an_arm_that_is_opened_anew_has_its_tool_on(tmp_path: Path, robot: Robot) -> None:
    rig = Rig(tmp_path)
    rig.robots["uzuner"] = robot
    rig.arm(tool="pen")
    asyncio.run(rig.desk.reopen(PAGE, lambda: None))
    assert SetTool("pen") in rig.opened["uzuner"].commands
    rig.robots["uzuner"] = load_robot("uzuner")  # its file was edited: there is no such tool any more
    rig.arm(tool="pen")
    asyncio.run(rig.desk.reopen(PAGE, lambda: None))
    assert SetTool("pen") not in rig.opened["uzuner"].commands


def test_the_pages_follow_the_tool_once_nothing_moves(tmp_path: Path, robot: Robot) -> None:
    controller = FakeController(snapshot_of(robot))
    console = Console(
        calibration=CalibrationInForce(robot, "simulated", CalibrationStore(tmp_path / "calibrations")),
        controller=cast(Any, controller),
        list_ports=list,
        files=tmp_path,
        close=lambda: None,
    )
    switch, told = (
        RobotSwitch(console, RobotChoice("uzuner", "Uzuner"), [], lambda name, port, progress: console),
        list[RobotChange](),
    )
    switch.on_change(told.append)
    shared, touches = console.shared(SharedProgram), console.shared(TipTouches)
    shared.edit(Program(robot="uzuner", name="mine", steps=(WaitStep(seconds=1),)), None)
    switch.follow_tool()
    assert switch.console is console and not told
    controller.snapshot = replace(controller.snapshot, tool="pen", busy=True)
    switch.follow_tool()
    assert switch.console is console and not told  # a program goes on; its page is built anew later
    controller.snapshot = replace(controller.snapshot, busy=False)
    switch.follow_tool()
    assert [(one.title, one.did) for one in told] == [("Felt pen", EQUIPPED)]
    assert switch.console.robot == robot.with_tool("pen") and switch.console.controller is controller
    assert switch.console.shared(SharedProgram).program.name == "mine"  # what is on the list stays
    assert switch.console.shared(TipTouches) is not touches  # touches were those of another tip
    switch.follow_tool()
    assert len(told) == 1

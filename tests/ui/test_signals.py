"""Inputs and outputs on the page: to look at, to press, and to set on a simulated board."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from tests.runtime.signal_kit import SIGNALS, VACUUM, robot_with
from tests.ui.page_kit import FakePage

from armctl.errors import InputError
from armctl.facts import State
from armctl.hardware import BoardIdentity, Source
from armctl.protocol import PlayInputs, SetOutput, SimulateInput
from armctl.robot import Robot, load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.screen import ManualScreen
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.manual.signals import PLAY, STOP_SCRIPT, InputScriptText, SignalPanel, said

SIMULATED, REAL = BoardIdentity("Maestro", "sim", simulated=True), BoardIdentity("Maestro", "/dev/ttyACM0")
PWM = """
[board]
kind = "firmata"
"""


def page_of(server: GuardedServer, robot: Robot) -> FakePage:
    page = FakePage(server, robot, np.zeros(robot.n))
    script = InputScriptText(robot.signals.inputs)
    vars(page.session.console).update(shared=lambda _: script)
    page.require_operator = lambda: None  # type: ignore[attr-defined]
    vars(page.snapshot).update(
        scripted=(),
        board=SIMULATED,
        inputs={"button": 1.0, "door": 0.0, "knob": 0.25},
        outputs={"lamp": 0.0, "pump": 1.0},
    )
    return page


@pytest.fixture
def page(server: GuardedServer, tmp_path: Path) -> FakePage:
    return page_of(server, robot_with(tmp_path))


def test_states_are_shown_in_words(page: FakePage) -> None:
    page.refresh(SignalPanel(page.session))
    cells = re.findall(r"<td[^>]*>([^<]*)</td>", page.html)
    assert [tuple(cells[k : k + 3]) for k in range(0, len(cells), 3)] == [
        ("Button", "input", "on"),
        ("Door", "input", "off"),
        ("Knob", "input", "25 %"),
        ("Lamp", "output", "off"),
        ("Vacuum pump", "output", "on"),
        ("Bell", "output", "–"),
    ]


def test_outputs_are_pressed(page: FakePage) -> None:
    panel = SignalPanel(page.session)
    page.press("Lamp", "On")
    page.press("Vacuum pump", "Off")
    assert page.sent == [SetOutput("lamp", 1.0), SetOutput("pump", 0.0)]
    assert panel is not None


def test_inputs_are_set_on_a_simulated_board_only(page: FakePage) -> None:
    panel = SignalPanel(page.session)
    assert vars(panel)["_simulated"].visible and "nothing is connected to it" in page.html
    page.press("Button", "On")
    page.press("Knob", "75 %")
    assert page.sent == [SimulateInput("button", 1.0), SimulateInput("knob", 0.75)]
    vars(page.snapshot).update(board=REAL)
    page.refresh(panel)
    assert not vars(panel)["_simulated"].visible


def test_a_script_is_typed_or_chosen_and_played(page: FakePage) -> None:
    panel = SignalPanel(page.session)
    page.press("Inputs over time", PLAY)  # the example that stands there at first
    assert page.sent == [PlayInputs("every 5 s button on for 1 s")]
    vars(page.snapshot).update(scripted=("button",))
    page.refresh(panel)
    assert "A script sets button." in page.html
    text = vars(panel)["_text"]
    text.value = "at 2 s horn = on"
    with pytest.raises(InputError, match="line 1: there is no input 'horn'"):
        page.press("Inputs over time", PLAY)
    for content, why in ((b"\xff", "not a text file"), (b"time_s,door\n1,much\n", "line 2: input door")):
        with pytest.raises(InputError, match=f"day.csv: .*{why}"):
            page.act(lambda content=content: panel._on_upload("day.csv", content))
    page.act(lambda: panel._on_upload("day.csv", b"time_s,door\n1,on\n"))
    page.press("Inputs over time", PLAY)
    page.press("Inputs over time", STOP_SCRIPT)
    assert page.sent[1:] == [PlayInputs("time_s,door\n1,on"), PlayInputs("")]
    again = SignalPanel(page.session)  # another page
    assert vars(again)["_text"].value == "time_s,door\n1,on\n"


def test_the_grippers_output_is_left_to_the_gripper(server: GuardedServer, tmp_path: Path) -> None:
    page, told = page_of(server, robot_with(tmp_path, SIGNALS, VACUUM)), []
    vars(page)["needs"] = lambda *_, also=None, **__: told.append(also)
    SignalPanel(page.session)
    (why,) = [also for also in told if also is not None]
    assert why(page.snapshot) == "it is the gripper's: use the gripper"
    vars(page.snapshot).update(state=State.OFF)
    assert why(page.snapshot) is None


def test_an_arm_without_pins_has_no_such_tab(server: GuardedServer, tmp_path: Path) -> None:
    robot = load_robot("uzuner")
    page = page_of(server, robot)
    vars(page.snapshot).update(source=Source.TRANSMITTED, limp=())
    shared = SharedProgram("uzuner", tmp_path)
    vars(page.session.console).update(shared=lambda kind: shared if kind is SharedProgram else kind())
    assert vars(ManualScreen(page.session))["_signals"] is None


def test_values_in_words(page: FakePage) -> None:
    lamp = page.session.console.robot.signals.output("lamp")
    assert lamp is not None
    assert [said(lamp, value) for value in (None, 0.0, 1.0)] == ["–", "off", "on"]

"""Inputs and outputs on the page: to look at, to press, and to set on a simulated board."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tests.runtime.signal_kit import SIGNALS, VACUUM, robot_with
from tests.ui.page_kit import FakePage

from armctl.calibration import CalibrationStore
from armctl.errors import ArmctlError, InputError
from armctl.facts import State
from armctl.hardware import BoardIdentity, Source
from armctl.program import Program, WaitStep, load_program, save_program
from armctl.protocol import PlayInputs, SetOutput, SimulateInput
from armctl.robot import Robot, load_robot
from armctl.robot.signals import Input, Output
from armctl.ui.guard import GuardedServer
from armctl.ui.robot_switch import RobotChoice
from armctl.ui.tabs.manual.screen import ManualScreen
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.manual.signals import (
    PLAY,
    STOP_SCRIPT,
    InputScriptText,
    NewSignal,
    SignalPanel,
    kinds_of,
    said,
)

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
    why = next(also for also in told if also is not None)
    assert why(page.snapshot) == "it is the gripper's: use the gripper"
    vars(page.snapshot).update(state=State.OFF)
    assert why(page.snapshot) is None


class Switch:
    """The robots of a page, of which another is chosen or opened anew."""

    def __init__(self, robot: Robot) -> None:
        self.present = RobotChoice(robot.name, robot.title)
        self.opened: list[str] = []
        self.console = SimpleNamespace(shared=cache(lambda _: SharedProgram("my_uzuner", Path("nowhere"))))

    def require_reopenable(self) -> None:
        """Nothing moves here."""

    def offer(self, choice: RobotChoice) -> None:
        self.present = choice

    async def change(self, name: str, *_: object) -> None:
        self.opened.append(name)

    async def reopen(self) -> None:
        self.opened.append("again")


def test_a_button_and_a_lamp_are_named_and_the_program_comes_along(
    server: GuardedServer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    robot = load_robot("uzuner")
    page, told, switch = page_of(server, robot), list[str](), Switch(robot)
    edited = SharedProgram("uzuner", tmp_path)
    edited.edit(Program(robot="uzuner", name="mine", steps=(WaitStep(seconds=1),)))
    kept = SimpleNamespace(file_robot=robot, store=CalibrationStore(tmp_path / "calibrations"))
    vars(page.session.console).update(
        shared=lambda kind: edited if kind is SharedProgram else kind(()), calibration=kept, files=tmp_path
    )
    mine_before = Program(robot="uzuner", name="wave", steps=(WaitStep(seconds=2),))
    (tmp_path / "programs" / "uzuner").mkdir(parents=True)
    save_program(mine_before, tmp_path / "programs" / "uzuner" / "wave.toml")
    vars(page).update(robots=switch, origin=None, notify=lambda _, text: told.append(text))
    vars(page)["reopen_arm"] = switch.reopen
    vars(page.snapshot).update(inputs={}, outputs={})
    panel = SignalPanel(page.session)
    page.refresh(panel)
    assert "No input and no output has a name yet" in page.html
    page.press("Add it to the arm")
    mine = load_robot("my_uzuner")
    assert mine.signals.inputs == (Input("button", "Button", 6),) and mine.title == f"My {robot.title}"
    assert switch.opened == ["my_uzuner"] and "my_uzuner.toml" in told[-1]
    assert told[-1].endswith(f"Copied from {robot.title}, which keeps its own: 1 saved program.")
    assert load_program(tmp_path / "programs" / "my_uzuner" / "wave.toml").robot == "my_uzuner"
    carried = switch.console.shared(SharedProgram).program
    assert (carried.robot, carried.steps) == ("my_uzuner", edited.program.steps)

    page = page_of(server, mine)
    vars(page).update(robots=switch, origin=None, notify=lambda _, text: told.append(text))
    vars(page)["reopen_arm"] = switch.reopen
    form = vars(NewSignal(page.session))
    page.put("It is an", "output: lamp, valve, pump")
    assert form["_title"].value == "Lamp" and form["_channel"].value == 7
    form["_title"].value, form["_low"].value = "Red lamp 2", True
    page.press("Add it to the arm")
    assert switch.opened[1:] == ["again"]
    named = load_robot("my_uzuner").signals
    assert named.output("red_lamp_2") == Output("red_lamp_2", "Red lamp 2", 7, active_low=True)
    assert named.inputs == mine.signals.inputs
    for title, channel, why in (
        ("Bell", "0", "channel = 0: a joint has it already"),
        ("Bell", "7.5", "Channel: 7.5 is no whole number"),
        ("?!", "9", "write what it is"),
        ("Button", "9", "two inputs or outputs have this name"),
    ):
        form["_title"].value, form["_channel"].handle.value = title, channel
        with pytest.raises(ArmctlError, match=why):
            page.press("Add it to the arm")
    assert load_robot("my_uzuner").signals == named


def test_an_arm_whose_board_has_no_pins_to_spare_has_no_such_tab(
    server: GuardedServer, tmp_path: Path
) -> None:
    robot = load_robot("so101")
    assert kinds_of(robot) == {} and len(kinds_of(load_robot("uzuner"))) == 3
    page = page_of(server, robot)
    vars(page.snapshot).update(source=Source.TRANSMITTED, limp=())
    shared = SharedProgram("so101", tmp_path)
    vars(page.session.console).update(shared=lambda kind: shared if kind is SharedProgram else kind())
    assert vars(ManualScreen(page.session))["_signals"] is None


def test_values_in_words(page: FakePage) -> None:
    lamp = page.session.console.robot.signals.output("lamp")
    assert lamp is not None
    assert [said(lamp, value) for value in (None, 0.0, 1.0)] == ["–", "off", "on"]

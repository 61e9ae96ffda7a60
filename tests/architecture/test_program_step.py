"""A kind of step that armctl does not know: added by its struct and its line in the registry."""

from __future__ import annotations

from pathlib import Path

import pytest
from examples.extending.step import BlinkStep
from tests.runtime.kit import make_rig

from armctl.errors import InputError, ProgramError
from armctl.facts import State
from armctl.program import Program, Step, check_program, load_program, read_csv, save_program, write_csv
from armctl.program import steps as registry
from armctl.program.base_steps import Effect
from armctl.program.edit import PLACES, add
from armctl.program.motion_steps import MoveStep
from armctl.protocol import RunProgram
from armctl.robot import load_robot
from armctl.ui.tabs.manual.new_step import recorded_kinds, step_here
from armctl.ui.tabs.manual.program_list import row_html
from armctl.ui.tabs.manual.step_form import by_label, edited, texts_of

ROBOT = load_robot("uzuner")


class BowStep(MoveStep, frozen=True, kw_only=True, tag="bow"):
    """Move, and say so."""

    @property
    def effect(self) -> Effect:
        """A line in the log."""
        return Effect(says=f"the arm bows {self.note}")


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "KINDS", (*registry.KINDS, BlinkStep, BowStep))


def recorded(step: Step) -> Program:
    return add(Program(robot="uzuner", name="lamp"), step, PLACES[0], 0)[0]


def test_it_is_saved_and_loaded_as_toml_and_csv(tmp_path: Path) -> None:
    program, path = recorded(BlinkStep(flashes=3, each_s=0.25, note="look")), tmp_path / "lamp.toml"
    save_program(program, path)
    assert load_program(path) == program
    table = write_csv(program, ROBOT)
    assert table == "step,do,flashes,each_s,note\r\n1,blink,3,0.25,look\r\n"
    assert read_csv(table, ROBOT, "lamp") == program
    assert read_csv("do,flashes,each_ms\nblink,3,250\n", ROBOT).steps == (BlinkStep(flashes=3, each_s=0.25),)


def test_what_it_may_not_hold_is_refused_everywhere(tmp_path: Path) -> None:
    path = tmp_path / "lamp.toml"
    path.write_text('robot = "uzuner"\n[[steps]]\ndo = "blink"\nflashes = 21\n')
    with pytest.raises(ProgramError, match="line 4, step 1, key flashes: must be 1 … 20, not 21"):
        load_program(path)
    (finding,) = check_program(recorded(BlinkStep(flashes=0)), ROBOT)
    assert finding.what == "key flashes: must be 1 … 20, not 0"
    (finding,) = check_program(recorded(BlinkStep(flashes=4, each_s=1)), ROBOT)
    assert finding.what == "the lamp gets too hot"


def test_it_has_a_row_in_the_list_and_fields_in_the_form() -> None:
    step = BlinkStep(flashes=3)
    row = row_html("1", 0, step, 0)
    assert "Blink" in row and "3 flashes" in row
    texts = texts_of(step)
    assert list(texts) == ["Flashes", "Flash s", "roll_deg", "Note"]
    assert {"Flashes", "Flash s"} <= set(by_label(registry.all_keys()))
    assert edited(step, {**texts, "Flashes": "5"}) == BlinkStep(flashes=5)
    with pytest.raises(InputError, match="Flashes: must be 1 … 20, not 50"):
        edited(step, {**texts, "Flashes": "50"})


def test_it_runs_on_the_arm() -> None:
    rig = make_rig().enable()
    begin = rig.clock.now()
    ticket = rig.do(RunProgram(recorded(BlinkStep(flashes=3, each_s=0.5))))
    rig.until(lambda snapshot: snapshot.state is State.HOLDING)
    ticket.result(0)
    assert rig.clock.now() - begin == pytest.approx(1.5, abs=0.2)
    assert any("the lamp flashes 3 times" in event.text for event in rig.now.events)


def test_it_is_recorded_where_the_arm_stands() -> None:
    snapshot = make_rig().enable(ROBOT.pose("home")).now
    kind = recorded_kinds(ROBOT)["Lamp"]["Blink here"]
    assert step_here(kind, ROBOT, snapshot) == BlinkStep(roll_deg=0.0)


@pytest.mark.parametrize("blend_mm", [0.0, 20.0])
def test_one_that_moves_has_its_line_in_the_log(blend_mm: float) -> None:
    rig = make_rig().enable(ROBOT.pose("home"))
    left, right = (10.0, 90.0, -80.0, -40.0, 0.0), (-10.0, 80.0, -80.0, -40.0, 0.0)
    steps = (
        BowStep(joints_deg=left, note="left", blend_mm=blend_mm),
        BowStep(joints_deg=right, note="right"),
    )
    rig.do(RunProgram(Program(robot="uzuner", name="bows", steps=steps)))
    rig.until(lambda snapshot: snapshot.state is State.HOLDING)
    said = [event.text for event in rig.now.events if "bows " in event.text]
    assert said == ["the arm bows left", "the arm bows right"]

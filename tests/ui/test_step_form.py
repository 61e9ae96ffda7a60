from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.long import examples
from tests.program.kit import programs
from tests.runtime.signal_kit import robot_with

from armctl.errors import InputError
from armctl.kinematics import CRITERIA
from armctl.program import (
    ArcStep,
    CallStep,
    DrawStep,
    EndStep,
    GridStep,
    GripperStep,
    IfStep,
    LineStep,
    MessageStep,
    MoveStep,
    PickStep,
    PointStep,
    Program,
    RepeatStep,
    Step,
    WaitStep,
)
from armctl.program.base_steps import keys_of
from armctl.protocol import Snapshot
from armctl.robot import load_robot
from armctl.ui.tabs.manual.new_step import step_here
from armctl.ui.tabs.manual.step_form import KnownNames, StepEdit, by_label, edited, texts_of

HERE = SimpleNamespace(commanded=True, q_command=load_robot("uzuner").pose("home"), gripper=0.3, part_mm=None)
MOVE = MoveStep(joints_deg=(0.12345, 90, -80, -40, 0), duration_s=2)
POINT = PointStep(x_mm=200, y_mm=0, z_mm=85)
LINE = LineStep(x_mm=200, y_mm=0, z_mm=85)


def texts(step: Step, **changes: str) -> dict[str, str]:
    return texts_of(step) | changes


def test_each_kind_has_its_fields() -> None:
    assert list(texts_of(MOVE)) == ["Angles °", "Profile", "Duration s", "Blend mm", "Note"]
    assert list(texts_of(POINT))[:4] == ["Point mm", "Pitch °", "Roll °", "Choose by"]
    assert list(texts_of(LINE))[:4] == ["Point mm", "Tool pitch", "Pitch °", "Tool speed mm/s"]
    arc = ArcStep(via_x_mm=1, via_y_mm=2, via_z_mm=3, x_mm=4, y_mm=5, z_mm=6)
    assert list(texts_of(arc))[:2] == ["Point mm", "Via mm"]
    assert list(texts_of(WaitStep(seconds=1))) == ["Wait time s", "Note"]
    assert list(texts_of(EndStep())) == ["Note"]


def test_arms_with_six_joints_are_asked_for_an_orientation_and_one_of_the_two_counts() -> None:
    ur5 = load_robot("ur5")
    fields = ["Point mm", "Tool orientation", "Rx Ry Rz °", "Tool speed mm/s"]
    assert list(texts_of(LINE, ur5))[:4] == fields
    assert texts_of(LINE, ur5)["Tool orientation"] == texts_of(LINE)["Tool pitch"] == "kept"
    assert list(texts_of(POINT, ur5))[:3] == ["Point mm", "Rx Ry Rz °", "Choose by"]
    changes = {"Tool orientation": "interpolated", "Rx Ry Rz °": "180, 0 -90"}
    turned = edited(LINE, texts_of(LINE, ur5) | changes)
    assert turned == LineStep(
        x_mm=200, y_mm=0, z_mm=85, orientation="interpolated", rx_deg=180, ry_deg=0, rz_deg=-90
    )
    shown = texts_of(turned)
    assert shown["Rx Ry Rz °"] == "180, 0, -90" and shown["Tool pitch"] == "kept"
    assert edited(turned, shown | {"Tool pitch": "free"}) == LineStep(x_mm=200, y_mm=0, z_mm=85, pitch="free")
    emptied = edited(turned, shown | {"Rx Ry Rz °": " ", "Tool orientation": "kept"})
    assert emptied == LineStep(x_mm=200, y_mm=0, z_mm=85, orientation="kept")
    with pytest.raises(InputError, match="Rx Ry Rz °: 3 numbers are needed"):
        edited(turned, shown | {"Rx Ry Rz °": "1, 2"})


@given(programs(joints=st.just(5)))
@settings(max_examples=examples(100))
def test_every_value_of_every_step_has_a_field_and_stays_as_it_is(program: Program) -> None:
    for step in program.steps:
        keys = [key.name for field in by_label(keys_of(type(step))).values() for key in field]
        assert sorted(keys) == sorted(step.__struct_fields__)
        assert edited(step, texts(step)) == step


def test_what_is_typed_is_taken() -> None:
    typed = {"Profile": "quintic", "Duration s": "", "Blend mm": "5", "Note": "here"}
    expected = MoveStep(joints_deg=MOVE.joints_deg, profile="quintic", blend_mm=5, note="here")
    assert edited(MOVE, texts(MOVE, **typed)) == expected
    assert edited(MOVE, texts(MOVE, **{"Angles °": "1 2, −3;4 5"})) == MoveStep(
        joints_deg=(1, 2, -3, 4, 5), duration_s=2
    )
    assert edited(POINT, texts(POINT, **{"Point mm": "(1, 2.5, 3)", "Pitch °": "-30"})) == PointStep(
        x_mm=1, y_mm=2.5, z_mm=3, pitch_deg=-30
    )
    assert edited(LINE, texts(LINE, **{"Tool pitch": "free", "Tool speed mm/s": "20"})) == LineStep(
        x_mm=200, y_mm=0, z_mm=85, pitch="free", speed_mm_s=20
    )
    assert edited(RepeatStep(times=2), {"Times": "7", "Note": ""}) == RepeatStep(times=7)
    grip = GripperStep(open_percent=40)
    assert texts_of(grip) == {"Open %": "40", "Part mm": "", "Note": ""}
    held = GripperStep(open_percent=40, part_x_mm=20, part_y_mm=30, part_z_mm=40)
    for text in ("20 × 30 × 40", "20x30x40", "20, 30 40"):
        assert edited(grip, texts(grip, **{"Part mm": text})) == held
    assert edited(held, texts(held, **{"Part mm": " "})) == grip


@pytest.mark.parametrize(
    ("step", "changes", "message"),
    [
        (MOVE, {"Angles °": "1, 2"}, "Angles °: 5 numbers are needed, separated by commas; there are 2"),
        (MOVE, {"Angles °": "1, 2, x, 4, 5"}, "Angles °: 'x' is not a number"),
        (POINT, {"Point mm": ""}, "Point mm: 3 numbers are needed"),
        (POINT, {"Pitch °": "up"}, "Pitch °: 'up' is not a number"),
        (POINT, {"Blend mm": ""}, "Blend mm is empty; type a number"),
        (POINT, {"Blend mm": "-1"}, "Blend mm: must be 0 … 1000, not -1"),
        (POINT, {"Profile": "fast"}, "Profile: must be one of .*'cubic'.*, not 'fast'"),
        (
            POINT,
            {"Duration s": "nan"},
            "Duration s: 'nan' is not a number that can be used; it must be within",
        ),
        (LINE, {"Tool speed mm/s": "0"}, "Tool speed mm/s: must be more than 0"),
        (GripperStep(open_percent=1), {"Part mm": "20 × 30"}, "Part mm: 3 numbers are needed"),
        (GripperStep(open_percent=1), {"Part mm": "20, 0, 3"}, "Part mm: must be 0.1 … 1000, not 0"),
        (WaitStep(seconds=1), {"Wait time s": "90000"}, "Wait time s: must be 0 … 86400, not 90000"),
        (RepeatStep(times=2), {"Times": "2.5"}, "Times: 2.5 is not a whole number"),
        (RepeatStep(times=2), {"Times": "0"}, "Times: must be 1 … 1000000, not 0"),
    ],
)
def test_what_cannot_be_is_refused_by_its_field(step: Step, changes: dict[str, str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        edited(step, texts(step, **changes))


def test_a_point_is_chosen_by_torque_only_where_masses_of_links_are_known() -> None:
    uzuner = load_robot("uzuner")
    bare = replace(uzuner, gravity=replace(uzuner.gravity, bodies=()))
    for robot, offered in ((uzuner, CRITERIA), (bare, CRITERIA[:-1])):
        html = StepEdit("1", more=True).html(POINT, robot)
        (choice,) = re.findall("<label[^>]*>Choose by</label><select.*?</select>", html)
        assert tuple(re.findall("<option[^>]*>(.*?)</option>", choice)) == offered


def test_a_field_that_is_refused_keeps_what_is_typed_and_the_others_are_saved() -> None:
    edit, robot = StepEdit("1"), load_robot("uzuner")
    assert edit.take(POINT, "Blend mm", "-1") is POINT
    assert edit.refusals == {"Blend mm": "Blend mm: must be 0 … 1000, not -1.0"}
    html = edit.html(POINT, robot)
    assert "value='-1'" in html and "must be 0 … 1000, not −1.0</em>" in html
    assert html.count("aria-invalid") == 1 and "Discard" in html
    step = edit.take(POINT, "Duration s", "1,5")
    assert step == msgspec.structs.replace(POINT, duration_s=1.5)
    assert edit.refusals and edit.typed == {"Blend mm": "-1"}
    step = edit.take(step, "Blend mm", "2")
    assert step == msgspec.structs.replace(POINT, duration_s=1.5, blend_mm=2)
    assert not edit.refusals and "Discard" not in edit.html(step, robot)


def test_fields_that_are_right_only_together_are_saved_together() -> None:
    """Of six joints: an orientation is interpolated to one that is given."""
    edit, step = StepEdit("1"), msgspec.structs.replace(LINE, note="<b>'\"")
    for label, text in (("Tool orientation", "interpolated"), ("Rx Ry Rz °", "180, 0, −90")):
        step = edit.take(step, label, text)
    assert (step.orientation, step.rx_deg, step.rz_deg) == ("interpolated", 180, -90)
    assert "<b>" not in edit.html(step, load_robot("ur5"))


def offered(html: str, label: str) -> list[str]:
    (choice,) = re.findall(f"<label[^>]*>{label}</label><select.*?</select>", html)
    return re.findall("<option[^>]*>(.*?)</option>", choice)


def test_names_are_offered_where_there_are_any(tmp_path: Path) -> None:
    robot, call, pick = robot_with(tmp_path), CallStep(program="gone"), PickStep(x_mm=1, y_mm=2, z_mm=3)
    html = StepEdit("1").html(call, robot, KnownNames(saved=["grip", "turn"]))
    assert offered(html, "Program") == ["grip", "turn", "gone"]
    assert "<select" not in StepEdit("1").html(call, robot)
    html = StepEdit("1", more=True).html(pick, robot)
    assert offered(html, "Output") == ["–", "lamp", "pump", "bell"]
    assert offered(html, "Part input") == ["–", "button", "door", "knob"]
    assert offered(html, "Along") == ["base", "tool"]
    taken = StepEdit("1").take(pick, "Output", "pump")
    assert isinstance(taken, PickStep) and taken.output == "pump"
    html = StepEdit("1").html(MessageStep(text="<b>Ready?</b>"), robot)
    assert "<b>" not in html and offered(html, "Goes on") == ["at OK", "at once"]


def test_what_is_wrong_with_the_step_is_said_below_its_fields(tmp_path: Path) -> None:
    robot, edit = robot_with(tmp_path), StepEdit("1")
    step = IfStep(watch="load")
    assert "Load of which joint?" in edit.html(step, robot)
    assert offered(edit.html(step, robot), "Watch")[:4] == ["button", "door", "knob", "load"]
    assert list(texts_of(IfStep(watch="button")))[:3] == ["Watch", "Compare", "Value"]
    assert "Counter" in texts_of(IfStep(watch="counter")) and "Counter" not in texts_of(step)
    step = edit.take(step, "Joint", "elbow")
    assert "Joint" in texts_of(msgspec.structs.replace(step, watch="button"))  # it is wrong there
    assert "compare it above or below" in edit.html(step, robot)
    step = edit.take(step, "Compare", "above")
    assert "<em" not in edit.html(step, robot)
    assert edit.take(step, "Value", "much") is step
    assert edit.html(step, robot).count("<em") == 1  # only the field's own


def test_a_place_has_a_button_that_puts_the_tool_there(tmp_path: Path) -> None:
    robot, grid = robot_with(tmp_path), step_here(GridStep, load_robot("uzuner"), cast(Snapshot, HERE))
    html = StepEdit("7").html(grid, robot)
    assert re.findall("aria-label='([^']*): where the tool is now'", html) == [
        "First cell mm", "Row end mm", "Column end mm"
    ]  # fmt: skip
    assert "data-do=step-touch data-key=7.0 " in html and html.count("<label") == 3 * 3 + 3
    drawn = StepEdit("7").html(
        DrawStep(file="/p/b.svg", plane_mm=(0.0,) * 9), robot, KnownNames(drawings=["/p/a.svg", "/p/b.svg"])
    )
    assert offered(drawn, "File") == ["a.svg", "b.svg"] and "<option value='/p/a.svg'>" in drawn


def test_a_place_and_the_joints_have_a_box_for_each_number_and_the_others_keep_all_digits() -> None:
    robot, point = load_robot("uzuner"), PointStep(x_mm=200, y_mm=-80.12345, z_mm=140)
    html = StepEdit("7").html(point, robot)
    assert re.findall("<label[^>]*>(.*?)</label>", html) == ["X mm", "Y mm", "Z mm", "Duration s", "Note"]
    assert re.findall("value='(.*?)'", html)[:3] == ["200.0", "−80.123", "140.0"]
    edit = StepEdit("7")
    assert edit.take_part(point, "Point mm", "y_mm", "−80.123", robot) is point  # as it was shown
    assert edit.take_part(point, "Point mm", "x_mm", " -12,5", robot) == msgspec.structs.replace(
        point, x_mm=-12.5
    )
    assert edit.take_part(point, "Point mm", "w_mm", "1", robot) is point
    html = StepEdit("7").html(MOVE, robot)
    joints = [f"{joint.title} °" for joint in robot.joints]
    assert re.findall("<label[^>]*>(.*?)</label>", html) == [*joints, "Duration s", "Note"]
    moved = edit.take_part(MOVE, "Angles °", "1", "45", robot)
    assert moved == msgspec.structs.replace(MOVE, joints_deg=(0.12345, 45, -80, -40, 0))
    short = MoveStep(joints_deg=(1, 2))  # of another arm: as one text
    assert "value='1, 2'" in edit.html(short, robot) and "Angles °" in edit.html(short, robot)


def test_a_box_that_is_refused_keeps_what_is_typed_beside_those_that_count() -> None:
    robot, edit = load_robot("uzuner"), StepEdit("7")
    assert edit.take_part(POINT, "Point mm", "y_mm", "wide", robot) is POINT
    html = edit.html(POINT, robot)
    assert "value='wide'" in html and "value='200.0'" in html and "Discard" in html
    assert html.count("aria-invalid") == 1 and "Y mm: 'wide' is not a number</em>" in html.replace(
        "&#x27;", "'"
    )
    taken = edit.take_part(POINT, "Point mm", "y_mm", "3", robot)
    assert taken == msgspec.structs.replace(POINT, y_mm=3) and not edit.refusals and not edit.typed


def test_what_is_seldom_needed_is_folded_away_until_something_stands_there() -> None:
    robot, blended = load_robot("uzuner"), msgspec.structs.replace(POINT, blend_mm=5)
    assert "Blend mm" not in StepEdit("7").html(POINT, robot)
    assert "Blend mm" not in StepEdit("7").html(msgspec.structs.replace(POINT, note="above"), robot)
    assert "Blend mm" in StepEdit("7").html(blended, robot)
    assert "Blend mm" not in StepEdit("7", more=False).html(blended, robot)
    assert "Blend mm" in StepEdit("7", more=True).html(POINT, robot)
    edit = StepEdit("7", more=False)
    edit.take(POINT, "Blend mm", "x")
    assert "Blend mm" in edit.html(POINT, robot)  # with its reason
    html = StepEdit("7").html(EndStep(), robot)
    assert "Note" in html and "step-more" not in html  # it has nothing else

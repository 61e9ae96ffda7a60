"""Where the arm is, in figures, and what whole steps of a board mean at the tool."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Coroutine
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.runtime.kit import make_rig

from armctl.arrays import FloatArray
from armctl.facts import State
from armctl.hardware.boards import board_type
from armctl.motion import plan_line
from armctl.robot import Robot, load_robot
from armctl.ui.bar import AskingButton, take_html, warning_lines, way_out, where_html
from armctl.ui.scene.ghost import NEAREST
from armctl.ui.tabs.manual.joints import joint_steps, rounding_note, rounding_off_m

SERVO_ARMS = ("uzuner", "abaas", "mico", "humanoid")


def rounded(robot: Robot, q: FloatArray) -> float:
    """How far the tool point is off once every setpoint is a whole step [m]."""
    outputs, scale = robot.output_map, board_type(robot.board).scale
    assert outputs is not None
    sent = {channel: round(value / scale.step) * scale.step for channel, value in outputs.outputs(q).items()}
    return float(np.linalg.norm(robot.forward(outputs.angles(sent))[:3, 3] - robot.forward(q)[:3, 3]))


@pytest.mark.parametrize("name", SERVO_ARMS)
def test_a_rounded_setpoint_is_never_farther_off_than_the_note_says(name: str) -> None:
    robot = load_robot(name)
    poses = np.random.default_rng(61).uniform(*robot.limits.T, (300, robot.n))
    shares = [rounded(robot, q) / rounding_off_m(robot, q) for q in poses]
    assert 0.5 < max(shares) <= 1.001  # near the bound; of second order: the steps are not infinitely small


def test_the_figures_are_those_of_the_arm_and_its_board_and_a_finer_servo_is_nearer() -> None:
    robot = load_robot("uzuner")
    q = robot.pose("home")
    told = rounding_note(robot, q)
    steps = np.degrees(joint_steps(robot))
    assert "Servo steps of" in told and "(0.25 µs)" in told
    assert f"{steps.max():.3f}°" in told
    assert f"up to {1000 * rounding_off_m(robot, q):.2f} mm beside its target" in told
    abaas = load_robot("abaas")
    assert "(1 µs)" in rounding_note(abaas, abaas.pose("home"))
    ur5 = load_robot("ur5")  # its simulated board stands for no real one
    assert rounding_note(ur5, ur5.pose("home")) == ""
    scorbot = load_robot("scorbot")
    assert re.search(r"Encoder steps of .*\(1 count\)", rounding_note(scorbot, scorbot.pose("home")))
    robot, humanoid = load_robot("uzuner"), load_robot("humanoid")
    assert robot.output_map is not None
    finer = replace(robot, output_map=replace(robot.output_map, per_rad=4 * robot.output_map.per_rad))
    q = robot.pose("home")
    assert rounding_off_m(finer, q) == pytest.approx(rounding_off_m(robot, q) / 4)
    held = [joint.lower == joint.upper for joint in humanoid.joints]
    assert any(held)
    assert (joint_steps(humanoid) == 0).tolist() == held


def test_a_kept_orientation_reads_the_same_all_along_a_line() -> None:
    robot = load_robot("ur5")
    home = robot.pose("home")
    line = plan_line(robot, home, robot.forward(home)[:3, 3] + [0.0, 0.08, 0.0], orientation="kept")
    told = {
        re.search("Rx <small>.*?Pitch <small>", where_html(robot, q))
        for q in line.sample(np.linspace(0, line.duration, 9)).q
    }
    assert len({one[0] for one in told if one}) == 1 and None not in told
    assert "Roll" not in where_html(robot, home)
    uzuner = load_robot("uzuner")
    assert "Roll" in where_html(uzuner, uzuner.pose("home")) and "Rx" not in where_html(
        uzuner, uzuner.pose("home")
    )


def test_what_a_program_waits_for_is_a_state_and_neither_a_fault_nor_a_warning() -> None:
    warnings = ("the supply is low", "waiting for button = 1", "overload")
    shown = replace(make_rig().controller.snapshot, warnings=warnings, awaited=(1,), told_by_cause=(2,))
    assert warning_lines(shown) == [
        "<p class='warn'>⚠ the supply is low</p>",
        "<p class='waits'>Waiting for button = 1.</p>",
    ]


def test_a_fault_is_told_once_and_beside_the_state_stands_what_to_do() -> None:
    fault = replace(make_rig().enable().now, state=State.FAULT, cause="the line is gone")
    assert fault.board is not None and way_out(fault) == "clear the fault, then enable"
    assert way_out(replace(fault, board=None)) == "connect again in Main"
    assert way_out(replace(fault, board=None, unreachable=True)) == "the arm does not answer"
    assert way_out(replace(fault, state=State.HOLDING)) == ""


def test_where_nobody_knows_the_pose_no_number_is_shown_for_it() -> None:
    robot = load_robot("uzuner")
    q = robot.pose("rest")
    unknown = where_html(robot, q, now=None)
    assert "not known" in unknown and re.search(r"\d", unknown) is None
    looked = where_html(robot, q, robot.pose("home"), now=None, kind="looked")
    assert "looked at" in looked and "not known" not in looked
    assert "<th class='looked'>nearest</th>" in where_html(robot, q, robot.pose("home"), kind=NEAREST)
    assert looked.count("<td class='looked'>") == robot.n + 5 and looked.count("<td>") == 1
    assert "<th>Shoulder <small>°</small></th><td>110.0</td>" in where_html(robot, q)


def test_take_control_asks_in_its_own_button_and_keeps_its_name() -> None:
    assert "asks" not in take_html("Ada", asks=False)
    asked = take_html("A<da", asks=True)
    assert "class='asks'" in asked and "aria-label='Take control'" in asked
    assert "Take it from A&lt;da? Press again</button>" in asked and "<da" not in asked


def test_a_button_that_asks_acts_when_pressed_again_and_forgets_its_question(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def over(_: float) -> None: ...

    monkeypatch.setattr(asyncio, "sleep", over)
    asyncio.run(_ask_and_forget())


async def _ask_and_forget() -> None:
    forgetting: list[Coroutine[Any, Any, None]] = []
    drawn: list[bool] = []
    asking = AskingButton(forgetting.append, lambda: drawn.append(asking.asked))
    assert not asking.answered() and asking.asked
    assert asking.answered() and not asking.asked
    assert not asking.answered(said=False) and asking.asked
    assert not asking.answered(said=False) and asking.asked, "the button did not ask yet"
    assert not asking.answered(after_s=10.0) and asking.asked, "half of a double click"
    *older, last = forgetting
    for forget in older:
        await forget
        assert asking.asked, "pressed since"
    await last
    assert not asking.asked
    assert drawn == [True, True, True, True, False]

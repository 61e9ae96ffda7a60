"""Pick and place: made of steps that there are, checked part by part, and run as was foretold."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from tests.program.kit import program
from tests.runtime.kit import ROBOT, TICK, make_rig
from tests.runtime.signal_kit import BELL, DOOR, bench_of, robot_with

from armctl.errors import ProgramError
from armctl.facts import CalledStep, InStep, OnPath, PathTurn, State
from armctl.motion import Finding, plan
from armctl.motion.paths import tool_path
from armctl.motion.paths.tool_walk import StepBudget, Walk
from armctl.program import (
    CalledProgram,
    CallStep,
    EndStep,
    GridStep,
    GripperStep,
    IfStep,
    LineStep,
    MoveStep,
    PickStep,
    PlaceStep,
    PointStep,
    Program,
    SetStep,
    Step,
    WaitForStep,
    WaitStep,
    check_program,
    decode_program,
    encode_program,
    read_csv,
    write_csv,
    write_script,
)
from armctl.program.rehearsal import Rehearsal, pose_after, rehearse
from armctl.protocol import RunProgram
from armctl.robot import Robot, load_robot

HERE = {"x_mm": 190.0, "y_mm": -80.0, "z_mm": 90.0}
THERE = {"x_mm": 180.0, "y_mm": 80.0, "z_mm": 90.0}
PICK = PickStep(**HERE, ready_percent=80, close_percent=20)
PLACE = PlaceStep(**THERE)
HOME = MoveStep(joints_deg=(0, 90, -80, -40, 0))


def tips(robot: Robot, found: Rehearsal) -> list[tuple[str, list[float]]]:
    """Where each part leads the tool [mm]."""
    ends = ((step.place.part, robot.forward(step.trajectory.end)[:3, 3]) for step in found.steps)
    return [(part, np.round(1000 * tip, 3).tolist()) for part, tip in ends]


def errors(robot: Robot, *steps: Step) -> list[Finding]:
    found = check_program(program(*steps), robot, start=robot.pose("home"))
    return [one for one in found if one.severity == "error"]


# What it is made of.


def test_it_is_made_of_steps_that_there_are() -> None:
    full = PickStep(
        **HERE, ready_percent=80, close_percent=20, part_x_mm=10, part_y_mm=10, part_z_mm=10, seconds=0.2,
        part_input="held", retreat_mm=70, speed_mm_s=50,
    )  # fmt: skip
    names, steps = zip(*full.parts, strict=True)
    assert names == ("open", "approach", "down", "grip", "settle", "held", "retreat")
    assert steps[0] == GripperStep(open_percent=80)
    assert steps[2] == LineStep(**HERE, speed_mm_s=50)
    assert steps[3] == GripperStep(open_percent=20, part_x_mm=10, part_y_mm=10, part_z_mm=10)
    assert steps[4:6] == (WaitStep(seconds=0.2), WaitForStep(watch="held", timeout_s=2))
    assert steps[6] == LineStep(**{**HERE, "z_mm": 160}, speed_mm_s=50)
    sucked = PlaceStep(**HERE, output="vacuum", part_input="held", otherwise="go on")
    names, steps = zip(*sucked.parts, strict=True)
    assert names == ("approach", "down", "let go", "gone", "retreat")
    assert steps[2] == SetStep(output="vacuum", value=0)
    assert steps[3] == WaitForStep(watch="held", value=0, timeout_s=2, otherwise="go on")


def test_the_way_is_straight_and_on_one_branch() -> None:
    found = rehearse(ROBOT, program(PICK, PLACE), ROBOT.pose("home"), 0.5)
    assert tips(ROBOT, found)[1:] == [
        ("approach", [190, -80, 140]), ("down", [190, -80, 90]), ("grip", [190, -80, 90]),
        ("retreat", [190, -80, 140]), ("approach", [180, 80, 140]), ("down", [180, 80, 90]),
        ("let go", [180, 80, 90]), ("retreat", [180, 80, 140]),
    ]  # fmt: skip
    down = found.steps[2].trajectory
    points = 1000 * ROBOT.forward(down.sample(np.linspace(0, down.duration, 50)).q)[:, :3, 3]
    np.testing.assert_allclose(points[:, :2], [[190, -80]] * 50, atol=0.02)
    np.testing.assert_allclose(found.steps[4].trajectory.end, found.steps[1].trajectory.end, atol=1e-6)


@pytest.mark.parametrize("pitch", [None, -70.0])
@pytest.mark.parametrize("name", ["uzuner", "ur5"])
def test_along_the_tool_it_comes_and_goes_on_the_axis_of_the_tool(name: str, pitch: float | None) -> None:
    robot = load_robot(name)
    at = (
        {"x_mm": 210.0, "y_mm": -60.0, "z_mm": 60.0}
        if name == "uzuner"
        else {"x_mm": 450.0, "y_mm": 100.0, "z_mm": 250.0}
    )
    turned: dict[str, Any] = {"pitch_deg": pitch}
    if name == "ur5":
        turned = {} if pitch is None else {"rx_deg": 160.0, "ry_deg": 10.0, "rz_deg": 0.0}
    step = PlaceStep(**at, along="tool", approach_mm=20, output="x", **turned)
    path = [part for part in step.parts if part[0] != "let go"]
    assert [name for name, _ in path] == ["approach", "down", "retreat"]
    q = robot.pose("home")
    ends = []
    for _, part in path:
        q = part.plan(robot, q).end  # type: ignore[attr-defined]
        ends.append(robot.forward(q))
    high, low, away = ends
    np.testing.assert_allclose(1000 * low[:3, 3], list(at.values()), atol=0.01)
    np.testing.assert_allclose(1000 * (low[:3, 3] - high[:3, 3]), 20 * low[:3, 2], atol=0.02)
    np.testing.assert_allclose(away, high, atol=1e-4)


def test_in_a_grid_it_is_at_each_cell() -> None:
    grid = GridStep(
        x_mm=180, y_mm=10, z_mm=80, row_x_mm=180, row_y_mm=70, row_z_mm=80,
        column_x_mm=210, column_y_mm=10, column_z_mm=80, rows=2, columns=2,
    )  # fmt: skip
    to_cell = PlaceStep(x_mm=0, y_mm=0, z_mm=5, approach_mm=30, frame="cell")
    found = rehearse(ROBOT, program(HOME, grid, to_cell, EndStep()), ROBOT.pose("home"), 0.5)
    down = [tip for part, tip in tips(ROBOT, found) if part == "down"]
    assert down == [[180, 10, 85], [180, 70, 85], [210, 10, 85], [210, 70, 85]]
    assert [tip[2] for part, tip in tips(ROBOT, found) if part == "retreat"] == 4 * [115]
    far = GridStep(
        x_mm=180, y_mm=10, z_mm=80, row_x_mm=180, row_y_mm=70, row_z_mm=80,
        column_x_mm=600, column_y_mm=10, column_z_mm=80, rows=2, columns=2,
    )  # fmt: skip
    one = errors(ROBOT, HOME, far, to_cell, EndStep())[0]
    assert one.step == 2 and isinstance(one.reason, InStep) and one.reason.doing == "approach"
    assert "step 3: approach: " in str(one) and "cell 3" in str(one)


def test_it_is_written_and_read_and_a_script_calls_it() -> None:
    whole = program(PICK, PlaceStep(**THERE, along="tool", pitch_deg=-30, part_input="held", frame=None))
    assert decode_program(encode_program(whole)) == whole
    assert read_csv(write_csv(whole, ROBOT), ROBOT, "pick") == whole
    script = write_script(whole)
    assert "arm.pick(x_mm=190.0, y_mm=-80.0, z_mm=90.0, ready_percent=80, close_percent=20)" in script
    assert "along='tool', pitch_deg=-30, part_input='held')" in script


def test_where_it_leads_is_known_of_the_whole_step() -> None:
    end = pose_after(ROBOT, program(HOME, PICK, HOME), 1, ROBOT.pose("home"))
    assert end is not None
    np.testing.assert_allclose(1000 * ROBOT.forward(end)[:3, 3], [190, -80, 140], atol=0.01)


# What is refused.


def test_what_grips_must_be_there(tmp_path: Path) -> None:
    robot = robot_with(tmp_path)
    for step, what in (
        (PlaceStep(**HERE, output="vacuum"), "has no output 'vacuum'"),
        (PickStep(**HERE, part_input="held"), "has no input 'held'"),
        (
            PickStep(**HERE, output="bell", part_x_mm=1, part_y_mm=1, part_z_mm=1),
            "counts between the jaws",
        ),
        (PickStep(**HERE, part_x_mm=10), "the size of a part needs all of"),
        (PickStep(**HERE, rx_deg=1), "an orientation needs all of"),
    ):
        (one,) = errors(robot, step)
        assert one.step == 0 and what in one.what
    bare = load_robot("ur5")
    assert bare.gripper is None
    (one,) = check_program(program(PickStep(**HERE), robot="ur5"), bare)
    assert one.what == "ur5 has no gripper: say by which output it grips"


def test_each_part_that_cannot_be_is_named() -> None:
    (one,) = errors(ROBOT, HOME, PickStep(x_mm=900, y_mm=0, z_mm=0))
    assert one.step == 1 and isinstance(one.reason, InStep) and one.reason.doing == "approach"
    sunk = errors(ROBOT, HOME, PickStep(x_mm=200, y_mm=0, z_mm=-20))
    assert {one.reason.doing for one in sunk if isinstance(one.reason, InStep)} >= {"down"}
    high = errors(ROBOT, HOME, PickStep(**HERE, retreat_mm=400))
    assert [one.reason.doing for one in high if isinstance(one.reason, InStep)] == ["retreat"]


def test_a_pick_in_a_called_program_on_one_branch_is_found(tmp_path: Path) -> None:
    robot = robot_with(tmp_path)
    inside = (HOME, IfStep(watch="button"), PickStep(x_mm=200, y_mm=0, z_mm=-20), EndStep())
    called = CalledProgram(file="take.toml", robot="uzuner", steps=inside)
    steps = (HOME, IfStep(watch="button", value=0), CallStep(program="take"), EndStep())
    whole = Program(robot="uzuner", name="main", steps=steps, called=(called,))
    found = check_program(whole, robot, start=robot.pose("home"))
    one = next(one for one in found if one.severity == "error")
    assert one.step == 2 and isinstance(one.reason, InStep) and isinstance(one.reason.reason, OnPath)
    assert (one.reason.calls, one.reason.doing) == ((CalledStep("take", 2),), "down")
    assert one.reason.reason.turns == (PathTurn(1, "then"), PathTurn(1, "then", 0, "take"))
    assert str(one).startswith("step 3: in 'take', step 3, down: ")


# How it runs.


def test_it_runs_as_was_foretold_and_tells_its_parts() -> None:
    rig = make_rig().enable(ROBOT.pose("home"))
    whole = program(PickStep(**HERE, ready_percent=80, close_percent=20, seconds=0.5, speed_mm_s=40), PLACE)
    foretold = rehearse(ROBOT, whole, ROBOT.pose("home"), rig.now.gripper or 0.5)
    begun, ticket = rig.clock.now(), rig.do(RunProgram(whole))
    rig.rests()
    ticket.result(0)
    assert rig.clock.now() - begun == pytest.approx(foretold.duration, abs=3 * TICK)
    seen = [(s.program.step, s.program.part) for s in rig.history if s.program is not None]
    assert [here for here, _ in groupby(seen)] == [(step.index, step.place.part) for step in foretold.steps]
    assert rig.now.gripper == 1.0


@pytest.mark.parametrize("otherwise", ["stop", "go on"])
def test_a_part_that_is_not_held_in_time(otherwise: str, tmp_path: Path) -> None:
    robot = robot_with(tmp_path)
    bench = bench_of(robot)
    step = PickStep(**HERE, output="bell", part_input="door", timeout_s=0.5, otherwise=otherwise)  # type: ignore[arg-type]
    ticket = bench.do(RunProgram(program(HOME, step, HOME)))
    while bench.now.state is State.MOVING:
        bench.run(TICK)
    assert bench.now.outputs["bell"] == 1.0 and bench.board.channel(BELL).position >= 6000
    tip = 1000 * robot.forward(bench.now.q_command)[:3, 3]
    if otherwise == "stop":
        with pytest.raises(ProgramError, match=r"pick: step 2: held: waited 0\.5 s for door = 1"):
            ticket.finished.result(0)
        np.testing.assert_allclose(tip, [190, -80, 90], atol=0.1)
    else:
        ticket.finished.result(0)
        assert any("step" in event.text or "door" in event.text for event in bench.now.events)


def test_a_part_that_is_held_is_lifted(tmp_path: Path) -> None:
    bench = bench_of(robot_with(tmp_path))
    bench.board.levels[DOOR] = 1.0
    ticket = bench.do(RunProgram(program(HOME, PickStep(**HERE, output="bell", part_input="door"))))
    while bench.now.state is State.MOVING:
        bench.run(TICK)
    ticket.finished.result(0)


def test_the_part_counts_until_it_is_put_down() -> None:
    part = {"part_x_mm": 20.0, "part_y_mm": 20.0, "part_z_mm": 60.0}
    found = rehearse(ROBOT, program(PickStep(**HERE, **part), PLACE), ROBOT.pose("home"), 0.5)
    carried = [(step.index, step.place.part) for step in found.steps if step.part is not None]
    assert carried[0] == (0, "grip") and (1, "down") in carried and (1, "retreat") not in carried
    low = PlaceStep(**{**THERE, "z_mm": 20})
    (one,) = errors(ROBOT, PickStep(**HERE, **part), low)[:1]
    assert one.step == 1 and isinstance(one.reason, InStep) and "carried part" in str(one)


@pytest.mark.parametrize(
    "pick",
    [
        PickStep(x_mm=200, y_mm=0, z_mm=60, approach_mm=400),
        PickStep(x_mm=220, y_mm=-60, z_mm=30, approach_mm=350, along="tool"),
    ],
)
def test_of_all_ways_that_cannot_be_one_is_explained(pick: PickStep, monkeypatch: pytest.MonkeyPatch) -> None:
    """Why a way cannot be takes twenty times as long to say as whether it can."""
    explained, walked = list[object](), list[int]()
    follow, walk = tool_path.follow, tool_path.walk

    def counted(*given: Any, effort: StepBudget | None = None, **more: Any) -> Walk:
        found = walk(*given, effort=effort, **more)
        walked.append(sum(found.tries))
        return found

    monkeypatch.setattr(plan, "follow", lambda *given: explained.append(given) or follow(*given))
    monkeypatch.setattr(tool_path, "walk", counted)
    (error,) = errors(ROBOT, pick)
    assert "of the line" in error.what and len(explained) == 1
    assert sum(walked) < 4000  # a millisecond each


def test_a_point_that_only_the_pitch_forbids_says_so() -> None:
    for step in (
        PickStep(x_mm=190, y_mm=-80, z_mm=60, pitch_deg=-40),
        PointStep(x_mm=190, y_mm=-80, z_mm=60, pitch_deg=-40),
    ):
        (error,) = errors(ROBOT, step)
        assert (
            "the arm reaches this point, but not with that pitch: leave the pitch empty; within" in error.what
        )
        assert not errors(ROBOT, replace(step, pitch_deg=None))
    (error,) = errors(ROBOT, PickStep(x_mm=400, y_mm=0, z_mm=60, pitch_deg=-40))
    assert "empty" not in error.what


@pytest.mark.parametrize(
    ("pitch", "roll", "without"),
    [(-40, 10, "pitch"), (-80, 170, "roll"), (-40, 170, "pitch and roll")],
)
def test_what_is_to_be_left_empty_is_what_frees_the_tool(pitch: float, roll: float, without: str) -> None:
    step = PointStep(x_mm=190, y_mm=-80, z_mm=60, pitch_deg=pitch, roll_deg=roll)
    (error,) = errors(ROBOT, step)
    assert f"not with that {without}: leave the {without} empty" in error.what
    freer = {"pitch_deg": None} if without != "roll" else {}
    freer |= {"roll_deg": None} if without != "pitch" else {}
    assert not errors(ROBOT, replace(step, **freer))

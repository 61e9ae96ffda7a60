"""The page of a planned motion: what it holds. Browsers: ``tests/browser/test_twin_in_browser.py``."""

from __future__ import annotations

import base64
import json
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.robot.test_tools import arm_with_tools

from armctl.errors import ArmctlError, ProgramError
from armctl.facts import Said
from armctl.motion.preflight import Finding
from armctl.program import (
    EndStep,
    GripperStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    RepeatStep,
    SpeedStep,
    Step,
    ToolStep,
    WaitStep,
    check_program,
)
from armctl.program.rehearsal import Rehearsal, rehearse_pose
from armctl.robot import CarriedPart, Robot, load_robot
from armctl.ui.twin_file import planned_for_file, program_file, twin_file

ROBOT = load_robot("uzuner")
POINT = PointStep(x_mm=220, y_mm=-60, z_mm=120, blend_mm=10)
LINE = LineStep(x_mm=220, y_mm=60, z_mm=120, pitch="free")
MOVES = (MoveStep(joints_deg=(60, 60, -40, -40, 20)), POINT, LINE)


def program(*steps: Step, name: str = "mine") -> Program:
    return Program(robot="uzuner", name=name, steps=steps)


def page_of(what: Program, robot: Robot = ROBOT) -> tuple[Rehearsal, str, dict[str, Any]]:
    """Plan, page, and the numbers in it."""
    plan = planned_for_file(robot, what, robot.first_pose, None)
    page = program_file(robot, what, plan, check_program(what, robot, start=robot.first_pose))
    (data,) = re.findall(r"<script id='twin-data' type='application/json'>(.*?)</script>", page)
    return plan, page, json.loads(data)


def columns_of(data: dict[str, Any]) -> np.ndarray:
    """The columns as the player makes them."""
    packed = np.frombuffer(zlib.decompress(base64.b64decode(data["columns"])), np.uint8)
    low, high = packed.reshape(-1, 2, data["frames"]).astype(np.uint16).transpose(1, 0, 2)
    words = np.cumsum(low + 256 * high, axis=1, dtype=np.uint16)
    ranges = np.array(data["ranges"])
    return ranges[:, :1] + ranges[:, 1:] * words


def test_the_motion_in_the_page_is_the_planned_one() -> None:
    plan, _, data = page_of(program(*MOVES, GripperStep(open_percent=0), WaitStep(seconds=0.5)))
    columns = columns_of(data)
    times = np.linspace(0, plan.duration, data["frames"])
    assert data["duration"] == plan.duration and 29 < data["frames"] / plan.duration < 32
    state = plan.trajectory.sample(times)
    assert np.abs(columns[-11:-6].T - np.degrees(state.q)).max() < 0.01
    assert np.abs(columns[-6:-1].T - np.degrees(state.velocity)).max() < 0.01
    first = dict(data["tracks"])["/arm/tool"]
    poses = ROBOT.forward(state.q)
    assert np.abs(columns[first : first + 3].T - poses[:, :3, 3]).max() < 1e-5
    w, x, y, z = columns[first + 3 : first + 7]
    approach = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    assert np.abs(approach.T - poses[:, :3, 2]).max() < 2e-4
    jaws = [first for name, first in data["tracks"] if "/jaw" in name]
    assert len(jaws) == 2 and np.ptp(columns[jaws[0] : jaws[0] + 7]) > 0.01  # from half open to closed
    assert [begins for begins, _ in data["steps"]] == [step.begins for step in plan.steps]
    assert data["steps"][2][1].startswith("Step 3 of 5: line 220, 60, 120 mm")


def test_what_is_carried_is_shown_from_when_it_is_gripped() -> None:
    small, large = (
        GripperStep(open_percent=30, part_x_mm=20, part_y_mm=one, part_z_mm=20) for one in (20, 30)
    )
    let_go = GripperStep(open_percent=100)
    plan, _, data = page_of(program(MOVES[0], small, POINT, let_go, LINE, large, small))
    begins = [step.begins for step in plan.steps]
    part = "/arm/tool/part"
    assert [begin for begin, _ in data["parts"]] == [0.0, begins[1], begins[3], begins[5], begins[6]]
    assert [name for _, name in data["parts"]] == ["", f"{part}0", "", f"{part}1", f"{part}0"]
    held = ROBOT.carrying(CarriedPart((20, 20, 20)))
    plan = rehearse_pose(held, ROBOT.pose("home"), ROBOT.pose("rest"), 0.5)
    carried = twin_file(ROBOT, "to rest", plan, ())
    assert re.search(r'"parts":\[\[0\.0,""\],\[0\.0,"/arm/tool/part0"\]\]', carried)


def test_each_tool_is_drawn_while_it_is_on(tmp_path: Path) -> None:
    robot = arm_with_tools(tmp_path)
    part = GripperStep(open_percent=30, part_x_mm=20, part_y_mm=20, part_z_mm=20)
    pump = GripperStep(open_percent=0, part_x_mm=20, part_y_mm=20, part_z_mm=20)
    steps = (part, MOVES[0], GripperStep(open_percent=100), ToolStep(tool="cup"), pump, MOVES[0], LINE)
    plan, _, data = page_of(program(*steps), robot)
    begins = [step.begins for step in plan.steps]
    assert data["tools"] == [[0.0, "/arm"], [begins[3], "/arm1"]]
    assert [name for _, name in data["parts"]] == ["", "/arm/tool/part0", "", "/arm1/tool/part1"]
    columns, times = columns_of(data), np.linspace(0, plan.duration, data["frames"])
    state = plan.trajectory.sample(times)
    for name, tool in (("/arm", "jaws"), ("/arm1", "cup")):
        first = dict(data["tracks"])[f"{name}/tool"]
        tips = robot.with_tool(tool).forward(state.q)[:, :3, 3]
        assert np.abs(columns[first : first + 3].T - tips).max() < 1e-5
    late = times > begins[-1]
    cup = robot.with_tool("cup")
    speed = np.einsum("kij,kj->ki", cup.jacobian(state.q)[:, :3], state.velocity)
    assert np.abs(columns[-1] - 1000 * np.linalg.norm(speed, axis=1))[late].max() < 0.1


def test_two_minutes_fit_into_two_megabytes_and_nothing_may_be_fetched() -> None:
    plan, page, _ = page_of(program(SpeedStep(percent=20), RepeatStep(times=8), *MOVES, EndStep()))
    assert plan.duration > 120
    assert len(page.encode()) < 1.5e6
    begin = r"<!doctype html>\s*<html[^>]*>\s*<head><meta http-equiv=\"Content-Security-Policy\" "
    begin += r"content=\"(.*?)\">"
    policy = re.match(begin, page, re.IGNORECASE)
    assert policy is not None and "default-src 'none'" in policy[1]
    assert "http" not in policy[1] and "'self'" not in policy[1] and "*" not in policy[1]


def test_findings_and_names_are_shown_as_text() -> None:
    stretched = MoveStep(joints_deg=(0, 0, 0, 0, 0), note="</script><b>")
    plan, page, data = page_of(program(MOVES[0], stretched, name="<img src=x> & co"))
    assert "<h1>&lt;img src=x&gt; &amp; co</h1>" in page and "<img" not in page.split("</aside>")[0][-90000:]
    begins = plan.steps[1].begins
    assert re.search(
        rf"<li class='warning'><button type='button' data-time='{begins}'>⚠ step 2: .*singularity", page
    )
    assert len(data["steps"]) == 2


def test_a_program_that_breaks_off_is_shown_as_far_as_it_goes() -> None:
    what = program(*MOVES, LineStep(x_mm=-200, y_mm=0, z_mm=120, pitch="free"))
    plan, page, _ = page_of(what)
    assert plan.broken is not None and len(plan.steps) == 3
    assert re.search(r"<li class='error'>✖ step 4: ", page)
    bare = program_file(ROBOT, what, plan, ())
    assert re.search(r"<li class='error'>✖ step 4: .*the motion shown ends there", bare)


@pytest.mark.parametrize(
    ("what", "says"),
    [
        (program(), "mine has no steps, so there is no motion to show"),
        (Program(robot="mico", steps=(POINT,)), "is for the robot 'mico', this one is 'uzuner'"),
        (program(PointStep(x_mm=900, y_mm=0, z_mm=0)), "step 1: .*330"),
    ],
)
def test_what_cannot_be_shown_is_refused_in_words(what: Program, says: str) -> None:
    with pytest.raises(ProgramError, match=says):
        planned_for_file(ROBOT, what, ROBOT.first_pose, None)


@pytest.mark.parametrize("name", ["mico", "eezybotarm_mk2", "scorbot"])
def test_every_arm_has_a_page(name: str) -> None:
    robot = load_robot(name)
    plan = rehearse_pose(robot, robot.pose("home"), robot.pose("rest"), 0.5)
    told: list[float] = []
    page = twin_file(
        robot, "to rest", plan, [Finding(Said("nearly"), severity="warning")], progress=told.append
    )
    assert "<li class='warning'>⚠ nearly</li>" in page and told[0] == 0.0
    assert len(page.encode()) < 1.2e6


def test_the_work_ends_when_nobody_waits_for_it() -> None:
    plan = rehearse_pose(ROBOT, ROBOT.pose("home"), ROBOT.pose("rest"), 0.5)

    def gone(_: float) -> None:
        raise ArmctlError("the page is gone")

    with pytest.raises(ArmctlError, match="the page is gone"):
        twin_file(ROBOT, "to rest", plan, (), progress=gone)

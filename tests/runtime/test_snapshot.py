"""What of a snapshot is news to who has seen the one before."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, TEST, Rig, make_rig

from armctl.facts import LevelPassed, Need, State
from armctl.facts.commands import Stopped
from armctl.hardware import Source
from armctl.program import GripperStep, Program, WaitStep
from armctl.protocol import (
    AxisHoming,
    Command,
    Connect,
    Control,
    Enable,
    Event,
    Jog,
    LastPose,
    Message,
    MoveGripper,
    MoveJoints,
    Pause,
    RunProgram,
    Snapshot,
    stands_as_before,
    unmet,
)

_TIME = {"stamp", "tick"}
_BESIDE_STATE = {
    "velocity_command",
    "acceleration_command",
    "program",
    "quantities",
    "limits",
    "unreachable",
    "doing",
    "last_stop",
}
"""They change with the state, or are for the eye."""
CHANGES: dict[str, Any] = {
    "state": State.FAULT, "cause": "overload", "q_command": ROBOT.pose("home") + 1e-6, "commanded": False,
    "q": ROBOT.pose("home") + np.radians(0.1), "source": Source.MEASURED, "powered": False, "gripper": 0.25,
    "part_mm": (20.0, 30.0, 40.0), "speed": 0.75, "board": None,
    "homing": (AxisHoming("axis 1", homed=True, running=False),),
    "warnings": ("the supply is low",), "events": (Event(0.0, "info", "new"),),
    "control": Control(locked=True), "progress": 0.5, "busy": True,
    "levels": (LevelPassed("Elbow", "servo 3", "load", 0.9, 0.8, 0.8),),
    "inputs": {"door": 1.0}, "outputs": {"lamp": 1.0}, "edges": {"door": 1}, "limp": ("Elbow",),
    "message": Message("Put a part in", 1, waits=True), "tool": "pen", "tool_unconfirmed": True,
    "scripted": ("door",), "told_by_cause": (0,), "awaited": (0,), "stopped": Stopped("page 2"), "stops": 1,
    "last_pose": LastPose(ROBOT.pose("home"), None, 0.0, ""),
}  # fmt: skip


@pytest.fixture
def holding() -> Snapshot:
    rig = make_rig()
    rig.enable()
    return rig.controller.snapshot


def test_an_arm_that_stands_is_no_news(holding: Snapshot) -> None:
    later = replace(holding, stamp=holding.stamp + 0.02, tick=holding.tick + 1, q=holding.q + 1e-4)
    assert stands_as_before(later, holding)


def test_a_joint_that_stays_unknown_is_no_news(holding: Snapshot) -> None:
    unknown = replace(holding, q=np.full(ROBOT.n, np.nan))
    assert stands_as_before(unknown, unknown)
    assert not stands_as_before(unknown, holding)


@pytest.mark.parametrize("name", CHANGES)
def test_whatever_else_changes_is_news(name: str, holding: Snapshot) -> None:
    assert not stands_as_before(replace(holding, **{name: CHANGES[name]}), holding)


def test_an_arm_that_moves_is_news_at_each_tick(holding: Snapshot) -> None:
    moving = replace(holding, busy=True)
    assert not stands_as_before(moving, moving)


def test_each_field_is_thought_of() -> None:
    assert {field.name for field in fields(Snapshot)} == _TIME | _BESIDE_STATE | CHANGES.keys()


HOME, REST = ROBOT.pose("home"), ROBOT.pose("rest")
TURN = Jog(np.array([0.2, 0.0, 0.0, 0.0, 0.0]))
GRIP = Program(robot="uzuner", steps=(GripperStep(open_percent=100), WaitStep(seconds=5)))


def begin(rig: Rig, situation: str) -> None:
    """Bring a rig there: commands by name, one after the other."""
    if situation in ("off", "enabling"):
        rig.do(Connect("sim"))
    else:
        rig.enable()
    for words in situation.split(" "):
        match words:
            case "enabling":
                rig.do(Enable(REST))
            case "moving":
                rig.do(MoveJoints(HOME))
                assert rig.run(0.2).state is State.MOVING
            case "paused":
                rig.do(Pause())
                rig.until(lambda snapshot: snapshot.state is State.PAUSED)
            case "stopping":
                rig.controller.stop(TEST)
                rig.tick()
            case "jogged":
                rig.do(TURN)
            case "gripping":
                rig.do(RunProgram(GRIP))
                rig.tick()
            case _:
                assert words in ("off", "holding")


@pytest.mark.parametrize(
    "situation",
    ["off", "enabling", "holding", "moving", "moving paused", "moving stopping", "jogged", "gripping"],
)
@pytest.mark.parametrize(
    ("need", "command"),
    [
        (Need.HOLDING, MoveJoints(REST)), (Need.JOG, TURN), (Need.PAUSE, Pause()),
        (Need.GRIPPER, MoveGripper(0.4)),
    ],
)  # fmt: skip
def test_what_the_snapshot_says_is_refused_is_what_the_controller_refuses(
    situation: str, need: Need, command: Command
) -> None:
    rig = make_rig()
    begin(rig, situation)
    now = rig.now
    told = unmet(need, now.state, connected=True, homed=True, doing=now.doing)
    refusal = rig.do(command).accepted.exception(0)
    assert (told is None) is (refusal is None), (told, refusal)

"""What of a snapshot is news to who has seen the one before."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from tests.runtime.kit import ROBOT, make_rig

from armctl.hardware import Source
from armctl.runtime import AxisHoming, Control, LastPose, Snapshot, State
from armctl.runtime.snapshot import Event, stands_as_before

_TIME = {"stamp", "tick"}
_BESIDE_STATE = {"velocity_command", "acceleration_command", "program", "measured", "unreachable"}
"""They change with the state, or are for the eye."""
CHANGES: dict[str, Any] = {
    "state": State.FAULT, "cause": "overload", "q_command": ROBOT.pose("home") + 1e-6, "commanded": False,
    "q": ROBOT.pose("home") + np.radians(0.1), "source": Source.MEASURED, "powered": False, "gripper": 0.25,
    "speed": 0.75, "board": None, "homing": (AxisHoming("axis 1", homed=True, running=False),),
    "warnings": ("the supply is low",), "events": (Event(0.0, "info", "new"),),
    "control": Control(locked=True), "progress": 0.5,
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


@pytest.mark.parametrize("state", [State.MOVING, State.PAUSED])
def test_an_arm_that_moves_is_news_at_each_tick(state: State, holding: Snapshot) -> None:
    moving = replace(holding, state=state)
    assert not stands_as_before(moving, moving)


def test_each_field_is_thought_of() -> None:
    assert {field.name for field in fields(Snapshot)} == _TIME | _BESIDE_STATE | CHANGES.keys()

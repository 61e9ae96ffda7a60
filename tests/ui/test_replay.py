"""A recorded minute on the page: the arm has that tool on that was on then."""

from __future__ import annotations

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.robot.test_tools import arm_with_tools
from tests.ui.test_arm_figure import in_base

from armctl.protocol import Recording
from armctl.protocol.recording import PLAIN, READBACK, SETPOINT, TOOL
from armctl.robot import Robot
from armctl.ui.guard import GuardedServer
from armctl.ui.replay import ReplayPage


def recorded(robot: Robot, tools: list[float]) -> Recording:
    """Ticks of an arm at rest, with the tool of each."""
    ticks = np.zeros((len(tools), len(PLAIN) + 2 * robot.n + 1))
    ticks[:, 0], ticks[:, -1] = 0.1 * np.arange(len(tools)), tools
    ticks[:, len(PLAIN) : -1] = np.tile(robot.pose("rest"), 2)
    heads = (*(f"{head}{name}" for head in (SETPOINT, READBACK) for name in robot.joint_names), TOOL)
    return Recording(
        robot=robot.name, joints=robot.joint_names, titles=tuple(one.title for one in robot.joints),
        board="simulated", period_s=0.02, why="asked for", wall_s=0.0, clock_s=ticks[-1, 0], utc_offset_s=0.0,
        commands=(), lines=(), warnings=(), states=("holding",), columns=(*PLAIN, *heads),
        tools=tuple(tool.name for tool in robot.tools), ticks=ticks,
    )  # fmt: skip


def test_each_tick_is_drawn_with_the_tool_of_its_time(server: GuardedServer, tmp_path: Path) -> None:
    robot = arm_with_tools(tmp_path)
    recording = recorded(robot, [0, 1, 1, 2])
    assert recording.tools_on == ("jaws", "pen", "cup")
    client = SimpleNamespace(scene=server.scene, gui=server.gui, atomic=nullcontext)
    page: Any = ReplayPage(cast(Any, client), recording, robot)
    for k, tool in ((3, "cup"), (0, "jaws"), (2, "pen")):
        page._go(recording.time_s[k] - recording.clock_s)
        tip = robot.with_tool(tool).forward(robot.pose("rest"))[:3, 3]
        for figure in ("/arm", "/setpoint"):
            assert in_base(server, f"{figure}/tool")[:3, 3] == pytest.approx(tip, abs=1e-6)
        assert f">{tool}<" in page._state._content

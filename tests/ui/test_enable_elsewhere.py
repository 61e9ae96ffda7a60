"""Enable where the rest pose is below the floor: the clear pose is named, and one press away."""

from __future__ import annotations

import asyncio
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.robot.plain_arm import write_plain_arm
from tests.robot.urdf_kit import Step, written

from armctl import Arm, load_robot
from armctl.errors import MotionRefusedError
from armctl.motion.clearance import clear_rest, stands_clear
from armctl.protocol import Enable
from armctl.robot import Robot
from armctl.ui.enabling import EnableControl

CLEAR = "[0, -90, 0, 0, 0]"


@pytest.fixture(name="robot")
def _robot(tmp_path: Path) -> Robot:
    """Its zero is below the floor."""
    return load_robot(write_plain_arm(tmp_path / "arm.urdf", {"lift": {"rpy": "0 2.6 0"}}))


def test_the_refusal_names_the_pose_and_where_it_is_kept(robot: Robot) -> None:
    with Arm.open(robot) as arm:
        with pytest.raises(MotionRefusedError, match="below the floor") as refused:
            arm.enable()
        assert f"enable({CLEAR})" in str(refused.value) and f"[poses] rest = {CLEAR}" in str(refused.value)
        arm.enable([0, -90, 0, 0, 0])
        assert arm.joints_deg == pytest.approx([0, -90, 0, 0, 0], abs=0.1)


def test_random_arms_that_begin_folded_or_below_the_floor(tmp_path: Path) -> None:
    rng, named = np.random.default_rng(3), 0
    for k in range(4):
        bends = zip(("lift", "elbow", "wrist"), rng.uniform((1.8, -1, -3), (3, 1, 3)).tolist(), strict=True)
        bent = {name: {"rpy": f"0 {bend:.3f} 0"} for name, bend in bends}
        robot = load_robot(write_plain_arm(tmp_path / f"{k}.urdf", bent))
        if stands_clear(robot, robot.pose("rest")) or (found := clear_rest(robot)) is None:
            continue
        named += 1
        q, words = found
        assert np.degrees(q) == pytest.approx(
            [float(part) for part in words.strip("[]").split(",")], abs=0.01
        )
        robot.check_limits(q)
        assert stands_clear(replace(robot, poses={}), q)
        _, *joints = robot.chain.frames(q)[:, 2, 3]
        assert min(joints) > 0.0  # above the floor
        points = robot.chain.frames(q)[1:, :3, 3]
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        assert apart[np.triu_indices(len(points), 2)].min() > 0.02  # not folded onto each other
    assert named > 1


def test_a_very_long_arm_is_an_answer_too(tmp_path: Path) -> None:
    steps = [
        Step(f"j{k}", "revolute", f"l{k}", f"l{k + 1}", "0.05 0 0" if k else "0 0 -0.1", axis="0 1 0")
        for k in range(16)
    ]
    assert clear_rest(load_robot(written(tmp_path / "arm.urdf", steps))) is None


def test_the_page_offers_it_in_one_press(robot: Robot) -> None:
    sent: list[Enable] = []

    async def submit(command: Enable) -> None:
        sent.append(command)
        if command.q is None:
            raise MotionRefusedError("the tool: 147.1 mm below the floor")

    board = SimpleNamespace(simulated=True)
    session = SimpleNamespace(
        snapshot=SimpleNamespace(
            board=board, state=None, limp=(), powered=False, unreachable=False, tool_unconfirmed=False
        ),
        submit=submit,
        why_not=lambda *_: None,
        console=SimpleNamespace(robot=robot),
    )
    page: Any = SimpleNamespace(
        _session=session,
        _clear=None,
        _question=SimpleNamespace(asked=False),
        _ports=SimpleNamespace(back_on=None),
    )
    offered = re.compile(r"<button[^>]*>Enable in ([^<]*)°</button>")
    with pytest.raises(MotionRefusedError, match="Tool, rest pose and floor"):
        asyncio.run(EnableControl.enable(page))
    assert offered.findall(EnableControl.html(page, session.snapshot)) == [CLEAR]
    asyncio.run(EnableControl.enable_elsewhere(page))
    assert sent[-1].q is not None and np.degrees(sent[-1].q) == pytest.approx([0, -90, 0, 0, 0])
    board.simulated = False  # where a real arm stands is no choice
    with pytest.raises(MotionRefusedError, match=r"below the floor$"):
        asyncio.run(EnableControl.enable(page))

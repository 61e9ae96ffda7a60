"""The point that *First steps* proposes: who types it sees the arm move."""

from __future__ import annotations

import numpy as np
import pytest

from armctl.robot.draft import BUILDS, Build, Draft
from armctl.ui.tabs.main.screen import example_point


@pytest.mark.parametrize("build", BUILDS, ids=lambda build: build.name)
def test_an_arm_without_a_home_pose_of_its_own_does_not_stand_at_it(build: Build) -> None:
    robot = Draft.of_build("mine", "Mine", build, {one.key: one.usual_mm for one in build.lengths}).robot()
    point = example_point(robot)
    rest = robot.forward(robot.pose("rest"))[:3, 3]
    assert np.linalg.norm(point - rest) > 0.01
    assert point[2] > robot.floor_z
    assert robot.inverse(point)

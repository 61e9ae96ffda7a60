"""Sample programs fit every shipped arm."""

from __future__ import annotations

import pytest
from tests.arms import FIVE

from armctl.program import check_program
from armctl.program.files import SAMPLES, sample_program
from armctl.robot import load_robot


@pytest.mark.parametrize("name", FIVE)
@pytest.mark.parametrize("sample", SAMPLES)
def test_a_sample_can_be_run_from_home(name: str, sample: str) -> None:
    robot = load_robot(name)
    program = sample_program(sample, robot)
    assert len(program.steps) > 2
    found = check_program(program, robot, start=robot.pose("home"))
    assert [str(finding) for finding in found if finding.severity == "error"] == []

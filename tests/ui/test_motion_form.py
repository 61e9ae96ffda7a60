"""The fields of a motion: "Plan it freer" chooses what the list of the arm has."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, Literal, cast

import pytest
from tests.ui.page_kit import FakePage

from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.trajectory.motion_form import MotionForm
from armctl.ui.tabs.trajectory.plan import TOOL_LINE


@pytest.mark.parametrize(
    ("name", "label", "chosen", "freer", "asked"),
    [
        ("uzuner", "Tool pitch", "whole orientation kept", "kept", ("kept", None)),
        ("scorbot", "Tool pitch", "whole orientation kept", "kept", ("kept", None)),
        ("scorbot", "Tool pitch", "kept", "free", ("free", None)),
        ("ur5", "Tool orientation", "kept", "kept", ("kept", None)),
        ("ur5", "Tool orientation", "kept", "free", (None, "free")),
    ],
)
def test_what_is_freer_is_on_the_list_and_can_be_planned(
    server: GuardedServer,
    name: str,
    label: str,
    chosen: str,
    freer: Literal["kept", "free"],
    asked: tuple[str | None, str | None],
) -> None:
    robot = load_robot(name)
    page = FakePage(server, robot, robot.pose("home"))
    cast(Any, page.console).shared = {SharedProgram: SimpleNamespace(version=0)}.__getitem__
    form = MotionForm(page.session)
    page.put("Which motion", TOOL_LINE)
    page.put(label, chosen)
    form.ask_freer(freer)
    request = form.request(page.snapshot.q_command)
    assert (request.pitch, request.orientation) == asked
    assert not request.yields

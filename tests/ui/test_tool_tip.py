"""Teaching the tool point on a page: presses, what they say, and the rows for the robot file."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.calibration.test_tool_point import TIP, apart, sides
from tests.ui.page_kit import FakePage

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, InputError, StateError
from armctl.facts import State
from armctl.robot import load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.calibration.tool_tip import CLEAR, DELETE, TOUCH, CalibrationTip, TipTouches

ROBOT = load_robot("uzuner")


class TipPage(FakePage):
    watches = False

    def __init__(self, server: GuardedServer) -> None:
        super().__init__(server, ROBOT, ROBOT.pose("home"))
        self.touches = TipTouches(ROBOT)
        self.console.shared = lambda kind: self.touches
        self.saved: dict[str, str] = {}
        self.form = CalibrationTip(self.session)
        self.refresh(self.form)

    def require_operator(self) -> None:
        if self.watches:
            raise ArmctlError("this page is watching")

    def download(self, name: str, content: str) -> None:
        self.saved[name] = content

    def touch(self, q: FloatArray) -> None:
        self.snapshot.q = self.snapshot.q_command = q
        self.press(TOUCH)
        self.refresh(self.form)


@pytest.fixture
def page(server: GuardedServer) -> TipPage:
    return TipPage(server)


def test_touches_say_where_the_tip_is_and_the_rows_are_downloaded(page: TipPage) -> None:
    q = sides("uzuner")[0]
    for number, one in enumerate(q[apart(ROBOT, q, 4)], 1):
        assert not page.is_visible("Download the rows")
        page.touch(one)
        assert (f"{number} of 4 touches" in page.html) == (number < 4)
    assert "Residual of 4 touches: 0.00 mm" in page.html
    for value in TIP:
        assert f">{1000 * value:.2f}<".replace("-", "−") in page.html
    page.press("Download the rows")
    (text,) = page.saved.values()
    assert (
        text == page.touches.suggestion
        and "d_mm = 35.00" in text
        and "behind the last one of [dh] rows" in text
    )


def test_the_same_place_again_is_no_touch_nor_is_an_arm_that_moves(page: TipPage) -> None:
    q = sides("uzuner")[0]
    page.touch(q[0])
    with pytest.raises(InputError, match="the arm stands as in touch 1; turn the tool"):
        page.touch(q[0])
    page.snapshot.state = State.MOVING
    with pytest.raises(StateError, match="the arm is moving"):
        page.touch(q[1])
    page.snapshot.state = State.HOLDING
    with pytest.raises(StateError, match="nobody knows where the arm stands"):
        page.touch(np.full(5, np.nan))
    page.watches = True
    with pytest.raises(ArmctlError, match="watching"):
        page.touch(q[1])
    assert len(page.touches.touches) == 1


def test_a_tool_that_was_only_rolled_tells_what_it_cannot(page: TipPage) -> None:
    for roll in (-1.2, -0.4, 0.4, 1.2):
        q = ROBOT.pose("home")
        q[4] = roll
        page.touch(q)
    assert "z axis is not told" in page.html and "about another axis, too" in page.html
    assert not page.is_visible("Download the rows")
    page.press("Touches", DELETE)
    page.refresh(page.form)
    assert "3 of 4 touches" in page.html
    page.press("Touches", CLEAR)
    assert page.touches.touches == ()


def test_touches_stay_while_the_arm_is_the_same() -> None:
    touches = TipTouches(ROBOT)
    console = cast(Any, SimpleNamespace(robot=load_robot("uzuner")))
    assert TipTouches.of(console, touches) is touches
    console.robot = load_robot("ur5")
    assert TipTouches.of(console, touches) is not touches

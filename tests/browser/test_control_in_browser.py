"""The control panel and Main, as an operator meets them after something has gone wrong."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.browser.kit import Screen, Screens
from tests.browser.served_arm import ServedArm, served_arm

from armctl.runtime import State

pytestmark = pytest.mark.browser


@pytest.fixture
def served(tmp_path: Path) -> Iterator[ServedArm]:
    with served_arm(tmp_path / "programs") as served:
        yield served


def test_after_a_reconnect_enable_takes_the_arm_over_where_it_stands(
    screen: Screen, served: ServedArm
) -> None:
    screen.open(served.url, until="STOP")
    screen.click("Disconnect")
    screen.wait_until(lambda: served.now.state is State.DISCONNECTED, "the line is closed")
    screen.click("Connect")
    screen.wait_until(lambda: served.now.state is State.OFF, "the line is open")
    screen.wait_for_text("takes the arm over where it stands")
    screen.click("Enable")
    screen.wait_until(lambda: served.now.state is State.HOLDING, "the arm is enabled")
    assert served.commanded_deg == pytest.approx([0, 90, -80, -40, 0], abs=0.02)


def test_a_double_click_on_release_is_no_answer_to_its_question(screen: Screen, served: ServedArm) -> None:
    screen.open(served.url, until="STOP")
    screen.button("Release").dblclick()
    screen.wait_for_text("DROPS! Click again")
    screen.pause(700)
    assert served.now.state is State.HOLDING
    screen.click("DROPS! Click again")
    screen.wait_until(lambda: served.now.state is State.OFF, "the pulses are off")


def test_a_reloaded_page_shows_the_speed_that_is_in_force(screens: Screens, served: ServedArm) -> None:
    first = screens(served.url)
    first.type_into("Speed %", "20")
    first.wait_until(lambda: served.now.speed == pytest.approx(0.2), "the override is in force")
    first.page.close()
    second = screens(served.url)
    assert second.number("Speed %") == 20

"""The control panel and Main, as an operator meets them after something has gone wrong."""

from __future__ import annotations

import pytest
from tests.browser.kit import Screens
from tests.browser.served_arm import HOME, ServedArm

from armctl.facts import State

pytestmark = pytest.mark.browser


def test_a_new_page_shows_the_speed_in_force_and_after_a_reconnect_enable_takes_the_arm_over(
    screens: Screens, served: ServedArm
) -> None:
    first = screens(served.url)
    first.type_into("Speed %", "20")
    first.wait_until(lambda: served.now.speed == pytest.approx(0.2), "the override is in force")
    first.page.close()
    page = screens(served.url)
    assert page.number("Speed %") == 20

    page.click("Disconnect")
    served.wait_for(page, State.DISCONNECTED)
    page.click("Connect")
    served.wait_for(page, State.OFF)
    page.wait_for_text("takes the arm over where it stands")
    page.click("Enable")
    served.wait_for_deg(page, HOME, within=0.02)
    page.button("Release").dblclick()  # its second click is no answer to the question
    page.wait_for_text("Drops! Press again")
    page.pause(700)
    assert served.now.state is State.HOLDING
    page.click("Drops! Press again")
    served.wait_for(page, State.OFF)

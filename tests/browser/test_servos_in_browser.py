"""Arms on simulated servo buses: from *Servos* to a point, led by hand, overload, restart, a plug pulled."""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Locator
from tests.browser.kit import Screen
from tests.browser.served_arm import ServedArm, TestHost, served_arm

from armctl.facts import State
from armctl.hardware import Source
from armctl.hardware.bus import setup
from armctl.hardware.bus.plant import PlantJoint
from armctl.hardware.bus.simulated import SimulatedBus
from armctl.program import MoveStep
from armctl.protocol import Disconnect, Release

pytestmark = pytest.mark.browser
POINT_MM = (230.0, 60.0, 120.0)
PAN = 0
"""the joint that is led by hand: gravity leaves it alone"""
_LOG = logging.getLogger(__name__)


@pytest.fixture
def so101(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedArm]:
    """Its console, as it is before anybody has connected the arm."""
    monkeypatch.setattr(setup, "_SIMULATED_PING_S", 0.002)  # for the 247 ids that nobody has
    with served_arm(tmp_path / "files", "so101") as served:
        for command in (Release(), Disconnect()):
            served.order(command).result(10)
        yield served


@contextmanager
def bus_of(served: ServedArm) -> Iterator[SimulatedBus]:
    """The simulated bus, held still for a moment."""
    host = served.arm.link
    assert isinstance(host, TestHost)
    with host.boards.simulated().inspect() as model:
        assert isinstance(model, SimulatedBus)
        yield model


class Clicks:
    """Counts what is clicked, by the part of the way; how long that took is in the log."""

    def __init__(self, screen: Screen) -> None:
        self.counted: dict[str, int] = {}
        self._part, self._began = "", time.monotonic()
        press = screen.press

        def counting(target: Locator) -> None:
            self.counted[self._part] = self.counted.get(self._part, 0) + 1
            press(target)

        screen.press = counting  # type: ignore[method-assign]

    def begin(self, part: str) -> None:
        """The clicks from now on belong to this part; empty: to none."""
        if self._part:
            took_s = time.monotonic() - self._began
            _LOG.info("%s: %d clicks, %.0f s", self._part, self.counted.get(self._part, 0), took_s)
        self._part, self._began = part, time.monotonic()


def lead(screen: Screen, served: ServedArm, to_deg: float) -> float:
    """A hand turns the pan joint past an angle, and holds it; where [degrees]."""

    def turn(speed: float) -> PlantJoint:
        with bus_of(served) as bus:
            joint = bus.plant.joints[PAN]
            joint.hand = speed
            return joint

    speed = np.sign(to_deg - np.degrees(turn(0.0).angle)) * 1.5
    joint = turn(float(speed))
    screen.wait_until(lambda: (np.degrees(joint.angle) - to_deg) * speed >= 0, f"the hand is at {to_deg}°")
    turn(0.0)
    at = float(np.degrees(joint.angle))
    screen.wait_until(lambda: abs(np.degrees(served.now.q[PAN]) - at) < 0.5, "the page follows the hand")
    return at


def let_go(served: ServedArm) -> None:
    with bus_of(served) as bus:
        bus.plant.joints[PAN].hand = None


def blocked_below(served: ServedArm, angle_deg: float, place: int = PAN) -> bool:
    """Hold a joint fast if it is below an angle now; whether it is held."""
    with bus_of(served) as bus:
        joint = bus.plant.joints[place]
        joint.blocked = bool(np.degrees(joint.angle) < angle_deg)
        return joint.blocked


def test_from_the_servos_to_a_point_a_loop_led_by_hand_an_overload_and_a_loose_plug(
    screen: Screen, so101: ServedArm
) -> None:
    clicks = Clicks(screen)
    screen.open(so101.url, until="STOP")

    clicks.begin("servos to point")
    screen.open_tab("Servos")
    screen.click("Look for the servos")
    screen.wait_for_text("✓ 6 servos, as the arm needs them.")
    screen.screenshot("servos_found")
    screen.click("Connect the arm")
    so101.wait_for(screen, State.OFF)
    screen.click("Enable")
    so101.wait_for(screen, State.HOLDING)
    screen.open_tab("Inverse")
    screen.type_xyz(*map(str, POINT_MM))
    screen.click("Go by least energy")
    so101.wait_for(screen, State.MOVING)
    so101.wait_for(screen, State.HOLDING)
    assert so101.now.source is Source.MEASURED and "measured" in screen.text("#armctl-top")
    assert np.abs(so101.tool_mm - POINT_MM).max() < 0.5
    measured_mm = 1000 * so101.robot.forward(so101.now.q)[:3, 3]
    assert 0 < np.abs(measured_mm - POINT_MM).max() < 30  # it sags: its servos are springs

    clicks.begin("four poses by hand")
    screen.open_tab("Manual", "Joints")
    screen.unfold("Lead by hand", "Let ticked joints go limp")
    screen.press(
        screen.page.get_by_label("Shoulder pan", exact=True).and_(screen.page.get_by_role("checkbox"))
    )
    screen.pause()
    screen.click("Let ticked joints go limp")
    screen.wait_for_text(re.compile("Limp: Shoulder pan"))
    led_deg: list[float] = []
    for k, angle in enumerate((-20.0, 0.0, 20.0, 35.0), 1):
        led_deg.append(lead(screen, so101, angle))
        screen.click("Record pose")
        screen.wait_until(lambda k=k: len(so101.steps) == k, f"{k} poses are recorded")
    poses = [step for step in so101.steps if isinstance(step, MoveStep)]
    assert [pose.joints_deg[PAN] for pose in poses] == pytest.approx(led_deg, abs=0.5)
    screen.click("Take them back as they stand")
    screen.wait_until(lambda: not so101.now.limp, "all joints hold")
    let_go(so101)
    screen.click("Loop")
    screen.wait_until(lambda: len(so101.steps_run) > 4, "the loop begins anew")
    screen.screenshot("servos_loop")

    clicks.begin("overload")
    screen.wait_until(lambda: blocked_below(so101, min(led_deg) + 5), "something is in the way of the joint")
    screen.wait_until(
        lambda: np.degrees(so101.now.q_command[PAN]) > 10, "the arm is told to be far from there"
    )
    screen.click("STOP")
    screen.wait_for_text(re.compile(r"Shoulder pan: servo 1: overload"))
    screen.screenshot("servos_overload")
    with bus_of(so101) as bus:
        bus.plant.joints[PAN].blocked = False
    screen.click("Clear fault")
    screen.click("Enable")
    so101.wait_for(screen, State.HOLDING)
    seen = len(so101.steps_run)
    screen.click("Loop")
    screen.wait_until(lambda: len(so101.steps_run) > seen + 1, "the loop goes on")
    screen.click("STOP")
    so101.wait_for(screen, State.HOLDING)

    clicks.begin("loose plug")
    with bus_of(so101) as bus:
        bus.loose = 3
    screen.wait_for_text(re.compile("Wrist flex: servo 4 does not answer; look at its plug"))
    screen.screenshot("servos_plug")
    assert so101.now.state is not State.MOVING
    clicks.begin("")
    assert screen.errors == []
    assert clicks.counted == {"servos to point": 9, "four poses by hand": 11, "overload": 5}

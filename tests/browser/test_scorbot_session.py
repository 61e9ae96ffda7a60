"""A session with the Scorbot on a simulated encoder board: home, move, lose the cable, home again, go on."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.browser.kit import Screen
from tests.browser.served_arm import served_arm

from armctl.hardware.boards import channel_settings
from armctl.hardware.encoder.messages import Mode
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard, simulated_encoder_board
from armctl.hardware.faults import FaultyModel
from armctl.hardware.simulation import BoardServer
from armctl.protocol import MonotonicClock
from armctl.robot import load_robot
from armctl.ui import PortChoice

pytestmark = pytest.mark.browser
ROBOT = load_robot("scorbot")
HOME = np.degrees(ROBOT.pose("home"))
REFERENCE = "Go with respect to reference"
_WAITS_S = 0.2
"""for how long the board goes on without a word of its computer: less than its watchdog waits"""


class Patient(FaultyModel[SimulatedEncoderBoard]):
    """The board's time stands still where its computer does: one that is busy trips no watchdog."""

    def __init__(self, board: SimulatedEncoderBoard) -> None:
        super().__init__(board)
        self._seen = self._at = MonotonicClock.now()
        self._fed = math.inf  # nobody has said a word yet

    def feed(self, data: bytes) -> bytes:
        self._fed = self._at
        return super().feed(data)

    def advance(self, now: float) -> bytes:
        passed, self._seen = now - self._seen, now
        self._at = min(self._at + passed, max(self._at, self._fed + _WAITS_S))
        return super().advance(self._at)


class Cable:
    """The simulated board on a link, and pulling and plugging its cable."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.server = self._serve()

    def _serve(self) -> BoardServer[Patient]:
        board = simulated_encoder_board(channels=channel_settings(ROBOT), axes=ROBOT.board_settings.axes)
        return BoardServer(Patient(board), MonotonicClock.now, link=self.link).__enter__()

    def pull(self) -> None:
        self.server.close()

    def plug_in(self) -> None:
        """Plug a board in; it has started anew, and knows nothing."""
        self.server = self._serve()

    @property
    def mode(self) -> Mode:
        with self.server.inspect() as line:
            return line.inner.mode

    @property
    def setpoints(self) -> list[str]:
        with self.server.inspect() as line:
            return [words for words in line.inner.log if words.split()[0] == "P"]


@pytest.fixture
def cable(tmp_path: Path) -> Iterator[Cable]:
    cable = Cable(tmp_path / "scorbot")
    yield cable
    cable.server.close()


@pytest.fixture
def page(cable: Cable, tmp_path: Path, screen: Screen) -> Iterator[Screen]:
    with served_arm(tmp_path, "scorbot", port=PortChoice(str(cable.link), "Encoder board")) as served:
        screen.open(served.url, until="Enable")
        yield screen


def home(page: Screen) -> None:
    page.open_tab("Main")
    page.click("Homing")
    page.wait_for_text("looks for its zero")
    page.screenshot("scorbot-homing")
    for axis in range(1, 7):  # on a busy computer all six take longer than a wait may
        page.wait_for_text(re.compile(f"Homed [{axis}-6] of 6"))
    page.wait_for_text("HOLDING")


def joints_shown(page: Screen) -> list[float]:
    """The angles beside the arm, as the encoders measured them."""
    text = page.text("[name=where]").replace("−", "-")
    return [
        float(found[1])
        for joint in ROBOT.joints
        if (found := re.search(rf"{joint.title} °\s*(-?\d+\.\d+)", text)) is not None
    ]


def stop_ends_homing(page: Screen, cable: Cable) -> None:
    page.click("Homing")
    page.wait_for_text("looks for its zero")
    page.click("STOP")
    page.wait_for_text("OFF")
    page.wait_for_text("homing was stopped")
    assert cable.mode is not Mode.HOMING
    assert not page.is_enabled("Enable")


def a_stalled_axis_is_told_in_words(page: Screen, cable: Cable) -> None:
    with cable.server.inspect() as line:
        line.inner.axes[1].jammed = True
    page.open_tab("Forward")
    page.type_into("Shoulder °", "-80")
    page.click(REFERENCE)
    page.wait_for_text("FAULT")
    page.wait_for_text(re.compile("Shoulder: "))
    page.open_tab("Main")
    page.screenshot("scorbot-stalled")
    page.click("Clear fault")
    page.wait_for_text("OFF")
    with cable.server.inspect() as line:
        line.inner.axes[1].jammed = False
    page.click("Enable")  # it still knows where it is
    page.wait_for_text("HOLDING")


def nothing_goes_on_by_itself_after_the_cable_is_pulled(page: Screen, cable: Cable) -> None:
    """Nor once it is plugged in again, and connected."""
    cable.pull()
    page.wait_for_text("FAULT")
    page.wait_for_text("Position shown: last known")
    page.page.get_by_title("Position shown: last known; unknown until the arm is homed again").wait_for()
    page.open_tab("Main")
    page.screenshot("scorbot-unplugged")
    cable.plug_in()
    page.pause(600)
    assert cable.mode is Mode.OFF
    assert cable.setpoints == []  # nothing goes on by itself
    page.click("Connect")
    page.wait_for_text("unknown until the arm is homed")
    page.pause(600)
    assert cable.setpoints == []
    assert not page.is_enabled("Enable")


def test_home_move_stall_lose_the_cable_and_go_on(page: Screen, cable: Cable) -> None:
    page.wait_for_text("unknown until the arm is homed")
    page.screenshot("scorbot-unhomed")
    assert not page.is_enabled("Enable")
    stop_ends_homing(page, cable)
    home(page)
    page.wait_for_text("measured")
    page.wait_until(lambda: len(joints_shown(page)) == 5, "the panel shows five joints")
    assert joints_shown(page) == pytest.approx(HOME.tolist(), abs=0.2)
    page.screenshot("scorbot-homed")

    # joints and pose are coupled, both ways
    page.open_tab("Forward")
    page.type_into("Waist °", "20")
    asked = np.radians([20, *HOME[1:]])
    x, y, _ = 1000 * ROBOT.forward(asked)[:3, 3]
    page.wait_until(lambda: abs(page.number("X mm") - x) < 0.06, "the pose follows the joints")
    page.type_into("Y mm", f"{-y:.1f}")
    page.wait_until(lambda: abs(page.number("Waist °") + 20) < 0.2, "the joints follow the pose")
    page.click(REFERENCE)
    page.wait_until(lambda: abs(joints_shown(page)[0] + 20) < 0.3, "the arm stands there")
    page.wait_for_text("HOLDING")
    page.screenshot("scorbot-forward")
    a_stalled_axis_is_told_in_words(page, cable)

    # a program in a loop
    page.open_tab("Manual", "Serial motion")
    page.click("Record pose")
    page.open_tab("Main")
    page.click("Home")
    page.wait_until(lambda: abs(joints_shown(page)[0]) < 0.3, "the arm is in its home pose")
    page.wait_for_text("HOLDING")
    page.open_tab("Manual")
    page.click("Record pose")
    page.click("Loop")
    page.wait_for_text("MOVING")
    seen = len(cable.setpoints)
    page.wait_until(lambda: len(cable.setpoints) > seen + 20, "setpoints come")

    nothing_goes_on_by_itself_after_the_cable_is_pulled(page, cable)
    home(page)
    page.open_tab("Manual")
    page.click("Loop")
    page.wait_for_text("MOVING")
    page.wait_until(lambda: len(cable.setpoints) > 20, "the program runs again")
    page.click("STOP")
    page.wait_for_text("HOLDING")

    # disconnecting asks before the arm drops
    page.open_tab("Main")
    page.click("Disconnect")
    page.wait_for_notification("THE ARM MAY DROP")
    assert cable.mode is Mode.ON
    page.click("Disconnect")
    page.wait_for_text("DISCONNECTED")
    assert page.errors == []

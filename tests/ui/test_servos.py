"""*Main → Servos*: what is shown, who may write, what is asked first, what stands in the servos then."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.hardware.bus_kit import BusBench, TimedLoop
from tests.ui.page_kit import FakePage
from viser import UploadedFile

from armctl.boards import has_servos
from armctl.errors import ArmctlError, BoardError, InputError, StateError
from armctl.hardware import BoardIdentity
from armctl.hardware.bus.setup import BusSetup
from armctl.hardware.feetech.make import FEETECH
from armctl.protocol import Snapshot
from armctl.robot import load_robot
from armctl.ui.console import PortChoice
from armctl.ui.guard import GuardedServer
from armctl.ui.tabs.main import shared_servos
from armctl.ui.tabs.main.servos import Servos
from armctl.ui.tabs.main.shared_servos import SharedServos

ROBOT = load_robot("so101")
SIM, REAL = PortChoice("sim", "Simulated board"), PortChoice("/dev/ttyACM0", "adapter", listed=True)


class ServoPage(FakePage):
    """A page with the section, of an arm whose servos are on a desk; its buttons by what they do."""

    def __init__(self, server: GuardedServer, port: PortChoice) -> None:
        super().__init__(server, ROBOT, np.zeros(ROBOT.n))
        self.bench, self.port = BusBench(ROBOT), port
        self.bus, self.used = self.bench.bus, list[tuple[str, str | None]]()
        self.notices: list[str] = []
        self.files: dict[str, bytes] = {}
        self.asked: list[str] = []
        vars(self.snapshot).update(board=None)
        controller = SimpleNamespace(snapshot=self.snapshot, simulated_port=lambda: "/dev/pts/7")
        vars(self.console).update(controller=controller)
        shared = SharedServos(self.console)  # type: ignore[arg-type]
        vars(self.console).update(shared=lambda _: shared)
        self.shared = shared
        self.section = Servos(
            self.session,
            lambda: self.port,
            lambda: self.asked.append("connect"),
            lambda: self.asked.append("off"),
        )
        self.refresh(self.section)

    def servo_setup(self, port: str, served: str | None) -> BusSetup:
        self.used.append((port, served))
        return BusSetup(FEETECH, self._open, self.bench.clock.now, 0.008, simulated=served is not None)

    def _open(self, baud: int) -> TimedLoop:
        return TimedLoop(self.bench.faulty, self.bench.clock, baud)

    def close(self) -> None: ...

    def why_not(self, arm: object, snapshot: Snapshot) -> str | None:
        return None if self.operates else "this page is watching"

    def require_operator(self) -> None:
        if not self.operates:
            raise ArmctlError("this page is watching")

    def notify(self, title: str, text: str, *_: object) -> None:
        self.notices.append(text)

    def download(self, name: str, content: bytes) -> None:
        self.files[name] = content

    def give_file(self, label: str, name: str, content: bytes) -> None:
        """Hand a file to an upload button."""
        self._handles[label]._impl.value = UploadedFile(name, content)
        self.press(label)

    def field(self, label: str) -> Any:
        """The newest field with a label."""
        containers = self.gui._container_handle_from_uuid.values()
        handles = [one for container in containers for one in container._children.values()]
        return [one for one in handles if getattr(one, "label", "") == label][-1]

    def do(self, what: str, key: str = "") -> str:
        """Press a button of the part; what the part shows then."""
        self.act(lambda: self.parts.done(f"servo-{what}", key))
        self.refresh(self.section)
        return self.parts["servos"]


@pytest.fixture
def open_page(server: GuardedServer, monkeypatch: pytest.MonkeyPatch) -> Callable[..., ServoPage]:
    def opened(port: PortChoice = SIM) -> ServoPage:
        page = ServoPage(server, port)
        monkeypatch.setattr(shared_servos, "Boards", lambda *_, **__: page)
        monkeypatch.setattr(shared_servos, "board_name", lambda *_: "A1")
        return page

    return opened


def places(html: str, *texts: str) -> list[int]:
    """Where texts stand one after the other; each is there."""
    found = [html.index(text) for text in texts]
    assert found == sorted(found)
    return found


def test_the_section_is_there_only_for_arms_whose_servos_can_be_set_up() -> None:
    arms = ("so101", "koch", "uzuner", "abaas", "scorbot", "ur5")
    assert [name for name in arms if has_servos(load_robot(name))] == ["so101", "koch"]


def test_the_servos_are_listed_in_the_order_of_the_chain_and_nothing_is_written(
    open_page: Callable[..., ServoPage],
) -> None:
    page = open_page()
    assert "<b>Simulated board</b>" in page.html and "STS3215" not in page.parts["servos"]
    html = page.do("look")
    joints = ["Shoulder pan", "Shoulder lift", "Elbow flex", "Wrist flex", "Wrist roll", "Gripper"]
    places(html, *joints, "✓ 6 servos, as the arm needs them")
    assert html.count("STS3215") == html.count("12.0") == html.count("3.10") == html.count("limp") == 6
    assert page.used == [("sim", "/dev/pts/7")]
    assert all(one.code in (1, 2) for one in page.bus.heard)  # pings and reads


@pytest.mark.parametrize("key", ["", "all"])
def test_every_rate_is_looked_at_on_request(
    open_page: Callable[..., ServoPage], key: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    page, opened = open_page(REAL), list[int]()
    monkeypatch.setattr(
        page,
        "_open",
        lambda baud: opened.append(baud) or TimedLoop(page.bench.faulty, page.bench.clock, baud),
    )
    monkeypatch.setattr("armctl.hardware.bus.setup.IDS", range(9))
    page.do("look", key)
    assert opened == (list(FEETECH.bauds) if key else [1_000_000])


def test_a_register_that_differs_is_written_only_after_the_page_has_asked(
    open_page: Callable[..., ServoPage],
) -> None:
    page = open_page()
    page.bus.servo(5).put("highest", 2500)
    html = page.do("look")
    places(
        html,
        "1 difference from what the arm needs",
        "Servo 5: its own limits 0 … 2500",
        "Write highest = 3901",
    )
    page.do("mend", "5.0")
    assert page.bus.servo(5).get("highest") == 2500 and "Write highest = 3901 into servo 5" in page.html
    page.press("Leave it as it is")
    page.do("mend", "5.0")
    page.press("Write it")
    assert page.bus.servo(5).get("highest") == 3901 and page.bus.servo(5).get("lock") == 1
    page.refresh(page.section)
    assert "✓ 6 servos" in page.parts["servos"]
    assert page.notices[-1].startswith("Servo 5 · Wrist roll: written")
    with pytest.raises(InputError, match="no longer there"):
        page.do("mend", "5.0")


def test_a_servo_with_another_id_gets_the_one_that_is_missing(open_page: Callable[..., ServoPage]) -> None:
    page = open_page()
    page.do("look")
    page.do("id", "3@1000000")
    page.field("New id").value = "300"
    with pytest.raises(InputError, match="'300' is no id"):
        page.press("Write it")
    page.do("id", "3@1000000")
    page.field("New id").value = "9"
    page.press("Write it")
    page.refresh(page.section)
    html = page.parts["servos"]
    places(
        html,
        "Elbow flex",
        "silent",
        "not of this arm",
        "Servo 3 (Elbow flex) does not answer",
        "Give servo 9 the id 3",
    )
    page.do("mend", "3.0")
    page.press("Write it")
    page.refresh(page.section)
    assert [one.id for one in page.bus.servos] == [1, 2, 3, 4, 5, 6] and "✓ 6 servos" in page.parts["servos"]


def test_who_watches_looks_and_writes_nothing(open_page: Callable[..., ServoPage]) -> None:
    page = open_page()
    page.bus.servo(5).put("mode", 1)
    page.operates = False
    html = page.do("look")
    assert "Write mode = 0" in html and html.count("aria-disabled='true' title='this page is watching'") == 13
    for what, key in (("mend", "5.0"), ("nudge", "1@1000000"), ("id", "1@1000000")):
        with pytest.raises(ArmctlError, match="watching"):
            page.do(what, key)
    for label in ("Give it this id", "Save as LeRobot's file", "They are right as they are"):
        with pytest.raises(ArmctlError, match="watching"):
            page.press(label)
    assert page.bus.servo(5).get("mode") == 1 and all(one.code in (1, 2) for one in page.bus.heard)


def test_who_has_lost_control_while_the_page_asked_writes_nothing(
    open_page: Callable[..., ServoPage],
) -> None:
    page = open_page()
    page.bus.servo(5).put("mode", 1)
    page.do("look")
    page.do("mend", "5.0")
    page.operates = False
    with pytest.raises(ArmctlError, match="watching"):
        page.press("Write it")
    assert page.bus.servo(5).get("mode") == 1


def test_a_connected_arm_is_said_and_can_be_disconnected_there(open_page: Callable[..., ServoPage]) -> None:
    page = open_page()
    assert page.is_visible("Connect the arm") and not page.is_visible("Disconnect the arm")
    vars(page.snapshot).update(board=BoardIdentity("servo bus", "/dev/ttyACM0"))
    page.refresh(page.section)
    assert "The arm is connected on /dev/ttyACM0" in page.html
    assert page.is_visible("Disconnect the arm") and not page.is_visible("Connect the arm")
    page.press("Disconnect the arm")
    page.press("Connect the arm")
    assert page.asked == ["off", "connect"]
    with pytest.raises(StateError, match="disconnect first"):
        page.do("look")
    assert page.used == []


def test_a_search_shows_how_far_it_is_can_be_cancelled_and_is_alone(
    open_page: Callable[..., ServoPage],
) -> None:
    page, seen = open_page(), list[str]()
    feed = page.bench.faulty.feed

    def cancelling(data: bytes) -> bytes:
        if len(page.bus.heard) > 20:
            page.section.refresh(page.session.snapshot)
            seen.append(page.parts["servos"])
            with pytest.raises(StateError, match="under way"):
                page.section.require_free()
            page.shared.cancel()
        return feed(data)

    page.bench.faulty.feed = cancelling  # type: ignore[method-assign]
    html = page.do("look")
    assert "Cancel the search" in seen[0] and "Look for the servos" not in seen[0]
    assert page.notices == ["The search was cancelled."] and "STS3215" not in html
    page.section.require_free()


def test_a_new_servo_gets_its_id_and_the_next_one_is_asked_for(open_page: Callable[..., ServoPage]) -> None:
    page = open_page()
    with pytest.raises(BoardError, match=r"6 servos answer \(1, 2, 3, 4, 5, 6\): plug in the new one alone"):
        page.press("Give it this id")
    new = page.bus.servo(3)
    new.put("id", 1)
    page.bus.servos[:] = [new]
    page.field("It becomes").value = "3 · Elbow flex"
    page.press("Give it this id")
    assert "One servo answers: <b>STS3215</b> at 12.0 V, id 1" in page.html and new.id == 1
    page.press("Give it id 3")
    assert new.id == 3 and page.field("It becomes").value == "4 · Wrist flex"
    assert "✓ Servo 3 · Elbow flex</b> is set up" in page.html
    page.bus.servos.clear()
    with pytest.raises(BoardError, match="no servo answers"):
        page.press("Give it this id")


def test_a_nudge_shows_the_servo_and_leaves_it_limp(open_page: Callable[..., ServoPage]) -> None:
    page = open_page()
    page.do("look")
    page.do("nudge", "4@1000000")
    assert page.notices == ["Servo 4 · Wrist flex has moved, and is limp again."]
    assert not page.bus.servo(4).driven


def test_of_two_servos_with_one_id_the_one_at_the_row_is_meant(open_page: Callable[..., ServoPage]) -> None:
    page, opened = open_page(), list[int]()
    page.do("look")
    found = page.shared.seen.found if page.shared.seen else ()
    slow = replace(page.shared.found("4@1000000"), baud=57_600)
    page.shared._see("sim", [*found, slow], None)
    page.refresh(page.section)
    keys = re.findall(r"data-do='servo-(?:nudge|id)' data-key='(4@\d+)'", page.parts["servos"])
    assert keys == ["4@1000000"] * 2 + ["4@57600"] * 2
    page._open = lambda baud: (  # type: ignore[method-assign]
        opened.append(baud) or TimedLoop(page.bench.faulty, page.bench.clock, baud)
    )
    page.do("nudge", "4@57600")
    page.do("id", "4@57600")
    page.field("New id").value = "9"
    page.press("Write it")
    assert set(opened) == {57_600}
    page.refresh(page.section)
    keys = re.findall(r"data-do='servo-nudge' data-key='(\d+@\d+)'", page.parts["servos"])
    assert [key for key in keys if key[0] in "49"] == ["4@1000000", "9@57600"]
    with pytest.raises(InputError, match="no longer there"):
        page.do("nudge", "4@57600")


def test_lerobots_file_is_saved_compared_and_restored(open_page: Callable[..., ServoPage]) -> None:
    page = open_page(REAL)
    page.press("Save as LeRobot's file")
    file = page.files["calibration.json"]
    assert json.loads(file)["wrist_roll"]["range_max"] == 4095

    def compare(content: bytes) -> str:
        page.give_file("Compare with a file", "arm.json", content)
        return page.html

    assert "✓ The servos are as arm.json has them" in compare(file)
    page.bus.servo(5).put("lowest", 300)
    assert "5 · Wrist roll: lowest is 300, the file has 0" in compare(file)
    page.press("Write what differs")
    assert page.bus.servo(5).get("lowest") == 300
    page.press("Write it")
    assert page.bus.servo(5).get("lowest") == 0 and page.notices == ["1 registers are written and checked."]
    with pytest.raises(InputError, match=r"arm.json: not a calibration of LeRobot"):
        compare(b"\xff[")


def test_what_another_program_changed_since_is_named_written_back_or_kept(
    open_page: Callable[..., ServoPage], tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    page = open_page(REAL)
    page.do("look")
    assert page.is_visible("They are right as they are")
    page.press("They are right as they are")
    page.bus.servo(2).put("offset", 40)
    html = page.do("look")
    places(
        html,
        "Servo 2: its homing offset is 40, and was 0 when armctl kept it",
        "Write offset = 0 into servo 2",
    )
    page.press("They are right as they are")
    page.refresh(page.section)
    assert "✓ 6 servos" in page.parts["servos"] and page.bus.servo(2).get("offset") == 40
    page.bus.servo(2).put("offset", 7)
    page.do("look")
    page.do("mend", "2.0")
    page.press("Write it")
    assert page.bus.servo(2).get("offset") == 40


def test_nothing_is_kept_of_simulated_servos(
    open_page: Callable[..., ServoPage], tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    page = open_page(SIM)
    page.press("Save as LeRobot's file")
    page.refresh(page.section)
    assert not page.is_visible("They are right as they are") and list(tmp_path.iterdir()) == []


def test_a_port_that_cannot_be_used_is_not_opened(open_page: Callable[..., ServoPage]) -> None:
    page = open_page(PortChoice("/dev/ttyACM0", "adapter", why_not="no permission"))
    with pytest.raises(InputError, match="no permission"):
        page.do("look")
    assert page.used == []

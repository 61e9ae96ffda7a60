"""Changing the arm that the pages show."""

from __future__ import annotations

import asyncio
import re
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from tests.ui.page_kit import snapshot_of

from armctl.calibration import Calibration, CalibrationStore, own_calibration
from armctl.errors import ArmctlError, BoardError, InputError, RobotFileError, StateError, StoppedError
from armctl.facts import State
from armctl.hardware import BoardIdentity, Source
from armctl.process.heavy_work import Progress
from armctl.protocol import (
    Arrive,
    Command,
    Connect,
    Control,
    ControlCommand,
    Leave,
    LockControl,
    Origin,
    Party,
    RememberWrongPins,
    SetSpeed,
    Snapshot,
    Ticket,
    WrongPins,
)
from armctl.robot import Robot, load_robot
from armctl.ui import CalibrationInForce, Console, RobotChoice, RobotSwitch
from armctl.ui.robot_switch import RobotChange, release_first, require_replaceable
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration
from armctl.ui.tabs.main.boards import about, joints_of, labelled, opening_html
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.simulation.screen import Trail
from armctl.ui.tabs.simulation.workspace import CloudStore

SIMULATED = BoardIdentity("Pololu Micro Maestro 6-channel", "/dev/pts/3", simulated=True)
REAL = BoardIdentity("Pololu Micro Maestro 6-channel", "/dev/ttyACM0")
CHOICES = tuple(RobotChoice(name, load_robot(name).title) for name in ("uzuner", "mico", "scorbot"))
PAGE = Origin("page 7")


@dataclass
class FakeController:
    """Obeys at once, but for the commands it is told to refuse."""

    snapshot: Snapshot
    ended: bool = False
    refuses: dict[type[object], ArmctlError] = field(default_factory=dict[type[object], ArmctlError])
    commands: list[Command] = field(default_factory=list[Command])
    said: list[tuple[str, Command]] = field(default_factory=list[tuple[str, Command]])

    def submit(self, command: Command, origin: Origin) -> Ticket:
        assert origin == PAGE or isinstance(command, ControlCommand)
        self.commands.append(command)
        self.said.append((origin.who, command))
        if isinstance(command, Arrive):
            control = self.snapshot.control
            party = Party(origin.who, command.name, not command.watch)
            self.snapshot = replace(
                self.snapshot, control=replace(control, parties=(*control.parties, party))
            )
        return Ticket.ended(self.refuses.get(type(command)))


class Rig:
    """A desk of fake consoles; opening one can be held up, or fail."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.store = CalibrationStore(folder / "calibrations")
        self.closed: list[str] = []
        self.told: list[RobotChange] = []
        self.seen: list[tuple[str, list[str]]] = []
        self.opened: dict[str, FakeController] = {}
        self.meshes = False
        self.reading = threading.Event()
        self.may_open = threading.Event()
        self.may_open.set()
        self.on_open: Callable[[FakeController], None] = lambda controller: None
        self.robots: dict[str, Robot | ArmctlError] = {
            choice.name: load_robot(choice.name) for choice in CHOICES
        }
        self.desk = RobotSwitch(self.open("uzuner"), CHOICES[0], CHOICES, self.open)
        self.desk.on_change(self.tell)
        self.arm(board=SIMULATED, state=State.HOLDING, powered=True, speed=0.4)

    def open(self, name: str, port: str = "sim", progress: Progress | None = None) -> Console:
        if self.meshes and progress is not None:
            self.reading.set()
            while True:  # as long as it is wanted
                progress(2, 9)
        assert self.may_open.wait(10)
        robot = self.robots[name]
        if isinstance(robot, ArmctlError):
            raise robot
        controller = self.opened[name] = FakeController(snapshot_of(robot))
        self.on_open(controller)
        return Console(
            calibration=CalibrationInForce(robot, "simulated", self.store),
            controller=cast(Any, controller),
            list_ports=list,
            files=self.folder,
            default_port=port,
            close=lambda: self.closed.append(name),
        )

    def tell(self, change: RobotChange) -> None:
        self.told.append(change)
        self.seen.append((self.desk.console.robot.name, list(self.closed)))

    def arm(self, **changes: Any) -> None:
        """Make the first arm's snapshot another."""
        present = self.opened["uzuner"]
        present.snapshot = replace(present.snapshot, **changes)

    def change(self, name: str, permit: Callable[[], None] = lambda: None) -> None:
        asyncio.run(self.desk.change(name, PAGE, permit))

    def log(self) -> list[tuple[str, str]]:
        return [(event.level, event.text) for event in self.desk.console.earlier]

    def is_untouched(self) -> bool:
        return (
            self.desk.console.robot.name == self.desk.present.name == "uzuner"
            and "uzuner" not in self.closed
            and self.told == []
            and self.desk.opening is None
        )


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    return Rig(tmp_path)


def test_the_new_arm_takes_the_place_of_the_old_one_and_the_log_goes_on(rig: Rig) -> None:
    left = rig.desk.console
    rig.arm(q_command=np.radians([10.0, 90, -80, -40, 0]))
    rig.change("mico")
    assert rig.seen == [("mico", [])]  # told before the old arm is closed
    console = rig.desk.console
    assert (console.robot.n, rig.desk.present.name) == (4, "mico")
    assert console.shared(SharedProgram).folder != left.shared(SharedProgram).folder
    assert console.shared(Trail) is not left.shared(Trail)
    assert console.last_known is not left.last_known
    assert console.shared(CloudStore) is not left.shared(CloudStore)
    assert console.controller.snapshot.q_command == pytest.approx(load_robot("mico").first_pose)
    assert rig.opened["mico"].commands == [SetSpeed(0.4), Connect("sim")]
    assert rig.closed == ["uzuner"]
    assert rig.told == [RobotChange("page 7", "Kinova MICO, 4 joints", None)]
    assert rig.log() == [("info", "robot: Uzuner 5-DOF arm → Kinova MICO, 4 joints (page 7)")]
    rig.change("scorbot")
    assert [text for _, text in rig.log() if text.startswith("robot:")] == [
        "robot: Uzuner 5-DOF arm → Kinova MICO, 4 joints (page 7)",
        "robot: Kinova MICO, 4 joints → Scorbot ER-4PC (page 7)",
    ]
    rig.desk.close()
    assert rig.closed == ["uzuner", "mico", "scorbot"]


def test_pages_that_cannot_be_built_leave_no_arm_open(rig: Rig) -> None:
    def broken(change: RobotChange) -> None:
        raise RuntimeError(change.title)

    rig.desk.on_change(broken)
    with pytest.raises(RuntimeError, match="MICO"):
        rig.change("mico")
    assert rig.closed == ["uzuner"]
    assert rig.desk.opening is None


@pytest.mark.parametrize(
    ("state", "board", "said"),
    [
        (State.MOVING, SIMULATED, r"the arm moves; wait until it stands, or press STOP, then choose"),
        (
            State.PAUSED,
            SIMULATED,
            r"in the middle of a motion; wait until it stands, or press STOP, then choose",
        ),
        (State.HOLDING, REAL, r"servos on /dev/ttyACM0 are on; press Release \(the arm drops\), then"),
        (State.FAULT, REAL, r"servos on /dev/ttyACM0 are on; press Release"),
    ],
)
def test_an_arm_that_moves_or_is_held_up_by_real_servos_is_not_left(
    rig: Rig, state: State, board: BoardIdentity, said: str
) -> None:
    rig.arm(state=state, board=board, powered=True)
    with pytest.raises(StateError, match=said):
        rig.change("mico")
    assert rig.is_untouched()
    assert "mico" not in rig.opened


@pytest.mark.parametrize(
    ("state", "board"),
    [(State.HOLDING, SIMULATED), (State.FAULT, SIMULATED), (State.OFF, REAL), (State.DISCONNECTED, None)],
)
def test_an_arm_that_may_be_left(state: State, board: BoardIdentity | None) -> None:
    snapshot = snapshot_of(load_robot("uzuner"))
    powered = board is SIMULATED
    require_replaceable(replace(snapshot, state=state, board=board, powered=powered), reopen=False)


@pytest.mark.parametrize(
    ("source", "outputs"),
    [(Source.COMMANDED, "servos"), (Source.TRANSMITTED, "servos"), (Source.MEASURED, "motors")],
)
@pytest.mark.parametrize("state", [State.OFF, State.HOLDING, State.MOVING])
def test_what_release_is_needed_for_is_known_before_it_is_asked_for(
    source: Source, outputs: str, state: State
) -> None:
    snapshot = replace(
        snapshot_of(load_robot("uzuner")), state=state, board=REAL, powered=True, source=source
    )
    on = f"the {outputs} on /dev/ttyACM0 are on"
    leave = release_first(snapshot, reopen=False)
    assert leave == f"{on}; press Release (the arm drops), then choose another robot"
    support = f"{on}, and the arm has to be opened anew: support it, press Release (it drops), then try again"
    keeps_it_up = source is Source.TRANSMITTED  # a Maestro goes on by itself
    assert release_first(snapshot, reopen=True) == (None if keeps_it_up else support)


@pytest.mark.parametrize(
    ("board", "why"),
    [
        (REAL, "the servos on /dev/ttyACM0 are another arm's; choose its port and press Connect"),
        (None, "as the arm before it was not; press Connect"),
    ],
)
def test_the_new_arm_is_not_connected_after_one_that_is_not_simulated(
    rig: Rig, board: BoardIdentity | None, why: str
) -> None:
    rig.arm(state=State.DISCONNECTED if board is None else State.OFF, board=board, powered=False)
    rig.change("mico")
    assert rig.opened["mico"].commands == [SetSpeed(0.4)]
    level, text = rig.log()[-1]
    assert (level, rig.told[0].not_connected) == ("warning", text)
    assert why in text


def test_a_robot_that_cannot_be_opened_leaves_the_present_one(rig: Rig) -> None:
    rig.robots["mico"] = RobotFileError("mico.toml: dh.rows: broken")
    with pytest.raises(RobotFileError, match=r"dh\.rows: broken"):
        rig.change("mico")
    assert rig.is_untouched()
    rig.change("scorbot")  # and the desk still works
    assert rig.desk.present.name == "scorbot"


def test_an_arm_that_cannot_be_connected_is_closed_again(rig: Rig) -> None:
    def refuse(controller: FakeController) -> None:
        controller.refuses[Connect] = BoardError("no pty left")

    rig.on_open = refuse
    with pytest.raises(BoardError, match="no pty left"):
        rig.change("mico")
    assert rig.is_untouched()
    assert rig.closed == ["mico"]


def test_an_arm_that_has_begun_to_move_meanwhile_is_not_left(rig: Rig) -> None:
    rig.on_open = lambda controller: rig.arm(state=State.MOVING)
    with pytest.raises(StateError, match="press STOP"):
        rig.change("mico")
    assert rig.is_untouched()
    assert rig.closed == ["mico"]


@pytest.mark.parametrize("allowed", [0, 1])
def test_a_page_that_may_not_choose_or_has_gone_meanwhile_changes_nothing(rig: Rig, allowed: int) -> None:
    asked: list[bool] = []

    def permit() -> None:
        asked.append(True)
        if len(asked) > allowed:
            raise ArmctlError("this page is watching")

    with pytest.raises(ArmctlError, match="watching"):
        rig.change("mico", permit)
    assert rig.is_untouched()
    assert rig.closed == ["mico"] * allowed
    assert len(rig.opened) == 1 + allowed


def test_of_two_quick_choices_the_second_is_refused(rig: Rig) -> None:
    async def choose_twice() -> None:
        rig.may_open.clear()
        first = asyncio.create_task(rig.desk.change("mico", PAGE, lambda: None))
        await asyncio.sleep(0)
        assert rig.desk.opening is CHOICES[1]
        with pytest.raises(StateError, match="being changed for Kinova MICO"):
            await rig.desk.change("scorbot", PAGE, lambda: None)
        with pytest.raises(StateError, match="wait a moment"):
            rig.desk.require_settled()  # what asks for a motion asks this first
        rig.may_open.set()
        await first
        rig.desk.require_settled()

    asyncio.run(choose_twice())
    assert rig.desk.present.name == "mico"
    assert "scorbot" not in rig.opened


def test_an_arm_whose_meshes_take_long_can_be_left(rig: Rig) -> None:
    rig.meshes = True

    async def leave() -> None:
        change = asyncio.create_task(rig.desk.change("mico", PAGE, lambda: None))
        await asyncio.to_thread(rig.reading.wait, 10)
        while rig.desk.progress is None:
            await asyncio.sleep(0)
        assert rig.desk.progress == (2, 9)
        assert "2 of 9 parts" in opening_html("MICO", rig.desk.progress)
        rig.desk.give_up()
        with pytest.raises(StoppedError, match=r"MICO.* was not opened"):
            await change

    asyncio.run(leave())
    assert rig.is_untouched()
    assert rig.desk.progress is None
    rig.meshes = False
    rig.change("mico")
    assert rig.desk.present.name == "mico"


def test_an_arm_that_was_left_too_late_is_closed(rig: Rig) -> None:
    rig.on_open = lambda _: rig.desk.give_up()
    with pytest.raises(StoppedError):
        rig.change("mico")
    assert rig.closed == ["mico"]
    assert rig.desk.present.name == "uzuner"


def test_only_another_robot_of_the_list_can_be_chosen(rig: Rig) -> None:
    console = rig.desk.console
    rig.arm(state=State.MOVING)
    rig.change("uzuner")
    with pytest.raises(InputError, match=r"no robot '\.\./secret' to choose"):
        rig.change("../secret")
    assert rig.desk.console is console
    assert rig.is_untouched()


def test_where_an_arm_was_last_known_is_kept_for_the_same_machine_alone(rig: Rig) -> None:
    rig.arm(powered=False, state=State.OFF)
    before = rig.desk.console.last_known
    reopen(rig)
    assert rig.desk.console.last_known is before
    reopen(rig, "/dev/ttyACM7")  # never seen there
    assert rig.desk.console.last_known is not before
    before = rig.desk.console.last_known
    rig.robots["uzuner"] = load_robot("mico")  # the file holds four joints by now
    reopen(rig, "/dev/ttyACM7")
    assert rig.desk.console.last_known is not before


def test_robots_of_one_title_are_told_apart_by_their_files_and_these_by_their_folders() -> None:
    own = RobotChoice("/home/lab/mine.toml", CHOICES[0].title)
    links = [RobotChoice(f"/home/{who}/arm.urdf#w/link", "hobby") for who in ("ann", "ben")]
    assert labelled((*CHOICES[:2], own, *links)) == {
        "Uzuner 5-DOF arm (uzuner)": "uzuner",
        "Kinova MICO, 4 joints": "mico",
        "Uzuner 5-DOF arm (mine.toml)": "/home/lab/mine.toml",
        "hobby (/home/ann/arm.urdf#w/link)": links[0].name,
        "hobby (/home/ben/arm.urdf#w/link)": links[1].name,
    }
    assert list(labelled([RobotChoice("ur5", "UR5", simulated_only=True)])) == ["UR5 – simulated only"]
    other = RobotChoice("/home/ann/second.urdf", "hobby")
    assert list(labelled([links[0], other])) == ["hobby (arm.urdf)", "hobby (second.urdf)"]


def test_what_a_robot_file_says_is_shown_as_text() -> None:
    robot = replace(load_robot("mico"), source="<img src=x>")
    assert joints_of(robot) == "4 joints and a gripper"
    assert "<img" not in about(robot)
    assert "<details" not in about(replace(robot, source="", assumed=()))
    assert "Simulated only" not in about(robot)
    ur5 = load_robot("ur5")
    assert re.search(rf"Simulated only.*: {ur5.no_board}\.", about(ur5))
    guessed = about(replace(robot, assumed=("limits of <b>Elbow</b>: -90 to 90°",)))
    assert "limits of &lt;b&gt;Elbow&lt;/b&gt;: −90 to 90°</li>" in guessed


def reopen(rig: Rig, port: str | None = None) -> None:
    asyncio.run(rig.desk.reopen(PAGE, lambda: None, port))


def test_an_arm_that_is_opened_anew_goes_on_with_speed_marks_and_port(rig: Rig) -> None:
    left = rig.desk.console
    left.shared(SharedCalibration).work.add_mark("base", 1500.0, 0.0)
    edited = left.shared(SharedProgram)
    reopen(rig)
    console = rig.desk.console
    assert console is not left
    assert console.last_known is left.last_known
    assert console.shared(SharedProgram) is edited
    assert len(console.shared(SharedCalibration).work.joint("base").marks) == 1
    assert rig.opened["uzuner"].commands == [SetSpeed(0.4), Connect("sim")]
    assert rig.closed == ["uzuner"]
    assert rig.told == [RobotChange("page 7", "Uzuner 5-DOF arm", None, "calibrated")]
    assert rig.log() == [("info", "robot: Uzuner 5-DOF arm calibrated (page 7)")]


@pytest.mark.parametrize("port", [None, "/dev/ttyACM0"])
def test_an_arm_that_was_not_connected_is_connected_on_the_port_it_was_opened_anew_for(
    rig: Rig, port: str | None
) -> None:
    rig.arm(state=State.DISCONNECTED, board=None, powered=False)
    reopen(rig, port)
    assert rig.opened["uzuner"].commands == [SetSpeed(0.4), *([Connect(port)] if port else [])]
    assert rig.desk.console.default_port == (port or "sim")
    did = "opened" if port else "calibrated"
    assert rig.log()[-1] == ("info", f"robot: Uzuner 5-DOF arm {did} (page 7)")


def test_a_board_that_does_not_answer_is_told_and_the_new_arm_stays(rig: Rig) -> None:
    def refuse(controller: FakeController) -> None:
        controller.refuses[Connect] = BoardError("nobody there")

    left, rig.on_open = rig.desk.console, refuse
    with pytest.raises(BoardError, match="nobody there"):
        reopen(rig)
    assert rig.desk.console is not left
    assert rig.desk.opening is None


def test_an_arm_in_motion_is_not_opened_anew(rig: Rig) -> None:
    rig.arm(state=State.MOVING)
    with pytest.raises(
        StateError, match="in the middle of a motion; wait until it stands, or press STOP, then try again"
    ):
        reopen(rig)
    assert rig.is_untouched()


@pytest.mark.parametrize("source", [Source.COMMANDED, Source.TRANSMITTED])
def test_an_arm_that_would_drop_is_not_opened_anew(rig: Rig, source: Source) -> None:
    rig.arm(board=REAL, state=State.HOLDING, powered=True, source=source)
    if source is Source.TRANSMITTED:  # the board goes on by itself meanwhile
        reopen(rig)
        assert rig.opened["uzuner"].commands[-1] == Connect("sim")
        return
    with pytest.raises(StateError, match=r"support it, press Release \(it drops\), then try again"):
        reopen(rig)
    with pytest.raises(StateError, match="press Release"):
        rig.desk.require_reopenable()
    assert rig.is_untouched()


@pytest.mark.parametrize("state", [State.DISCONNECTED, State.FAULT, State.HOLDING])
def test_to_connect_elsewhere_the_arm_is_opened_for_the_board_there(rig: Rig, state: State) -> None:
    """A fault may leave its board open: another one is another arm's calibration all the same."""
    if state is not State.HOLDING:  # connected already
        rig.arm(state=state, board=SIMULATED if state is State.FAULT else None, powered=False)
    assert asyncio.run(rig.desk.needs_reopening("/dev/ttyACM0")) is (state is not State.HOLDING)
    assert not asyncio.run(rig.desk.needs_reopening("sim"))


def test_what_was_calibrated_at_the_terminal_meanwhile_takes_an_arm_that_is_opened_anew(rig: Rig) -> None:
    rig.arm(state=State.DISCONNECTED, board=None, powered=False)
    elbow = own_calibration(rig.desk.console.robot, "elbow")
    rig.store.save(Calibration("uzuner", "simulated", "µs", {"elbow": elbow}))
    assert asyncio.run(rig.desk.needs_reopening("sim"))


def test_an_arm_whose_process_is_gone_is_opened_anew(rig: Rig) -> None:
    rig.opened["uzuner"].ended = True
    rig.arm(board=None, state=State.FAULT, powered=False)
    assert asyncio.run(rig.desk.needs_reopening("sim"))


def test_a_process_that_is_gone_is_started_again_once_for_all_who_ask_and_not_connected(rig: Rig) -> None:
    asyncio.run(rig.desk.revive("vision"))
    assert rig.told == []  # it is there
    people = (Party("vision, program 1", "vision"), Party("page 7", "Bob", True))
    rig.desk.pages.append("page 7")
    rig.opened["uzuner"].ended = True
    rig.arm(board=None, state=State.FAULT, powered=False, control=Control(people))

    async def all_ask() -> None:
        await asyncio.gather(*(rig.desk.revive(who) for who in ("vision", "one", "another")))

    asyncio.run(all_ask())
    (change,) = rig.told
    assert change.did == "started a new arm process for" and change.who == "vision"
    assert change.not_connected is not None and "press Connect" in change.not_connected
    new = rig.opened["uzuner"]
    assert not new.ended
    assert [type(one) for one in new.commands] == [Arrive, SetSpeed]
    assert {who for who, _ in new.said} == {"page 7"}  # who operated does so again, and says how fast


def test_a_process_that_cannot_be_started_again_is_not_tried_at_each_hello(rig: Rig) -> None:
    rig.opened["uzuner"].ended = True
    rig.arm(board=None, state=State.FAULT, powered=False)
    tried: list[str] = []

    def fails(controller: FakeController) -> None:
        tried.append("")
        raise BoardError("no more processes")

    rig.on_open = fails

    async def ask_twice() -> None:
        for _ in range(2):
            with pytest.raises(BoardError, match="no more processes"):
                await rig.desk.revive("vision")

    asyncio.run(ask_twice())
    assert len(tried) == 1


@pytest.mark.parametrize("by_teacher", [False, True])
def test_who_operates_and_a_lock_go_over_to_the_new_arm(rig: Rig, by_teacher: bool) -> None:
    people = (
        Party("browser page 1", "Ann"),
        Party("pick.py, program 1", "pick.py"),
        Party("page 7", "Bob", True),
    )
    rig.arm(control=Control(people, locked=True, by_teacher=by_teacher, pin=True))
    rig.desk.pages += ["browser page 1", "page 7"]
    rig.change("mico")
    pin = rig.desk.console.pin if by_teacher else ""
    said = [one for one in rig.opened["mico"].commands if isinstance(one, ControlCommand)]
    assert said == [Arrive("Bob"), Arrive("Ann", watch=True), LockControl(True, pin)]


def test_wrong_pins_are_counted_on_by_the_new_arm_and_pages_keep_their_source(rig: Rig) -> None:
    guessed = (WrongPins("Bob", "pages at 10.0.0.7", 60),)
    rig.arm(control=Control((Party("page 7", "Bob", True),), pin=True, wrong_pins=guessed))
    rig.desk.pages += ["page 7"]
    rig.desk.sources["page 7"] = "pages at 10.0.0.7"
    rig.change("mico")
    said = [one for one in rig.opened["mico"].commands if isinstance(one, ControlCommand)]
    assert said == [Arrive("Bob"), RememberWrongPins(guessed)]
    assert rig.desk.origin("page 7") == Origin("page 7", source="pages at 10.0.0.7")


def test_a_page_that_comes_or_goes_while_the_arm_is_changed_is_told_to_the_new_arm(rig: Rig) -> None:
    people = (Party("browser page 1", "Ann"), Party("page 7", "Bob", True), Party("browser page 2", "Eve"))
    rig.arm(control=Control(people))
    rig.desk.pages += ["browser page 1", "page 7"]

    def permit() -> None:
        if "mico" in rig.opened:  # it is open, and knows who was there before
            rig.desk.pages[:] = ["page 7", "browser page 2"]

    rig.change("mico", permit)
    assert [one for one in rig.opened["mico"].said if isinstance(one[1], ControlCommand)] == [
        ("page 7", Arrive("Bob")),
        ("browser page 1", Arrive("Ann", watch=True)),
        ("browser page 1", Leave("its page is gone")),
        ("browser page 2", Arrive("Eve", watch=True)),
    ]

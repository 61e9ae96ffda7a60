"""One next pose a page: whoever writes it, what is drawn is what *Go* sends."""

from __future__ import annotations

import gc
import os
import re
import weakref
from collections.abc import Callable
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from tests.ui.page_kit import FakePage

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError, InputError
from armctl.facts import State
from armctl.motion import plan_joints
from armctl.protocol import MoveJoints, Party
from armctl.robot import Deflection, load_robot
from armctl.ui.guard import GuardedServer
from armctl.ui.next_line import Told
from armctl.ui.next_pose import End, NextPoses, PoseWriter
from armctl.ui.tabs.forward.screen import ForwardScreen
from armctl.ui.tabs.inverse.screen import InverseScreen
from armctl.ui.tabs.manual.joints import JointControl
from armctl.ui.widgets import number_field

ROBOT = load_robot("uzuner")
LOW, HIGH = ROBOT.limits.T
HOME = ROBOT.pose("home")
THERE = HOME + np.radians([20.0, 0, 0, 0, 0])
LONG = bool(os.environ.get("ARMCTL_LONG"))
SEQUENCES, STEPS = (300, 40) if LONG else (5, 25)


def line(page: FakePage) -> str:
    """What the line below the picture says."""
    return " ".join(re.sub("<[^>]*>", " ", page.parts["next"]).split())


def go_is_off(page: FakePage) -> bool:
    return "aria-disabled" in page.parts["next"].rpartition("data-do='go'")[2]


@pytest.fixture
def page(server: GuardedServer) -> FakePage:
    made = FakePage(server, ROBOT, HOME)
    made.next.refresh(made.session.snapshot)
    return made


def test_it_says_where_by_whom_and_how_long_and_go_sends_it(page: FakePage) -> None:
    assert line(page).startswith("No next pose") and go_is_off(page)
    with pytest.raises(InputError, match="there is no next pose yet"):
        page.go()
    writer = PoseWriter(page.session, "somebody")
    page.act(lambda: writer.show(THERE))
    x, y, z = 1000 * ROBOT.forward(THERE)[:3, 3]
    seconds = plan_joints(ROBOT, HOME, THERE).duration
    assert (
        line(page)
        == f"X {x:.1f} &ensp;Y {y:.1f} &ensp;Z {z:.1f} mm somebody · {seconds:.2f} s · clear Record Go"
    )
    assert not go_is_off(page)
    page.go()
    (command,) = page.sent
    assert isinstance(command, MoveJoints) and np.array_equal(command.q, THERE)
    page.snapshot.q_command = THERE
    page.next.refresh(page.session.snapshot)
    assert page.next.q is None and not page.next.ghost.seen and line(page).startswith("No next pose")


def test_record_is_grey_where_nobody_knows_where_the_arm_is(page: FakePage) -> None:
    assert (
        "aria-disabled" not in page.parts["next"].partition("data-do='record'")[2].partition("</button>")[0]
    )
    page.snapshot.q, page.snapshot.commanded = np.full(5, np.nan), False
    page.next.refresh(page.session.snapshot)
    record = page.parts["next"].partition("data-do='record'")[2].partition("</button>")[0]
    assert "aria-disabled" in record and "so its pose is not known" in record


def test_while_a_program_runs_the_line_tells_its_step_and_the_next_pose_waits(page: FakePage) -> None:
    writer = PoseWriter(page.session, "somebody")
    page.act(lambda: writer.show(THERE))
    page.next.running = lambda snapshot: None if snapshot.program is None else Told("Step 1 of 2", "a · b")
    page.snapshot.program, page.snapshot.busy, page.snapshot.state = object(), True, State.MOVING
    page.next.refresh(page.session.snapshot)
    assert line(page).startswith("Step 1 of 2 a · b") and go_is_off(page)
    assert not page.next.ghost.seen and page.next.in_view is None
    assert page.next.q is not None and "data-keep=recall" in page.parts["next"]  # nothing is lost
    page.snapshot.program, page.snapshot.busy, page.snapshot.state = None, False, State.HOLDING
    page.next.refresh(page.session.snapshot)
    assert page.next.ghost.seen and line(page).startswith("X ")


def test_while_a_tab_shows_a_motion_of_its_own_the_next_pose_waits_and_go_sends_nothing(
    page: FakePage,
) -> None:
    writer = PoseWriter(page.session, "somebody")
    page.act(lambda: writer.show(THERE))
    number = str(page.next.number)
    page.next.instead = lambda _: Told("home to zero", "1.2 s")
    page.next.refresh(page.session.snapshot)
    assert line(page).startswith("home to zero 1.2 s") and go_is_off(page)
    assert not page.next.ghost.seen and "data-keep=recall" in page.parts["next"]  # nothing is lost
    with pytest.raises(InputError, match="another motion is looked at"):
        page.act(lambda: page.parts.done("go", number))
    assert not page.sent
    page.next.instead = lambda _: None
    page.next.refresh(page.session.snapshot)
    assert page.next.ghost.seen and line(page).startswith("X ")


def test_who_finds_no_pose_says_why_until_it_looks_again_or_somebody_writes(page: FakePage) -> None:
    writer, other = PoseWriter(page.session, "somebody"), PoseWriter(page.session, "another")
    writer.hide(Told("Out of reach", "the nearest point is far", bad=True))
    assert line(page).startswith("Out of reach The nearest point is far.")
    other.begin()  # not its own
    assert line(page).startswith("Out of reach")
    writer.begin()
    assert line(page).startswith("No next pose")
    writer.hide(Told("Out of reach", "the nearest point is far", bad=True))
    page.act(lambda: other.show(THERE))
    page.next.clear()
    assert line(page).startswith("No next pose")


def test_go_names_the_pose_that_it_was_pressed_for(page: FakePage) -> None:
    writer = PoseWriter(page.session, "somebody")
    page.act(lambda: writer.show(THERE))
    pressed = str(page.next.number)
    page.act(lambda: writer.show(THERE + 0.1))
    with pytest.raises(InputError, match="has just changed"):
        page.act(lambda: page.parts.done("go", pressed))
    assert page.sent == []
    page.go()
    assert len(page.sent) == 1


def test_a_way_that_is_refused_says_why_and_is_not_sent(page: FakePage) -> None:
    folded = HOME.copy()
    folded[1] = LOW[1]
    writer = PoseWriter(page.session, "somebody")
    page.act(lambda: writer.show(folded))
    assert "below the floor" in line(page) and go_is_off(page)
    with pytest.raises(InputError, match="below the floor"):
        page.go()
    assert page.sent == []


def test_a_movement_that_cannot_be_had_is_told_in_the_line(page: FakePage) -> None:
    asked: list[float | None] = [0.01]
    writer = PoseWriter(page.session, "somebody", lambda: ("cubic", asked[0]))
    page.act(lambda: writer.show(THERE))
    assert "shortest possible duration" in line(page) and go_is_off(page)
    asked[0] = 3.0
    page.act(lambda: page.next.refresh(page.session.snapshot))
    assert "3.00 s · clear" in line(page)
    page.go()
    command = page.sent[-1]
    assert isinstance(command, MoveJoints) and command.duration_s == 3.0


def test_from_one_side_it_has_arrived_where_the_links_stand(server: GuardedServer) -> None:
    """Half of the play ahead of the pose, if that is known."""
    rigid = Deflection.of(ROBOT.gravity, ROBOT.gravity.heaviest(ROBOT.limits))
    soft = replace(rigid, play=np.radians([2.0, 0.0, 0.0, 0.0, 0.0]))
    page = FakePage(server, replace(ROBOT, output_map=replace(ROBOT.outputs, deflection=soft)), HOME)
    writer = PoseWriter(page.session, "somebody", lambda: ("end-minus", None))
    page.act(lambda: writer.show(THERE))
    page.go()
    command = page.sent[-1]
    assert isinstance(command, MoveJoints) and command.profile == "end-minus"
    assert np.array_equal(command.q, THERE)
    planned = page.next.trajectory
    assert planned is not None and planned.end[0] == pytest.approx(THERE[0] - np.radians(1.0))
    page.snapshot.q_command = planned.end
    page.next.refresh(page.session.snapshot)
    assert page.next.q is None


def test_it_outlives_a_stop_and_is_planned_anew_where_the_arm_is_moved_otherwise(page: FakePage) -> None:
    writer = PoseWriter(page.session, "somebody")
    page.act(lambda: writer.show(THERE))
    page.go()
    page.snapshot.state, page.snapshot.busy = State.MOVING, True
    page.next.refresh(page.session.snapshot)
    assert "on its way" in line(page) and go_is_off(page)
    page.snapshot.q_command = 0.5 * (HOME + THERE)  # stopped half way
    page.snapshot.state, page.snapshot.busy = State.HOLDING, False
    page.act(lambda: page.next.refresh(page.session.snapshot))
    assert page.next.q is not None and np.array_equal(page.next.q, THERE)
    seconds = plan_joints(ROBOT, page.snapshot.q_command, THERE).duration
    assert f"{seconds:.2f} s · clear" in line(page) and not go_is_off(page)


def test_who_is_replaced_is_told_and_a_pose_that_the_arm_has_is_none(page: FakePage) -> None:
    told: list[tuple[str, End]] = []

    def writer(name: str) -> PoseWriter:
        return PoseWriter(page.session, name, ended=lambda why: told.append((name, why)))

    one, other = writer("one"), writer("other")
    page.act(lambda: one.show(THERE))
    assert one.shown and other.taken and told == [("other", "replaced")]
    page.act(lambda: other.show(THERE + 0.1))
    assert one.taken and told[1:] == [("one", "replaced")]
    one.hide()  # it is not its own
    assert page.next.q is not None
    other.hide()
    assert page.next.q is None and len(told) == 2  # who hides knows
    page.act(lambda: one.show(THERE))
    page.act(lambda: page.parts.done("forget", ""))
    assert page.next.q is None and told[-1] == ("one", "forgotten")
    page.act(lambda: one.show(HOME))
    assert page.next.q is None and not page.next.ghost.seen


def test_who_watches_sees_the_operators(server: GuardedServer) -> None:
    page = FakePage(server, ROBOT, HOME)
    poses = page.console.shared(NextPoses)
    page.act(lambda: PoseWriter(page.session, "somebody").show(THERE))
    watcher = FakePage(server, ROBOT, HOME)
    watcher.me, watcher.operates, watcher.next._poses = "browser page 2", False, poses
    watcher.snapshot.control = type(page.snapshot.control)((Party(page.me, "Ada", operates=True),))
    watcher.next.refresh(watcher.session.snapshot)
    assert watcher.next._theirs.q is not None and np.array_equal(watcher.next._theirs.q, THERE)
    assert watcher.next.q is None
    page.next.close()
    watcher.next.refresh(watcher.session.snapshot)
    assert not watcher.next._theirs.seen


def kept_by(page: FakePage) -> str:
    """What the page keeps while it is loaded anew."""
    found = re.search("data-keep=recall data-kept='([^']*)'", page.parts["next"])
    assert found is not None
    return unescape(found[1])


def test_a_page_that_is_loaded_anew_has_it_again_as_it_was(server: GuardedServer) -> None:
    page, back = FakePage(server, ROBOT, HOME), FakePage(server, ROBOT, HOME)
    page.act(lambda: PoseWriter(page.session, "some<body>", lambda: ("normal", None)).show(THERE))
    page.next.refresh(page.session.snapshot)
    back.act(lambda: back.parts.done("recall", "", kept_by(page)))
    assert back.next.q is not None and np.array_equal(back.next.q, THERE)
    assert "some&lt;body&gt;" in back.parts["next"] and "some<body>" not in back.parts["next"]
    assert not back.sent
    back.go()
    command = back.sent[-1]
    assert isinstance(command, MoveJoints) and command.profile == "normal"


def test_what_a_page_kept_changes_no_newer_pose_and_is_nothing_to_another_arm(server: GuardedServer) -> None:
    page, back = FakePage(server, ROBOT, HOME), FakePage(server, ROBOT, HOME)
    page.act(lambda: PoseWriter(page.session, "old").show(THERE))
    page.next.refresh(page.session.snapshot)
    kept = kept_by(page)
    newer = PoseWriter(back.session, "newer")
    back.act(lambda: newer.show(HOME + 0.1))
    back.act(lambda: back.parts.done("recall", "", kept))
    assert "newer" in line(back)
    back.act(newer.hide)
    back.act(lambda: back.parts.done("recall", "", kept.replace("uzuner", "abaas")))
    assert back.next.q is None


def test_what_a_page_kept_leaves_nothing_behind_once_it_is_forgotten(page: FakePage) -> None:
    page.act(lambda: PoseWriter(page.session, "old").show(THERE))
    page.next.refresh(page.session.snapshot)
    kept = kept_by(page)
    page.act(lambda: page.parts.done("forget", ""))
    page.act(lambda: page.parts.done("recall", "", kept))
    assert page.next.writer is not None
    recalled = weakref.ref(page.next.writer)
    page.act(lambda: page.parts.done("forget", ""))
    gc.collect()
    assert page.next.q is None and recalled() is None


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"q":[', '"q":[null,'),
        ('"q":[', '"q":[0.0,'),
        ('"q":[', '"q":[9e9],"more":['),
        ('"words":"', '"words":"' + 50 * "x"),
        ('"profile":"cubic"', '"profile":"jump"'),
        ('"duration_s":null', '"duration_s":-1'),
        ("{", "["),
    ],
)
def test_what_a_page_could_not_have_kept_is_refused(page: FakePage, old: str, new: str) -> None:
    page.act(lambda: PoseWriter(page.session, "old").show(THERE))
    page.next.refresh(page.session.snapshot)
    kept = kept_by(page)
    page.act(page.next.clear)
    with pytest.raises(InputError):
        page.act(lambda: page.parts.done("recall", "", kept.replace(old, new, 1)))
    assert page.next.q is None


class Sequence:
    """One page with its three screens that write the next pose, and somebody else who moves the arm."""

    def __init__(self, server: GuardedServer, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self.page = FakePage(server, ROBOT, HOME)
        self.joints = JointControl(self.page.session)
        self.sliders = {
            label: self.page._handles[label] for label in self.page._handles if label.endswith("°")
        }
        self.slid = {label: self.page._actions[label] for label in self.sliders}
        self.forward = ForwardScreen(self.page.session)
        self.angles = {f"{joint.title} °": self.page._handles[f"{joint.title} °"] for joint in ROBOT.joints}
        self.typed = {label: self.page._actions[label] for label in self.angles}
        self.inverse = InverseScreen(self.page.session)
        self.refresh()

    def refresh(self) -> None:
        def draw() -> None:
            self.page.next.refresh(self.page.session.snapshot)
            for screen in (self.joints, self.forward, self.inverse):
                screen.refresh(self.page.session.snapshot)

        self.page.act(draw)

    def slide(self) -> None:
        i = int(self.random.integers(ROBOT.n))
        label = f"{ROBOT.joints[i].title} °"
        slider = self.sliders[label]
        slider.value = round(float(np.degrees(self.random.uniform(LOW[i], HIGH[i]))), 2)
        self.page.act(self.slid[label])

    def type_angle(self) -> None:
        i = int(self.random.integers(ROBOT.n))
        label = f"{ROBOT.joints[i].title} °"
        self.angles[label].value = self.random.choice(
            [f"{np.degrees(self.random.uniform(LOW[i], HIGH[i])):.2f}", "4,5", "", "300"],
            p=[0.7, 0.1, 0.1, 0.1],
        )
        self.page.act(self.typed[label])

    def solve(self) -> None:
        point = 1000 * ROBOT.forward(self.random.uniform(LOW, HIGH))[:3, 3]
        self.page.ask(*np.round(point * self.random.choice([1.0, 1.0, 3.0]), 1).tolist())
        self.page.press("Solve")

    def choose_a_row(self) -> None:
        if (found := self.inverse._answer) is not None and found.solutions.success:
            self.page.put("Row", str(self.random.integers(1, len(found.solutions) + 1)))

    def another_moves(self) -> None:
        there = self.random.uniform(LOW, HIGH)
        self.page.snapshot.state, self.page.snapshot.busy = State.MOVING, True
        for part in (0.4, 1.0):
            self.page.snapshot.q_command = (1 - part) * self.page.snapshot.q_command + part * there
            self.refresh()
        self.page.snapshot.state, self.page.snapshot.busy = State.HOLDING, False

    def forget(self) -> None:
        self.page.act(lambda: self.page.parts.done("forget", ""))
        assert self.page.next.q is None

    def go(self) -> None:
        drawn, sent = self.page.next.q, len(self.page.sent)
        off = go_is_off(self.page)
        try:
            self.page.go()
        except ArmctlError:
            assert off and len(self.page.sent) == sent
            return
        command = self.page.sent[-1]
        assert not off and isinstance(command, MoveJoints)
        assert drawn is not None and np.array_equal(command.q, drawn)
        arrives = self.random.random() < 0.6  # else it is stopped on its way
        start = self.page.snapshot.q_command
        self.page.snapshot.q_command = drawn.copy() if arrives else start + 0.3 * (drawn - start)
        if not arrives:
            return
        self.refresh()
        adds = self.forward._shown.value != "angles as reference" and self.forward._following.edited
        assert self.page.next.q is None or adds

    def looks_true(self) -> None:
        page = self.page
        q, ghost = page.next.q, page.next.ghost
        shown = np.array([self.sliders[f"{joint.title} °"].value for joint in ROBOT.joints])
        present: FloatArray = page.snapshot.q_command
        base = present if q is None else q
        assert np.abs(shown - np.degrees(base)).max() < 0.02  # the sliders show it, or the arm
        assert ghost.seen is (q is not None)
        assert line(page).startswith(("No next pose", "Out of reach", "The arm cannot")) is (q is None)
        if q is None:
            return
        assert ghost.q is not None and np.array_equal(ghost.q, q)
        x, y, z = 1000 * ROBOT.forward(q)[:3, 3] + 0.0
        told = line(page).replace("−", "-")
        assert re.findall(r"[XYZ] (-?[\d.]+)", told)[:3] == [f"{round(v, 1) + 0.0:.1f}" for v in (x, y, z)]
        try:
            plan_joints(ROBOT, present, q)
            refused = False
        except ArmctlError:
            refused = True
        assert refused is ("class='bad'" in page.parts["next"]) and refused is go_is_off(page)


@pytest.mark.parametrize("seed", range(SEQUENCES))
def test_in_any_order_of_writers_what_is_drawn_is_what_go_sends(
    server: GuardedServer, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(number_field, "_QUIET_S", 0.0)
    monkeypatch.setattr(number_field, "_SETTLE_S", 0.0)
    sequence = Sequence(server, seed)
    ways: tuple[Callable[[], None], ...] = (
        sequence.slide, sequence.slide, sequence.type_angle, sequence.type_angle, sequence.solve,
        sequence.choose_a_row, sequence.another_moves, sequence.forget, sequence.go, sequence.go,
    )  # fmt: skip
    for _ in range(STEPS):
        ways[sequence.random.integers(len(ways))]()
        sequence.refresh()
        sequence.looks_true()


def test_another_movement_makes_another_press_of_it(page: FakePage) -> None:
    asked: list[float | None] = [3.0]
    writer = PoseWriter(page.session, "somebody", lambda: ("cubic", asked[0]))
    page.act(lambda: writer.show(THERE))
    pressed = str(page.next.number)
    asked[0] = None  # typed after the line was drawn
    with pytest.raises(InputError, match="has just changed"):
        page.act(lambda: page.parts.done("go", pressed))
    assert page.sent == []
    page.go()
    command = page.sent[-1]
    assert isinstance(command, MoveJoints) and command.duration_s is None


def test_fields_that_are_being_typed_into_are_not_sent(page: FakePage) -> None:
    def settled() -> None:
        raise InputError("the fields were edited just now")

    writer = PoseWriter(page.session, "somebody", settled=settled)
    page.act(lambda: writer.show(THERE))
    with pytest.raises(InputError, match="edited just now"):
        page.go()
    assert page.sent == []


def test_nothing_is_said_of_one_pose_that_was_found_for_another(page: FakePage) -> None:
    folded = HOME.copy()
    folded[1] = LOW[1]
    writer = PoseWriter(page.session, "somebody")
    page.act(lambda: writer.show(folded))
    assert "below the floor" in line(page) and page.next.trajectory is None
    page.snapshot.state, page.snapshot.busy = State.MOVING, True  # somebody else moves it
    page.next.refresh(page.session.snapshot)
    page.act(lambda: writer.show(THERE))
    assert "below the floor" not in line(page) and go_is_off(page) and page.next.trajectory is None
    page.snapshot.state, page.snapshot.busy = State.HOLDING, False
    page.act(lambda: page.next.refresh(page.session.snapshot))
    assert "clear" in line(page) and page.next.trajectory is not None
    page.next.set(THERE + 0.1, writer)  # not planned yet
    assert page.next.trajectory is None and page.next._path._handle is not None
    assert not page.next._path._handle.visible and "planning" in line(page)
    page.act(lambda: None)
    assert page.next._path._handle.visible and "clear" in line(page)


def test_an_arm_that_is_off_and_led_by_hand_arrives_nowhere(page: FakePage) -> None:
    writer = PoseWriter(page.session, "somebody")
    page.act(lambda: writer.show(THERE))
    page.snapshot.commanded, page.snapshot.q_command = False, THERE.copy()
    page.act(lambda: page.next.refresh(page.session.snapshot))
    assert page.next.q is not None and np.array_equal(page.next.q, THERE)
    number = page.next.number
    page.snapshot.q_command = THERE + 1e-5  # a count more or less
    page.act(lambda: page.next.refresh(page.session.snapshot))
    assert page.next.number == number


def test_what_outlives_its_page_writes_nothing(page: FakePage) -> None:
    writer = PoseWriter(page.session, "somebody")
    page.closed = True
    writer.show(THERE)
    assert page.next.q is None and page.next._poses.by_party == {}


def test_after_a_stop_go_leads_to_where_the_sum_led(page: FakePage) -> None:
    forward = ForwardScreen(page.session)
    page.refresh(forward)
    for joint in ROBOT.joints:
        page.put(f"{joint.title} °", "30" if joint.title == "Base" else "0")
    page.press("Go with respect to last position")
    goal = HOME + np.radians([30.0, 0, 0, 0, 0])
    assert page.next.q == pytest.approx(goal)
    page.snapshot.q_command = HOME + np.radians([19.8, 0, 0, 0, 0])  # stopped
    page.refresh(forward)
    assert page.next.q == pytest.approx(goal)
    page.refresh(forward)
    page.go()
    command = page.sent[-1]
    assert isinstance(command, MoveJoints) and command.q == pytest.approx(goal)

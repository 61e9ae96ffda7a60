"""A page's session: which controls can be used, and what shows that something is being worked on."""

from __future__ import annotations

import asyncio
import re
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from tests.robot.urdf_kit import Step, written
from tests.ui.page_kit import snapshot_of
from viser import GuiEvent

from armctl.apart import is_given_up
from armctl.calibration import LEAST_POINTS, TouchedPoint, TouchFit, own_map
from armctl.errors import InputError, StateError
from armctl.facts import Need, State
from armctl.facts.commands import NoBoard, Stopped
from armctl.hardware import BoardIdentity
from armctl.protocol import (
    AxisHoming,
    Command,
    Control,
    Doing,
    HomeAxes,
    MoveJoints,
    Origin,
    Party,
    Release,
    Snapshot,
    Ticket,
)
from armctl.robot import load_robot
from armctl.ui import RobotChoice, console, events
from armctl.ui.console import Console, Precedence
from armctl.ui.events import LastStop
from armctl.ui.guard import GuardedServer
from armctl.ui.offers import NO_REASON
from armctl.ui.session import Session
from armctl.ui.tabs.calibration import touch_question
from armctl.ui.tabs.calibration.points import CalibrationPoints
from armctl.ui.tabs.calibration.touched_points import TouchedPoints
from armctl.ui.tabs.main import urdf_arm
from armctl.ui.tabs.main.urdf_arm import UrdfArm

ROBOT = load_robot("uzuner")
ME, OTHER = Party("browser page 7", "Ada", True), Party("browser page 8", "Bob", True)
BOARD = BoardIdentity("Pololu Micro Maestro 6-channel", "/dev/pts/3", simulated=True)


NOT_FREE, NO_PAUSE = "the gripper is not free: wait, or stop first", "cannot be paused; press STOP"


def moving(
    label: str = "motion", *, pausable: bool = True, gripping: bool = False, stopping: bool = False
) -> dict[str, Any]:
    """What a snapshot of an arm that moves says of it."""
    doing = Doing(label, pausable, gripping, stopping, jogged=label == "jog")
    return {"state": State.MOVING, "doing": doing}


class Bench:
    """A session on an arm that obeys at once, and the notifications that its page shows."""

    def __init__(self, server: GuardedServer, **changes: Any) -> None:
        given = {"state": State.HOLDING, "board": BOARD, "control": Control((ME,)), **changes}
        self.snapshot = replace(snapshot_of(ROBOT), **given)
        self.shown: list[str] = []
        self.told: list[tuple[str, str]] = []
        """those that say something: title and text"""
        self.ended = False
        self.changed_to: list[str] = []
        self.opening: RobotChoice | None = None
        self.ticket = Ticket.ended()
        client = SimpleNamespace(
            gui=server.gui, scene=server.scene, client_id=6, add_notification=self._notify,
            camera=SimpleNamespace(position=np.ones(3), look_at=np.zeros(3)),
        )  # fmt: skip
        controller = SimpleNamespace(snapshot=self.snapshot, ended=False, submit=lambda *_: self.ticket)
        self.console = SimpleNamespace(
            robot=ROBOT,
            controller=controller,
            unsaved=[],
            savers=[],
            precedence=Precedence(),
            last_stop=LastStop(),
            submit=lambda command, origin, _: controller.submit(command, origin),
        )
        self.console.shared = cache(lambda kind: kind())

        async def change(name: str, *_: object) -> None:
            self.changed_to.append(name)

        self.robots = SimpleNamespace(
            console=self.console, opening=None, present=RobotChoice("uzuner", "Uzuner"), change=change,
            require_settled=lambda: None, choices=(),
        )  # fmt: skip
        self.session = Session(cast(Any, client), cast(Any, self.robots))

    def _notify(self, title: str, body: str, **_: object) -> SimpleNamespace:
        self.shown.append(title)
        if body != "Working …":
            self.told.append((title, body))
        impl = SimpleNamespace(uuid=f"{title} {len(self.shown)}")
        return SimpleNamespace(remove=lambda: self.shown.remove(title), _impl=impl)

    def why_not(self, need: Need | None) -> str | None:
        return self.session.why_not(need, self.snapshot)


@pytest.mark.parametrize(
    ("need", "changes", "why"),
    [
        (Need.HOLDING, {}, None),
        (Need.GRIPPER, {"state": State.MOVING}, None),
        (
            Need.GRIPPER,
            moving(gripping=True),
            f"the arm is moving; {NOT_FREE}",
        ),
        (Need.PAUSE, moving(), None),
        (Need.PAUSE, moving(stopping=True), "the arm is stopping; wait until it stands"),
        (
            Need.PAUSE,
            moving("homing", pausable=False),
            f"the arm is moving; homing {NO_PAUSE}",
        ),
        (Need.PAUSE, {}, "the arm is holding; there is nothing to pause"),
        (Need.PAUSE, {"state": State.OFF}, "the arm is off; enable first"),
        (Need.JOG, {}, None),
        (Need.JOG, moving("jog"), None),
        (Need.JOG, moving("jog", stopping=True), "the arm is stopping; wait until it stands"),
        (Need.JOG, moving(), "the arm is moving; stop first"),
        (Need.HOLDING, moving("jog"), "the arm is moving; stop first"),
        (Need.OFF_OR_HOLDING, {"state": State.OFF}, None),
        (None, {"state": State.DISCONNECTED, "board": None}, None),
        (Need.HOLDING, {"state": State.OFF}, "the arm is off; enable first"),
        (Need.HOLDING, {"state": State.DISCONNECTED}, "the arm is disconnected; connect and enable first"),
        (Need.OFF, {"state": State.DISCONNECTED}, "the arm is disconnected; connect first"),
        (Need.HOLDING, {"state": State.MOVING, "cause": "program"}, "the arm is moving; stop first"),
        (Need.OFF_OR_HOLDING, {"state": State.MOVING}, "the arm is moving; stop first"),
        (Need.OFF, {}, "the arm is holding; the arm is enabled already"),
        (Need.OFF, {"state": State.MOVING}, "the arm is moving; the arm is enabled already"),
        (Need.OFF, {"state": State.PAUSED}, "the arm is paused; the arm is enabled already"),
        (Need.HOLDING, {"state": State.FAULT}, "the arm is in fault; clear the fault first"),
        (Need.HOLDING, {"state": State.FAULT, "board": None}, "the arm is in fault; connect again"),
        (
            Need.HOLDING,
            {"state": State.FAULT, "unreachable": True},
            "the arm does not answer; see the message over the picture",
        ),
        (
            Need.HOLDING,
            {"state": State.OFF, "homing": (AxisHoming("Base", False, False),)},
            "the arm is off; press Homing (every axis moves to its switch)",
        ),
        (
            None,
            {"control": Control((replace(ME, operates=False), OTHER))},
            "this page is watching; press 'Take control' first",
        ),
        (Need.HOLDING, {"control": Control((OTHER,))}, "this page has just come; wait a moment"),
    ],
)
def test_why_a_control_cannot_be_used(
    server: GuardedServer, need: Need | None, changes: dict[str, Any], why: str | None
) -> None:
    assert Bench(server, **changes).why_not(need) == why


def test_controls_follow_the_arm_and_say_why_they_cannot_be_used(server: GuardedServer) -> None:
    bench = Bench(server, state=State.OFF)
    session, steps = bench.session, list[str]()
    button, group = server.gui.add_button("Go"), server.gui.add_button_group("Run", ("Once", "Loop"))
    before = set(server.gui._gui_input_handle_from_uuid)
    session.needs(Need.HOLDING, button, group, also=lambda _: None if steps else "the list is empty")
    assert set(server.gui._gui_input_handle_from_uuid) == before
    (offer,) = session._offers
    assert offer.reason is not None

    def told(snapshot: Snapshot) -> str | None:
        session.refresh(snapshot)
        assert offer.reason.visible  # with nothing to say, too: what lies below stays where it is
        content = offer.reason._handle.content
        assert button.disabled == group.disabled == (NO_REASON not in content)
        return content if button.disabled else None

    assert "The arm is off; enable first." in (told(bench.snapshot) or "")
    holding = replace(bench.snapshot, state=State.HOLDING)
    assert "The list is empty." in (told(holding) or "")
    steps.append("one")
    assert told(holding) is None
    assert not button.disabled
    export = server.gui.add_button("Export")
    session.needs(None, export, also=lambda _: None if steps else "nothing is shown", anyone=True)
    session.refresh(replace(holding, control=Control((replace(ME, operates=False), OTHER))))
    assert (button.disabled, export.disabled) == (True, False)
    steps.clear()
    session.refresh(holding)
    assert export.disabled


def test_a_reason_takes_the_place_of_the_hint_that_stands_there_otherwise(server: GuardedServer) -> None:
    bench = Bench(server)
    offer = bench.session.needs(Need.HOLDING, server.gui.add_button("Go"), hint="It goes at -5 mm/s.")
    assert offer.reason is not None
    assert "<div class='armctl-why'>It goes at −5 mm/s.</div>" in offer.reason._handle.content
    bench.session.refresh(replace(bench.snapshot, state=State.OFF))
    told = offer.reason._handle.content
    assert "<span>The arm is off; enable first.</span>" in told
    assert "<span aria-hidden='true'>It goes at −5 mm/s.</span>" in told  # keeps the height
    offer.hint = "Another one."
    bench.session.refresh(bench.snapshot)
    assert ">Another one.<" in offer.reason._handle.content


async def pressing(session: Session, button: Any) -> None:
    """Call what is attached to a button, as viser does."""
    (callback,) = button._impl.update_cb
    await callback(GuiEvent(cast(Any, session.client), 6, button))


def press(session: Session, button: Any) -> None:
    asyncio.run(pressing(session, button))


def test_what_takes_long_is_shown_until_it_is_done(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(events, "_AT_ONCE_S", 0.0)
    bench = Bench(server)
    session, button = bench.session, server.gui.add_button("Solve")
    seen: list[list[str]] = []

    async def solve() -> None:
        for _ in range(3):
            await asyncio.sleep(0)
        seen.append(list(bench.shown))
        await session.submit(MoveJoints(ROBOT.pose("home")))
        seen.append(list(bench.shown))

    session.on(button.on_click, solve)
    press(session, button)
    assert seen == [["Solve"], []]  # once the arm obeys, it shows so itself
    assert bench.shown == []
    assert session.obeyed == {"Solve"}


def offered(session: Session) -> list[str]:
    """Where *Cancel* is offered."""
    return [html for html in cast(Any, session.parts)._html.values() if "cancel-work" in html]


async def press_and_cancel(session: Session, button: Any, begun: threading.Event) -> None:
    """Press a button; cancel what that does once it has begun, and again, too late."""
    pressed = asyncio.create_task(pressing(session, button))
    await asyncio.to_thread(begun.wait, 10)
    async with asyncio.timeout(10):  # where it has failed by then, nothing is offered
        while not (offers := offered(session)):
            await asyncio.sleep(0)
    (key,) = re.findall(r"data-key=(\d+)>Cancel", offers[0])
    await session.parts.done("cancel-work", key)
    await pressed
    await session.parts.done("cancel-work", key)


def wait_until_given_up() -> None:
    while not is_given_up():
        time.sleep(0)


def test_what_is_worked_out_can_be_cancelled_and_its_process_hears_of_it(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(events, "_AT_ONCE_S", 0.0)
    bench = Bench(server)
    session, button = bench.session, server.gui.add_button("Plan")
    begun, undone, after = threading.Event(), threading.Event(), list[str]()

    def work() -> str:
        begun.set()
        wait_until_given_up()
        return "too late"

    def undo(made: str) -> None:
        assert made == "too late"
        undone.set()

    async def plan() -> None:
        after.append(await session.work_out(work, undo=undo))

    async def cancel() -> None:
        await press_and_cancel(session, button, begun)
        assert await asyncio.to_thread(undone.wait, 10)

    session.on(button.on_click, plan)
    asyncio.run(cancel())
    assert after == [] and bench.told == [("Plan", "Cancelled.")]
    assert offered(session) == []


def test_what_is_worked_out_in_time_is_not_undone(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(events, "_AT_ONCE_S", 0.0)
    bench = Bench(server)
    session, button = bench.session, server.gui.add_button("Plan")
    after, undone = list[str](), list[str]()

    async def plan() -> None:
        after.append(await session.work_out(str.upper, "made", undo=undone.append))

    session.on(button.on_click, plan)
    press(session, button)
    assert (after, undone) == (["MADE"], [])


class Stoppable:
    """A page whose button works out a motion, and a STOP that comes ``meanwhile``."""

    def __init__(self, server: GuardedServer) -> None:
        self.bench = Bench(server)
        self.button = server.gui.add_button("Go by least energy")
        self.sent: list[object] = []
        self.meanwhile: Callable[[], object] = lambda: None
        self.controller = self.bench.console.controller
        self.controller.submit = self.send
        self.controller.stop = self.sent.append
        self.console = Console(cast(Any, None), self.controller, list, Path(), lambda: None)
        self.bench.console.submit = self.console.submit

        async def go() -> None:
            await self.bench.session.work_out(lambda: self.meanwhile())
            await self.bench.session.submit(Release())  # moves nothing
            await self.bench.session.submit(MoveJoints(ROBOT.pose("home")))

        self.bench.session.on(self.button.on_click, go)

    def send(self, command: Command, _: Origin) -> Ticket:
        self.sent.append(command)
        return self.bench.ticket

    def counted(self, stops: int, by: str) -> None:
        """The arm says that it has had so many STOPs."""
        self.controller.snapshot = replace(self.bench.snapshot, stops=stops, last_stop=Stopped(by))

    def press(self) -> list[type]:
        """What was sent."""
        self.bench.console.last_stop = self.console.last_stop
        self.sent.clear()
        press(self.bench.session, self.button)
        return [type(one) for one in self.sent if not isinstance(one, Origin)]


@pytest.mark.parametrize(
    ("who", "told"), [("browser page 8", "browser page 8"), ("browser page 7", "you"), ("", "a, program 2")]
)
def test_what_was_pressed_before_stop_begins_no_motion_after_it(
    server: GuardedServer, who: str, told: str
) -> None:
    page = Stoppable(server)
    assert page.press() == [Release, MoveJoints]
    page.meanwhile = lambda: page.console.stop(Origin(who)) if who else page.counted(1, told)
    assert page.press() == [Release]
    assert page.bench.told[-1][1] == f"stopped by {told} before it began"
    page.meanwhile = lambda: None
    assert page.press() == [Release, MoveJoints]


_MOVE = MoveJoints(ROBOT.pose("home"))


@pytest.mark.parametrize(
    ("command", "stopped", "told"),
    [
        (_MOVE, Stopped("browser page 7", what="move"), []),
        (_MOVE, Stopped("browser page 8", what="move"), ["move was stopped by browser page 8"]),
        (_MOVE, Stopped("browser page 7", "it is gone"), ["stopped by browser page 7: it is gone"]),
        (HomeAxes(), Stopped("browser page 7", what="homing"), ["homing was stopped by you"]),
    ],
)
def test_nobody_is_told_of_their_own_stop_but_of_axes_that_are_not_homed(
    server: GuardedServer, command: Command, stopped: Stopped, told: list[str]
) -> None:
    bench = Bench(server)
    bench.ticket = Ticket([])

    async def stop() -> None:
        bench.ticket.accepted.set_result(None)
        await bench.session.submit(command)
        bench.ticket.finished.set_exception(StateError(stopped))
        for _ in range(20):
            await asyncio.sleep(0)

    asyncio.run(stop())
    assert bench.told == [("Not finished", words) for words in told]


def test_what_is_pressed_after_stop_goes_before_the_arm_has_counted_that(server: GuardedServer) -> None:
    page = Stoppable(server)
    page.console.stop(Origin("browser page 6"))
    page.meanwhile = lambda: page.counted(1, "browser page 6")
    assert page.press() == [Release, MoveJoints]
    page.console.stop(Origin("browser page 6"))
    page.meanwhile = lambda: page.counted(3, "a, program 2")  # and then that one, too
    assert page.press() == [Release]


def test_a_stop_beside_a_motion_that_is_just_sent_is_sent_behind_it(server: GuardedServer) -> None:
    page, stop = Stoppable(server), Origin("browser page 7")

    def send(command: Command, origin: Origin) -> Ticket:
        if isinstance(command, MoveJoints):  # the page's own line has a thread of its own
            page.console.stop(stop)
        return page.send(command, origin)

    page.controller.submit = send
    page.press()
    assert page.sent[-1] is stop and isinstance(page.sent[-2], MoveJoints)


def test_an_upload_that_is_cancelled_leaves_nothing(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(events, "_AT_ONCE_S", 0.0)
    bench = Bench(server)
    session, button = bench.session, server.gui.add_button("Upload an arm")
    bench.console.files = tmp_path
    arm = written(tmp_path / "arm.urdf", (Step("pan", "revolute", "base", "tool0", "0 0 0.1"),)).read_bytes()
    upload = SimpleNamespace(value=SimpleNamespace(name="my.urdf", content=arm))
    begun, removed, there = threading.Event(), threading.Event(), list[bool]()
    install, remove = urdf_arm._installed, urdf_arm._remove

    def slowly(*given: Any) -> RobotChoice:
        """It is there when it is cancelled: nobody could have asked in time."""
        choice = install(*given)
        there.append((tmp_path / "robots/my").is_dir())
        begun.set()
        wait_until_given_up()
        return choice

    def and_tell(choice: RobotChoice) -> None:
        remove(choice)
        removed.set()

    monkeypatch.setattr(urdf_arm, "_installed", slowly)
    monkeypatch.setattr(urdf_arm, "_remove", and_tell)
    page: Any = SimpleNamespace(_session=session, _upload=upload)
    page._install = partial(UrdfArm._install, page)

    async def cancel() -> None:
        await press_and_cancel(session, button, begun)
        assert await asyncio.to_thread(removed.wait, 10)

    session.on(button.on_click, lambda: UrdfArm._on_upload(page))
    asyncio.run(cancel())
    assert there == [True] and [*(tmp_path / "robots").iterdir()] == []
    assert bench.told == [("Upload an arm", "Cancelled: nothing of my.urdf is kept.")]
    assert bench.changed_to == []


@pytest.mark.parametrize("changed_since", [False, True])
def test_a_point_whose_comparison_is_cancelled_is_not_added(
    server: GuardedServer, monkeypatch: pytest.MonkeyPatch, changed_since: bool
) -> None:
    monkeypatch.setattr(events, "_AT_ONCE_S", 0.0)
    bench = Bench(server)
    session, button = bench.session, server.gui.add_button("Add point")
    points, outputs = TouchedPoints(ROBOT), own_map(ROBOT).outputs(ROBOT.pose("home"))
    for x in range(LEAST_POINTS):
        points.add(TouchedPoint(outputs, (0.1 * x, 0.0, 0.0)))
    before, begun, changed = points.touches, threading.Event(), threading.Event()
    compare = touch_question.fit_touches

    def slowly(*given: Any, **how: Any) -> TouchFit:
        if len(given[1]) == LEAST_POINTS + 1:
            begun.set()
            wait_until_given_up()
        return compare(*given, **how)

    monkeypatch.setattr(touch_question, "fit_touches", slowly)
    page: Any = SimpleNamespace(_session=session, _points=points, _given=lambda: (0.0, 0.0, 0.0))

    async def cancel() -> None:
        cancelling = asyncio.create_task(press_and_cancel(session, button, changed))
        assert await asyncio.to_thread(begun.wait, 10)
        if changed_since:  # on another page
            points.delete(0)
        changed.set()
        await cancelling
        await asyncio.gather(*session._tasks)
        for _ in range(6000):  # one of them has begun another
            if points.result is not None:
                break
            await asyncio.sleep(0.01)

    add = partial(points.add, TouchedPoint(outputs, (0.0, 0.0, 0.5)))
    session.on(button.on_click, lambda: CalibrationPoints._change(page, add))
    asyncio.run(cancel())
    assert isinstance(points.result, TouchFit)  # of those that are left
    if changed_since:
        assert len(points.touches) == LEAST_POINTS and points.touches != before
        assert bench.told[-1][1] == "Cancelled: the points stay: others have changed since."
    else:
        assert points.touches == before
        assert bench.told == [("Add point", "Cancelled: the points are as before.")]


def test_what_is_worked_out_without_a_press_comes_as_it_is(server: GuardedServer) -> None:
    bench = Bench(server)
    assert asyncio.run(bench.session.work_out(divmod, 7, 3)) == (2, 1)
    with pytest.raises(ZeroDivisionError):
        asyncio.run(bench.session.work_out(divmod, 7, 0))


def parts_of(question: Any) -> list[Any]:
    """The text of a question, and its answers from left to right."""
    text, row = question._children.values()
    _, *answers = row._children.values()
    return [text, *answers]


def test_a_robot_is_changed_at_once_only_where_nothing_is_lost(server: GuardedServer) -> None:
    bench = Bench(server)
    session, words = bench.session, list[str]()
    bench.console.unsaved.append(lambda: words[0] if words else None)
    asyncio.run(session.change_robot("mico"))
    assert bench.changed_to == ["mico"]
    words.append("The program 'pick' (3 steps) is not saved.")
    asyncio.run(session.change_robot("scorbot"))
    assert bench.changed_to == ["mico"]
    (question,) = server.gui._modal_handle_from_uuid.values()
    text, stay, _, _ = parts_of(question)
    assert "The robot becomes scorbot. The program 'pick' (3 steps)" in cast(Any, text).content
    press(session, stay)
    assert (bench.changed_to, question.closed) == (["mico"], True)
    asyncio.run(session.change_robot("scorbot"))
    (question,) = server.gui._modal_handle_from_uuid.values()
    _, _, change, _ = parts_of(question)
    press(session, change)
    assert bench.changed_to == ["mico", "scorbot"]
    assert not server.gui._modal_handle_from_uuid


def test_what_is_not_saved_is_saved_before_the_change_or_nothing_is_changed(server: GuardedServer) -> None:
    bench, saved = Bench(server), list[str]()
    bench.console.unsaved.append(lambda: "The program 'pick' (3 steps) is not saved.")

    async def save() -> Path | None:
        if not saved:
            saved.append("tried")
            raise InputError("the disk is full")
        saved.append("pick")
        return Path("pick.toml")

    bench.console.savers.append(save)
    asyncio.run(bench.session.change_robot("scorbot"))
    (question,) = server.gui._modal_handle_from_uuid.values()
    *_, button = parts_of(question)
    press(bench.session, button)
    assert (bench.changed_to, question.closed) == ([], False)
    assert bench.shown == ["Refused"]
    press(bench.session, button)
    assert (bench.changed_to, saved) == (["scorbot"], ["tried", "pick"])
    assert not server.gui._modal_handle_from_uuid


def test_who_stopped_the_arm_is_told_as_this_page_knows_them(server: GuardedServer) -> None:
    told = Bench(server, control=Control((ME, replace(OTHER, operates=False)))).session.with_names
    assert told(Stopped("browser page 7", what="move")) == Stopped("", what="move")
    assert told(Stopped("browser page 8")) == Stopped("Bob")
    for other in (
        Stopped("browser page 78"),
        Stopped("browser page 7", "the page does not answer"),
        NoBoard(),
    ):
        assert told(other) == other


def test_pages_compute_one_after_the_other_and_behind_who_presses_go(server: GuardedServer) -> None:
    """What is computed for pages shares the interpreter with the check of what is to go to the arm."""
    bench, begun = Bench(server), list[str]()
    held, ticket = threading.Event(), Ticket([])
    bench.ticket = ticket

    def first() -> None:
        begun.append("first")
        assert held.wait(10)

    async def turns() -> None:
        for _ in range(20):
            await asyncio.sleep(0)

    async def compute(*work: Any) -> None:
        async with bench.console.precedence.turn():
            await bench.session.work_out(*work)

    async def press() -> None:
        one = asyncio.create_task(compute(first))
        two = asyncio.create_task(compute(begun.append, "second"))
        await turns()
        going = asyncio.create_task(bench.session.submit(MoveJoints(ROBOT.pose("home"))))
        await turns()
        held.set()
        await one
        await turns()
        assert begun == ["first"] and not going.done()
        ticket.accepted.set_result(None)
        await going
        await two
        assert begun == ["first", "second"]

    asyncio.run(press())


def test_a_go_that_takes_long_is_waited_for_no_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "_FIRST_S", 0.0)

    async def wait() -> None:
        precedence = Precedence()
        with precedence.going(), precedence.going():
            await asyncio.wait_for(precedence.give_way(), 10)
        await asyncio.wait_for(precedence.give_way(), 10)

    asyncio.run(wait())

"""Who may command the arm: one operates, the others watch, everybody may stop it."""

from __future__ import annotations

import numpy as np
import pytest
from tests.runtime.kit import LateExecutor, Rig, fails, make_rig

from armctl.errors import StateError
from armctl.facts import State
from armctl.protocol import (
    Arrive,
    Command,
    Leave,
    LendControl,
    LockControl,
    MoveJoints,
    Origin,
    Release,
    SetSpeed,
    TakeControl,
    Ticket,
)
from armctl.runtime import Controller

ANNA, BEN = Origin("page 1"), Origin("page 2")
AWAY = np.radians([60.0, 90, -60, -40, 0])


def ask(rig: Rig, command: Command, who: Origin) -> Ticket:
    ticket = rig.controller.submit(command, who)
    rig.tick()
    return ticket


@pytest.fixture
def two() -> Rig:
    """Anna operates, Ben watches."""
    rig = make_rig().enable()
    ask(rig, Arrive("Anna"), ANNA)
    ask(rig, Arrive("Ben"), BEN)
    return rig


def operator(rig: Rig) -> str | None:
    party = rig.now.control.operator
    return None if party is None else party.name


def test_the_first_operates_and_the_others_watch(two: Rig) -> None:
    assert operator(two) == "Anna"
    assert [party.name for party in two.now.control.parties] == ["Anna", "Ben"]
    fails(ask(two, SetSpeed(0.5), BEN).finished, "Anna operates the arm; take control first")
    ask(two, SetSpeed(0.5), ANNA).result(0)
    assert two.now.speed == 0.5


def test_who_only_wants_to_watch_does_not_operate_though_nobody_does() -> None:
    rig = make_rig().enable()
    ask(rig, Arrive("screen", watch=True), BEN)
    assert operator(rig) is None
    fails(ask(rig, SetSpeed(0.5), BEN).finished, "nobody operates the arm; take control first")
    ask(rig, Arrive("Anna"), ANNA)
    assert operator(rig) == "Anna"


def test_who_watched_takes_control_before_it_commands_an_arm_that_nobody_operates(two: Rig) -> None:
    ask(two, Leave("the page is gone"), ANNA)
    fails(ask(two, SetSpeed(0.5), BEN).finished, "nobody operates the arm; take control first")
    ask(two, TakeControl(), BEN)
    ask(two, SetSpeed(0.5), BEN).result(0)


def test_who_is_there_operates_again_if_nobody_does(two: Rig) -> None:
    ask(two, Arrive("Ben"), BEN)
    assert operator(two) == "Anna"  # nothing is taken from anybody
    ask(two, LockControl(True), ANNA)
    ask(two, Leave("it does not answer"), ANNA)
    ask(two, Arrive("Anna", watch=True), ANNA)
    assert operator(two) is None
    ask(two, Arrive("Anna"), ANNA)
    assert operator(two) == "Anna"
    assert any("Anna operates the arm again" in event.text for event in two.now.events)


def test_everybody_may_stop(two: Rig) -> None:
    moving = ask(two, MoveJoints(AWAY), ANNA)
    two.run(0.2)
    two.controller.stop(BEN)
    two.rests(1)
    fails(moving.finished, "stopped by page 2")


def test_taking_control_is_logged_and_the_motion_goes_on(two: Rig) -> None:
    ask(two, MoveJoints(AWAY), ANNA)
    ask(two, TakeControl(), BEN).result(0)
    assert operator(two) == "Ben" and two.now.state is State.MOVING
    assert "Ben has taken control of the arm; Anna watches now" in two.texts
    fails(ask(two, Release(), ANNA).finished, "Ben operates the arm")


def test_a_lock_keeps_control_until_its_operator_opens_it_or_goes(two: Rig) -> None:
    fails(ask(two, LockControl(True), BEN).finished, "only the operator may lock control")
    ask(two, LockControl(True), ANNA).result(0)
    fails(ask(two, TakeControl(), BEN).finished, "Anna has locked control; ask for it to be unlocked$")
    ask(two, LockControl(False), ANNA).result(0)
    ask(two, TakeControl(), BEN).result(0)
    ask(two, LockControl(True), BEN)
    ask(two, Leave("the page does not answer"), BEN)
    assert operator(two) is None and not two.now.control.locked
    assert "Ben no longer operates: the page does not answer; control is free" in two.texts
    ask(two, TakeControl(), ANNA).result(0)


def test_what_moves_at_the_command_of_somebody_who_leaves_is_stopped(two: Rig) -> None:
    moving = ask(two, MoveJoints(AWAY), ANNA)
    ask(two, Leave("the page is gone"), ANNA)
    two.rests(1)
    fails(moving.finished, "stopped by Anna: the page is gone")
    ask(two, Arrive(), Origin("page 3"))
    assert operator(two) == "page 3"


def test_what_is_being_planned_for_somebody_who_leaves_does_not_begin() -> None:
    rig = make_rig(executor=LateExecutor()).enable()
    ask(rig, Arrive("Anna"), ANNA)
    moving = ask(rig, MoveJoints(AWAY), ANNA)
    ask(rig, Leave("the page is gone"), ANNA)
    rig.executor.work()
    rig.run(0.2)
    assert rig.now.state is State.HOLDING
    fails(moving.finished, "stopped by Anna: the page is gone")


def test_a_watcher_who_leaves_stops_nothing(two: Rig) -> None:
    ask(two, MoveJoints(AWAY), ANNA)
    ask(two, Leave(), BEN)
    two.run(0.2)
    assert two.now.state is State.MOVING


@pytest.fixture
def classroom() -> Rig:
    """Anna operates, Ben watches, and there is a teacher's PIN."""
    plain = make_rig()
    plain.controller = Controller(
        plain.robot, lambda _port: plain.driver, plain.clock, executor=plain.executor, pin="4711"
    )
    ask(plain, Arrive("Anna"), ANNA)
    ask(plain, Arrive("Ben"), BEN)
    return plain


def test_the_teachers_pin_takes_control_and_locks_it(classroom: Rig) -> None:
    ask(classroom, LockControl(True), ANNA)
    fails(ask(classroom, TakeControl(), BEN).finished, "or give the teacher's PIN")
    ask(classroom, TakeControl("4711"), BEN).result(0)
    ask(classroom, LockControl(True, "4711"), BEN).result(0)
    fails(ask(classroom, LockControl(False), BEN).finished, "only the teacher's PIN opens it")
    fails(ask(classroom, TakeControl(), ANNA).finished, "the teacher has locked control")
    ask(classroom, Leave(), BEN)
    assert classroom.now.control.locked
    fails(ask(classroom, SetSpeed(0.5), ANNA).finished, "the teacher has locked control")
    ask(classroom, LockControl(False, "4711"), ANNA).result(0)
    ask(classroom, TakeControl(), ANNA).result(0)
    ask(classroom, SetSpeed(0.5), ANNA).result(0)
    assert not any("4711" in text for text in classroom.texts)


def test_what_a_client_says_stands_in_the_log_in_one_short_line(two: Rig) -> None:
    ask(two, Arrive("A\x1b]0;n\x07n"), ANNA)
    ask(two, Leave("\x1b[2J" + "x" * 100_000), ANNA)
    *_, named, left = two.texts
    assert named == "Anna is called A ]0;n n now"
    assert left.startswith("A ]0;n n no longer operates:  [2Jxx") and len(left) == 2000


def test_a_name_is_kept_short_and_may_change(two: Rig) -> None:
    ask(two, Arrive("  Ann \n " + "a" * 100), ANNA)
    name = operator(two)
    assert name is not None and len(name) == 60 and "\n" not in name
    with pytest.raises(StateError, match="has not said that it is there"):
        ask(two, TakeControl(), Origin("page 9")).result(0)


def test_the_operator_lends_control_to_a_device_beside_it(two: Rig) -> None:
    fails(ask(two, LendControl("page 2"), BEN).finished, "only the operator may lend control")
    fails(ask(two, LendControl("pad"), ANNA).finished, "pad is not there beside Anna")
    ask(two, LendControl("page 2"), ANNA).result(0)
    for who in (BEN, ANNA):
        ask(two, SetSpeed(0.5), who).result(0)
    assert operator(two) == "Anna" and two.now.control.lent_to == "page 2"
    fails(ask(two, LockControl(True), BEN).finished, "only the operator may lock control")
    ask(two, LendControl(), ANNA).result(0)
    fails(ask(two, SetSpeed(0.6), BEN).finished, "Anna operates the arm")


@pytest.mark.parametrize("who", [ANNA, BEN])
def test_where_one_of_both_leaves_the_arm_stops_and_nothing_is_lent(two: Rig, who: Origin) -> None:
    ask(two, LendControl("page 2"), ANNA)
    ticket = ask(two, MoveJoints(AWAY), BEN)
    two.run(0.2)
    ask(two, Leave(), who)
    assert two.now.control.lent_to == ""
    two.rests(2.0)
    fails(ticket.finished, "was stopped by")


def test_control_that_is_taken_is_lent_no_more(two: Rig) -> None:
    ask(two, Arrive("Cleo"), Origin("page 3"))
    ask(two, LendControl("page 2"), ANNA)
    ask(two, TakeControl(), Origin("page 3")).result(0)
    fails(ask(two, SetSpeed(0.6), BEN).finished, "Cleo operates the arm")

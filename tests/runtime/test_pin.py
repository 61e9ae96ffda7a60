"""The teacher's PIN: the right one is judged at once, whoever guesses; who guesses has to wait."""

from __future__ import annotations

import os
import tracemalloc
from itertools import count

import pytest
from tests.runtime.kit import Rig, fails, make_rig

from armctl.errors import StateError
from armctl.protocol import (
    Arrive,
    Command,
    Leave,
    LockControl,
    Origin,
    RememberWrongPins,
    TakeControl,
    Ticket,
    WrongPins,
)
from armctl.runtime import Controller
from armctl.runtime.control import MOST_PARTIES
from armctl.runtime.pin import EACH_AT_SOURCE_S, FREE_AT_SOURCE, LONGEST_WAIT_S, OWN_TRIES, PinGuard

PIN = "4711"
LAB, HALL = "programs at 10.0.0.5", "programs at 10.0.0.6"
WRONG = "that is not the teacher's PIN"


def classroom() -> Rig:
    """Anna operates, Ben watches, and there is a teacher's PIN."""
    rig = make_rig()
    rig.controller = Controller(rig.robot, lambda _: rig.driver, rig.clock, executor=rig.executor, pin=PIN)
    come(rig, "Anna", LAB)
    come(rig, "Ben", LAB)
    return rig


@pytest.fixture
def room() -> Rig:
    return classroom()


def ask(rig: Rig, command: Command, who: str) -> Ticket:
    ticket = rig.controller.submit(command, Origin(who))
    rig.tick()
    return ticket


def come(rig: Rig, name: str, source: str = "") -> None:
    rig.controller.submit(Arrive(name), Origin(name, source=source))
    rig.tick()


def go(rig: Rig, name: str) -> None:
    ask(rig, Leave(), name)


def guess(rig: Rig, who: str) -> Ticket:
    return ask(rig, TakeControl("0"), who)


def spent(rig: Rig, source: str, wrong: int = FREE_AT_SOURCE + OWN_TRIES) -> None:
    """Guess from a source, each time under another name, until nothing there is free any more."""
    for number in range(wrong):
        come(rig, f"guesser {number}", source)
        guess(rig, f"guesser {number}")
        go(rig, f"guesser {number}")


def test_a_wrong_pin_is_answered_late_and_logged_with_its_name(room: Rig) -> None:
    ticket = guess(room, "Ben")
    room.run(1.9)
    assert not ticket.finished.done()
    room.run(0.2)
    fails(ticket.finished, WRONG)
    assert "Ben has given a wrong PIN (programs at 10.0.0.5)" in room.texts
    ask(room, TakeControl(PIN), "Ben").result(0)
    assert not any(PIN in text for text in room.texts)


def test_the_right_pin_is_accepted_in_the_same_tick_whoever_guesses(room: Rig) -> None:
    come(room, "Teacher", LAB)
    for k in range(100):
        guess(room, "Anna"), guess(room, "Ben")
        come(room, f"new {k}", LAB)
        guess(room, f"new {k}")
        go(room, f"new {k}")
        ask(room, LockControl(True, PIN), "Teacher").result(0)


def test_a_program_or_page_from_anywhere_else_does_not_wait_either(room: Rig) -> None:
    spent(room, LAB, 3 * FREE_AT_SOURCE)
    for k in range(100):
        come(room, f"teacher {k}", HALL)
        ask(room, LockControl(True, PIN), f"teacher {k}").result(0)
        go(room, f"teacher {k}")


@pytest.mark.parametrize("pin", ["0", PIN], ids=["wrong", "right"])
def test_in_a_lock_out_no_pin_is_judged_and_both_are_answered_alike(room: Rig, pin: str) -> None:
    guess(room, "Ben")
    fails(ask(room, TakeControl(pin), "Ben").finished, "^wait 2 s before the next PIN$")
    assert not room.now.control.operates("Ben")


def test_a_lock_out_doubles_and_the_right_pin_or_a_quiet_hour_ends_that(room: Rig) -> None:
    def guesses(*waits_s: float) -> None:
        for wait in waits_s:
            assert not guess(room, "Ben").accepted.done()  # it was judged
            room.clock.advance(wait - 0.1)
            fails(guess(room, "Ben").finished, "wait 1 s before")
            room.clock.advance(0.1)

    guesses(2, 4, 8, 16, 32, 64, 128, 256, 300, 300)
    ask(room, TakeControl(PIN), "Ben").result(0)
    ask(room, TakeControl(), "Anna").result(0)
    guesses(2, 4, 8)
    room.clock.advance(3600)
    guesses(2, 4)


def test_who_comes_again_under_another_name_gets_no_fresh_tries_for_ever(room: Rig) -> None:
    spent(room, LAB)
    come(room, "again", LAB)
    fails(ask(room, TakeControl("0"), "again").finished, "before the next PIN")
    fails(ask(room, TakeControl(PIN), "again").finished, "before the next PIN")
    room.clock.advance((OWN_TRIES + 1) * EACH_AT_SOURCE_S)
    ask(room, TakeControl(PIN), "again").result(0)


def test_who_leaves_and_comes_under_its_own_name_waits_as_before(room: Rig) -> None:
    guess(room, "Ben")
    go(room, "Ben")
    come(room, "Ben", LAB)
    fails(ask(room, TakeControl(PIN), "Ben").finished, "wait 2 s before")


def test_a_teacher_mistypes_three_times_beside_somebody_who_guesses(room: Rig) -> None:
    come(room, "Teacher", LAB)
    spent(room, LAB)
    for seconds in (2, 4, 8):
        guess(room, "Teacher")
        room.clock.advance(seconds)
    ask(room, TakeControl(PIN), "Teacher").result(0)


def brute_force(places: int, sources: int, days: float) -> tuple[int, int]:
    """How many PINs of one guesser are judged, who has so many places, and renews one where that helps.

    In half of the time, and in all of it.
    """
    guard, judged, names, first_half = PinGuard(PIN), 0, count(), 0

    def fresh(now: float, source: str) -> tuple[Origin, int]:
        origin = Origin(str(next(names)), source=source)
        guard.arrive(origin.who, source, now)
        return origin, 0

    there = [fresh(0.0, str(k % sources)) for k in range(places)]
    for second in range(0, round(days * 86400), 4):
        now = float(second)
        guard.tick(now)
        for place, (origin, tries) in enumerate(there):
            if tries == OWN_TRIES:
                guard.leave(origin.who, now)
                there[place] = fresh(now, origin.source)
                continue
            try:
                guard.accepts(origin, "x", "0", now, Ticket([]))
            except StateError:
                continue
            judged += 1
            there[place] = origin, tries + 1
        if 2 * now < days * 86400:
            first_half = judged
    return first_half, judged


def test_ten_thousand_pins_take_days_on_every_connection_that_there_is() -> None:
    length = 0.5 if os.environ.get("ARMCTL_LONG") else 0.25
    before, whole = brute_force(MOST_PARTIES, 2, length)
    days = 0.5 * length * (1 + (10_000 - before) / (whole - before))
    assert 2.5 < days < 5


def test_what_is_remembered_of_guessers_is_bounded() -> None:
    guard, held = PinGuard(PIN), list[int]()
    tracemalloc.start()
    for k in range(3900):
        origin = Origin(f"n{k}", source=f"pages at 10.1.{k // 256}.{k % 256}")
        guard.arrive(origin.who, origin.source, 0.0)
        guard.accepts(origin, origin.who, "0", 0.0, Ticket([]))
        guard.leave(origin.who, 0.0)
        if k % 1300 == 1299:
            held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert len(guard.tick(0.0)) == 20
    assert held[2] - held[1] < 20_000


def test_the_snapshot_names_who_guesses_for_an_hour(room: Rig) -> None:
    guess(room, "Ben")
    room.clock.advance(5)
    guess(room, "Ben")
    go(room, "Ben")
    assert room.now.control.wrong_pins == (WrongPins("Ben", LAB, 2),)
    room.clock.advance(3601)
    room.tick()
    assert room.now.control.wrong_pins == ()


def test_a_log_is_not_flooded_by_a_guesser(room: Rig) -> None:
    for _ in range(40):
        guess(room, "Ben")
        room.clock.advance(LONGEST_WAIT_S)
    lines = [text for text in room.texts if "wrong PIN" in text]
    assert 5 < len(lines) < 10 and lines[-1].startswith("Ben has given a wrong PIN") and "32" in lines[-1]


def test_another_arm_goes_on_counting() -> None:
    new = classroom()
    guessed = (WrongPins("Eve", HALL, FREE_AT_SOURCE + 10),)
    ask(new, RememberWrongPins(guessed), "console").result(0)
    assert new.now.control.wrong_pins == guessed
    come(new, "Eve again", HALL)
    fails(ask(new, TakeControl(PIN), "Eve again").finished, "before the next PIN")
    ask(new, TakeControl(PIN), "Ben").result(0)


def test_where_there_is_no_pin_that_is_said() -> None:
    rig = make_rig()
    fails(ask(rig, LockControl(True, "1"), "Anna").finished, "there is no teacher's PIN")


def test_a_controller_that_is_closed_answers_the_wrong_pins_that_wait(room: Rig) -> None:
    ticket = guess(room, "Ben")
    room.controller.close()
    fails(ticket.finished, WRONG)

from __future__ import annotations

import pytest

from armctl.hardware.firmata.codec import PinState
from armctl.hardware.firmata.pins import Attacher, FirstPulse, PinWatch

SERVO, OUTPUT = 4, 1


def watch_of(*pins: int) -> PinWatch:
    return PinWatch(PinState(pin, OUTPUT, 0) for pin in pins)


def test_what_is_found_on_the_board():
    watch = PinWatch([PinState(9, SERVO, 1500), PinState(10, SERVO, 90), PinState(11, OUTPUT, 0)])
    assert watch.positions == {9: 1500.0, 10: None, 11: None}
    assert watch.powered
    assert [watch.is_on(pin) for pin in (9, 10, 11)] == [True, True, False]


def test_pins_are_asked_in_turn_and_none_twice():
    watch = watch_of(2, 3, 4)
    assert watch.ask(2, now=0.0) == (2, 3)
    assert watch.ask(2, now=0.02) == (4,)
    assert watch.ask(2, now=0.04) == ()
    for pin in (2, 3, 4):
        assert watch.answered(PinState(pin, OUTPUT, 0)) is None
    assert watch.ask(2, now=0.06) == (2, 3)


def test_an_answer_is_compared_with_what_was_sent_when_it_was_asked():
    watch = watch_of(9)
    watch.sent({9: 1500})
    watch.ask(1, now=0.0)
    watch.sent({9: 1600})
    assert watch.answered(PinState(9, SERVO, 1500)) is None
    watch.ask(1, now=0.1)
    words = watch.answered(PinState(9, SERVO, 1500))
    assert words is not None and words.startswith("pin 9 had 1500 instead of the 1600 µs last sent")
    assert watch.to_repeat() == {9: 1600}
    assert watch.needs(9, 1600)
    watch.sent({9: 1600})
    assert watch.to_repeat() == {}
    assert not watch.needs(9, 1600)


def test_one_answer_does_not_prove_that_a_pin_is_off():
    watch = watch_of(9)
    watch.sent({9: 1500})
    for state, gone in (
        (PinState(9, OUTPUT, 0), ()),
        (PinState(9, SERVO, 1500), ()),
        (PinState(9, OUTPUT, 0), ()),
        (PinState(9, OUTPUT, 0), (9,)),
    ):
        watch.ask(1, now=0.0)
        watch.answered(state)
        assert watch.switched_off() == gone


def test_a_pin_that_somebody_switched_on_is_told():
    watch = watch_of(9)
    watch.ask(1, now=0.0)
    words = watch.answered(PinState(9, SERVO, 1500))
    assert words == "pin 9 is still on at the board, though armctl switched it off"


def test_what_is_overdue_may_be_asked_again():
    watch = watch_of(2, 3)
    watch.ask(2, now=0.0)
    watch.answered(PinState(3, OUTPUT, 0))
    assert watch.overdue(0.1, timeout_s=0.1) == ()
    assert watch.overdue(0.11, timeout_s=0.1) == (2,)
    assert watch.overdue(0.13, timeout_s=0.1) == ()  # told once
    assert watch.ask(2, now=0.13) == (3,)  # what still comes from 2 belongs to the question that is open
    assert watch.overdue(0.15, timeout_s=0.1) == ()
    assert watch.ask(2, now=0.15) == (2,)


def test_answers_that_nobody_waits_for_change_nothing():
    watch = watch_of(9)
    assert watch.answered(PinState(9, SERVO, 1500)) is None
    assert watch.answered(PinState(77, SERVO, 1500)) is None
    assert watch.positions == {9: None}


def test_a_new_book_keeps_what_was_sent():
    earlier = watch_of(2, 3, 4)
    earlier.sent({2: 1100, 3: 1300})
    later = PinWatch([PinState(2, SERVO, 1000), PinState(3, OUTPUT, 0), PinState(5, SERVO, 1700)])
    assert later.carry_on(earlier) == (3,)
    assert later.positions == {2: 1100.0, 3: None, 5: 1700.0}


NAME = "StandardFirmata.ino"
REPORT = 2 + 2 + 2 * len(NAME) + 1  # F0 79, the version, two bytes a character, F7
BUFFER = 64
BYTE_S = 10 / 57600
ATTACHED = "f0 70 09 68 07 50 0f f7 f0 6f 09 5c 0b f7"


def first_pulses(count: int) -> list[FirstPulse]:
    return [FirstPulse(2 + number, 1500, (544, 2400)) for number in range(count)]


def test_the_bytes_on_a_fresh_board():
    burst = Attacher(NAME, fresh=True).burst([FirstPulse(9, 1500, (1000, 2000))])
    assert burst.request.hex(" ") == ATTACHED
    assert burst.answer_length == 0


def test_the_bytes_on_a_board_that_drives_servos_already():
    burst = Attacher(NAME, fresh=False).burst([FirstPulse(9, 1500, (1000, 2000))])
    assert burst.request.hex(" ") == f"f0 79 f7 f0 79 f7 {ATTACHED}"
    assert burst.answer_length == 2 * REPORT


def test_a_board_is_fresh_once():
    attacher = Attacher(NAME, fresh=True)
    assert attacher.most_at_once == 12
    attacher.burst(first_pulses(6))
    assert attacher.most_at_once == 4
    assert attacher.burst(first_pulses(1)).answer_length > 0


def test_on_a_fresh_board_all_is_said_before_the_timer_wraps_round():
    attacher = Attacher(NAME, fresh=True)
    burst = attacher.burst(first_pulses(attacher.most_at_once))
    assert len(burst.request) * BYTE_S < 65536 * 0.5e-6


@pytest.mark.parametrize(
    ("name", "most"), [(NAME, 4), ("StandardFirmata", 3), ("StandardFirmataEthernetPlus.ino", 4), ("xy", 1)]
)
def test_how_many_servos_one_hold_is_good_for(name: str, most: int):
    assert Attacher(name, fresh=False).most_at_once == most


@pytest.mark.parametrize("name", [NAME, "StandardFirmata", "StandardFirmataEthernetPlus.ino"])
@pytest.mark.parametrize("less", [0, 1, 2])
def test_the_sketch_is_held_until_all_has_come_in_and_nothing_overflows(name: str, less: int):
    attacher = Attacher(name, fresh=False)
    burst = attacher.burst(first_pulses(attacher.most_at_once - less))
    report = 5 + 2 * len(name)
    # Byte times, from the first byte on: the sketch takes a question as soon as it has come in and it is
    # not held, and is held until the answer fits into the transmit buffer, which drains all the while.
    free, waiting, drained_from = 0, 0, None
    for number in range(burst.answer_length // report):
        taken = max(free, 3 * (number + 1))
        drained_from = taken if drained_from is None else drained_from
        free = max(taken, drained_from + report * (number + 1) - BUFFER)
        arrived = min(len(burst.request), free)
        waiting = max(waiting, arrived - 3 * (number + 1))
    assert free >= len(burst.request), "held too short: attach and write may be torn apart"
    assert waiting < BUFFER, "the receive buffer overflows"


def test_a_sketch_with_a_short_name_never_gets_more_than_its_buffer_holds():
    burst = Attacher("x", fresh=False).burst(first_pulses(1))
    assert len(burst.request) - 3 < BUFFER

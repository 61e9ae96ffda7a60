from __future__ import annotations

from armctl.hardware.firmata.codec import PinState
from armctl.hardware.firmata.pins import PinWatch

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

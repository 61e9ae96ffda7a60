"""Setpoints, questions and answers of the pins; servos switched on with the right first pulse."""

from __future__ import annotations

import pytest

from armctl.hardware import ChannelSettings
from armctl.hardware.driver import ChannelTable
from armctl.hardware.firmata import BAUD, SERVO_FRAME_S, pin_table
from armctl.hardware.firmata.codec import PinState, pin_state_query, servo_write
from armctl.hardware.firmata.pin_watch import PinWatch
from armctl.hardware.firmata.stream import Attacher, SetpointStream, spare_pin
from armctl.protocol import ManualClock

SERVO, OUTPUT = 4, 1
MARKER = 0


def watch_of(*pins: int) -> PinWatch:
    return PinWatch(PinState(pin, OUTPUT, 0) for pin in pins)


def test_what_is_found_on_the_board():
    watch = PinWatch([PinState(9, SERVO, 1500), PinState(10, SERVO, 90), PinState(11, OUTPUT, 0)])
    assert watch.positions == {9: 1500.0, 10: None, 11: None}
    assert watch.powered
    assert watch.due({9: 1500, 10: 1600, 11: 1700}, 0.0) == ({10: 1600}, {11: 1700})


def test_pins_are_asked_in_turn_and_none_twice():
    watch = watch_of(2, 3, 4)
    assert watch.ask(2, now=0.0) == (2, 3)
    assert watch.ask(2, now=0.02) == (4,)
    assert watch.ask(2, now=0.04) == ()
    for pin in (2, 3, 4):
        assert watch.answered(PinState(pin, OUTPUT, 0), 0.1) is None
    assert watch.ask(2, now=0.06) == (2, 3)


def test_an_answer_is_compared_with_what_was_sent_when_it_was_asked():
    watch = watch_of(9)
    watch.sent({9: 1500}, 0.0)
    watch.ask(1, now=0.0)
    watch.sent({9: 1600}, 0.0)
    assert watch.answered(PinState(9, SERVO, 1500), 0.1) is None
    watch.ask(1, now=0.1)
    assert watch.answered(PinState(9, SERVO, 1500), 0.1) is None  # one answer may be garbled
    assert watch.due({}, 0.1) == ({}, {})
    watch.ask(1, now=0.1)
    words = watch.answered(PinState(9, SERVO, 1500), 0.1)
    assert words is not None and words.startswith("pin 9 had 1500 instead of the 1600 µs last sent")
    assert watch.due({}, 0.2) == ({9: 1600}, {})
    watch.sent({9: 1600}, 0.0)
    assert watch.due({9: 1600}, 0.3) == ({}, {})


def test_two_answers_do_not_prove_that_a_pin_is_off_that_was_seen_on():
    watch = watch_of(9)
    watch.sent({9: 1500}, 0.0)
    for state, gone in (
        (PinState(9, OUTPUT, 0), ()),
        (PinState(9, SERVO, 1500), ()),
        (PinState(9, SERVO, 1500), ()),
        (PinState(9, OUTPUT, 0), ()),
        (PinState(9, OUTPUT, 0), ()),
        (PinState(9, OUTPUT, 0), (9,)),
    ):
        watch.ask(1, now=0.0)
        watch.answered(state, 0.1)
        assert watch.switched_off == gone


def test_a_pin_that_another_program_switched_on_is_told_and_unasked_answers_are_not():
    watch = watch_of(9)
    assert watch.answered(PinState(9, SERVO, 1500), 0.1) is None
    assert watch.answered(PinState(77, SERVO, 1500), 0.1) is None
    for _ in range(2):
        watch.ask(1, now=0.0)
        assert watch.answered(PinState(9, SERVO, 1500), 0.1) is None
    watch.ask(1, now=0.0)
    words = watch.answered(PinState(9, SERVO, 1500), 0.1)
    assert words == "pin 9 is still on at the board, though armctl switched it off"
    assert watch.positions == {9: None}


def test_a_question_that_a_later_answer_overtakes_is_lost_and_may_be_asked_again():
    watch = watch_of(2, 3, 4)
    watch.ask(2, now=0.0)
    assert watch.ask(2, now=0.02) == (4,)
    assert watch.silent_s(0.05) == pytest.approx(0.05)
    assert watch.answered(PinState(4, OUTPUT, 0), 0.06) is None
    assert (watch.asked, watch.lost, watch.open_questions, watch.silent_s(0.07)) == (3, 2, 0, 0.0)
    assert watch.answered(PinState(2, OUTPUT, 0), 0.07) is None  # too late: it belongs to no question
    assert watch.ask(3, now=0.08) == (2, 3, 4)
    assert watch.ask_marker(MARKER, 0.1) == MARKER
    words = watch.answered(PinState(MARKER, OUTPUT, 0), 0.19)
    assert words is not None and words.startswith("the board did not get what was sent 110 ms ago")
    assert watch.lost == 5


def test_a_new_watch_keeps_what_was_sent_and_brings_a_pin_there_at_its_speed():
    earlier = watch_of(2, 3, 4)
    earlier.sent({2: 1100, 3: 1300, 4: 1500}, 0.0)
    for _ in range(2):
        for pin in earlier.ask(2, now=0.0):
            assert earlier.answered(PinState(pin, SERVO, {2: 1100, 3: 1300}[pin]), 0.02) is None
    assert earlier.positions == {2: 1100.0, 3: 1300.0, 4: None}
    off = [PinState(pin, OUTPUT, 0) for pin in (3, 4)]
    later = PinWatch([PinState(2, SERVO, 1000), *off, PinState(5, SERVO, 1700)], {2: 2000.0})
    gone, words = later.carry_on(earlier)
    assert (gone, len(words)) == ((3,), 1)
    assert words[0].startswith("pin 2 had 1000 instead of the 1100 µs last sent")
    assert later.positions == {2: 1100.0, 3: None, 4: None, 5: 1700.0}
    assert later.due({}, 0.1)[1] == {4: 1500}, "its attaching was lost: once more"
    seen = []
    for frame in range(4):
        on, _ = later.due({2: 1110} if frame == 2 else {}, 0.02 * (5 + frame))
        seen.append(on)
        later.sent(on, 0.02 * (5 + frame), {2: 1110} if frame == 2 else {})
    assert seen == [{2: 1040}, {2: 1080}, {2: 1110}, {}]


def test_a_pin_that_does_not_switch_on_is_tried_three_times():
    watch = watch_of(9)
    for attempt in range(3):
        watch.sent(watch.due({9: 1500}, 0.0)[1], 0.0)
        for _ in range(2):
            assert watch.never_on == ()
            watch.ask(1, now=0.0)
            assert watch.answered(PinState(9, OUTPUT, 0), 0.0) is None
        assert watch.due({}, 0.0)[1] == ({9: 1500} if attempt < 2 else {})
    assert watch.never_on == (9,)


def test_a_value_that_nobody_sent_is_another_programs():
    watch = watch_of(9)
    watch.sent({9: 1500}, 0.0)

    def says(pulse_us: int, at: float) -> str | None:
        """Twice: one answer alone may be garbled."""
        watch.ask(1, now=at)
        assert watch.answered(PinState(9, SERVO, pulse_us), at) is None
        assert watch.due({}, at) == ({}, {})
        watch.ask(1, now=at)
        words = watch.answered(PinState(9, SERVO, pulse_us), at)
        watch.sent(watch.due({}, at)[0], at)
        return words

    for at in (1.0, 20.0, 25.0):
        assert says(1500, at) is None
        words = says(2020, at + 0.1)
        assert words is not None and words.startswith("pin 9 went from 1500 µs to 2020 µs, which armctl")
        assert watch.strayed == ((9,) if at == 25.0 else ())
    assert says(1500, 40.0) is None
    words = says(90, 40.1)
    assert words is not None and words.startswith("pin 9 went from 1500 µs to 90°, which armctl did not send")


def test_a_garbled_width_is_neither_shown_nor_another_programs():
    watch = watch_of(9)
    watch.sent({9: 1455}, 0.0)
    for at in (1.0, 2.0, 3.0):
        watch.ask(1, now=at)
        assert watch.answered(PinState(9, SERVO, 1455), at) is None
        for _ in range(2):
            assert watch.due({}, at + 0.1) == ({}, {})
            watch.ask(1, now=at + 0.1)
            words = watch.answered(PinState(9, SERVO, 2_078_448), at + 0.1)
        assert words is not None and words.startswith("pin 9 had no pulse width instead of the 1455 µs last")
        assert watch.due({}, at + 0.2) == ({9: 1455}, {})
        watch.sent({9: 1455}, at + 0.2)
    assert watch.strayed == ()


def test_garbled_answers_that_differ_move_nothing():
    watch = watch_of(9)
    watch.sent({9: 1500}, 0.0)
    for pulse_us in (1500, 1500, 1508, 1500, 1244, 1628, 1372, 1500):
        watch.ask(1, now=1.0)
        assert watch.answered(PinState(9, SERVO, pulse_us), 1.0) is None
        assert watch.due({}, 1.0) == ({}, {})
    assert watch.positions == {9: 1500.0}


def test_a_pin_counts_as_on_once_the_board_has_said_so_twice():
    watch = watch_of(9)
    watch.sent({9: 1500}, 0.0)
    for seen in (None, 1500.0):
        assert watch.positions == {9: None}
        watch.ask(1, now=0.0)
        watch.answered(PinState(9, SERVO, 1500), 0.02)
        assert watch.positions == {9: seen}
    assert watch.delay_s == pytest.approx(0.02)


def test_a_pin_is_not_tried_again_when_nobody_waits_any_more():
    watch = watch_of(9)
    watch.sent(watch.due({9: 1500}, 0.0)[1], 0.0)
    for at in (1.2, 1.3):
        watch.ask(1, now=at)
        assert watch.answered(PinState(9, OUTPUT, 0), at) is None
    assert watch.due({}, 1.4) == ({}, {})
    assert watch.never_on == (9,)


def test_a_board_that_says_nothing_for_longer_than_usual_stalls():
    watch = watch_of(9)
    watch.ask(1, now=0.0)
    assert [watch.stalls(at) for at in (0.049, 0.051)] == [False, True]
    watch.answered(PinState(9, OUTPUT, 0), 0.08)  # late, but it answers
    watch.ask(1, now=0.1)
    assert [watch.stalls(at) for at in (0.25, 0.27)] == [False, True]


def test_after_a_setpoint_was_dropped_the_next_is_reached_at_the_pins_speed():
    watch = PinWatch([PinState(2, SERVO, 1000)], {2: 2000.0})
    watch.sent({2: 1000}, 0.0)
    watch.dropped(2)
    assert watch.due({2: 1100}, 0.02)[0] == {2: 1040}


NAME = "StandardFirmata.ino"
REPORT = 2 + 2 + 2 * len(NAME) + 1  # F0 79, the version, two bytes a character, F7
BUFFER = 64
OWN_SERVOS, SHARED_SERVOS = (2, 3), (2, 4)
LED = 13
ATTACHED = "f0 70 09 68 07 50 0f f7 f0 6f 09 5c 0b f7"
SPARE = "f0 70 0d 68 07 50 0f f7 f0 6f 0d 5c 0b f7 f4 0d 01 f5 0d 00"


def table_of(*pins: int) -> ChannelTable:
    return pin_table([ChannelSettings(pin, 1000.0, 2000.0) for pin in pins], pins)


def prepared(attacher: Attacher, count: int) -> tuple[bytes, int]:
    """The bytes for so many pins at 1500 µs, and how many are answered."""
    pins = range(2, 2 + count)
    return attacher.prepare(dict.fromkeys(pins, 1500), table_of(*pins), 0.0)


def test_the_bytes_for_a_sketch_whose_pins_have_servos_of_their_own():
    attacher = Attacher(NAME, OWN_SERVOS, LED)
    assert attacher.needs_preparing
    request, answer_length = attacher.prepare({9: 1500}, table_of(9), 0.0)
    assert (request.hex(" "), answer_length) == (f"f0 79 f7 f0 79 f7 {ATTACHED} f4 09 01", 2 * REPORT)
    assert attacher.holding(0.1)
    for _ in range(2):
        attacher.answered()
    assert not attacher.holding(0.1)
    request, answer_length = attacher.attach(9, 1500, table_of(9), 0.0, kept=True)
    assert (request.hex(" "), answer_length) == (ATTACHED, 0)
    request, answer_length = attacher.attach(9, 1500, table_of(9), 0.0, kept=False)
    assert (request.hex(" "), answer_length) == (f"f0 79 f7 f0 79 f7 {ATTACHED}", 2 * REPORT)


def test_the_bytes_for_a_sketch_whose_pins_share_its_servos():
    attacher = Attacher(NAME, SHARED_SERVOS, LED)
    assert not attacher.needs_preparing
    request, answer_length = attacher.attach(9, 1500, table_of(9), 0.0, kept=False)
    assert (request.hex(" "), answer_length) == (f"{SPARE} {ATTACHED}", 0)
    assert len(request) < BUFFER


def test_what_is_pulsed_ahead_of_a_pin_drives_no_servo():
    assert spare_pin(range(2, 50), (2, 3, 4)) == LED
    assert spare_pin(range(2, 50), (2, LED)) == 49
    assert spare_pin((2, 3), (2, 3)) is None


@pytest.mark.parametrize(
    ("name", "most"), [(NAME, 3), ("StandardFirmata", 3), ("StandardFirmataEthernetPlus.ino", 3), ("xy", 1)]
)
def test_how_many_pins_one_hold_is_good_for(name: str, most: int):
    assert Attacher(name, OWN_SERVOS, LED).most_prepared_at_once == most


@pytest.mark.parametrize("name", [NAME, "StandardFirmata", "StandardFirmataEthernetPlus.ino"])
@pytest.mark.parametrize("less", [0, 1])
def test_the_sketch_is_held_until_all_has_come_in_and_nothing_overflows(name: str, less: int):
    attacher = Attacher(name, OWN_SERVOS, LED)
    request, answer_length = prepared(attacher, attacher.most_prepared_at_once - less)
    report = 5 + 2 * len(name)
    # Byte times, from the first byte on: the sketch takes a question as soon as it has come in and it is
    # not held, and is held until the answer fits into the transmit buffer, which drains all the while.
    free, waiting, drained_from = 0, 0, None
    for number in range(answer_length // report):
        taken = max(free, 3 * (number + 1))
        drained_from = taken if drained_from is None else drained_from
        free = max(taken, drained_from + report * (number + 1) - BUFFER)
        arrived = min(len(request), free)
        waiting = max(waiting, arrived - 3 * (number + 1))
    assert free >= len(request), "held too short: attach and write may be torn apart"
    assert waiting < BUFFER, "the receive buffer overflows"


def test_a_sketch_with_a_short_name_never_gets_more_than_its_buffer_holds():
    request, _ = prepared(Attacher("x", OWN_SERVOS, LED), 1)
    assert len(request) - 3 < BUFFER


# Setpoints that wait for the line: the newest goes out, once, and before any question.

PINS = tuple(range(2, 14))
FRAME_BYTES = round(SERVO_FRAME_S * BAUD / 10)


class Line:
    """A stream on a line that is only written down, and the pins at its end."""

    def __init__(self, clock: ManualClock, *, mode: int = SERVO) -> None:
        self.clock = clock
        self.sent: list[bytes] = []
        self.table = pin_table([ChannelSettings(pin, 1000.0, 2000.0) for pin in PINS], PINS)
        self.watch = PinWatch(PinState(pin, mode, 1500 if mode == SERVO else 0) for pin in PINS)
        self.stream = SetpointStream(self.sent.append, clock.now, Attacher("StandardFirmata.ino", (2, 3), 13))

    def flush(self) -> bytes:
        """What goes out now."""
        count = len(self.sent)
        self.stream.flush(self.table, self.watch)
        return b"".join(self.sent[count:])

    def ask(self) -> bytes:
        count = len(self.sent)
        self.stream.ask_next(self.watch, lambda: MARKER)
        return b"".join(self.sent[count:])


@pytest.fixture
def line(clock: ManualClock) -> Line:
    return Line(clock)


def test_only_the_newest_value_of_a_pin_goes_out_and_only_where_it_is_new(line: Line):
    line.stream.put({9: 1600, 10: 1500})
    line.stream.put({9: 1700})
    assert line.flush() == servo_write(9, 1700)
    assert line.flush() == b""
    line.stream.put({9: 1700})
    assert line.flush() == b""
    line.stream.put({9: 1600})
    line.stream.clear()
    assert line.flush() == b""


@pytest.mark.parametrize(("request_length", "answer_length"), [(FRAME_BYTES, 0), (1, FRAME_BYTES)])
def test_a_busy_line_keeps_the_newest_setpoint_waiting(line: Line, request_length: int, answer_length: int):
    line.stream.send(bytes(request_length), answer_length)  # the longer direction counts
    line.stream.put({9: 1600})
    assert line.flush() == b""
    line.stream.put({9: 1650})
    line.clock.advance(SERVO_FRAME_S)
    assert line.flush() == servo_write(9, 1650)


def test_a_round_of_questions_does_not_hold_a_setpoint_up(line: Line):
    assert line.ask() == b"".join(map(pin_state_query, PINS[:8]))
    line.stream.put({9: 1600})
    assert line.flush() == servo_write(9, 1600)


def test_questions_go_round_and_keep_their_distance(line: Line):
    line.ask()
    for pin in PINS[:8]:
        assert line.watch.answered(PinState(pin, SERVO, 1500), 0.1) is None
    assert line.ask() == b""  # too soon
    line.clock.advance(SERVO_FRAME_S)
    assert line.ask() == b"".join(map(pin_state_query, (*PINS[8:], *PINS[:4])))


def test_questions_take_only_what_setpoints_leave_of_a_frame(line: Line):
    line.stream.put(dict.fromkeys(PINS, 1600))
    sent = line.flush()
    asked = line.ask()
    assert len(sent) == len(PINS) * 6
    assert 0 < len(asked) < 8 * len(pin_state_query(2))
    assert len(sent) + len(asked) <= FRAME_BYTES


def test_a_pin_that_the_board_was_seen_with_otherwise_is_sent_again(line: Line):
    line.stream.put({9: 1600})
    line.flush()
    for words in (None, "pin 9 had 1234 instead of the 1600 µs last sent"):
        line.clock.advance(SERVO_FRAME_S)
        line.ask()
        told = line.watch.answered(PinState(9, SERVO, 1234), line.clock.now())
        assert told is words or (told is not None and words is not None and told.startswith(words))
    line.clock.advance(SERVO_FRAME_S)
    assert line.flush() == servo_write(9, 1600)

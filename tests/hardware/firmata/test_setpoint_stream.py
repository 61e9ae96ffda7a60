"""Setpoints that wait for the line: the newest goes out, once, and before any question."""

from __future__ import annotations

import pytest

from armctl.hardware import ChannelSettings
from armctl.hardware.firmata.codec import BAUD, PinState, pin_state_query, servo_write
from armctl.hardware.firmata.line import SERVO_FRAME_S, SetpointStream
from armctl.hardware.firmata.pins import Attacher, PinWatch, pin_table
from armctl.runtime.clock import ManualClock

SERVO, OUTPUT = 4, 1
PINS = tuple(range(2, 14))
FRAME_BYTES = round(SERVO_FRAME_S * BAUD / 10)


class Line:
    """A stream on a line that is only written down, and the pins at its end."""

    def __init__(self, clock: ManualClock, *, mode: int = SERVO) -> None:
        self.clock = clock
        self.sent: list[bytes] = []
        self.table = pin_table([ChannelSettings(pin, 1000.0, 2000.0) for pin in PINS], PINS)
        self.watch = PinWatch(PinState(pin, mode, 1500 if mode == SERVO else 0) for pin in PINS)
        self.stream = SetpointStream(
            self.sent.append, clock.now, Attacher("StandardFirmata.ino", fresh=False)
        )

    def flush(self) -> bytes:
        """What goes out now."""
        count = len(self.sent)
        self.stream.flush(self.table, self.watch)
        return b"".join(self.sent[count:])

    def ask(self) -> bytes:
        count = len(self.sent)
        self.stream.ask_next(self.watch)
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


def test_what_was_forgotten_does_not_go_out(line: Line):
    line.stream.put({9: 1600})
    line.stream.clear()
    assert line.flush() == b""


def test_a_busy_line_keeps_the_newest_setpoint_waiting(line: Line):
    line.stream.send(bytes(FRAME_BYTES))
    line.stream.put({9: 1600})
    assert line.flush() == b""
    line.stream.put({9: 1650})
    line.clock.advance(SERVO_FRAME_S)
    assert line.flush() == servo_write(9, 1650)


def test_the_longer_direction_is_what_the_line_is_busy_with(line: Line):
    line.stream.send(b"?", answer_length=FRAME_BYTES)
    line.stream.put({9: 1600})
    assert line.flush() == b""


def test_a_round_of_questions_does_not_hold_a_setpoint_up(line: Line):
    assert line.ask() == b"".join(map(pin_state_query, PINS[:8]))
    line.stream.put({9: 1600})
    assert line.flush() == servo_write(9, 1600)


def test_questions_go_round_and_keep_their_distance(line: Line):
    line.ask()
    for pin in PINS[:8]:
        assert line.watch.answered(PinState(pin, SERVO, 1500)) is None
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
    line.ask()
    assert line.watch.answered(PinState(9, SERVO, 1234)) is not None
    line.clock.advance(SERVO_FRAME_S)
    assert line.flush() == servo_write(9, 1600)


def test_servos_are_switched_on_a_few_at_a_time_and_none_is_lost(clock: ManualClock):
    line = Line(clock, mode=OUTPUT)
    wanted = {pin: 1400 + pin for pin in PINS[:6]}
    line.stream.put(wanted)
    bursts: list[bytes] = []
    for _ in range(4):
        bursts.append(line.flush())
        clock.advance(SERVO_FRAME_S)
    assert [sum(servo_write(pin, pulse) in burst for pin, pulse in wanted.items()) for burst in bursts][
        :2
    ] == [4, 2]
    assert {pin for pin in PINS if line.watch.is_on(pin)} == set(wanted)
    assert {pin: line.watch.positions[pin] for pin in wanted} == wanted

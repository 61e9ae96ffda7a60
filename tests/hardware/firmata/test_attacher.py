from __future__ import annotations

import pytest

from armctl.hardware.firmata.pins import Attacher, FirstPulse

NAME = "StandardFirmata.ino"
REPORT = 2 + 2 + 2 * len(NAME) + 1  # F0 79, the version, two bytes a character, F7
BUFFER = 64
BYTE_S = 10 / 57600
SERVO = "f0 70 09 68 07 50 0f f7 f0 6f 09 5c 0b f7"


def first_pulses(count: int) -> list[FirstPulse]:
    return [FirstPulse(2 + number, 1500, (544, 2400)) for number in range(count)]


def test_the_bytes_on_a_fresh_board():
    burst = Attacher(NAME, fresh=True).burst([FirstPulse(9, 1500, (1000, 2000))])
    assert burst.request.hex(" ") == SERVO
    assert burst.answer_length == 0


def test_the_bytes_on_a_board_that_drives_servos_already():
    burst = Attacher(NAME, fresh=False).burst([FirstPulse(9, 1500, (1000, 2000))])
    assert burst.request.hex(" ") == f"f0 79 f7 f0 79 f7 {SERVO}"
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

from __future__ import annotations

from armctl.hardware.firmata.attach import MOST_AT_ONCE, Attachment, attach

NAME = "StandardFirmata.ino"
REPORT = 2 + 2 + 2 * len(NAME) + 1  # F0 79, the version, two bytes a character, F7
TRANSMIT_BUFFER = RECEIVE_BUFFER = 64


def test_the_bytes_of_one_attachment():
    burst = attach([Attachment(9, 1500, (1000, 2000))], NAME)
    assert burst.request.hex(" ") == "f0 79 f7 f0 79 f7 f0 70 09 68 07 50 0f f7 f0 6f 09 5c 0b f7"
    assert burst.answer_length == 2 * REPORT


def test_the_sketch_waits_until_all_has_come_in_and_nothing_overflows():
    for name in (NAME, "StandardFirmata", "StandardFirmataEthernetPlus.ino"):
        for count in range(1, MOST_AT_ONCE + 1):
            burst = attach([Attachment(2 + i, 1500, (544, 2400)) for i in range(count)], name)
            # It goes on once all of its answers but a buffer full are out, at the line's own speed.
            assert burst.answer_length - TRANSMIT_BUFFER >= len(burst.request)
            assert len(burst.request) < RECEIVE_BUFFER


def test_a_sketch_with_a_short_name_gets_as_many_questions_as_its_buffer_holds():
    burst = attach([Attachment(2 + i, 1500, (544, 2400)) for i in range(MOST_AT_ONCE)], "x")
    assert RECEIVE_BUFFER - 3 <= len(burst.request) < RECEIVE_BUFFER

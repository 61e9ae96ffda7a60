"""Golden bytes of lines; the checksums were worked out by hand and by another program."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.avr.encoder_conformance import crc16

from armctl.errors import BoardProtocolError, InputError
from armctl.hardware.encoder import messages as frame
from armctl.hardware.encoder.messages import Realtime

GOLDEN = [
    (1, "HELLO", b"1 HELLO*7DF0\n"),
    (2, "EN 1", b"2 EN 1*5689\n"),
    (65535, "P 100 -200 - - - 1650 30", b"65535 P 100 -200 - - - 1650 30*9D09\n"),
]


def test_the_published_check_value():
    assert frame.crc16(b"123456789") == 0x29B1
    assert frame.crc16(b"") == 0xFFFF


@given(st.binary(max_size=100))
def test_the_checksum_is_the_one_worked_out_bit_by_bit(data):
    assert frame.crc16(data) == crc16(data)


@pytest.mark.parametrize(("sequence", "text", "line"), GOLDEN)
def test_requests(sequence, text, line):
    assert frame.request(sequence, text) == line


def test_realtime_bytes():
    assert [bytes((one,)) for one in Realtime] == [b"!", b"?", b"\x18", b"~"]


@pytest.mark.parametrize("text", ["CFG? 1", "EN 1!", "P ~", "P \x18"])
def test_a_request_never_contains_a_byte_that_is_obeyed_at_once(text):
    with pytest.raises(InputError, match="obeys at once"):
        frame.request(1, text)


def test_a_request_is_never_longer_than_the_board_takes():
    text = "X" * (96 - len("1 ") - len("*0000"))
    assert len(frame.request(1, text)) == 97
    with pytest.raises(InputError, match="longer than the 96 bytes"):
        frame.request(1, text + "X")


@given(st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=90))
def test_a_sealed_line_opens_again(text):
    assert frame.unseal(frame.seal(text)[:-1]) == text


@given(st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=90), st.data())
def test_no_line_with_a_flipped_bit_opens(text, data):
    line = bytearray(frame.seal(text)[:-1])
    line[data.draw(st.integers(0, len(line) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    with pytest.raises(BoardProtocolError):
        frame.unseal(bytes(line))


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (b"", "no checksum"),
        (b"*", "no checksum"),
        (b"1 ok", "no checksum"),
        (b"1 ok*12", "no checksum"),
        (b"1 ok*0x1F", "no checksum"),
        (b"1 ok* 1F2", "no checksum"),
        (frame.seal("1 ok")[:-1].lower(), "no checksum"),
        (b"1 ok*0000", "wrong checksum"),
        (b"\x01*%04X" % frame.crc16(b"\x01"), "no text"),
        (b"\xff*%04X" % frame.crc16(b"\xff"), "no text"),
    ],
)
def test_lines_that_do_not_open(line, why):
    with pytest.raises(BoardProtocolError, match=why):
        frame.unseal(line)

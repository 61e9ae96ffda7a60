"""Lines in both directions, by hand; the checksums were worked out by another program."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.avr.encoder_conformance import crc16 as crc16_bit_by_bit

from armctl.errors import BoardError, BoardProtocolError, InputError, StateError
from armctl.hardware.encoder.messages import (
    Banner,
    BoardFlag,
    FaultKind,
    LineReader,
    LineReply,
    Mode,
    Status,
    crc16,
    decode,
    decode_status,
    fault_words,
    flag_words,
    request,
    seal,
    unseal,
)

PRINTABLE = st.text(st.characters(min_codepoint=0x20, max_codepoint=0x7E), max_size=90)
STATUS = Status(
    time_ms=12340,
    mode=Mode.TRIPPED,
    homed=(True, True, False, False, False, True),
    switches=(False, True, False, False, False, False),
    flags=BoardFlag.WATCHDOG | BoardFlag.STOPPED,
    faults=(FaultKind(0), FaultKind.STALL | FaultKind.HOMING, FaultKind.LIMIT, *[FaultKind(0)] * 3),
    lost=(0, 4, 0, 15, 0, 0),
    counts=(0, -120, 4000, 7, 8, -2147483648),
    changes=(1, 0, 0, 15, 0, 0, 0, 2),
)
BANNER = Banner("armctl-encoder", "1.3.0", 4, 6, "external")


def said(text: str):
    return decode(seal(text)[:-1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("7 ok", LineReply(7, "")),
        ("65535 ok a b=1", LineReply(65535, "a b=1")),
        ("9 err LIMIT 2 600 -500 500", LineReply(9, "2 600 -500 500", "LIMIT")),
        ("0 err CRC", LineReply(0, "", "CRC")),
        ("! home failed 3 notfound", ("home", "failed", "3", "notfound")),
        ("# armctl-encoder 1.3.0 proto=4 axes=6 reset=external", BANNER),
        ("@ 12340 T 23 02 09 000910000000 040f00 100f0002 0 -120 4000 7 8 -2147483648", STATUS),
    ],
)
def test_what_the_board_says(text, message):
    assert said(text) == message
    if isinstance(message, Status | Banner):
        assert message.encode() == text[2:]


@given(
    st.builds(
        Status,
        time_ms=st.integers(0, 2**32 - 1),
        mode=st.sampled_from(Mode),
        homed=st.tuples(*[st.booleans()] * 6),
        switches=st.tuples(*[st.booleans()] * 6),
        flags=st.integers(0, 63).map(BoardFlag),
        faults=st.tuples(*[st.integers(0, 63).map(FaultKind)] * 6),
        lost=st.tuples(*[st.integers(0, 15)] * 6),
        counts=st.tuples(*[st.integers(-(2**31), 2**31 - 1)] * 6),
    )
)
def test_every_status_both_ways(status):
    assert decode_status(status.encode()) == status


@pytest.mark.parametrize(
    "text",
    [
        "",
        "@ ",
        "@ 1 O 00 00 00 000000000000 000000 00000000 1 2 3 4 5",  # five counts, six faults
        "@ 1 X 00 00 00 000000000000 000000 00000000 1 2 3 4 5 6",
        "@ 1 O 40 00 00 000000000000 000000 00000000 1 2 3 4 5 6",  # a seventh axis
        "@ 1 O 00 00 40 000000000000 000000 00000000 1 2 3 4 5 6",  # an unknown flag
        "@ 1 O 00 00 00 400000000000 000000 1 2 3 4 5 6",
        "@ 1 O 00 00 00 000000000000 000000 00000000 1 2 3 4 5 x",
        "@ 1 O 00 00 00 000000000000 00000 1 2 3 4 5 6",
        "@ 1 O 00 00 00 000000000000 1 2 3 4 5 6",  # protocol 2
        "@ 1 O 00 00 00 000000000000 000000 1 2 3 4 5 6",  # protocol 3
        "! pins 0000000",
        "! pins",
        "# grbl 1.1",
        "hello",
        "7 OK",
        "7 err",
        "65536 ok",
        "70000000000 ok",
        "-1 ok",
    ],
)
def test_what_no_board_says(text):
    with pytest.raises(BoardProtocolError):
        said(text)


@given(st.binary(max_size=120))
def test_whatever_comes_is_a_message_or_a_protocol_error(data):
    for line in (data, seal("@ 1 ")[:-1] + data, data + b"*0000"):
        with pytest.raises(BoardProtocolError):
            decode(line)


@pytest.mark.parametrize(
    ("code", "kind", "words"),
    [
        ("MOVING", StateError, "release first"),
        ("NOTHOMED", StateError, "home first"),
        ("OFF", StateError, "motors are off"),
        ("HOLD", StateError, "the board holds"),
        ("FAULT", StateError, "a fault is latched"),
        ("BUSY", StateError, "homing"),
        ("LIMIT", BoardError, "soft limits"),
        ("NEWCODE", BoardProtocolError, "NEWCODE 3"),
    ],
)
def test_refusals_in_words(code, kind, words):
    error = LineReply(5, "3", code).error("EN 1")
    assert type(error) is kind
    assert "the board refused 'EN 1'" in str(error)
    assert words in str(error)


def test_every_fault_and_flag_has_words():
    assert [one for one in FaultKind if not fault_words(one)] == []
    assert [one for one in BoardFlag if not flag_words(one)] == [BoardFlag.LINE_LOST]
    assert fault_words(FaultKind(0), "detail") == ""
    both = fault_words(FaultKind.STALL | FaultKind.HOMING, "not found")
    assert re.fullmatch(r"stalled: .*; homing failed; .* \(not found\)", both)


@given(st.binary(max_size=100))
def test_the_checksum_is_the_published_one(data):
    assert crc16(b"123456789") == 0x29B1
    assert crc16(data) == crc16_bit_by_bit(data)


@pytest.mark.parametrize(
    ("sequence", "text", "line"),
    [
        (1, "HELLO", b"1 HELLO*7DF0\n"),
        (2, "EN 1", b"2 EN 1*5689\n"),
        (65535, "P 100 -200 - - - 1650 30", b"65535 P 100 -200 - - - 1650 30*9D09\n"),
    ],
)
def test_requests(sequence, text, line):
    assert request(sequence, text) == line


@pytest.mark.parametrize(
    ("text", "why"),
    [
        *((f"EN{byte} 1", "obeys at once") for byte in "!?\x18~"),
        ("X" * 90, "longer than the 96 bytes"),
    ],
)
def test_requests_that_the_board_would_not_take_as_such(text, why):
    assert len(request(1, "X" * 89)) == 97
    with pytest.raises(InputError, match=why):
        request(1, text)


@given(PRINTABLE, st.data())
def test_a_sealed_line_opens_again_unless_a_bit_flips(text, data):
    line = bytearray(seal(text)[:-1])
    assert unseal(bytes(line)) == text
    line[data.draw(st.integers(0, len(line) - 1))] ^= 1 << data.draw(st.integers(0, 7))
    with pytest.raises(BoardProtocolError):
        unseal(bytes(line))


@pytest.mark.parametrize(
    ("line", "why"),
    [
        (b"", "no checksum"),
        (b"*", "no checksum"),
        (b"1 ok", "no checksum"),
        (b"1 ok*12", "no checksum"),
        (b"1 ok*0x1F", "no checksum"),
        (b"1 ok* 1F2", "no checksum"),
        (seal("1 ok")[:-1].lower(), "no checksum"),
        (b"1 ok*0000", "wrong checksum"),
        (b"\x01*%04X" % crc16(b"\x01"), "no text"),
        (b"\xff*%04X" % crc16(b"\xff"), "no text"),
    ],
)
def test_lines_that_do_not_open(line, why):
    with pytest.raises(BoardProtocolError, match=why):
        unseal(line)


@pytest.mark.parametrize(
    ("data", "lines"),
    [
        (b"one\ntwo\r\n\n\r\nthr", [b"one", b"two", b"", b""]),
        (b"12345\n12345\r\n", [b"12345", b"12345"]),
        (b"123456\n12345x\r\n1\n", [None, None, b"1"]),
    ],
)
def test_lines_of_at_most_five_bytes(data, lines):
    assert LineReader(5).feed(data) == lines


def test_a_flood_without_an_end_is_not_kept():
    reader = LineReader(5)
    for _ in range(1000):
        assert reader.feed(b"x" * 1000) == []
    assert len(reader._pending) <= 7
    assert reader.feed(b"\nok\n") == [None, b"ok"]


@given(st.lists(st.binary(max_size=8).map(lambda b: b.replace(b"\n", b"").replace(b"\r", b""))), st.data())
def test_the_pieces_do_not_matter(lines, data):
    stream = b"".join(line + b"\n" for line in lines)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=10)))
    reader = LineReader(6)
    found: list[bytes | None] = []
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        found += reader.feed(stream[start:end])
    assert found == [line if len(line) <= 6 else None for line in lines]

"""What the board sends, by hand."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import BoardError, BoardProtocolError, StateError
from armctl.hardware.encoder.messages import (
    Answer,
    Banner,
    BoardFlag,
    Event,
    FaultKind,
    Mode,
    Refusal,
    Status,
    decode,
    decode_status,
    fault_words,
    flag_words,
    seal,
)


def said(text: str):
    return decode(seal(text)[:-1])


def test_answers():
    assert decode(b"7 ok*B91B") == Answer(7, "")
    assert said("65535 ok a b=1") == Answer(65535, "a b=1")
    assert said("9 err LIMIT 2 600 -500 500") == Refusal(9, "LIMIT", "2 600 -500 500")
    assert said("0 err CRC") == Refusal(0, "CRC", "")


def test_events_and_banner():
    assert said("! home failed 3 notfound") == Event(("home", "failed", "3", "notfound"))
    banner = Banner("armctl-encoder", "1.1.0", 2, 6, "external")
    assert said("# armctl-encoder 1.1.0 proto=2 axes=6 reset=external") == banner
    assert banner.encode() == "armctl-encoder 1.1.0 proto=2 axes=6 reset=external"


STATUS = Status(
    time_ms=12340,
    mode=Mode.TRIPPED,
    homed=(True, True, False, False, False, True),
    switches=(False, True, False, False, False, False),
    flags=BoardFlag.WATCHDOG | BoardFlag.STOPPED,
    faults=(FaultKind(0), FaultKind.STALL | FaultKind.HOMING, FaultKind.LIMIT, *[FaultKind(0)] * 3),
    counts=(0, -120, 4000, 7, 8, -2147483648),
)
STATUS_LINE = "12340 T 23 02 09 000910000000 0 -120 4000 7 8 -2147483648"


def test_a_status_line_both_ways():
    assert said("@ " + STATUS_LINE) == STATUS
    assert STATUS.encode() == STATUS_LINE


@given(
    st.builds(
        Status,
        time_ms=st.integers(0, 2**32 - 1),
        mode=st.sampled_from(Mode),
        homed=st.tuples(*[st.booleans()] * 6),
        switches=st.tuples(*[st.booleans()] * 6),
        flags=st.integers(0, 15).map(BoardFlag),
        faults=st.tuples(*[st.integers(0, 31).map(FaultKind)] * 6),
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
        "@ 1 O 00 00 00 000000000000 1 2 3 4 5",  # five counts, six faults
        "@ 1 X 00 00 00 000000000000 1 2 3 4 5 6",
        "@ 1 O 40 00 00 000000000000 1 2 3 4 5 6",  # a seventh axis
        "@ 1 O 00 00 10 000000000000 1 2 3 4 5 6",  # a flag that nobody knows
        "@ 1 O 00 00 00 200000000000 1 2 3 4 5 6",
        "@ 1 O 00 00 00 000000000000 1 2 3 4 5 x",
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
        ("RANGE", BoardProtocolError, "RANGE 3"),
        ("NEWCODE", BoardProtocolError, "NEWCODE 3"),
    ],
)
def test_refusals_in_words(code, kind, words):
    error = Refusal(5, code, "3").error("EN 1")
    assert type(error) is kind
    assert "the board refused 'EN 1'" in str(error)
    assert words in str(error)


def test_every_fault_and_flag_has_words():
    for kind in FaultKind:
        assert fault_words(kind)
    for flag in set(BoardFlag) - {BoardFlag.LINE_LOST}:
        assert flag_words(flag)
    assert flag_words(BoardFlag.LINE_LOST) == ()
    assert fault_words(FaultKind(0), "detail") == ""
    both = fault_words(FaultKind.STALL | FaultKind.HOMING, "switch not found")
    assert (
        both.startswith("stalled: ") and "; homing failed; " in both and both.endswith("(switch not found)")
    )

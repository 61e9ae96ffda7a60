from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.hardware.firmata.codec import Command
from armctl.hardware.firmata.simulated import Overflow, ShortMessage, SketchParser, SysexMessage


def parsed(text: str) -> list:
    parser = SketchParser()
    messages = (parser.push(byte) for byte in bytes.fromhex(text))
    return [message for message in messages if message is not None]


@pytest.mark.parametrize(
    ("raw", "expected"),
    [
        ("f9", [ShortMessage(Command.REPORT_VERSION, 0, b"")]),
        ("ff", [ShortMessage(Command.SYSTEM_RESET, 0, b"")]),
        ("f4 09 04", [ShortMessage(Command.SET_PIN_MODE, 0, b"\x09\x04")]),
        ("e9 5c 0b", [ShortMessage(Command.ANALOG_MESSAGE, 9, b"\x5c\x0b")]),
        ("c3 01", [ShortMessage(Command.REPORT_ANALOG, 3, b"\x01")]),
        ("f0 6d 09 f7", [SysexMessage(b"\x6d\x09")]),
        ("f0 f7", [SysexMessage(b"")]),
        ("12 34 f7 a0 80", []),
        ("f4 09 f4 0a 01", [ShortMessage(Command.SET_PIN_MODE, 0, b"\x0a\x01")]),
        (
            "f4 09 f9 04",  # the version in between does not end the wait for data
            [
                ShortMessage(Command.REPORT_VERSION, 0, b""),
                ShortMessage(Command.SET_PIN_MODE, 0, b"\x09\x04"),
            ],
        ),
    ],
)
def test_messages(raw: str, expected: list):
    assert parsed(raw) == expected


def test_a_sysex_without_its_end_swallows_the_next_one():
    assert parsed("f0 6f 09 5c f0 6f 0a 5c 0b f7") == [SysexMessage(bytes.fromhex("6f 09 5c f0 6f 0a 5c 0b"))]


def test_nothing_ends_a_sysex_but_its_end():
    assert parsed("f0 6f ff f9 f4 09 01") == []


def test_the_buffer_holds_64_bytes():
    assert parsed("f0" + "01" * 64 + "f7") == [SysexMessage(b"\x01" * 64)]
    assert Overflow() in parsed("f0" + "01" * 65)


@given(st.binary(max_size=300))
def test_any_bytes_can_be_parsed(data: bytes):
    parser = SketchParser()
    for byte in data:
        parser.push(byte)

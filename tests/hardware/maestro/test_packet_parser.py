from __future__ import annotations

import pytest

from armctl.hardware.maestro.codec import MaestroErrors, Opcode
from armctl.hardware.maestro.packet_parser import Packet, PacketParser


def parse(text: str, *, crc: bool = False, mini: bool = False) -> list[object]:
    """Opcode and data in hex of each packet, and each error, in order."""
    parser = PacketParser(device=12, crc=crc, multiple_targets=mini)
    events: list[object] = []
    for byte in bytes.fromhex(text):
        for event in parser.push(byte):
            events.append((event.opcode, event.data.hex(" ")) if isinstance(event, Packet) else event)
    return events


TARGET = (Opcode.SET_TARGET, "02 70 2e")
PROTOCOL = MaestroErrors.SERIAL_PROTOCOL


@pytest.mark.parametrize(
    ("bytes_in", "events"),
    [
        ("84 02 70 2e", [TARGET]),
        ("aa 0c 04 02 70 2e", [TARGET]),
        ("84 02 70 2e 84 02 70 2e", [TARGET, TARGET]),
        ("a1", [(Opcode.GET_ERRORS, "")]),
        ("aa 0c 21", [(Opcode.GET_ERRORS, "")]),
        ("ff 00 7f", [(Opcode.MINI_SSC, "00 7f")]),
        ("ff fe 84", [(Opcode.MINI_SSC, "fe 84")]),  # its data bytes use all 8 bits
        ("84 02", []),
        ("84 02 a1", [PROTOCOL, (Opcode.GET_ERRORS, "")]),
        ("84 02 70 84 02 70 2e", [PROTOCOL, TARGET]),
        ("aa a1", [PROTOCOL, (Opcode.GET_ERRORS, "")]),
        ("ff 00 ff 00 7f", [PROTOCOL, (Opcode.MINI_SSC, "00 7f")]),
        ("c0 01 02 a1", [PROTOCOL, (Opcode.GET_ERRORS, "")]),  # unknown, its data skipped
        ("aa 0c 40 01 a1", [PROTOCOL, (Opcode.GET_ERRORS, "")]),
        ("02 70 2e", [PROTOCOL]),  # data of nothing: an error once
        ("84 02 70 2e 17 a1", [TARGET, PROTOCOL, (Opcode.GET_ERRORS, "")]),
        ("aa 0d 04 02 70 2e a1", [(Opcode.GET_ERRORS, "")]),  # for another device: no concern of ours
        ("9f 01 02 70 2e", [PROTOCOL]),  # the Micro does not know it
    ],
)
def test_what_a_micro_makes_of_bytes(bytes_in, events):
    assert parse(bytes_in) == events


@pytest.mark.parametrize(
    ("bytes_in", "events"),
    [
        ("9f 02 03 00 00 70 2e", [(Opcode.SET_MULTIPLE_TARGETS, "02 03 00 00 70 2e")]),
        ("aa 0c 1f 02 03 00 00 70 2e", [(Opcode.SET_MULTIPLE_TARGETS, "02 03 00 00 70 2e")]),
        ("9f 02 03 00 00 a1", [PROTOCOL, (Opcode.GET_ERRORS, "")]),
    ],
)
def test_the_mini_knows_multiple_targets(bytes_in, events):
    assert parse(bytes_in, mini=True) == events


def test_with_crc():
    # The remainder worked out by long division as in the guide.
    assert parse("84 02 70 2e 18", crc=True) == [TARGET]


def test_a_wrong_crc_is_its_own_error_and_the_command_is_ignored():
    assert parse("84 02 70 2e 19", crc=True) == [MaestroErrors.SERIAL_CRC]


def test_mini_ssc_never_carries_a_crc():
    assert parse("ff 00 7f", crc=True) == [(Opcode.MINI_SSC, "00 7f")]


def test_the_raw_bytes_are_kept():
    parser = PacketParser(device=12, crc=False, multiple_targets=False)
    events = [event for byte in bytes.fromhex("aa 0c 10 05") for event in parser.push(byte)]
    assert events == [Packet(Opcode.GET_POSITION, b"\x05", bytes.fromhex("aa 0c 10 05"))]

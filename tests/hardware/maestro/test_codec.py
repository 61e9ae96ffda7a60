"""Golden bytes from Pololu's guide 0J40 (sections 5.c to 5.e) and from its rules worked by hand."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.errors import BoardProtocolError, InputError
from armctl.hardware.maestro import MaestroModel, codec
from armctl.hardware.maestro.codec import MaestroErrors, Opcode, Packet, PacketParser, error_words

COMMANDS = [
    (lambda **crc: codec.command(codec.Opcode.SET_TARGET, 2, 6000, **crc), "84 02 70 2e"),
    (lambda **crc: codec.command(codec.Opcode.SET_TARGET, 0, 6000, **crc), "84 00 70 2e"),
    (lambda **crc: codec.command(codec.Opcode.SET_TARGET, 5, 0, **crc), "84 05 00 00"),
    (lambda **crc: codec.command(codec.Opcode.SET_TARGET, 23, 16383, **crc), "84 17 7f 7f"),
    (lambda **crc: codec.command(codec.Opcode.SET_SPEED, 5, 140, **crc), "87 05 0c 01"),
    (lambda **crc: codec.command(codec.Opcode.SET_ACCELERATION, 5, 4, **crc), "89 05 04 00"),
    (lambda **crc: codec.command(codec.Opcode.SET_ACCELERATION, 0, 255, **crc), "89 00 7f 01"),
    (lambda **crc: codec.command(codec.Opcode.GET_POSITION, 3, **crc), "90 03"),
    (lambda **crc: codec.command(codec.Opcode.GET_ERRORS, **crc), "a1"),
    (lambda **crc: codec.set_targets({3: 0, 4: 6000}, multiple=True, **crc), "9f 02 03 00 00 70 2e"),
]


def test_crc_of_the_guides_own_example():
    assert codec.crc7(bytes.fromhex("83 01")) == 0x17


def crc_by_long_division(message: bytes) -> int:
    """The guide's own method: bits least significant first, seven zeros, XOR with 10001001 under each 1."""
    bits = [byte >> bit & 1 for byte in message for bit in range(8)] + [0] * 7
    for at in range(len(message) * 8):
        if bits[at]:
            for offset, bit in enumerate((1, 0, 0, 0, 1, 0, 0, 1)):
                bits[at + offset] ^= bit
    return sum(bit << at for at, bit in enumerate(bits[-7:]))


@given(st.binary(min_size=1, max_size=40))
def test_crc_is_the_remainder_of_the_long_division(message):
    assert codec.crc7(message) == crc_by_long_division(message)


@pytest.mark.parametrize(("encode", "plain"), COMMANDS)
def test_every_command_with_and_without_crc(encode, plain):
    packet = bytes.fromhex(plain)
    assert encode() == packet
    assert encode(crc=True) == packet + bytes([crc_by_long_division(packet)])


def test_a_position_reply_uses_all_eight_bits():
    assert codec.decode_position(bytes.fromhex("07 0a")) == 641.75  # 2567, the guide's example
    assert codec.decode_position(bytes.fromhex("70 17")) == 1500.0
    assert codec.decode_position(b"\x00\x00") is None  # off
    assert codec.decode_position(bytes.fromhex("ff 3f")) == 4095.75


@pytest.mark.parametrize(
    ("decode", "reply", "says"),
    [
        *(
            (codec.decode_position, reply, r"answered by \d bytes, not by 2")
            for reply in ("", "70", "70 17 00")
        ),
        (codec.decode_position, "00 40", r"4096\.0 µs"),
        (codec.decode_errors, "00", "answered by 1 bytes"),
        (codec.decode_errors, "00 02", "0x0200"),
    ],
)
def test_an_answer_that_no_maestro_can_give_is_refused(decode, reply: str, says: str):
    with pytest.raises(BoardProtocolError, match=says):
        decode(bytes.fromhex(reply))


@pytest.mark.parametrize(
    ("reply", "begins"),
    [
        ("00 00", []),
        ("01 00", ["serial signal"]),
        ("02 00", ["serial overrun"]),
        ("04 00", ["serial buffer"]),
        ("08 00", ["serial CRC"]),
        ("10 00", ["serial protocol"]),
        ("20 00", ["serial timeout"]),
        ("40 00", ["script stack"]),
        ("80 00", ["script call stack"]),
        ("00 01", ["script program counter"]),
        ("28 01", ["serial CRC", "serial timeout", "script program counter"]),
    ],
)
def test_every_error_bit_has_words_of_its_own(reply: str, begins: list[str]):
    words = error_words(codec.decode_errors(bytes.fromhex(reply)))
    assert len(words) == len(begins)
    assert all(word.startswith(begin) for word, begin in zip(words, begins, strict=True))


@pytest.mark.parametrize(
    ("encode", "message"),
    [
        (lambda: codec.command(codec.Opcode.SET_TARGET, 24, 6000), "channel 24 is outside 0 … 23"),
        (lambda: codec.command(codec.Opcode.SET_TARGET, -1, 6000), "channel -1 is outside"),
        (lambda: codec.command(codec.Opcode.SET_TARGET, 0, 16384), "target 16384 is outside 0 … 16383"),
        (lambda: codec.command(codec.Opcode.SET_TARGET, 0, -1), "target -1 is outside"),
        (lambda: codec.command(codec.Opcode.SET_SPEED, 0, 16384), "speed 16384 is outside"),
        (lambda: codec.command(codec.Opcode.SET_ACCELERATION, 0, 256), "acceleration 256 is outside 0 … 255"),
        (lambda: codec.command(codec.Opcode.GET_POSITION, 24), "channel 24 is outside"),
        (lambda: codec.set_targets({23: 1, 24: 1}, multiple=True), "channel 24 is outside"),
    ],
)
def test_what_does_not_fit_is_refused(encode, message):
    with pytest.raises(InputError, match=message):
        encode()


def test_targets_go_out_in_channel_order_and_neighbours_together_where_the_board_knows_it():
    assert codec.set_targets({}) == b""
    assert codec.set_targets({3: 6000, 0: 4000}).hex(" ") == "84 00 20 1f 84 03 70 2e"
    packets = codec.set_targets({0: 4000, 1: 6000, 3: 0, 7: 0, 8: 6000}, multiple=True)
    assert packets.hex(" ") == "9f 02 00 20 1f 70 2e 84 03 00 00 9f 02 07 00 00 70 2e"


@given(
    targets=st.dictionaries(st.integers(0, 23), st.integers(0, 16383), max_size=24),
    crc=st.booleans(),
    multiple=st.booleans(),
)
def test_what_is_encoded_is_what_a_board_decodes(targets, crc, multiple):
    parser = PacketParser(device=12, crc=crc, mini=True)
    decoded: dict[int, int] = {}
    for byte in codec.set_targets(targets, crc=crc, multiple=multiple):
        for event in parser.push(byte):
            assert isinstance(event, Packet)
            if event.opcode is codec.Opcode.SET_TARGET:
                first, values = event.data[0], event.data[1:]
            else:
                assert event.opcode is codec.Opcode.SET_MULTIPLE_TARGETS
                first, values = event.data[1], event.data[2:]
            for at in range(0, len(values), 2):
                decoded[first + at // 2] = values[at] + 128 * values[at + 1]
    assert decoded == targets


@pytest.mark.parametrize(
    ("pulse_us", "quarters"),
    [(1500.0, 6000), (641.75, 2567), (1500.12, 6000), (1500.13, 6001), (0.01, 1), (4095.75, 16383)],
)
def test_pulse_widths_are_quarters_of_a_microsecond(pulse_us, quarters):
    assert codec.us_to_quarters(pulse_us) == quarters


@pytest.mark.parametrize("pulse_us", [0.0, -1.0, 4095.76, math.nan, math.inf, -math.inf])
def test_a_pulse_that_cannot_be_sent_is_refused(pulse_us):
    with pytest.raises(InputError, match="pulse width"):
        codec.us_to_quarters(pulse_us)


@pytest.mark.parametrize(
    ("convert", "limit", "units"),
    [
        (codec.speed_to_units, None, 0),  # unlimited only when asked for
        (codec.speed_to_units, 3500.0, 140),  # the guide's example: 3.5 µs/ms
        (codec.speed_to_units, 3499.9999999, 140),
        (codec.speed_to_units, 3499.0, 139),  # down: never faster than the limit
        (codec.speed_to_units, 25.0, 1),
        (codec.speed_to_units, 24.0, 1),  # 0 would mean unlimited
        (codec.speed_to_units, 1e-9, 1),
        (codec.speed_to_units, 409_575.0, 16383),
        (codec.speed_to_units, 1e9, 16383),
        (codec.acceleration_to_units, None, 0),
        (codec.acceleration_to_units, 1250.0, 4),  # the guide's example for 4
        (codec.acceleration_to_units, 1249.0, 3),
        (codec.acceleration_to_units, 1.0, 1),
        (codec.acceleration_to_units, 79_687.5, 255),
        (codec.acceleration_to_units, 1e12, 255),
    ],
)
def test_limits_in_the_boards_units(convert, limit, units):
    assert convert(limit) == units


@pytest.mark.parametrize("convert", [codec.speed_to_units, codec.acceleration_to_units])
@pytest.mark.parametrize("limit", [0.0, -1.0, math.nan, math.inf])
def test_a_limit_that_makes_no_sense_is_refused(convert, limit):
    with pytest.raises(InputError, match="makes no sense"):
        convert(limit)


@given(st.floats(25.0, 1e7))
def test_a_limit_of_at_least_one_unit_is_never_exceeded(speed):
    assert codec.speed_to_units(speed) * codec.SPEED_UNIT_US_PER_S <= speed * (1 + 1e-6)


@pytest.mark.parametrize(("count", "channels"), [(0, 6), (6, 6), (7, 12), (13, 18), (24, 24), (25, 24)])
def test_the_smallest_board_with_enough_channels(count: int, channels: int):
    model = MaestroModel.with_channels(count)
    assert (model.channels, model.has_multiple_targets) == (channels, channels > 6)
    assert MaestroModel.from_label(model.label) is model
    assert MaestroModel.from_label("Arduino Mega") is None


TARGET = (Opcode.SET_TARGET, "02 70 2e")
MULTIPLE = (Opcode.SET_MULTIPLE_TARGETS, "02 03 00 00 70 2e")
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
        ("mini 9f 02 03 00 00 70 2e", [MULTIPLE]),
        ("mini aa 0c 1f 02 03 00 00 70 2e", [MULTIPLE]),
        ("mini 9f 02 03 00 00 a1", [PROTOCOL, (Opcode.GET_ERRORS, "")]),
        ("crc 84 02 70 2e 18", [TARGET]),  # worked out by long division as in the guide
        ("crc 84 02 70 2e 19", [MaestroErrors.SERIAL_CRC]),
        ("crc ff 00 7f", [(Opcode.MINI_SSC, "00 7f")]),  # Mini SSC never carries a CRC
    ],
)
def test_what_a_board_makes_of_bytes(bytes_in: str, events):
    """Opcode and data in hex of each packet, and each error, in order."""
    crc, mini = bytes_in.startswith("crc "), bytes_in.startswith("mini ")
    parser = PacketParser(device=12, crc=crc, mini=mini)
    found: list[object] = []
    for byte in bytes.fromhex(bytes_in.removeprefix("crc ").removeprefix("mini ")):
        for event in parser.push(byte):
            found.append((event.opcode, event.data.hex(" ")) if isinstance(event, Packet) else event)
    assert found == events

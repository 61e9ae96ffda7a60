"""The bytes of Protocol 2.0 in each direction."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.hardware.bus.packets import BusPacket, PacketReader
from armctl.hardware.dynamixel.packets import DynamixelForm, crc

FORM = DynamixelForm()


def frames() -> list[tuple[str, bytes, list[bytes]]]:
    """Meaning, instruction, and the status packets that answer it."""
    rows = (Path(__file__).parent / "frames.tsv").read_text(encoding="utf-8").splitlines()[1:]
    return [
        (what, bytes.fromhex(asked), [bytes.fromhex(one) for one in answers.split("|") if one.strip()])
        for what, asked, answers in csv.reader(rows, delimiter="\t")
    ]


@pytest.mark.parametrize(("what", "asked", "answers"), frames(), ids=[what for what, _, _ in frames()])
def test_the_frames_of_the_manual_are_read_and_made(what: str, asked: bytes, answers: list[bytes]):
    [instruction] = PacketReader(FORM, status=False).feed(asked)
    assert FORM.instruction(instruction) == asked
    told = PacketReader(FORM, status=True).feed(b"".join(answers))
    assert len(told) == len(answers)
    assert [FORM.status(one) for one in told] == answers


def test_what_the_host_asks_is_what_the_manual_prints():
    printed = {what: asked for what, asked, _ in frames()}
    asked = {
        "ping id 1": FORM.ping(1),
        "ping broadcast": FORM.ping(0xFE),
        "read position": FORM.read(1, 132, 4),
        "write goal position 512": FORM.write(1, 116, (512).to_bytes(4, "little")),
        "reboot id 1": FORM.reboot(1),
        "sync read position": FORM.sync_read([1, 2], 132, 4),
        "sync write goals": FORM.sync_write(116, {1: bytes((150, 0, 0, 0)), 2: bytes((170, 0, 0, 0))}),
    }
    for begin, data in asked.items():
        assert [data] == [one for what, one in printed.items() if what.startswith(begin)], begin


def test_an_answer_says_its_position():
    [_, _, answers] = next(row for row in frames() if row[0].startswith("sync read"))
    told = PacketReader(FORM, status=True).feed(b"".join(answers))
    said = [(one.id, one.code, int.from_bytes(one.data, "little")) for one in told]
    assert said == [(1, 0, 166), (2, 0, 2079)]


def test_an_instruction_is_no_answer_and_an_answer_no_instruction():
    assert PacketReader(FORM, status=True).feed(FORM.read(1, 132, 4)) == []
    assert PacketReader(FORM, status=False).feed(FORM.status(BusPacket(1, 0, b"\1\2"))) == []


BODIES = st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x55, 0x8A]), max_size=24).map(bytes)
NOISE = st.lists(st.integers(0, 0xFE), max_size=8).map(bytes)


@given(st.integers(0, 252), st.integers(0, 255), BODIES, NOISE)
def test_whatever_is_inside_comes_out_as_it_was(servo: int, code: int, data: bytes, noise: bytes):
    sent = BusPacket(servo, code, data)
    status, instruction = FORM.status(sent), FORM.instruction(BusPacket(servo, 3, data))
    assert b"\xff\xff\xfd\x00" not in status[4:-2]
    reader = PacketReader(FORM, status=True)
    assert [one for byte in status for one in reader.feed(bytes((byte,)))] == [sent]
    assert PacketReader(FORM, status=False).feed(instruction) == [BusPacket(servo, 3, data)]
    reader = PacketReader(FORM, status=True)
    assert reader.feed(noise + status + FORM.status(BusPacket(7, 0)))[-1] == BusPacket(7, 0)


@given(BODIES, st.data())
def test_a_flipped_bit_is_noticed(data: bytes, draw: st.DataObject):
    status = bytearray(FORM.status(BusPacket(1, 0, data)))
    bit = draw.draw(st.integers(0, 8 * len(status) - 1))
    status[bit // 8] ^= 1 << bit % 8
    assert PacketReader(FORM, status=True).feed(bytes(status)) == []


def test_a_length_that_cannot_be_does_not_keep_the_next_packet_waiting():
    broken = bytes.fromhex("FF FF FD 00 01 FF FF 55")
    reader = PacketReader(FORM, status=True)
    assert reader.feed(broken + FORM.status(BusPacket(1, 0))) == [BusPacket(1, 0)]
    assert reader.spoilt > 0


def test_the_crc_is_that_of_the_manual():
    assert crc(bytes.fromhex("FF FF FD 00 01 07 00 02 84 00 04 00")) == 0x151D

"""Feetech's packets: those that the manual prints, and what is between them on a bad line."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armctl.hardware.bus.packets import BusPacket, PacketReader
from armctl.hardware.bus.plant import ArmPlant, PlantJoint
from armctl.hardware.bus.simulated import Gear, SimulatedBus, Supply
from armctl.hardware.feetech.make import FEETECH
from armctl.hardware.feetech.packets import FeetechForm, checksum
from armctl.hardware.feetech.simulated import SimulatedFeetech, factory_memory

FORM = FeetechForm()
LINES = [
    line.split("\t")
    for line in (Path(__file__).parent / "frames.tsv").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
]
FRAMES = [
    pytest.param(
        bytes.fromhex(asked), [bytes.fromhex(one) for one in said.split("|") if one.strip()], id=what
    )
    for what, asked, said, _ in LINES
]
BUILT = {
    "ping id 1, no error": FORM.ping(1),
    "read 2 bytes at 0x38 (position) of id 1: 0x0518 = 1304": FORM.read(1, 0x38, 2),
    "set id := 1 by broadcast (write 5)": FORM.write(0xFE, 5, b"\x01"),
    "write goal 2048, time 0, speed 1000 to id 1 (0x2A, 6 bytes)": FORM.write(
        1, 0x2A, bytes.fromhex("00080000e803")
    ),
    "action, broadcast": FORM.action(),
    "sync write goal 2048, time 0, speed 1000 to ids 1-4": FORM.sync_write(
        0x2A, dict.fromkeys((1, 2, 3, 4), bytes.fromhex("00080000e803"))
    ),
    "sync read 8 bytes at 0x38 of ids 1, 2": FORM.sync_read((1, 2), 0x38, 8),
    "restart id 1; no answer": FORM.reboot(1),
}


@pytest.mark.parametrize(("asked", "said"), FRAMES)
def test_every_printed_packet_is_one_packet_with_the_right_checksum(asked: bytes, said: list[bytes]):
    for frame in (asked, *said):
        assert frame[-1] == checksum(frame[2:-1])
        (packet,) = PacketReader(FORM, status=True).feed(frame)
        assert FORM.instruction(packet) == frame


def test_what_we_send_are_the_printed_bytes():
    printed = {what: bytes.fromhex(asked) for what, asked, _, _ in LINES}
    assert {what: printed[what].hex(" ") for what in BUILT} == {
        what: frame.hex(" ") for what, frame in BUILT.items()
    }


def bus_of(*ids: int) -> SimulatedBus:
    supply, joints = Supply(), [PlantJoint() for _ in ids]
    servos = [
        SimulatedFeetech(FEETECH, joint, Gear(2048.0, 651.9), supply, factory_memory(id=one))
        for one, joint in zip(ids, joints, strict=True)
    ]
    return SimulatedBus(FORM, servos, ArmPlant(joints), supply)


@pytest.mark.parametrize(
    "what", ["ping id 1, no error", "write goal 2048, time 0, speed 1000 to id 1 (0x2A, 6 bytes)"]
)
def test_a_simulated_servo_answers_with_the_printed_bytes(what: str):
    asked, said = next((asked, said) for name, asked, said, _ in LINES if name == what)
    assert bus_of(1).feed(bytes.fromhex(asked)) == bytes.fromhex(said)


def test_a_simulated_bus_answers_a_sync_read_one_servo_after_the_other():
    bus = bus_of(1, 2)
    answers = PacketReader(FORM, status=True).feed(bus.feed(FORM.sync_read((2, 1), 0x38, 2)))
    assert [one.id for one in answers] == [2, 1]
    assert all(one.data == (2048).to_bytes(2, "little") for one in answers)


PACKETS = st.builds(BusPacket, st.integers(0, 253), st.integers(0, 255), st.binary(max_size=20))


@given(packets=st.lists(PACKETS, max_size=5), noise=st.binary(max_size=9), cut=st.integers(1, 7))
def test_packets_are_found_in_any_pieces_behind_any_noise(packets: list[BusPacket], noise: bytes, cut: int):
    # noise that looks like the head of a packet may swallow what follows; a head of two FF ends it
    noise = noise.replace(b"\xff", b"\xfe")
    data = noise + b"".join(map(FORM.instruction, packets))
    reader = PacketReader(FORM, status=True)
    found = [one for start in range(0, len(data), cut) for one in reader.feed(data[start : start + cut])]
    assert found == packets


@given(packet=PACKETS, bit=st.integers(0, 2**16))
def test_a_packet_with_one_bit_spoilt_is_never_taken(packet: BusPacket, bit: int):
    frame = bytearray(FORM.instruction(packet))
    frame[bit // 8 % len(frame)] ^= 1 << bit % 8
    found = PacketReader(FORM, status=True).feed(bytes(frame))
    assert packet not in found or bytes(frame).count(FORM.instruction(packet)) > 0

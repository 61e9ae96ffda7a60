"""Feetech's packets (communication protocol manual, SCS/SMS/STS)."""

from __future__ import annotations

from armctl.hardware.bus.packets import BusPacket, PacketForm

_BEFORE_LENGTH = 4
"""bytes up to the length: head, id, length"""
_HEAD_BYTE = 0xFF


class FeetechForm(PacketForm):
    """``FF FF id length code data … checksum``; a status has its error byte in the place of the code.

    So the two cannot be told apart, and an adapter that echoes seems to be a servo.
    """

    head = b"\xff\xff"
    word = 1

    def __init__(self, *, sync_reads: bool = True) -> None:
        self.sync_reads = sync_reads

    def instruction(self, packet: BusPacket) -> bytes:
        """The bytes by which a host asks."""
        body = bytes((packet.id, len(packet.data) + 2, packet.code)) + packet.data
        return self.head + body + bytes((checksum(body),))

    status = instruction

    def length(self, begun: bytes) -> int | None:
        """Of the packet that begins so; 0: it is none."""
        if len(begun) < _BEFORE_LENGTH:
            return None
        if _HEAD_BYTE in (begun[2], begun[3]) or begun[3] < 2:  # another head, behind what was cut off
            return 0
        return _BEFORE_LENGTH + begun[3]

    def opened(self, whole: bytes, *, status: bool) -> BusPacket | None:
        """What it holds; None where the checksum does not fit."""
        if checksum(whole[2:-1]) != whole[-1]:
            return None
        return BusPacket(whole[2], whole[4], whole[5:-1])


def checksum(body: bytes) -> int:
    """Of everything between head and checksum."""
    return ~sum(body) & 0xFF

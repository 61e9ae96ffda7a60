"""Packets of ROBOTIS Dynamixel, Protocol 2.0 (ROBOTIS e-Manual, DYNAMIXEL Protocol 2.0)."""

from __future__ import annotations

from armctl.hardware.bus.packets import BusPacket, PacketForm

STATUS = 0x55
"""stands in a status packet where an instruction has its number"""
_BEFORE_LENGTH, _BEFORE_CODE = 5, 7
"""bytes up to the length: head and id; and up to what the length counts"""
_SHORTEST_LENGTH = 3
_LONGEST_LENGTH = 1024
"""A larger length is noise. Without a bound a reader would wait for its end and miss what comes meanwhile."""
_POLYNOMIAL = 0x8005
_HEAD_INSIDE, _STUFFED = b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"


class DynamixelForm(PacketForm):
    """``FF FF FD 00 id length code data … CRC``; what would begin like a head inside is stuffed.

    A status has ``STATUS`` for its code, and then its error, so an echo is never taken for an answer.
    """

    head = b"\xff\xff\xfd\x00"
    word = 2

    def instruction(self, packet: BusPacket) -> bytes:
        """The bytes by which a host asks."""
        return self._packed(packet.id, bytes((packet.code,)) + packet.data)

    def status(self, packet: BusPacket) -> bytes:
        """The bytes by which a servo answers."""
        return self._packed(packet.id, bytes((STATUS, packet.code)) + packet.data)

    def length(self, begun: bytes) -> int | None:
        """Of the packet that begins so; 0: it is none."""
        if len(begun) < _BEFORE_CODE:
            return None
        length = int.from_bytes(begun[_BEFORE_LENGTH:_BEFORE_CODE], "little")
        return _BEFORE_CODE + length if _SHORTEST_LENGTH <= length <= _LONGEST_LENGTH else 0

    def opened(self, whole: bytes, *, status: bool) -> BusPacket | None:
        """What it holds; None where the CRC does not fit, or it is of the other kind."""
        if crc(whole[:-2]) != int.from_bytes(whole[-2:], "little"):
            return None
        body = whole[_BEFORE_CODE:-2].replace(_STUFFED, _HEAD_INSIDE)
        if status != (body[0] == STATUS) or len(body) < 1 + status:
            return None
        return BusPacket(whole[4], body[int(status)], body[1 + status :])

    def _packed(self, servo: int, body: bytes) -> bytes:
        body = body.replace(_HEAD_INSIDE, _STUFFED)
        packet = self.head + bytes((servo,)) + (len(body) + 2).to_bytes(2, "little") + body
        return packet + crc(packet).to_bytes(2, "little")


def _crc_of(byte: int) -> int:
    register = byte << 8
    for _ in range(8):
        register = register << 1 ^ (_POLYNOMIAL if register & 0x8000 else 0)
    return register & 0xFFFF


_CRC = tuple(map(_crc_of, range(256)))
"""by the upper byte: 300 bytes a tick take 0.1 ms, and 1.1 ms bit by bit"""


def crc(data: bytes) -> int:
    """CRC-16 over the bytes of a packet before it; polynomial 0x8005, begins with 0."""
    register = 0
    for byte in data:
        register = register << 8 & 0xFFFF ^ _CRC[register >> 8 ^ byte]
    return register

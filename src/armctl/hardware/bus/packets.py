"""Packets on a servo bus: what both makes have in common, and what a make says of its own form.

A host sends instructions; the servo that is meant answers with a status, or none does. Both makes have the
same instructions under the same numbers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from enum import IntEnum

from armctl.lazy_dataclass import dataclass

BROADCAST = 0xFE
"""the id that all servos listen to"""


class Instruction(IntEnum):
    """What a host may ask."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83


@dataclass(frozen=True, slots=True)
class BusPacket:
    """One packet. Of a host ``code`` is the instruction, of a servo its error byte."""

    id: int
    code: int
    data: bytes = b""


class PacketForm(ABC):
    """How a make puts packets on the line."""

    head: bytes
    """how each begins"""
    sync_reads = True
    """whether several servos can be asked for the same at once"""
    word: int
    """bytes of an address, and of a size, in an instruction"""

    @abstractmethod
    def instruction(self, packet: BusPacket) -> bytes:
        """The bytes by which a host asks."""

    @abstractmethod
    def status(self, packet: BusPacket) -> bytes:
        """The bytes by which a servo answers."""

    @abstractmethod
    def length(self, begun: bytes) -> int | None:
        """How long the packet is that begins so, with ``head``; None: too little to tell; 0: it is none."""

    @abstractmethod
    def opened(self, whole: bytes, *, status: bool) -> BusPacket | None:
        """What a whole packet holds; None: it is spoilt, or an instruction where a status is meant."""

    def number(self, value: int) -> bytes:
        """An address or a size."""
        return value.to_bytes(self.word, "little")

    def ping(self, servo: int) -> bytes:
        """Ask who is there."""
        return self.instruction(BusPacket(servo, Instruction.PING))

    def read(self, servo: int, address: int, size: int) -> bytes:
        """Ask for ``size`` bytes from ``address`` on."""
        return self.instruction(BusPacket(servo, Instruction.READ, self.number(address) + self.number(size)))

    def write(self, servo: int, address: int, data: bytes) -> bytes:
        """Write ``data`` from ``address`` on."""
        return self.instruction(BusPacket(servo, Instruction.WRITE, self.number(address) + data))

    def sync_read(self, servos: Sequence[int], address: int, size: int) -> bytes:
        """Ask several servos for the same; they answer one after the other."""
        data = self.number(address) + self.number(size) + bytes(servos)
        return self.instruction(BusPacket(BROADCAST, Instruction.SYNC_READ, data))

    def sync_write(self, address: int, rows: Mapping[int, bytes]) -> bytes:
        """Write a row of the same length to each of several servos; none answers."""
        size = len(next(iter(rows.values()), b""))
        data = b"".join(bytes((servo,)) + row for servo, row in rows.items())
        packet = BusPacket(BROADCAST, Instruction.SYNC_WRITE, self.number(address) + self.number(size) + data)
        return self.instruction(packet)

    def action(self) -> bytes:
        """Let all servos do what REG_WRITE has put off."""
        return self.instruction(BusPacket(BROADCAST, Instruction.ACTION))

    def reboot(self, servo: int) -> bytes:
        """Let a servo start anew."""
        return self.instruction(BusPacket(servo, Instruction.REBOOT))

    def asked_size(self, instruction: BusPacket) -> tuple[int, int]:
        """Address and size of a READ or SYNC_READ."""
        address = int.from_bytes(instruction.data[: self.word], "little")
        return address, int.from_bytes(instruction.data[self.word : 2 * self.word], "little")


class PacketReader:
    """Finds packets in bytes that come in any pieces, with rubbish between them."""

    def __init__(self, form: PacketForm, *, status: bool) -> None:
        """``status``: a host that listens to servos; else a servo that listens to hosts."""
        self._form, self._status = form, status
        self._kept = bytearray()
        self.spoilt = 0
        """packets and pieces of them that made no sense"""

    def feed(self, data: bytes) -> list[BusPacket]:
        """The packets that are whole by now."""
        self._kept += data
        found: list[BusPacket] = []
        while (packet := self._next()) is not None:
            found.append(packet)
        return found

    def clear(self) -> None:
        """Forget what has begun."""
        self._kept.clear()

    @property
    def begun(self) -> bool:
        """Whether the beginning of a packet has come."""
        return bool(self._kept)

    def _next(self) -> BusPacket | None:
        form, kept = self._form, self._kept
        while kept:
            place = kept.find(form.head)
            if place < 0:  # the last bytes may be the beginning of a head
                keep = next(
                    n
                    for n in range(min(len(form.head) - 1, len(kept)), -1, -1)
                    if form.head.startswith(kept[len(kept) - n :])
                )
                self._drop(len(kept) - keep)
                return None
            self._drop(place)
            size = form.length(bytes(kept))
            if size is None:
                return None
            if size and len(kept) < size:
                return None
            packet = form.opened(bytes(kept[:size]), status=self._status) if size else None
            if packet is not None:
                del kept[:size]
                return packet
            self._drop(1)  # a packet may begin inside of what looked like one
        return None

    def _drop(self, count: int) -> None:
        if count:
            self.spoilt += 1
            del self._kept[:count]

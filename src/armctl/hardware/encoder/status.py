"""The status line: what the board says 50 times a second of itself and its axes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from armctl.errors import BoardProtocolError
from armctl.hardware.encoder.axis_fault import BoardFlag, FaultKind

_ALL_FAULTS = sum(FaultKind)
_ALL_FLAGS = sum(BoardFlag)


class Mode(Enum):
    """What the motors do."""

    OFF = "O"
    ON = "N"
    HOMING = "H"
    HELD = "B"
    TRIPPED = "T"

    @property
    def powered(self) -> bool:
        """Whether the motors are on."""
        return self in (Mode.ON, Mode.HOMING, Mode.HELD)


@dataclass(frozen=True, slots=True)
class Status:
    """One status line. Tuples go by axis number."""

    time_ms: int
    """since the board started; starts again at 0 after 49.7 days"""
    mode: Mode
    homed: tuple[bool, ...]
    switches: tuple[bool, ...]
    """home switches that are closed"""
    flags: BoardFlag
    faults: tuple[FaultKind, ...]
    counts: tuple[int, ...]
    """joint counts"""

    @property
    def latched(self) -> bool:
        """Whether there are flags or faults that CLR clears."""
        return bool(self.flags) or any(self.faults) or self.mode is Mode.TRIPPED

    def encode(self) -> str:
        """The fields as the board sends them, without the ``@``."""
        faults = "".join(f"{fault:02x}" for fault in self.faults)
        return (
            f"{self.time_ms} {self.mode.value} {_bits(self.homed):02x} {_bits(self.switches):02x} "
            f"{self.flags:02x} {faults} {' '.join(map(str, self.counts))}"
        )


def decode_status(text: str) -> Status:
    """The status in ``text``, the fields without the ``@``.

    Raises:
        BoardProtocolError: no status that the firmware can send.
    """
    fields = text.split(" ")
    try:
        time_ms, mode, homed, switches, flags, faults, *counts = fields
        bits = bytes.fromhex(faults)
        if not counts or len(bits) != len(counts):
            raise ValueError("as many faults as counts, and at least one")
        return Status(
            time_ms=int(time_ms),
            mode=Mode(mode),
            homed=_flags(homed, len(counts)),
            switches=_flags(switches, len(counts)),
            flags=BoardFlag(_known(int(flags, 16), _ALL_FLAGS)),
            faults=tuple(FaultKind(_known(one, _ALL_FAULTS)) for one in bits),
            counts=tuple(map(int, counts)),
        )
    except ValueError as error:
        raise BoardProtocolError(
            f"{text!r} is no status of an armctl encoder board ({error}); its firmware is another one"
        ) from error


def _bits(flags: tuple[bool, ...]) -> int:
    return sum(flag << axis for axis, flag in enumerate(flags))


def _flags(text: str, count: int) -> tuple[bool, ...]:
    bits = _known(int(text, 16), (1 << count) - 1)
    return tuple(bool(bits >> axis & 1) for axis in range(count))


def _known(bits: int, all_known: int) -> int:
    if bits & ~all_known:
        raise ValueError(f"bits {bits:#x} where only {all_known:#x} are known")
    return bits

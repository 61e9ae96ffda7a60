"""The board's error register in words."""

from __future__ import annotations

from enum import IntFlag


class MaestroErrors(IntFlag):
    """Error bits of Get Errors (Pololu guide 0J40, section 4.e)."""

    SERIAL_SIGNAL = 1 << 0
    SERIAL_OVERRUN = 1 << 1
    SERIAL_BUFFER_FULL = 1 << 2
    SERIAL_CRC = 1 << 3
    SERIAL_PROTOCOL = 1 << 4
    SERIAL_TIMEOUT = 1 << 5
    SCRIPT_STACK = 1 << 6
    SCRIPT_CALL_STACK = 1 << 7
    SCRIPT_PROGRAM_COUNTER = 1 << 8


ALL_ERRORS = 0x01FF

_WORDS: dict[MaestroErrors, str] = {
    MaestroErrors.SERIAL_SIGNAL: "serial signal error: wrong baud rate or noise on the TTL line",
    MaestroErrors.SERIAL_OVERRUN: "serial overrun: bytes came faster than the board's UART takes them",
    MaestroErrors.SERIAL_BUFFER_FULL: "serial buffer full: the board lost bytes",
    MaestroErrors.SERIAL_CRC: "serial CRC error: a damaged command, or only one side has CRC switched on",
    MaestroErrors.SERIAL_PROTOCOL: "serial protocol error: the board got an unknown command or half of one",
    MaestroErrors.SERIAL_TIMEOUT: "serial timeout: the board heard nothing for too long and went to its home",
    MaestroErrors.SCRIPT_STACK: "script stack error in the board's own script",
    MaestroErrors.SCRIPT_CALL_STACK: "script call stack error in the board's own script",
    MaestroErrors.SCRIPT_PROGRAM_COUNTER: "script program counter error in the board's own script",
}


def error_words(errors: MaestroErrors) -> tuple[str, ...]:
    """One phrase for each bit that is set, lowest bit first."""
    return tuple(words for bit, words in _WORDS.items() if bit in errors)

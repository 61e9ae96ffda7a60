"""A simulated AVR running a real firmware image, stepped by whoever holds it.

Everything happens in simulated time: the same calls give the same bytes and the same edges, to the
cycle. A CPU that crashes raises, so a test that only steps it fails.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from tests.avr.building import library

_MCU = "atmega2560"
_ROOM = 1 << 16
_RESULTS = {
    1: "the simulated CPU crashed",
    2: "the firmware switched its CPU off for good",
    3: "more bytes or edges came than the simulator holds; fetch them more often",
}


class AvrError(RuntimeError):
    """The simulated CPU crashed, or cannot be had."""


class Edge(NamedTuple):
    """A pin's change of level."""

    cycle: int
    pin: str
    level: int


class _Edge(ctypes.Structure):
    _fields_ = (
        ("cycle", ctypes.c_uint64),
        ("pin", ctypes.c_uint8),
        ("level", ctypes.c_uint8),
        ("unused", ctypes.c_uint8 * 6),
    )


class Avr:
    """One simulated CPU with its image loaded, at its reset.

    Pins are named by port and bit (``"H6"``); ``mega.PINS[9]`` is the one of an Arduino's pin 9. ``image`` is
    an Intel hex file; ``AvrError`` where simavr cannot load it.
    """

    clock_hz = 16_000_000

    def __init__(self, image: Path) -> None:
        self.image = image
        self._shim = _load()
        self._bytes = ctypes.create_string_buffer(_ROOM)
        self._edges = (_Edge * _ROOM)()
        self._handle = self._shim.sim_new(_MCU.encode(), self.clock_hz, str(image).encode())
        if not self._handle:
            raise AvrError(f"{image}: not a hex file that fits an {_MCU}, or simavr has no {_MCU}")

    @property
    def handle(self) -> int:
        """The simulator in the shim (``sim_t *``), for other C code that joins it."""
        return self._handle

    @property
    def cycle(self) -> int:
        """Clock cycles since the reset at the start."""
        return self._shim.sim_cycle(self._handle)

    @property
    def now(self) -> float:
        """Simulated time [s]."""
        return self.cycle / self.clock_hz

    def cycles(self, seconds: float) -> int:
        """How many clock cycles a time has."""
        return round(seconds * self.clock_hz)

    def run_until(self, cycle: int) -> None:
        """Run up to a cycle, or the few past it that the last instruction takes.

        ``AvrError`` where the CPU crashes, or a buffer overflows.
        """
        result = self._shim.sim_run(self._handle, cycle)
        if result:
            raise AvrError(
                f"{self.image.name}: {_RESULTS[result]} at {self.now:.6f} s, "
                f"program counter 0x{self._shim.sim_program_counter(self._handle):x}"
                f"{self._log()}"
            )

    def run_for(self, seconds: float) -> None:
        """Run on for a time, like ``run_until``."""
        self.run_until(self.cycle + self.cycles(seconds))

    def write(self, data: bytes, *, damaged: bool = False) -> None:
        """Put bytes on the serial line; the firmware gets them one by one at its baud rate.

        Damaged ones have no stop bit, as on a line with noise: the CPU reports a framing error.
        """
        if self._shim.sim_write(self._handle, data, len(data), damaged):
            raise AvrError(f"{self.image.name}: {_RESULTS[3]}")

    def read(self) -> bytes:
        """What the firmware has sent since the last call."""
        data = b""
        while count := self._shim.sim_read(self._handle, self._bytes, _ROOM):
            data += self._bytes.raw[:count]
        return data

    def watch(self, *pins: str) -> None:
        """Record the edges of these pins from now on."""
        for pin in pins:
            self._shim.sim_watch(self._handle, _NUMBERS[pin], 1)

    def edges(self) -> list[Edge]:
        """The watched pins' edges since the last call, in order; not those made by ``set_pin``."""
        found: list[Edge] = []
        while count := self._shim.sim_edges(self._handle, self._edges, _ROOM):
            found += [Edge(edge.cycle, _PINS[edge.pin], edge.level) for edge in self._edges[:count]]
        return found

    def set_pin(self, pin: str, level: int) -> None:
        """Hold a pin at a level from outside, from now on."""
        self._shim.sim_set_pin(self._handle, _NUMBERS[pin], int(bool(level)))

    def schedule(self, changes: Iterable[Edge]) -> None:
        """Set pins from outside at given cycles, while ``run_until`` passes them.

        Much faster than to stop at each; the cycles must not fall, over all calls.
        """
        records = [_Edge(edge.cycle, _NUMBERS[edge.pin], edge.level) for edge in changes]
        if self._shim.sim_schedule(self._handle, (_Edge * len(records))(*records), len(records)):
            raise AvrError(f"{self.image.name}: {_RESULTS[3]}")

    def pin(self, pin: str) -> int:
        """The level of a pin, whoever drives it."""
        return self._shim.sim_pin(self._handle, _NUMBERS[pin])

    def data(self, address: int) -> int:
        """A byte of the data space: register or RAM, by its data address (the datasheet's in brackets)."""
        value = self._shim.sim_data(self._handle, address)
        if value < 0:
            raise AvrError(f"data address 0x{address:x} is beyond the RAM")
        return value

    def set_data(self, address: int, value: int) -> None:
        """Change a byte of the data space behind the firmware's back."""
        self._shim.sim_set_data(self._handle, address, value)

    def reset(self) -> None:
        """Press the reset button. Time goes on; RAM stays."""
        self._shim.sim_reset(self._handle)

    def close(self) -> None:
        """Give the memory back; safe to call twice."""
        if self._handle:
            self._shim.sim_free(self._handle)
            self._handle = None

    def _log(self) -> str:
        log = self._shim.sim_log(self._handle).decode(errors="replace").strip()
        return f"; simavr says: {log}" if log else ""


_PINS = [f"{port}{bit}" for port in "ABCDEFGHIJKL" for bit in range(8)]
_NUMBERS = {pin: number for number, pin in enumerate(_PINS)}


def _load() -> ctypes.CDLL:
    shim = ctypes.CDLL(str(library("shim")))
    handle, text, edges = ctypes.c_void_p, ctypes.c_char_p, ctypes.POINTER(_Edge)
    pin = number = ctypes.c_int
    u32, u64 = ctypes.c_uint32, ctypes.c_uint64
    for name, result, arguments in (
        ("sim_new", handle, (text, u32, text)),
        ("sim_free", None, (handle,)),
        ("sim_run", number, (handle, u64)),
        ("sim_cycle", u64, (handle,)),
        ("sim_log", text, (handle,)),
        ("sim_program_counter", u32, (handle,)),
        ("sim_write", number, (handle, text, u32, number)),
        ("sim_read", u32, (handle, text, u32)),
        ("sim_watch", None, (handle, pin, number)),
        ("sim_edges", u32, (handle, edges, u32)),
        ("sim_schedule", number, (handle, edges, u32)),
        ("sim_set_pin", None, (handle, pin, number)),
        ("sim_pin", number, (handle, pin)),
        ("sim_data", number, (handle, u32)),
        ("sim_set_data", None, (handle, u32, ctypes.c_uint8)),
        ("sim_reset", None, (handle,)),
    ):
        function = getattr(shim, name)
        function.restype, function.argtypes = result, arguments
    return shim

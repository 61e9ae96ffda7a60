"""The real encoder firmware with an arm on its pins and a host on its line, for tests.

The host here is written against firmware/README.md alone, so that it does not share a mistake with
armctl's own driver.
"""

from __future__ import annotations

import binascii
from collections.abc import Callable
from dataclasses import dataclass, field

from tests.avr.avr import Avr
from tests.avr.plant import AXES, Plant

TICK_S = 0.001


def sealed(text: str) -> bytes:
    """A line with its CRC and its end."""
    body = text.encode("latin-1")
    return b"%s*%04X\n" % (body, binascii.crc_hqx(body, 0xFFFF))


@dataclass(frozen=True)
class Status:
    """A status line."""

    ms: int
    mode: str
    homed: int
    switches: int
    flags: int
    faults: tuple[int, ...]
    lost: tuple[int, ...]
    changes: tuple[int, ...]
    """of pins 42 ... 49, modulo 16"""
    counts: tuple[int, ...]

    @classmethod
    def of(cls, fields: str) -> Status:
        """Read the fields behind ``@``."""
        ms, mode, homed, switches, flags, faults, lost, changes, *counts = fields.split()
        return cls(
            ms=int(ms),
            mode=mode,
            homed=int(homed, 16),
            switches=int(switches, 16),
            flags=int(flags, 16),
            faults=tuple(bytes.fromhex(faults)),
            lost=tuple(int(digit, 16) for digit in lost),
            changes=tuple(int(digit, 16) for digit in changes),
            counts=tuple(map(int, counts)),
        )


@dataclass
class EncoderArm:
    """Firmware, arm and host."""

    avr: Avr
    plant: Plant
    status: list[Status] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    answers: list[str] = field(default_factory=list)
    banners: list[str] = field(default_factory=list)
    seq: int = 0
    _rest: bytes = b""

    def run(self, seconds: float) -> None:
        """Let time pass, and take what the board sends."""
        self.avr.run_for(seconds)
        self._rest += self.avr.read()
        *lines, self._rest = self._rest.split(b"\n")
        for line in lines:
            self._take(line)

    def _take(self, line: bytes) -> None:
        text, star, _ = line.decode("ascii").rpartition("*")
        assert star and sealed(text) == line + b"\n", f"damaged line from the board: {line!r}"
        kind, _, rest = text.partition(" ")
        if kind == "@":
            self.status.append(Status.of(rest))
        elif kind == "!":
            self.events.append(rest)
        elif kind == "#":
            self.banners.append(rest)
        else:
            self.answers.append(text)

    def run_until(self, condition: Callable[[], bool], seconds: float, *, ping_s: float = 0.1) -> None:
        """Let time pass until something is so, keeping the board's watchdog quiet."""
        end = self.avr.now + seconds
        next_ping = self.avr.now
        while not condition():
            assert self.avr.now < end, f"not in {seconds} s; {self.events[-5:]} {self.status[-1:]}"
            if self.avr.now >= next_ping:
                self.post("PING")
                next_ping += ping_s
            self.run(0.005)

    def post(self, command: str) -> bytes:
        """Send a command and do not wait for its answer; returns the line."""
        self.seq = self.seq % 65535 + 1
        line = sealed(f"{self.seq} {command}")
        self.avr.write(line)
        return line

    def ask(self, command: str) -> str:
        """Send a command and wait for its answer, which is returned without its number."""
        self.post(command)
        mine = f"{self.seq} "
        for _ in range(100):
            self.run(TICK_S)
            if self.answers and self.answers[-1].startswith(mine):
                return self.answers[-1].removeprefix(mine)
        raise AssertionError(f"no answer to {command!r}; last: {self.answers[-3:]}")

    def boot(self) -> None:
        """Wait for the banner."""
        seen = len(self.banners)
        for _ in range(100):
            self.run(TICK_S)
            if len(self.banners) > seen:
                return
        raise AssertionError("no banner in 0.1 s")

    def reset(self) -> None:
        """Press the reset button; the line that was on its way is lost."""
        self.avr.reset()
        self.avr.read()
        self._rest = b""
        self.boot()

    def home(self) -> None:
        """Home all axes."""
        assert self.ask("HOME") == "ok"
        self.run_until(lambda: "home done" in self.events, 90)

    def now(self) -> Status:
        """The status as it is now."""
        return Status.of(self.ask("GET").removeprefix("ok "))

    def setpoints(self, counts: list[int] | tuple[int, ...], ms: int = 20) -> str:
        """A P command's text."""
        assert len(counts) == AXES
        return f"P {' '.join(map(str, counts))} {ms}"

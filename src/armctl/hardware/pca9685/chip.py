"""The line to one chip: over an I²C bus of this computer, or behind an Arduino with StandardFirmata."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from armctl.errors import BoardProtocolError, BoardTimeoutError
from armctl.facts import Unanswered
from armctl.hardware.firmata import BYTE_S, HOW_TO_LOAD, codec
from armctl.hardware.firmata.codec import BoardText, I2cReply, Malformed, PinMode
from armctl.hardware.firmata.line import FirmataLine
from armctl.hardware.pca9685 import ALL_CHIPS, HIGHEST_ADDRESS, LOWEST_ADDRESS, SCHEME
from armctl.hardware.pca9685.i2c import ACKNOWLEDGED, TAGS, bus_and_address, is_bus, request
from armctl.hardware.pca9685.registers import IDENTIFYING, check_chip, transfers
from armctl.hardware.transport import Transport

WIRES = "the chip's supply (VCC), and the wires SDA, SCL and GND"
_ATTEMPTS = 3
_RESTARTED = (
    "the Arduino has restarted (reset button, or its supply broke down). The PCA9685 may have lost its "
    "power, too: then its pulses are off and the arm has dropped; check the supply, then connect again"
)


class ChipLine(Protocol):
    """What a driver needs of a line to a chip. Every method may raise ``BoardError`` when it is gone."""

    name: str
    """the port as the user named it"""
    address: int
    most_written: int
    most_read: int
    """bytes of registers that one transfer carries"""
    answers_at_once: bool
    """else an answer takes most of a tick, and is fetched at the next"""

    def write(self, register: int, data: bytes) -> bool:
        """Write registers in one transfer; False: nobody took it. Where that is not told: True."""
        ...

    def ask(self, register: int | None, count: int, address: int | None = None) -> None:
        """Ask for registers; what was asked before is forgotten. None: wherever the chip has its pointer."""
        ...

    def answer(self, wait_s: float) -> bytes | None:
        """The registers asked for; empty: nobody acknowledged; None: nothing has come within ``wait_s``."""
        ...


class I2cLine:
    """A chip on an I²C bus of this computer."""

    most_written = most_read = 64
    answers_at_once = True

    def __init__(self, transport: Transport, address: int, timeout_s: float) -> None:
        self.name, self.address = transport.name, address
        self._transport, self._timeout_s = transport, timeout_s
        self._tag = self._count = 0

    def write(self, register: int, data: bytes) -> bool:
        """Write registers, once more where that fails."""
        for _ in range(2):
            self._start(self.address, bytes((register,)) + data, 0)
            if self._outcome(self._timeout_s) == bytes((ACKNOWLEDGED,)):
                return True
        return False

    def ask(self, register: int | None, count: int, address: int | None = None) -> None:
        """Carry out a transfer that reads."""
        start = b"" if register is None else bytes((register,))
        self._start(self.address if address is None else address, start, count)

    def answer(self, wait_s: float) -> bytes | None:
        """What was read."""
        found = self._outcome(wait_s)
        if found is None:
            return None
        return found[1:] if found[0] == ACKNOWLEDGED and len(found) == 1 + self._count else b""

    def _start(self, address: int, data: bytes, count: int) -> None:
        self._transport.discard_input()
        self._tag, self._count = (self._tag + 1) % TAGS, count
        self._transport.write(request(self._tag, address, data, count))

    def _outcome(self, wait_s: float) -> bytes | None:
        """What became of the transfer, and what was read; None: nothing has come, or a late answer."""
        found = self._transport.read(2 + self._count, wait_s)
        return found[1:] if len(found) > 1 and found[0] == self._tag else None


class ArduinoLine:
    """A chip on the I²C pins of an Arduino with StandardFirmata.

    A write is not answered. The sketch reads 30 bytes at once, and drops a message of more than 32 (seen on
    the image of version 2.3), which are 14 of a transfer.
    """

    most_written, most_read = 12, 28
    answers_at_once = False

    def __init__(
        self, transport: Transport, address: int, now: Callable[[], float], ask_after_s: float
    ) -> None:
        """Wait until the sketch answers, and give it its I²C pins."""
        self.name, self.address = transport.name, address
        self._firmata = FirmataLine(transport, now, _RESTARTED)
        identity = self._firmata.identify(ask_after_s)
        self.firmware = identity.firmware
        self._asked = (address, 0, 0)
        self._refused = False
        if not identity.capabilities.pins_with(PinMode.I2C):
            raise BoardProtocolError(
                f"{self.name}: the sketch {self.firmware.name or 'there'} has no I²C pins; {HOW_TO_LOAD}"
            )
        self._firmata.send(codec.I2C_START)

    def write(self, register: int, data: bytes) -> bool:
        """Send one transfer; whether the chip took it shows when it is read."""
        self._firmata.send(codec.i2c_write(self.address, bytes((register,)) + data))
        return True

    def ask(self, register: int | None, count: int, address: int | None = None) -> None:
        """Send the question."""
        self.answer(0.0)  # a late answer to an earlier question
        self._asked, self._refused = (
            (self.address if address is None else address, register or 0, count),
            False,
        )
        self._firmata.send(codec.i2c_read(self._asked[0], register, count))

    def seconds(self, pulses: Mapping[int, bytes]) -> float:
        """How long the line takes [s] to carry these registers by channel, and a question."""
        messages = [
            codec.i2c_write(self.address, bytes((register,)) + data)
            for register, data in transfers(pulses, self.most_written)
        ]
        return BYTE_S * len(b"".join(messages) + codec.i2c_read(self.address, 0, self.most_read))

    def answer(self, wait_s: float) -> bytes | None:
        """Look through what has come; the last answer that fits."""
        found: bytes | None = None
        for reply in self._firmata.listen(wait_s) if wait_s else self._firmata.receive():
            if isinstance(reply, BoardText):  # older sketches send an old answer behind it
                self._refused = True
            elif isinstance(reply, Malformed):
                found = b""
            elif (
                isinstance(reply, I2cReply)
                and (reply.address, reply.register, len(reply.data)) == self._asked
            ):
                found, self._refused = b"" if self._refused else reply.data, False
            elif isinstance(reply, I2cReply) and self._refused:
                found, self._refused = b"", False
            if found is not None and wait_s:
                return found
        return found


def open_chip(
    transport: Transport, address: int, now: Callable[[], float], timeout_s: float, ask_after_s: float
) -> ChipLine:
    """The line to a chip at ``address``, unless the port says another; the port says which way, too."""
    if not is_bus(transport.name):
        return ArduinoLine(transport, address, now, ask_after_s)
    _, named = bus_and_address(transport.name)
    return I2cLine(transport, address if named is None else named, timeout_s)


def fetch(line: ChipLine, register: int, count: int, wait_s: float) -> bytes:
    """Registers, asked for a few times; ``BoardTimeoutError`` where no good answer comes."""
    answer: bytes | None = None
    for _ in range(_ATTEMPTS):
        line.ask(register, count)
        if answer := line.answer(wait_s):
            return answer
    raise unanswered(line, answer)


def unanswered(line: ChipLine, answer: bytes | None) -> BoardTimeoutError:
    """The error of a chip that does not acknowledge (``answer`` is empty), or of a line that is silent."""
    if answer is None:
        return BoardTimeoutError(Unanswered(f"{line.name}: no answer", f"the cable; then {WIRES}"))
    return BoardTimeoutError(
        Unanswered(f"{line.name}: the chip at {line.address:#x} does not acknowledge", WIRES)
    )


def identify(line: ChipLine, wait_s: float) -> dict[int, int]:
    """The registers that tell a PCA9685, one by one: it may not count them up yet. Changes nothing.

    ``BoardTimeoutError`` names who does answer on the bus; ``BoardProtocolError``: another chip answers.
    """
    try:
        found = {register: fetch(line, register, 1, wait_s)[0] for register in IDENTIFYING}
    except BoardTimeoutError as error:
        others = who_answers(line, wait_s)
        raise BoardTimeoutError(
            f"{line.name}: nothing answers at {line.address:#x}; {_advice(line, others)}"
        ) from error
    check_chip(f"{line.name}, address {line.address:#x}", found)
    return found


def who_answers(line: ChipLine, wait_s: float) -> list[int]:
    """The addresses, of those that a PCA9685 may have, at which somebody answers. Writes nothing.

    Ends at the first one where not even the line answers.
    """
    found: list[int] = []
    for address in range(LOWEST_ADDRESS, HIGHEST_ADDRESS + 1):
        line.ask(None, 1, address)
        answer = line.answer(wait_s)
        if answer is None:
            break
        if answer and address != ALL_CHIPS:
            found.append(address)
    return found


def _advice(line: ChipLine, others: Sequence[int]) -> str:
    if line.address in others:
        return f"now and then it does: check {WIRES}"
    if not others:
        return f"nor at any other address of a PCA9685: check {WIRES}"
    there = ", ".join(f"{one:#x}" for one in others)
    how = (
        f"as in {SCHEME}://{bus_and_address(line.name)[0]}/{others[0]:#x}"
        if is_bus(line.name)
        else f"in the robot file: address = {others[0]:#x} in [board]"
    )
    return f"on this bus {there} does: say that address, {how}; its solder bridges set it"

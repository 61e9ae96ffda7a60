"""The half-duplex line of a servo bus: one asks, who is asked answers; what is lost is asked again."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from armctl.errors import BoardTimeoutError
from armctl.facts.servos import ServoSilent
from armctl.hardware.bus.packets import BROADCAST, BusPacket, PacketForm, PacketReader
from armctl.hardware.transport import Transport
from armctl.lazy_dataclass import dataclass

ATTEMPTS = 3
"""how often a question to one servo is put"""
_CHUNK = 4096
_BITS_OF_A_BYTE, _INTRODUCTION = 10, 4
_PACKETS = 2
_STEP_S = 0.002
_NO_ECHO = 64
"""bytes after which a line that goes on talking does not echo"""
_ECHO_READ = 4
"""Bytes that are read to see whether the adapter echoes: a question for so many has another length than
its answer, while an echoed ping, or an echoed question for two bytes, is the answer of a servo in trouble."""


@dataclass(slots=True)
class LineCount:
    """What became of the questions since somebody took the count."""

    asked: int = 0
    """packets: a question and an answer are two, of which the loss of either loses the answer"""
    lost: int = 0
    slowest_s: float = 0.0
    """the longest that an answer took"""


class BusLine:
    """Carries packets over an open line. ``timeout_s``: how long the slowest answer may take.

    A late answer to an earlier question looks like one to the present question. So what has come is thrown
    away before each question, answers of another length than that which was asked for do not count, and a
    question that is repeated asks for another number of bytes where that is possible.
    """

    def __init__(
        self,
        transport: Transport,
        form: PacketForm,
        now: Callable[[], float],
        timeout_s: float,
        baud: int = 1_000_000,
    ) -> None:
        """``timeout_s``: how long an answer may take beside its bytes, which take theirs at ``baud``."""
        self.form, self.timeout_s, self._byte_s = form, timeout_s, _BITS_OF_A_BYTE / baud
        self._transport, self._now = transport, now
        self._status_bytes = len(form.status(BusPacket(0, 0)))
        self._reader = PacketReader(form, status=True)
        self.echoes = False
        """whether the adapter sends back what it is sent"""
        self.count = LineCount()

    @property
    def name(self) -> str:
        """The line as the user named it."""
        return self._transport.name

    def close(self) -> None:
        """Give the line up. Never raises."""
        self._transport.close()

    def take_count(self) -> LineCount:
        """What was counted since this was called last."""
        count, self.count = self.count, LineCount()
        return count

    def pause(self, seconds: float) -> None:
        """Let time pass on the line; what comes meanwhile is thrown away."""
        self._transport.read(_CHUNK, seconds)

    def tell(self, data: bytes) -> None:
        """Send what nobody answers."""
        self._transport.write(data)

    def exchange(
        self, request: bytes, servos: Sequence[int], size: int | None, timeout_s: float | None = None
    ) -> dict[int, BusPacket]:
        """Ask, and take the answers of ``servos`` that have ``size`` bytes (None: any), by id.

        Those that did not come within ``timeout_s`` are missing.
        """
        self._transport.discard_input()
        self._reader.clear()
        asked_at = self._now()
        self._transport.write(request)
        echo = bytearray(request) if self.echoes else bytearray()
        answers: dict[int, BusPacket] = {}
        silent_s, limit_s = 0.0, self.timeout_s if timeout_s is None else timeout_s
        due = len(echo) + len(servos) * (self._status_bytes + (size or 0))  # at the least
        longest = due + (_INTRODUCTION * len(servos) if size is None else 0)
        limit_s += self._byte_s * (len(request) + longest)
        while servos[-1] not in answers:  # they answer in their order: who is before the last is lost then
            left = min(asked_at + limit_s - self._now(), limit_s - silent_s)
            if left <= 0.0:
                break
            data = self._transport.read(max(1, due), min(_STEP_S, left))  # at once: each read costs
            if not data:  # counted as well as timed: the clock of a simulation may stand still
                silent_s += min(_STEP_S, left)
                continue
            data += self._transport.read(_CHUNK, 0.0)
            due -= len(data)
            for packet in self._reader.feed(_without_echo(data, echo)):
                if self.echoes and self.form.instruction(packet) == request:  # an echo behind a late answer
                    continue
                if packet.id in servos and packet.id not in answers and size in (None, len(packet.data)):
                    answers[packet.id] = packet
        took = self._now() - asked_at
        count = self.count
        count.asked += _PACKETS * len(servos)
        count.lost += len(servos) - len(answers)
        count.slowest_s = max(count.slowest_s, took)
        return answers

    def ping(self, servo: int, attempts: int = ATTEMPTS, timeout_s: float | None = None) -> BusPacket | None:
        """What a servo says to a ping; None: it does not answer."""
        for _ in range(attempts):
            answers = self.exchange(self.form.ping(servo), [servo], None, timeout_s)
            if (answer := answers.get(servo)) is not None:
                return answer
        return None

    def read(self, servo: int, address: int, size: int, *, more: bool = False) -> BusPacket:
        """``size`` bytes of a servo's table; ``BoardTimeoutError`` where it does not answer.

        ``more``: a repeated question asks for a byte more each time, so that a late answer to an earlier
        one is not taken for it. The answer is cut to ``size``.
        """
        for attempt in range(ATTEMPTS):
            wanted = size + (attempt if more else 0)
            answer = self.exchange(self.form.read(servo, address, wanted), [servo], wanted).get(servo)
            if answer is not None:
                return BusPacket(servo, answer.code, answer.data[:size])
        raise BoardTimeoutError(ServoSilent(servo))

    def read_all(self, servos: Sequence[int], address: int, size: int) -> dict[int, BusPacket]:
        """The same bytes of several servos, by id, at once where they can; who does not answer is missing."""
        if not self.form.sync_reads:
            found: dict[int, BusPacket] = {}
            for servo in servos:
                found |= self.exchange(self.form.read(servo, address, size), [servo], size)
            return found
        return self.exchange(self.form.sync_read(servos, address, size), servos, size)

    def write(self, servo: int, address: int, data: bytes) -> BusPacket | None:
        """Write into a servo's table; None where it does not confirm that."""
        if servo == BROADCAST:
            self.tell(self.form.write(servo, address, data))
            return None
        request = self.form.write(servo, address, data)
        for _ in range(ATTEMPTS):
            if (answer := self.exchange(request, [servo], 0).get(servo)) is not None:
                return answer
        return None

    def look_for_echo(self, servo: int, address: int) -> bool:
        """Find out whether the adapter sends back what it is sent; whether anything came at all."""
        self._transport.discard_input()
        request = self.form.read(servo, address, _ECHO_READ)
        self._transport.write(request)
        came, silent_s = b"", 0.0
        limit_s = self.timeout_s + self._byte_s * 2 * len(request)
        while silent_s < limit_s and len(came) < _NO_ECHO and request not in came:
            data = self._transport.read(1, _STEP_S)
            silent_s += 0.0 if data else _STEP_S
            came += data and data + self._transport.read(_CHUNK, 0.0)
        self.echoes = request in came
        return bool(came)


def _without_echo(data: bytes, echo: bytearray) -> bytes:
    """``data`` without what is left of the echo at its beginning; a spoilt echo is left to the reader."""
    if not echo:
        return data
    same = min(len(data), len(echo))
    if data[:same] != bytes(echo[:same]):
        echo.clear()
        return data
    del echo[:same]
    return data[same:]

"""Trouble on purpose: a simulated board behind a bad line or on a bad supply, the same each time."""

from __future__ import annotations

import math
import random
import re
from collections import deque
from collections.abc import Sequence
from enum import Enum
from typing import Generic, TypeVar

from armctl.errors import BoardError, InputError
from armctl.hardware.board_type import ByteModel
from armctl.lazy_dataclass import dataclass

Model = TypeVar("Model", bound=ByteModel)

DEFAULT_DELAY_S, DEFAULT_DARK_S = 0.06, 0.5
FAULT_HELP = (
    "Trouble to rehearse; may be given several times. On the line: drop, delay, garble, half or double, with "
    "how often (drop:0.02 strikes 2 % of the bursts in each direction; drop-command and drop-reply one of "
    "them), when (drop@10+0.3: from second 10 on, for 0.3 s), or both; delay=0.06:0.5: half of them by up to "
    "0.06 s. To the board: unplug@30+5 (back after 5 s; without +5 for good), brown-out@30+0.5 (silent for "
    "0.5 s, then started anew), reset@30 (the reset button). /60 at the end: again every 60 s."
)


class Fault(Enum):
    """What may happen to one burst of bytes, in one direction."""

    DROP_COMMAND = "drop-command"  # the host's burst never reaches the board
    DELAY_COMMAND = "delay-command"  # it comes late, and so does all that follows it
    GARBLE_COMMAND = "garble-command"  # one of its bits flips
    HALF_COMMAND = "half-command"  # its second half is lost
    DOUBLE_COMMAND = "double-command"  # it comes twice
    DROP_REPLY = "drop-reply"  # the same for what the board sends
    DELAY_REPLY = "delay-reply"
    GARBLE_REPLY = "garble-reply"
    HALF_REPLY = "half-reply"
    DOUBLE_REPLY = "double-reply"


class BoardFault(Enum):
    """What may happen to the board itself."""

    UNPLUG = "unplug"  # the line breaks, and a board fed over USB loses its power
    BROWN_OUT = "brown-out"  # its supply sags: it starts anew, deaf and dumb meanwhile
    RESET = "reset"  # its reset button


@dataclass(frozen=True, slots=True)
class Trouble:
    """One kind of fault, and when it strikes; times in seconds after the board was switched on."""

    faults: tuple[Fault, ...] | BoardFault
    rate: float = 1.0  # share of the bursts that it strikes while it is on
    delay_s: float = DEFAULT_DELAY_S  # the longest delay; each is one between 0 and this
    start_s: float = 0.0
    length_s: float = math.inf
    every_s: float = math.inf

    def turn(self, time_s: float) -> int | None:
        """How many times it has been on before; None while it is not."""
        since = time_s - self.start_s
        turn = 0 if math.isinf(self.every_s) else math.floor(since / self.every_s)
        passed = since if turn == 0 else since - turn * self.every_s
        return turn if since >= 0.0 and passed <= self.length_s else None


_NUMBER = r"\d*\.?\d+"
_FORM = re.compile(
    rf"(?P<kind>[a-z-]+)(=(?P<delay>{_NUMBER}))?(:(?P<rate>{_NUMBER}))?"
    rf"(@(?P<start>{_NUMBER})(\+(?P<length>{_NUMBER}))?(/(?P<every>{_NUMBER}))?)?"
)
_BURST_KINDS = {
    **{fault.value: (fault,) for fault in Fault},
    **{
        kind: tuple(fault for fault in Fault if fault.value.startswith(f"{kind}-"))
        for kind in ("drop", "delay", "garble", "half", "double")
    },
}
_KINDS = ", ".join(("drop, delay, garble, half, double", *(fault.value for fault in BoardFault)))


def trouble(text: str) -> Trouble:
    """A trouble as ``armctl simulate --fault`` takes it (``FAULT_HELP``); ``InputError`` where it is none."""
    found = _FORM.fullmatch(text)
    kind = found["kind"] if found else re.split(r"[=:@]", text)[0]
    faults = _BURST_KINDS.get(kind) or next((one for one in BoardFault if one.value == kind), None)
    if faults is None:
        raise InputError(f"there is no fault {kind!r}; there are {_KINDS}")
    if found is None:
        raise InputError(f"{text!r} cannot be read as a fault; examples: drop:0.02, drop@10+0.3, unplug@30+5")
    given = {name: float(value) for name, value in found.groupdict().items() if name != "kind" and value}
    rate, every_s = given.get("rate", 1.0), given.get("every", math.inf)
    length_s = given.get("length", math.inf)
    if not 0.0 < rate <= 1.0:
        raise InputError(f"{text}: the share of the bursts is more than 0 and at most 1, as in {kind}:0.02")
    if "delay" in given and not kind.startswith("delay"):
        raise InputError(f"{text}: only a delay has a length of its own, as in delay=0.06:0.5")
    if isinstance(faults, BoardFault):
        if "start" not in given or "rate" in given:
            raise InputError(f"{text}: say when, in seconds from the start, as in {kind}@30")
        if faults is BoardFault.RESET:
            length_s = every_s
        elif faults is BoardFault.BROWN_OUT:
            length_s = given.get("length", DEFAULT_DARK_S)
    elif "rate" not in given and "start" not in given:
        raise InputError(f"{text}: say how often or when, as in {kind}:0.02 or {kind}@10+0.3")
    if not math.isinf(every_s) and not length_s <= every_s:
        raise InputError(f"{text}: what comes every {every_s:g} s must not last longer, as in @30+5/60")
    delay_s = given.get("delay", DEFAULT_DELAY_S)
    return Trouble(faults, rate, delay_s, given.get("start", 0.0), length_s, every_s)


class FaultyModel(Generic[Model]):
    """A simulated board behind a bad line: itself a byte model that wraps another (``inner``).

    Faults strike in two ways. ``inject`` arms them by name: they strike the next bursts that they fit, in
    order. ``troubles`` strike by share and time. Chance follows the seed. A burst is what the host writes at
    once, or what the board sends at once. Delayed bytes are never overtaken by later ones.
    """

    def __init__(self, inner: Model, seed: int = 0, troubles: Sequence[Trouble] = ()) -> None:
        self.inner = inner
        self._random = random.Random(seed)
        self._troubles = [(one, [-1]) for one in troubles]
        self._armed: deque[tuple[Fault, float]] = deque()
        self._late: dict[str, deque[tuple[float, bytes]]] = {"command": deque(), "reply": deque()}
        self._unplugged = self._pulled = False
        self._dark_until: float | None = None
        self._began: float | None = None
        self._now = 0.0

    def inject(self, fault: Fault, count: int = 1, delay_s: float = 0.0) -> None:
        """Let ``fault`` strike the next ``count`` bursts; ``delay_s`` is that of a delay."""
        self._armed.extend([(fault, delay_s)] * count)

    def unplug(self) -> None:
        """Pull the USB cable: the line breaks, and a board fed over USB loses its power."""
        self._unplugged = True
        self.reset()

    def plug_in(self) -> None:
        """Put the cable back; the board has started anew."""
        self._unplugged = False

    def brown_out(self, duration_s: float) -> None:
        """Let the supply sag: the board starts anew and is deaf and dumb for ``duration_s``."""
        self.reset()
        self._dark_until = self._now + duration_s

    @property
    def pending(self) -> int:
        """How many armed faults have not struck yet."""
        return len(self._armed)

    def advance(self, now: float) -> bytes:
        """Let time pass, strike the board where it is due, and hand out the late bytes that are due."""
        self._now = now
        if self._began is None:
            self._began = now
        self._strike_board(now - self._began)
        if self._dark_until is not None and now >= self._dark_until:
            self._dark_until = None
        unasked = self.inner.advance(now)
        self._check_plugged()
        if self._dark_until is not None:
            return b""
        replies = self._due("reply") + self._passed(unasked, "reply")
        return replies + b"".join([self._answer(data) for data in self._due_bursts("command")])

    def feed(self, data: bytes) -> bytes:
        """Pass a burst to the board and its answer back, through whatever fault is next."""
        self._check_plugged()
        if self._dark_until is not None:
            return b""
        return self._answer(self._passed(data, "command", armed=True))

    def reset(self) -> None:
        """Start the board anew; what is on the line is lost. Armed faults stay armed."""
        for late in self._late.values():
            late.clear()
        self.inner.reset()

    def _answer(self, data: bytes) -> bytes:
        """What comes back of what the board answers to ``data``."""
        reply = self.inner.feed(data)
        return self._passed(reply, "reply", armed=True) if reply else b""

    def _passed(self, data: bytes, way: str, *, armed: bool = False) -> bytes:
        """What of a burst gets through now."""
        time_s = self._now - (self._now if self._began is None else self._began)
        delay_s = 0.0
        for fault, longest_s in self._striking(way, time_s, armed=armed) if data else ():
            match fault:
                case Fault.DROP_COMMAND | Fault.DROP_REPLY:
                    return b""
                case Fault.GARBLE_COMMAND | Fault.GARBLE_REPLY:
                    data = self._garbled(data)
                case Fault.HALF_COMMAND | Fault.HALF_REPLY:
                    data = data[: len(data) // 2]
                case Fault.DOUBLE_COMMAND | Fault.DOUBLE_REPLY:
                    data = data + data
                case Fault.DELAY_COMMAND | Fault.DELAY_REPLY:
                    delay_s = max(delay_s, longest_s)
        late = self._late[way]
        if data and (delay_s or late):
            latest = late[-1][0] if late else self._now
            late.append((max(latest, self._now + delay_s), data))
            return b""
        return data

    def _striking(self, way: str, time_s: float, *, armed: bool) -> list[tuple[Fault, float]]:
        """The faults that strike a burst, with the delay [s] of each."""
        struck: list[tuple[Fault, float]] = []
        found = next((one for one in self._armed if one[0].value.endswith(way)), None) if armed else None
        if found is not None:
            self._armed.remove(found)
            struck.append(found)
        for one, _ in self._troubles:
            if isinstance(one.faults, BoardFault) or one.turn(time_s) is None:
                continue
            fault = next((fault for fault in one.faults if fault.value.endswith(way)), None)
            if fault is not None and self._random.random() < one.rate:
                struck.append((fault, self._random.uniform(0.0, one.delay_s)))
        return struck

    def _strike_board(self, time_s: float) -> None:
        pulled = False
        for one, last in self._troubles:
            if not isinstance(one.faults, BoardFault):
                continue
            turn = one.turn(time_s)
            if (
                one.faults is BoardFault.RESET and time_s >= one.start_s
            ):  # an instant, mostly between two calls
                turn = 0 if math.isinf(one.every_s) else math.floor((time_s - one.start_s) / one.every_s)
            pulled |= one.faults is BoardFault.UNPLUG and turn is not None
            if turn is None or turn == last[0]:
                continue
            last[0] = turn
            match one.faults:
                case BoardFault.BROWN_OUT:
                    self.brown_out(one.length_s)
                case BoardFault.UNPLUG | BoardFault.RESET:
                    self.reset()
        self._pulled = pulled

    def _due_bursts(self, way: str) -> list[bytes]:
        late, due = self._late[way], list[bytes]()
        while late and late[0][0] <= self._now:
            due.append(late.popleft()[1])
        return due

    def _due(self, way: str) -> bytes:
        return b"".join(self._due_bursts(way))

    def _garbled(self, data: bytes) -> bytes:
        spoilt = bytearray(data)
        spoilt[self._random.randrange(len(spoilt))] ^= 1 << self._random.randrange(8)
        return bytes(spoilt)

    def _check_plugged(self) -> None:
        if self._unplugged or self._pulled:
            raise BoardError("the simulated board was unplugged; plug it in and connect again")

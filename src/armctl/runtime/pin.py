"""The teacher's PIN: whose is judged, when, and whose has to wait.

A PIN is short, so the number of wrong ones has to be kept small. Still the teacher never waits for somebody
who guesses. So each page and program (a party) has a time from which its next PIN is judged, and then it is
judged at once. Only a wrong PIN moves that time:

- its own: 2 s, then 4, 8, … 300 s after each wrong one of a party. A right one, or a quiet hour, resets that.
- its source's: the pages of one address have 50 wrong PINs, and so have its programs. Each further one costs
  a minute of those who *come* from there after it, and of those who have given more than three wrong ones
  themselves. So who guesses gains nothing by coming again under another name.
- everybody's together: 1000, then 10 s each, for those who come from a source that guesses. No single
  computer can use these up.

Who was there before, and has not guessed, waits for none of it; nor does who comes from anywhere else. Ten
thousand PINs take one computer three days, on all 100 connections (``tests/runtime/test_pin.py``).

A PIN that is not judged is refused at once, right or wrong. A wrong one is answered late, and its party can
have no other one judged meanwhile.
"""

from __future__ import annotations

import hashlib
import hmac
import math

from armctl.errors import StateError
from armctl.lazy_dataclass import dataclass
from armctl.protocol import Origin, Ticket, WrongPins

FIRST_WAIT_S, LONGEST_WAIT_S = 2.0, 300.0
"""how long a party waits after its first wrong PIN, and at most; each wrong one doubles it"""
LATEST_ANSWER_S = 10.0
"""a wrong PIN is answered when the next one may be given, and no later than this"""
OWN_TRIES = 3
"""so many wrong PINs cost their party its own wait alone: a teacher mistypes, too"""
FORGOTTEN_S = 3600.0
"""a source that gives no wrong PIN for so long has a clean record"""
FREE_AT_SOURCE, EACH_AT_SOURCE_S = 50, 60.0
FREE_IN_ALL, EACH_IN_ALL_S = 1000, 10.0
_ANSWER_EACH_S = 0.5
"""each wrong PIN that a source has not paid for yet makes its next answer so much later"""
_MOST_SOURCES = 1000
_MOST_STRANGERS = 100
"""who gives a PIN without being there, or has left while it had to wait"""
_MOST_TOLD = 20
_WRONG = "that is not the teacher's PIN"


class _Budget:
    """Wrong PINs that are free; behind them each one costs a time."""

    def __init__(self, free: int, each_s: float) -> None:
        self._free_s, self._each_s = free * each_s, each_s
        self.paid_at = -math.inf
        """when all of them are paid for: in the past while some are free"""
        self.last_at = -math.inf

    def charge(self, now: float, count: int = 1) -> None:
        self.paid_at = max(self.paid_at, now - self._free_s) + count * self._each_s
        self.last_at = now

    def unpaid(self, now: float) -> float:
        """How many are not paid for yet, the free ones included."""
        return max(0.0, self.paid_at - now + self._free_s) / self._each_s


@dataclass(slots=True)
class _Guesser:
    """A party, as far as PINs go."""

    source: str
    may_at: float
    """from when on its PIN is judged"""
    wrong: int = 0
    last_at: float = -math.inf

    def clear(self) -> None:
        """Its wrong PINs count no more."""
        self.wrong = 0

    def guessed(self, now: float) -> float:
        """It has given a wrong PIN; how long it waits for that [s]."""
        self.wrong += 1
        self.last_at = now
        wait = min(FIRST_WAIT_S * 2.0 ** min(self.wrong - 1, 30), LONGEST_WAIT_S)
        self.may_at = now + wait
        return wait

    def wait_until(self, at: float) -> None:
        """Its next PIN is judged no earlier than that."""
        self.may_at = max(self.may_at, at)


class PinGuard:
    """Judges PINs. Only the controller's thread uses it."""

    def __init__(self, pin: str) -> None:
        """``pin``: the teacher's; empty: there is none."""
        self._pin = _digest(pin) if pin else None
        self._guessers: dict[str, _Guesser] = {}
        self._strangers: dict[str, _Guesser] = {}
        self._sources: dict[str, _Budget] = {}
        self._in_all = _Budget(FREE_IN_ALL, EACH_IN_ALL_S)
        self._late: list[tuple[float, str, Ticket]] = []
        """wrong PINs that are not answered yet: when, whose"""
        self._told: dict[tuple[str, str], tuple[WrongPins, float]] = {}

    def arrive(self, id: str, source: str, now: float) -> None:
        """A party is there. ``source``: where it comes from, as the server knows it."""
        known = self._strangers.pop(id, None)
        self._guessers[id] = known or _Guesser(source, self._newcomers_from(source, now))

    def leave(self, id: str, now: float) -> None:
        """A party is gone; what it or its source has to wait for stays."""
        left = self._guessers.pop(id, None)
        if left is not None and left.may_at > now:
            self._keep_stranger(id, left)
        self._answer([one for one in self._late if one[1] == id])

    def accepts(self, origin: Origin, name: str, pin: str, now: float, ticket: Ticket) -> bool:
        """Whether this is the PIN. A wrong one is answered later, here; ``StateError``: it is not judged."""
        id = origin.who
        if self._pin is None:
            raise StateError("there is no teacher's PIN; it is set where armctl is started")
        guesser = self._guessers.get(id) or self._strangers.get(id)
        if guesser is None:
            guesser = self._keep_stranger(
                id, _Guesser(origin.source, self._newcomers_from(origin.source, now))
            )
        if now < guesser.may_at:
            raise StateError(f"wait {_duration(guesser.may_at - now)} before the next PIN")
        if now - guesser.last_at > FORGOTTEN_S:
            guesser.clear()
        if hmac.compare_digest(_digest(pin), self._pin):
            guesser.clear()
            return True
        self._charge(guesser.source, now)
        wait = guesser.guessed(now)
        if guesser.wrong > OWN_TRIES:
            guesser.wait_until(self._newcomers_from(guesser.source, now))
        unpaid = self._sources[guesser.source].unpaid(now)
        self._late.append((now + min(max(wait, unpaid * _ANSWER_EACH_S), LATEST_ANSWER_S), id, ticket))
        self._tell(name, guesser.source, 1, now)
        return False

    def told(self, id: str, name: str) -> WrongPins:
        """The wrong PINs of the last hour that somebody of this name has given, where this one comes from."""
        guesser = self._guessers.get(id) or self._strangers.get(id)
        source = "" if guesser is None else guesser.source
        known = self._told.get((name, source))
        return WrongPins(name, source, 0) if known is None else known[0]

    def remember(self, wrong: tuple[WrongPins, ...], now: float) -> None:
        """Count what was guessed at the arm that this one takes the place of."""
        for one in wrong[:_MOST_TOLD]:
            self._charge(one.source, now, one.count)
            self._tell(one.name, one.source, one.count, now)

    def tick(self, now: float) -> tuple[WrongPins, ...]:
        """Give the answers that are due; who has guessed in the last hour, the newest first."""
        if self._late:
            self._answer([one for one in self._late if one[0] <= now])
        if any(now - at > FORGOTTEN_S for _, at in self._told.values()):
            self._told = {key: one for key, one in self._told.items() if now - one[1] <= FORGOTTEN_S}
        return tuple([one for one, _ in reversed(self._told.values())])

    def close(self) -> None:
        """Answer everybody."""
        self._answer(self._late)

    def _newcomers_from(self, source: str, now: float) -> float:
        """From when on the PIN of somebody is judged who comes from there now."""
        budget = self._sources.get(source)
        if budget is None or now - max(budget.last_at, budget.paid_at) > FORGOTTEN_S:
            return now
        return max(now, budget.paid_at, self._in_all.paid_at)

    def _charge(self, source: str, now: float, count: int = 1) -> None:
        budget = self._sources.pop(source, None) or _Budget(FREE_AT_SOURCE, EACH_AT_SOURCE_S)
        self._sources[source] = budget
        budget.charge(now, count)
        self._in_all.charge(now, count)
        if len(self._sources) > _MOST_SOURCES:  # the one that owes least has the least to gain by it
            others = [one for one in self._sources if one != source]
            del self._sources[min(others, key=lambda one: self._sources[one].paid_at)]

    def _keep_stranger(self, id: str, guesser: _Guesser) -> _Guesser:
        """Remember somebody who is not there; of too many, the one goes that had to wait least."""
        self._strangers[id] = guesser
        if len(self._strangers) > _MOST_STRANGERS:
            others = [one for one in self._strangers if one != id]
            del self._strangers[min(others, key=lambda one: self._strangers[one].may_at)]
        return guesser

    def _tell(self, name: str, source: str, count: int, now: float) -> None:
        before, _ = self._told.pop((name, source), (None, 0.0))
        count += 0 if before is None else before.count
        self._told[name, source] = WrongPins(name, source, count), now
        if len(self._told) > _MOST_TOLD:
            del self._told[next(iter(self._told))]

    def _answer(self, due: list[tuple[float, str, Ticket]]) -> None:
        self._late = [one for one in self._late if one not in due]
        for _, _, ticket in due:
            ticket.end(StateError(_WRONG))


def _digest(pin: str) -> bytes:
    """Of one length, whatever the PIN's: comparing it tells nothing."""
    return hashlib.sha256(pin.encode(errors="surrogatepass")).digest()


def _duration(seconds: float) -> str:
    return f"{math.ceil(seconds)} s" if seconds <= 120 else f"{math.ceil(seconds / 60)} min"

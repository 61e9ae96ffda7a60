"""Who may command the arm: pages and programs have names, one of them operates, the others watch.

STOP is everybody's and is not asked about here.
"""

from __future__ import annotations

import hmac
import math
from dataclasses import replace

from armctl.errors import StateError
from armctl.runtime.snapshot import Control, EventLog, Party, printable

MOST_PARTIES = 100
LONGEST_NAME = 60
_PIN_PAUSE_S = 2.0
"""after a wrong PIN no other one is looked at for so long: a PIN is short"""


class ControlDesk:
    """Hands control from one to another. Only the controller's thread uses it."""

    def __init__(self, log: EventLog, pin: str = "") -> None:
        """``pin``: the teacher's, who can always take and lock control; empty: there is none."""
        self._log, self._pin = log, pin
        self._pin_from = -math.inf
        self._teachers: set[str] = set()
        """who has given the PIN: they do not wait for others who guess it"""
        self.control = Control(pin=bool(pin))

    def arrive(self, id: str, name: str, *, watch: bool) -> None:
        """Somebody is there, or has another name; it operates when nobody does, unless it only watches."""
        control = self.control
        name = " ".join(printable(name).split())[:LONGEST_NAME] or id
        known = control.party(id)
        if known is not None:
            if known.name != name:
                self._log.add(f"{known.name} is called {name} now")
                self._change(known, replace(known, name=name))
            return
        if len(control.parties) >= MOST_PARTIES:
            raise StateError(f"{MOST_PARTIES} pages and programs are there already; close one")
        first = control.operator is None and not control.locked and not watch
        self.control = replace(control, parties=(*control.parties, Party(id, name, first)))
        if first:
            self._log.add(f"{name} operates the arm")

    def leave(self, id: str, why: str) -> bool:
        """Somebody is gone; whether it operated. Then control is free, unless the teacher locked it."""
        control, party = self.control, self.control.party(id)
        if party is None:
            return False
        locked = control.locked and (control.by_teacher or not party.operates)
        parties = tuple(one for one in control.parties if one.id != id)
        self._teachers.discard(id)
        self.control = replace(control, parties=parties, locked=locked)
        if party.operates:
            self._log.add(f"{party.name} no longer operates: {why}; control is free", "warning")
        return party.operates

    def take(self, id: str, pin: str, now: float) -> None:
        """Somebody takes control; ``StateError`` where it is locked."""
        control, party = self.control, self.control.party(id)
        if party is None:
            raise StateError(f"{id} has not said that it is there")
        before = control.operator
        if before is party:
            return
        teacher = self._is_pin(id, pin, now)
        if control.locked and not teacher:
            whom = "the teacher has" if control.by_teacher or before is None else f"{before.name} has"
            pin_too = ", or give the teacher's PIN" if control.pin else ""
            raise StateError(f"{whom} locked control; ask for it to be unlocked{pin_too}")
        parties = tuple(replace(one, operates=one is party) for one in control.parties)
        self.control = replace(control, parties=parties)
        lost = "" if before is None else f"; {before.name} watches now"
        self._log.warn(f"{party.name} has taken control of the arm{lost}")

    def lock(self, id: str, locked: bool, pin: str, now: float) -> None:
        """The operator, or who knows the PIN, locks control or opens the lock."""
        control = self.control
        teacher = self._is_pin(id, pin, now)
        if not teacher:
            if control.by_teacher and control.locked:
                raise StateError("the teacher has locked control; only the teacher's PIN opens it")
            if not control.operates(id):
                raise StateError("only the operator may lock control; take it first")
        self.control = replace(control, locked=locked, by_teacher=locked and teacher)
        party = control.party(id)
        who = id if party is None else party.name
        what = "locked" if locked else "unlocked"
        self._log.add(f"control was {what} ({who}{', with the PIN' if teacher else ''})")

    def require(self, id: str) -> None:
        """Refuse (``StateError``) what only the operator may command; a lock without one counts, too."""
        if (why := self.control.refusal(id)) is not None:
            raise StateError(why)

    def _is_pin(self, id: str, pin: str, now: float) -> bool:
        if not pin:
            return False
        if now < self._pin_from and id not in self._teachers:
            raise StateError("wait a moment before the next PIN")
        party = self.control.party(id)
        if not (self._pin and hmac.compare_digest(pin.encode(), self._pin.encode())):
            self._pin_from = now + _PIN_PAUSE_S
            self._teachers.discard(id)
            self._log.warn(f"{id if party is None else party.name} has given a wrong PIN")
            raise StateError("that is not the teacher's PIN")
        if party is not None:
            self._teachers.add(id)
        return True

    def _change(self, old: Party, new: Party) -> None:
        parties = tuple(new if one is old else one for one in self.control.parties)
        self.control = replace(self.control, parties=parties)

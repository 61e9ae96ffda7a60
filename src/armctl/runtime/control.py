"""Who may command the arm: pages and programs have names, one of them operates, the others watch.

STOP is everybody's and is not asked about here.
"""

from __future__ import annotations

from dataclasses import replace

from armctl.errors import StateError
from armctl.facts.commands import ControlLocked
from armctl.protocol import Control, Origin, Party, Ticket, WrongPins
from armctl.protocol.commands import LONGEST_NAME
from armctl.protocol.snapshot import printable
from armctl.runtime.notices import EventLog
from armctl.runtime.pin import PinGuard

MOST_PARTIES = 100
_EACH_LOGGED = 5
"""wrong PINs of one name; from then on only each time that their number has doubled"""


class ControlHandover:
    """Hands control from one to another. Only the controller's thread uses it."""

    def __init__(self, log: EventLog, pin: str = "") -> None:
        """``pin``: the teacher's, who can always take and lock control; empty: there is none."""
        self._log, self._pins = log, PinGuard(pin)
        self.control = Control(pin=bool(pin))

    def arrive(self, origin: Origin, name: str, now: float, *, watch: bool) -> None:
        """Somebody is there, or has another name; it operates when nobody does, unless it only watches."""
        control, id = self.control, origin.who
        name = " ".join(printable(name).split())[:LONGEST_NAME] or id
        known = control.party(id)
        if known is not None:
            if known.name != name:
                self._log.add(f"{known.name} is called {name} now")
                self._change(known, replace(known, name=name))
            if control.operator is None and not (control.locked or watch):
                self._change(known, replace(known, name=name, operates=True))
                self._log.add(f"{name} operates the arm again")
            return
        if len(control.parties) >= MOST_PARTIES:
            raise StateError(f"{MOST_PARTIES} pages and programs are there already; close one")
        self._pins.arrive(id, origin.source, now)
        first = control.operator is None and not control.locked and not watch
        self.control = replace(control, parties=(*control.parties, Party(id, name, first)))
        if first:
            self._log.add(f"{name} operates the arm")

    def leave(self, id: str, why: str, now: float) -> bool:
        """Somebody is gone; whether it commanded. If it operated, control is free, or a teacher's."""
        control, party = self.control, self.control.party(id)
        if party is None:
            return False
        locked = control.locked and (control.by_teacher or not party.operates)
        parties = tuple(one for one in control.parties if one.id != id)
        self._pins.leave(id, now)
        commands = control.operates(id)
        lent_to = "" if commands else control.lent_to
        self.control = replace(control, parties=parties, locked=locked, lent_to=lent_to)
        if party.operates:
            self._log.add(f"{party.name} no longer operates: {why}; control is free", "warning")
        return commands

    def take(self, origin: Origin, pin: str, now: float, ticket: Ticket) -> bool:
        """Somebody takes control; ``StateError`` where it is locked. False: a wrong PIN, answered later."""
        control, id = self.control, origin.who
        party = control.party(id)
        if party is None:
            raise StateError(f"{id} has not said that it is there")
        before = control.operator
        if before is party:
            return True
        if pin and not self._is_pin(origin, pin, now, ticket):
            return False
        teacher = bool(pin)
        if control.locked and not teacher:
            whom = "" if control.by_teacher or before is None else before.name
            raise StateError(ControlLocked(whom, control.pin))
        parties = tuple(replace(one, operates=one is party) for one in control.parties)
        self.control = replace(control, parties=parties, lent_to="")
        lost = "" if before is None else f"; {before.name} watches now"
        self._log.warn(f"{party.name} has taken control of the arm{lost}")
        return True

    def lend(self, id: str, to: str) -> None:
        """The operator lets somebody command beside it; empty: nobody any more."""
        control, party = self.control, self.control.party(to)
        operator = control.operator
        if operator is None or operator.id != id:
            raise StateError("only the operator may lend control; take it first")
        if to and (party is None or party is operator):
            raise StateError(f"{to} is not there beside {operator.name}; control cannot be lent to it")
        self.control = replace(control, lent_to=to)
        words = "commands alone again" if party is None else f"lets {party.name} command beside it"
        self._log.add(f"{operator.name} {words}")

    def lock(self, origin: Origin, locked: bool, pin: str, now: float, ticket: Ticket) -> bool:
        """The operator, or who knows the PIN, locks control or opens it. False: as ``take``."""
        control, id = self.control, origin.who
        if pin and not self._is_pin(origin, pin, now, ticket):
            return False
        teacher = bool(pin)
        if not teacher:
            if control.by_teacher and control.locked:
                raise StateError("the teacher has locked control; only the teacher's PIN opens it")
            if control.operator is None or control.operator.id != id:
                raise StateError("only the operator may lock control; take it first")
        self.control = replace(control, locked=locked, by_teacher=locked and teacher)
        party = control.party(id)
        who = id if party is None else party.name
        what = "locked" if locked else "unlocked"
        self._log.add(f"control was {what} ({who}{', with the PIN' if teacher else ''})")
        return True

    def require(self, id: str) -> None:
        """Refuse (``StateError``) what only the operator may command; a lock without one counts, too."""
        if (why := self.control.refusal(id)) is not None:
            raise StateError(why)

    def remember(self, wrong_pins: tuple[WrongPins, ...], now: float) -> None:
        """Go on counting the wrong PINs of the arm before this one."""
        self._pins.remember(wrong_pins, now)

    def tick(self, now: float) -> None:
        """Answer the wrong PINs whose time has come."""
        wrong_pins = self._pins.tick(now)
        if wrong_pins != self.control.wrong_pins:
            self.control = replace(self.control, wrong_pins=wrong_pins)

    def close(self) -> None:
        """Answer all of them."""
        self._pins.close()

    def _is_pin(self, origin: Origin, pin: str, now: float, ticket: Ticket) -> bool:
        """Whether this is the PIN; see ``PinGuard.accepts``."""
        party = self.control.party(origin.who)
        name = origin.who if party is None else party.name
        if self._pins.accepts(origin, name, pin, now, ticket):
            return True
        told = self._pins.told(origin.who, name)
        if told.count <= _EACH_LOGGED or not told.count & (told.count - 1):
            often = f": {told.count} in the last hour" if told.count > 1 else ""
            where = f" ({told.source})" if told.source else ""
            self._log.warn(f"{name} has given a wrong PIN{where}{often}")
        return False

    def _change(self, old: Party, new: Party) -> None:
        parties = tuple(new if one.id == old.id else one for one in self.control.parties)
        self.control = replace(self.control, parties=parties)

"""Who operates the arm: names, taking control, locking it."""

from __future__ import annotations

import asyncio
from html import escape

import viser

from armctl.protocol import Arrive, Control, LockControl, Snapshot, TakeControl
from armctl.protocol.commands import LONGEST_NAME
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, muted

_NOTE = "Everybody may press STOP. A page that does not answer for a second loses control, and the arm stops."

_TYPED_S = 0.7
"""a pause after which a name counts as typed"""
_MOST_GUESSERS = 8


class People:
    """A tab in *Main*."""

    def __init__(self, session: Session) -> None:
        self._session = session
        gui = session.gui
        self._list = LiveHtml(gui)
        name = gui.add_text("Your name", initial_value=session.name)
        self._pin = gui.add_text("Teacher's PIN", initial_value="", visible=session.snapshot.control.pin)
        self._take = gui.add_button("Take control of the arm", icon=viser.Icon.HAND_GRAB)
        self._lock = gui.add_button("Lock control", icon=viser.Icon.LOCK)
        LiveHtml(gui, muted(_NOTE))
        self._name = name
        self._typed = 0
        session.on(name.on_update, self._on_name)
        session.on(self._take.on_click, self._on_take)
        session.on(self._lock.on_click, self._on_lock)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show who is there, and what may be done."""
        control, session = snapshot.control, self._session
        self._list.show(people_html(control, session.me))
        self._take.visible = not session.operates
        self._pin.visible = control.pin
        self._lock.label = "Unlock control" if control.locked else "Lock control"
        self._lock.disabled = not session.operates and not control.pin

    async def _on_name(self) -> None:
        """Everybody is told once the name is typed, not at each letter."""
        self._typed += 1
        typed = self._typed
        await asyncio.sleep(_TYPED_S)
        if typed == self._typed:
            await self._session.say(Arrive(self._name.value[:LONGEST_NAME], watch=True))

    async def _on_take(self) -> None:
        await self._session.say(TakeControl(self._taken_pin()))

    async def _on_lock(self) -> None:
        locked = self._session.snapshot.control.locked
        await self._session.say(LockControl(not locked, self._taken_pin()))

    def _taken_pin(self) -> str:
        """The PIN that was typed; it does not stay on the screen."""
        pin, self._pin.value = self._pin.value, ""
        return pin


def people_html(control: Control, me: str) -> str:
    """Who is there, as seen from page ``me``."""
    lines: list[str] = []
    for party in control.parties:
        what = "operates" if party.operates else "watches"
        you = " (this page)" if party.id == me else ""
        known = "" if party.name == party.id else f" · {escape(party.id)}"
        name = f"<b>{escape(party.name)}</b>" if party.operates else escape(party.name)
        lines.append(f"<div>{name}{you}: {what}<span style='opacity:.65'>{known}</span></div>")
    if control.locked:
        whose = "the teacher" if control.by_teacher else "the operator"
        lines.append(f"<div>Control is locked by {whose}.</div>")
    if control.wrong_pins:
        lines.append("<div>Wrong PINs in the last hour:</div>")
    for one in control.wrong_pins[:_MOST_GUESSERS]:
        where = f"<span style='opacity:.65'> · {escape(one.source)}</span>" if one.source else ""
        lines.append(f"<div><b>{escape(one.name)}</b>: {one.count}{where}</div>")
    return "".join(lines)

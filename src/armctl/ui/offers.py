"""Controls that can be used under the same conditions, and why they cannot be used now."""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Protocol

from armctl.errors import ArmctlError
from armctl.facts import Need, Reason
from armctl.lazy_dataclass import dataclass
from armctl.protocol import Snapshot
from armctl.ui.widgets.html import EMPTY_LINE, LiveHtml, sentence, with_minus


def why_html(content: str, hint: str = "") -> str:
    """HTML below controls: why they cannot be used; else a ``hint``, whose place the reason takes.

    The line is there all the time, and as high as the hint at least: what lies below it stays in its place.
    """
    kept = escape(with_minus(hint))
    if content and kept:
        return f"<div class='armctl-why'><span>{content}</span><span aria-hidden='true'>{kept}</span></div>"
    return f"<div class='armctl-why'>{content or kept}</div>"


NO_REASON = why_html(EMPTY_LINE)


class Disableable(Protocol):
    """A button, a field, or a command of the palette."""

    @property
    def disabled(self) -> bool:
        """Whether it can be used no more."""
        ...

    @disabled.setter
    def disabled(self, disabled: bool) -> None: ...


def refused_by(check: Callable[[Snapshot], object]) -> Callable[[Snapshot], str | None]:
    """For ``Session.needs``: why ``check`` refuses now, or None."""

    def why(snapshot: Snapshot) -> str | None:
        try:
            check(snapshot)
        except ArmctlError as refusal:
            return str(refusal)
        return None

    return why


@dataclass
class Offer:
    """Some controls, and what they need."""

    controls: tuple[Disableable, ...]
    arm: Need | Callable[[], Need | None] | None
    also: Callable[[Snapshot], str | Reason | None] | None
    reason: LiveHtml | None
    """where it is told why they cannot be used; None: nowhere"""
    anyone: bool
    """pages that watch may use them, whatever the arm does"""
    hint: str = ""
    """what stands there while they can be used"""
    why: str | Reason | None = None
    """why they cannot be used, as it was drawn last; None: they can"""
    _off: bool | None = None
    """whether they cannot be used, as they show it; None: nobody has told them yet"""
    _told: tuple[str | Reason | None, str] = (None, "")
    """that reason and the hint, as they are shown: the words take six times as long as to compare them"""

    @property
    def keeps_line(self) -> bool:
        """Whether the line of the reason stays, empty: the arm's moves and edits shift nothing below it."""
        return self.arm is not None or self.also is not None or bool(self.hint)

    def draw(self, snapshot: Snapshot, why_not: Callable[[Need | None], str | None], *, told: bool) -> None:
        """Enable or disable them; ``why_not``: what needs this of the arm. ``told``: and show the reason."""
        arm = self.arm() if callable(self.arm) else self.arm
        why: str | Reason | None = None if self.anyone else why_not(arm)
        if why is None and self.also is not None:
            why = self.also(snapshot)
        self.why, off = why, why is not None
        if off is not self._off:  # nobody else enables or disables them
            self._off = off
            for control in self.controls:
                control.disabled = off
        if self.reason is not None:
            shown = why if told else None
            self.reason.visible = shown is not None or self.keeps_line
            if (shown, self.hint) != self._told:
                self._told = shown, self.hint
                said = escape(sentence(shown)) if shown else ""
                self.reason.show(why_html(said, self.hint) if said or self.hint else NO_REASON)

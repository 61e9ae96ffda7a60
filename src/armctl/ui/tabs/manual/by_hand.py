"""Joints that go limp one by one, so that a hand can lead them; the page follows."""

from __future__ import annotations

from html import escape

from armctl.errors import InputError
from armctl.facts import Need
from armctl.hardware import Source
from armctl.protocol import Enable, Release, Snapshot
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.number_field import field_grid, in_row

_HINT = (
    "Joints that you tick go limp. <b>Support the arm</b>, then lead them by hand: the page follows, and "
    "<b>Record pose</b> and <b>Point</b> take where they stand."
)
_NO_TICK = "no joint is ticked; tick those that your hand is to lead"
_ABILITY = "release_channels"


def can_be_led(snapshot: Snapshot) -> bool:
    """Whether single joints of the arm can be limp while its board measures where they are."""
    board = snapshot.board
    return board is not None and _ABILITY in board.abilities and snapshot.source is Source.MEASURED


class ByHand:
    """Ticks for joints, and two buttons: let them go, take them back. Only where the board can."""

    def __init__(self, session: Session, *, ticked: bool = False, hint: str = _HINT) -> None:
        """``ticked``: whether all joints are ticked to begin with."""
        self._session, gui = session, session.gui
        joints = session.console.robot.joints
        self._folder = gui.add_folder("Lead by hand", expand_by_default=False)
        with self._folder:
            LiveHtml(gui, hint)
            with field_grid(gui):
                self._ticks = {
                    joint.name: gui.add_checkbox(joint.title, initial_value=ticked) for joint in joints
                }
            with in_row(gui):
                self._go_limp = gui.add_button("Let ticked joints go limp", color="orange")
                self._back = gui.add_button("Take them back as they stand", color="gray")
            hint = "They fall unless a hand holds them."
            session.needs(Need.HOLDING_SOME, self._go_limp, also=self._none_ticked, hint=hint)
            self._state = LiveHtml(gui)
            session.needs(None, self._back, also=_none_limp, told=False)
        session.on(self._go_limp.on_click, self._on_limp)
        session.on(self._back.on_click, self._on_back)
        self.refresh(session.snapshot)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show which joints are limp; nothing where the board cannot do it."""
        self._folder.visible = can_be_led(snapshot)
        limp = ", ".join(map(escape, snapshot.limp))
        self._state.show(
            f"<b>Limp: {limp}.</b> The others hold." if limp else muted("All joints hold or are off.")
        )

    def _ticked(self) -> tuple[str, ...]:
        return tuple(name for name, tick in self._ticks.items() if tick.value)

    def _none_ticked(self, _: Snapshot) -> str | None:
        return None if self._ticked() else _NO_TICK

    async def _on_limp(self) -> None:
        if not (names := self._ticked()):
            raise InputError(_NO_TICK)
        await self._session.submit(Release(names))

    async def _on_back(self) -> None:
        await self._session.submit(Enable())


def _none_limp(snapshot: Snapshot) -> str | None:
    return None if snapshot.limp else "no joint is limp"

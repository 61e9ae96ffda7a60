"""Inputs and outputs of the board: what they are at, outputs to press, inputs of a simulated board to set."""

from __future__ import annotations

from functools import partial

import viser

from armctl.facts import Need
from armctl.protocol import Command, SetOutput, SimulateInput, Snapshot
from armctl.protocol.snapshot import POWERED
from armctl.robot.signals import ON, Input, Output
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, muted, table

_SHARES = {"0 %": 0.0, "25 %": 0.25, "50 %": 0.5, "75 %": 0.75, "100 %": 1.0}
_SWITCH = {"On": 1.0, "Off": 0.0}
_SIMULATED = "The board is simulated: nothing is connected to it. Set here what its inputs see."


class SignalPanel:
    """Only for an arm whose robot file has inputs or outputs."""

    def __init__(self, session: Session) -> None:
        self._session, self._signals = session, session.console.robot.signals
        gui, gripper = session.gui, session.console.robot.gripper
        own = "" if gripper is None else gripper.output
        self._table = LiveHtml(gui)
        for one in self._signals.outputs:
            group, grips = self._group(one, partial(SetOutput, one.name)), one.name == own
            told = grips or one is self._signals.outputs[-1]
            session.needs(Need.CONNECTED, group, also=_use_gripper if grips else None, told=told)
        self._simulated = gui.add_folder("Simulated inputs", visible=False)
        with self._simulated:
            LiveHtml(gui, muted(_SIMULATED))
            for one in self._signals.inputs:
                session.needs(None, self._group(one, partial(SimulateInput, one.name)), told=False)
        self.refresh(session.snapshot)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what they are at."""
        board = snapshot.board
        self._simulated.visible = board is not None and board.simulated and bool(self._signals.inputs)
        rows = [
            [one.title, kind, said(one, values.get(one.name))]
            for kind, every, values in (
                ("input", self._signals.inputs, snapshot.inputs),
                ("output", self._signals.outputs, snapshot.outputs),
            )
            for one in every
        ]
        self._table.show(table(("Name", "", "is"), rows, words=(0, 1, 2)))

    def _group(self, one: Input | Output, command: partial[Command]) -> viser.GuiButtonGroupHandle:
        """Buttons that give it a value."""
        values = _SHARES if one.kind in ("analog", "pwm") else _SWITCH
        group = self._session.gui.add_button_group(one.title, tuple(values))

        async def on_press() -> None:
            await self._session.submit(command(values[group.value]))

        self._session.on(group.on_click, on_press)
        return group


def said(one: Input | Output, value: float | None) -> str:
    """A value in words."""
    if value is None:
        return "–"
    if one.kind in ("analog", "pwm"):
        return f"{100 * value:.0f} %"
    return "on" if value > ON else "off"


def _use_gripper(snapshot: Snapshot) -> str | None:
    return "it is the gripper's: use the gripper" if snapshot.state in POWERED else None

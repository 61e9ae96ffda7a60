"""Inputs and outputs of the board: what they are at, outputs to press, inputs of a simulated board to set."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Self

import viser

from armctl.errors import InputError
from armctl.facts import Need
from armctl.hardware.input_script import SCRIPT_FILES, read_script
from armctl.protocol import Command, PlayInputs, SetOutput, SimulateInput, Snapshot
from armctl.protocol.snapshot import POWERED
from armctl.robot.signals import ON, Input, Output
from armctl.ui.console import Console
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, muted, table

_SHARES = {"0 %": 0.0, "25 %": 0.25, "50 %": 0.5, "75 %": 0.75, "100 %": 1.0}
_SWITCH = {"On": 1.0, "Off": 0.0}
PLAY, STOP_SCRIPT = "Play script", "Stop script"
_SCRIPT_HINT = (
    "What the inputs see over time, e.g. 'at 2 s part = on; every 5 s part on for 200 ms', or a table (CSV) "
    "with time_s and the inputs as its columns."
)
_SIMULATED = "The board is simulated: nothing is connected to it. Set here what its inputs see."


class InputScriptText:
    """The script of the simulated inputs, as it was played last: all pages begin with it."""

    def __init__(self, inputs: Sequence[Input]) -> None:
        self.inputs = tuple(inputs)
        first = next((one.name for one in inputs), "")
        self.text = f"every 5 s {first} on for 1 s"

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Go on with that of an arm that has the same inputs."""
        inputs = console.robot.signals.inputs
        return before if before is not None and before.inputs == inputs else cls(inputs)


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
        self._script = session.console.shared(InputScriptText)
        self._simulated = gui.add_folder("Simulated inputs", visible=False)
        with self._simulated:
            LiveHtml(gui, muted(_SIMULATED))
            for one in self._signals.inputs:
                session.needs(None, self._group(one, partial(SimulateInput, one.name)), told=False)
            if self._signals.inputs:
                self._add_script()
        self.refresh(session.snapshot)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what they are at."""
        board = snapshot.board
        self._simulated.visible = board is not None and board.simulated and bool(self._signals.inputs)
        if self._signals.inputs:
            self._show_script(snapshot)
        rows = [
            [one.title, kind, said(one, values.get(one.name))]
            for kind, every, values in (
                ("input", self._signals.inputs, snapshot.inputs),
                ("output", self._signals.outputs, snapshot.outputs),
            )
            for one in every
        ]
        self._table.show(table(("Name", "", "is"), rows, words=(0, 1, 2)))

    # A script that sets the inputs.

    def _add_script(self) -> None:
        gui, session = self._session.gui, self._session
        self._text = gui.add_text("Script", self._script.text, multiline=True, hint=_SCRIPT_HINT)
        upload = gui.add_upload_button("Choose a script or a table (CSV)", icon=viser.Icon.UPLOAD)
        play = gui.add_button_group("Inputs over time", (PLAY, STOP_SCRIPT))
        self._played = LiveHtml(gui)
        session.needs(None, upload, play, told=False)
        session.on(upload.on_upload, lambda: self._on_upload(upload.value.name, upload.value.content))
        session.on(play.on_click, lambda: self._on_play(play.value))

    def _show_script(self, snapshot: Snapshot) -> None:
        names = ", ".join(snapshot.scripted)
        said = f"A script sets {names}. What you press counts until it sets that again."
        self._played.show(muted(said) if names else "")

    def _on_upload(self, name: str, content: bytes) -> None:
        self._session.require_operator()
        try:
            text = SCRIPT_FILES.text(content)
            read_script(text, self._signals)
        except InputError as cause:
            raise cause.about(name) from cause
        self._text.value = self._script.text = text

    async def _on_play(self, what: str) -> None:
        text = self._text.value.strip() if what == PLAY else ""
        if what == PLAY:
            read_script(text, self._signals)  # also an empty one is refused
            self._script.text = self._text.value
        await self._session.submit(PlayInputs(text))

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

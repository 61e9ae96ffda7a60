"""Programs as files: saved ones, downloads and uploads."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import ParamSpec

import viser

from armctl.errors import ProgramError
from armctl.program import PROGRAM_SUFFIXES, encode_program, read_program, write_csv, write_script
from armctl.program.check import ProgramFinding
from armctl.ui.session import Session
from armctl.ui.tabs.program.shared_program import SharedProgram
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.verdict_list import first_error

P = ParamSpec("P")
_NONE = "(none saved yet)"
_UPLOAD_NOTE = (
    "Upload takes a program of this robot: .toml, or .csv with units in its head "
    "(base_deg, … or x_mm, y_mm, z_mm)."
)
_EXPORT_HINT = "CSV X-Y-Z: poses become points of the tool. Python: a script for the armctl library."


class ProgramFiles:
    """Names and files of the program."""

    def __init__(self, session: Session, check: Callable[[], Awaitable[list[ProgramFinding]]]) -> None:
        """Add the controls; ``check`` checks the program and shows the verdict."""
        self._session = session
        self._check = check
        self._shared = session.shared(SharedProgram)
        self._version = -1
        self._named = self._shared.program.name
        gui = session.gui
        self._name = gui.add_text("Name", initial_value=self._named)
        self._keep = gui.add_button_group("This program", ("Save", "Download", "CSV"))
        self._export = gui.add_button_group("Download as", ("CSV X-Y-Z", "Python"), hint=_EXPORT_HINT)
        self._saved = gui.add_dropdown("Saved programs", self._choices())
        self._load = gui.add_button_group("Chosen one", ("Load",))
        suffixes = ",".join(PROGRAM_SUFFIXES)
        self._upload = gui.add_upload_button("Upload", icon=viser.Icon.UPLOAD, mime_type=suffixes)
        LiveHtml(gui, muted(_UPLOAD_NOTE))
        session.on(self._keep.on_click, self._on_keep)
        session.on(self._export.on_click, self._on_export)
        session.on(self._load.on_click, self._on_load)
        session.on(self._upload.on_upload, self._on_upload)

    def refresh(self) -> None:
        """Show the program's name and the saved programs, if they have changed."""
        if self._version == self._shared.version:
            return
        self._version = self._shared.version
        if self._named != self._shared.program.name:
            self._named = self._name.value = self._shared.program.name
        choices = self._choices()
        if self._saved.options != choices:
            self._saved.options = choices

    def _choices(self) -> tuple[str, ...]:
        return tuple(self._shared.saved()) or (_NONE,)

    async def _on_keep(self) -> None:
        program, robot = self._shared.program, self._session.console.robot
        match self._keep.value:
            case "Save":
                await self._save(self._name.value.strip())
            case "Download":
                await self._send(".toml", encode_program, program)
            case _:
                await self._send(".csv", write_csv, program, robot)

    async def _save(self, name: str) -> None:
        self._session.require_operator()
        path = await self._shared.save(name)
        self.refresh()
        self._saved.value = path.stem  # so that Load brings back this one, not another
        self._session.notify("Saved", str(path))

    async def _on_export(self) -> None:
        program, robot = self._shared.program, self._session.console.robot
        if self._export.value == "Python":
            await self._send(".py", write_script, program)
        else:
            await self._send("-xyz.csv", write_csv, program, robot, "points")

    async def _on_load(self) -> None:
        self._session.require_operator()
        if self._saved.value == _NONE:
            raise ProgramError("no program is saved yet; give this one a name and press Save")
        await self._shared.load(self._saved.value)
        await self._tell_findings(self._saved.value)

    async def _on_upload(self) -> None:
        self._session.require_operator()
        file, robot = self._upload.value, self._session.console.robot
        program = await asyncio.to_thread(read_program, file.name, file.content, robot)
        self._session.require_operator()
        try:
            self._shared.put(program)
        except ProgramError as cause:
            raise ProgramError(f"{file.name}: {cause}") from cause
        count = len(program.steps)
        steps = "1 step is" if count == 1 else f"{count} steps are"
        self._session.notify("Uploaded", f"{file.name}: {steps} on the list")
        await self._tell_findings(file.name)

    async def _tell_findings(self, name: str) -> None:
        """What would keep the arm from running the program, as Check tells it."""
        if not self._shared.program.steps:
            return
        error = first_error(await self._check())
        if error is not None and not self._session.closed:
            self._session.notify("Cannot run yet", f"{name}: {error}", "yellow")

    async def _send(self, suffix: str, write: Callable[P, str], *args: P.args, **options: P.kwargs) -> None:
        name = f"{self._shared.program.name}{suffix}"
        text = await asyncio.to_thread(write, *args, **options)
        self._session.client.send_file_download(name, text.encode(), save_immediately=True)

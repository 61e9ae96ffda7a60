"""Programs as files: saved ones, downloads and uploads."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import viser

from armctl.errors import ProgramError
from armctl.motion.preflight import Finding
from armctl.program import PROGRAM_SUFFIXES, Program, encode_program, read_program, write_csv, write_script
from armctl.program.samples import SAMPLES, sample_program
from armctl.robot import Robot
from armctl.ui.session import Session
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.html import LiveHtml, muted
from armctl.ui.widgets.verdict_list import first_error

_UPLOAD_NOTE = (
    "Upload takes a program of this robot: .toml, or .csv with units in its head "
    "(base_deg, … or x_mm, y_mm, z_mm)."
)
_WRITERS: dict[str, tuple[str, Callable[[Program, Robot], str]]] = {
    "Download": (".toml", lambda program, _: encode_program(program)),
    "CSV": (".csv", write_csv),
    "CSV X-Y-Z": ("-xyz.csv", lambda program, robot: write_csv(program, robot, "points")),
    "Python": (".py", lambda program, _: write_script(program)),
}
_EXPORT_HINT = "CSV X-Y-Z: poses become points of the tool. Python: a script for the armctl library."


class ProgramFiles:
    """Names and files of the program."""

    def __init__(self, session: Session, check: Callable[[], Awaitable[list[Finding]]]) -> None:
        """Add the controls; ``check`` checks the program and shows the verdict."""
        self._session = session
        self._check = check
        self._shared = session.console.shared(SharedProgram)
        self._version = -1
        self._named = self._shared.program.name
        gui = session.gui
        self._name = gui.add_text("Name", initial_value=self._named)
        save = gui.add_button_group("This program", ("Save",))
        session.needs(None, save)
        export = gui.add_button_group("Download as", tuple(_WRITERS), hint=_EXPORT_HINT)
        self._saved = gui.add_dropdown("Saved programs", self._choices())
        load = gui.add_button_group("Chosen one", ("Load",))
        suffixes = ",".join(PROGRAM_SUFFIXES)
        self._upload = gui.add_upload_button("Upload", icon=viser.Icon.UPLOAD, mime_type=suffixes)
        LiveHtml(gui, muted(_UPLOAD_NOTE))
        session.on(save.on_click, self._on_save)
        session.on(export.on_click, lambda: self._download(export.value))
        session.needs(None, load, self._upload)
        session.on(load.on_click, self._on_load)
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
        saved = self._shared.saved()
        return (*saved, *(name for name in SAMPLES if name not in saved))

    async def _on_save(self) -> None:
        self._session.require_operator()
        path = await self._shared.save(self._name.value.strip())
        self.refresh()
        self._saved.value = path.stem  # so that Load brings back this one, not another
        self._session.notify("Saved", str(path))

    async def _download(self, button: str) -> None:
        program, robot = self._shared.program, self._session.console.robot
        suffix, write = _WRITERS[button]
        text = await asyncio.to_thread(write, program, robot)
        name = f"{self._shared.program.name}{suffix}"
        self._session.client.send_file_download(name, text.encode(), save_immediately=True)

    async def _on_load(self) -> None:
        self._session.require_operator()
        name, robot = self._saved.value, self._session.console.robot
        if name in SAMPLES and name not in self._shared.saved():
            sample = await asyncio.to_thread(sample_program, name, robot)
            self._session.require_operator()
            self._shared.put(sample, kept=True)
        else:
            await self._shared.load(name)
        await self._tell_findings(name)

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
        if not self._shared.program.steps:
            return
        error = first_error(await self._check())
        if error is not None and not self._session.closed:
            self._session.notify("Cannot run yet", f"{name}: {error}", "yellow")

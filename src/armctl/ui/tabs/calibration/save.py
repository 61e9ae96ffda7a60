"""Overview, saving, the test pose, and going back to an earlier calibration."""

from __future__ import annotations

from collections.abc import Sequence

import viser

from armctl.calibration import Version, check_pose
from armctl.errors import InputError
from armctl.runtime import MoveJoints, Snapshot, State
from armctl.ui.robot_switch import release_to_reopen
from armctl.ui.session import Session
from armctl.ui.tabs.calibration.joint import slow_duration
from armctl.ui.tabs.calibration.shared_calibration import SharedCalibration
from armctl.ui.widgets.calibration_text import (
    check_pose_html,
    draft_html,
    kept_html,
    overview_html,
    version_label,
)
from armctl.ui.widgets.html import LiveHtml, muted, sentence

_ROBOT_FILE = "robot file, no calibration"
_LONGEST_NOTE = 120
_BREAK = "\u200b"
"""where a long path may go on in the next line; a notification would cut it off"""
_TEST_NOTE = (
    "Save first: the test pose goes by the calibration in force, slowly. If it does not look like this, "
    "Revert takes the arm back in one click."
)
_SAVE_NOTE = (
    "Saving opens the arm anew. A Maestro whose own Timeout ends in that moment lets its servos go: "
    "keep clear."
)
_REVERT_NOTE = "Revert brings this version in force again; the present one stays in the list."


class CalibrationSave:
    """What was measured becomes what the arm runs by."""

    def __init__(self, session: Session) -> None:
        """Add the controls to the present container."""
        self._session, self._desk = session, session.shared(SharedCalibration)
        self._drawn = -1
        gui = session.gui
        self._overview = LiveHtml(gui)
        self._note = gui.add_text("Note", "", hint="What a later reader should know of this calibration.")
        self._held = LiveHtml(gui)
        self._save = gui.add_button("Save calibration", icon=viser.Icon.DEVICE_FLOPPY)
        LiveHtml(gui, muted(_SAVE_NOTE))
        clear = gui.add_button("Forget what is not saved", color="gray")
        with gui.add_folder("Test pose"):
            self._pose = check_pose(session.console.robot)
            LiveHtml(gui, check_pose_html(self._pose))
            self._go = gui.add_button("Go to test pose")
            LiveHtml(gui, muted(_TEST_NOTE))
        with gui.add_folder("Earlier calibrations"):
            versions = self._desk.versions()
            self._versions = earlier_versions(versions)
            self._version = gui.add_dropdown("Version", tuple(self._versions))
            self._revert = gui.add_button("Revert", color="orange")
            LiveHtml(gui, muted(_REVERT_NOTE))
            LiveHtml(gui, kept_html(versions))
        session.on(self._save.on_click, self._on_save)
        session.on(clear.on_click, self._on_clear)
        session.on(self._go.on_click, self._on_go)
        session.on(self._revert.on_click, self._on_revert)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show what was measured, if that has changed, and what saving must wait for."""
        holds = snapshot.state is State.HOLDING
        if self._go.disabled == holds:
            self._go.disabled = not holds
        held = release_to_reopen(snapshot)
        self._held.show("" if held is None else muted(sentence(held)))
        for button in (self._save, self._revert):
            if button.disabled != (held is not None):
                button.disabled = held is not None
        if self._drawn != self._desk.work.version:
            self._drawn = self._desk.work.version
            self._overview.show(overview_html(self._desk.work) + draft_html(self._desk))

    async def _on_save(self) -> None:
        note = self._note.value.strip()
        if len(note) > _LONGEST_NOTE:
            raise InputError(f"the note has {len(note)} characters, {_LONGEST_NOTE} are allowed; shorten it")
        self._session.require_operator()
        self._session.robots.require_reopenable()
        saved = await self._desk.save(note)
        await self._take_effect("Calibration saved", str(saved.path).replace("/", f"/{_BREAK}"))

    async def _on_clear(self) -> None:
        self._session.require_operator()
        self._desk.work.clear()

    async def _on_go(self) -> None:
        session = self._session
        way = self._pose.q - session.snapshot.q_command
        await session.submit(MoveJoints(self._pose.q, slow_duration(session.console.robot, way)))

    async def _on_revert(self) -> None:
        self._session.require_operator()
        self._session.robots.require_reopenable()
        label = self._version.value
        await self._desk.revert(self._versions[label])
        await self._take_effect("Calibration reverted", label)

    async def _take_effect(self, title: str, text: str) -> None:
        """Open the arm anew by what is in force now; the page's next session shows it."""
        session = self._session
        session.notify(title, f"{text}. The arm is opened anew with it: enable it again on the tab Main.")
        await session.reopen_arm()


def earlier_versions(versions: Sequence[Version]) -> dict[str, int | None]:
    """Numbers by label of what can be gone back to, the version before the one in force first.

    The robot file itself, None, is always among them.
    """
    earlier = {version_label(one): one.number for one in versions[1:] if one.problem is None}
    return {**earlier, _ROBOT_FILE: None}

"""Manual: joints, jog, gripper, inputs and outputs; and beside the scene, on every tab: serial motion."""

from __future__ import annotations

from armctl.facts import State
from armctl.protocol import Snapshot
from armctl.ui.next_line import Told
from armctl.ui.session import Session
from armctl.ui.tabs.manual.by_hand import ByHand
from armctl.ui.tabs.manual.drawing import DrawingForm
from armctl.ui.tabs.manual.frames import FrameForm
from armctl.ui.tabs.manual.jog import JogControl
from armctl.ui.tabs.manual.joints import JointControl, LiveReadout
from armctl.ui.tabs.manual.link_ring import LinkRing
from armctl.ui.tabs.manual.program_ahead import ProgramAhead
from armctl.ui.tabs.manual.program_editor import ProgramEditor, ProgramRecord
from armctl.ui.tabs.manual.program_list import ProgramList, pass_words, short_words
from armctl.ui.tabs.manual.program_pins import ProgramPins
from armctl.ui.tabs.manual.program_run import ProgramFiles, ProgramRun
from armctl.ui.tabs.manual.scene_menu import SceneMenu
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.manual.signals import SignalPanel, kinds_of
from armctl.ui.widgets.html import LiveHtml, fixed, muted, strong

# Serial motion: a list of recorded steps, edited and run once, several times or for ever.


_PINS_HINT = "The path of the tool, and a pin where each step leads; click on one to select its step."
RESTORE, DELETE = "Yes, restore it", "No, delete it"


class SerialMotion:
    """The list of the program, and around it what changes and runs it."""

    def __init__(self, session: Session) -> None:
        self._shared = session.console.shared(SharedProgram)
        self._editor = ProgramEditor(session)
        gui = session.gui
        self._offer = LiveHtml(gui)
        self._answer = gui.add_button_group("Unsaved program", (RESTORE, DELETE), visible=False)
        self._list = ProgramList(session, self._editor, lambda: self._run.findings)
        self._pins = ProgramPins(session, self._editor)
        self._menu = SceneMenu(session, self._editor, self._pins)
        self._ring = LinkRing(session, self._pins.click)
        verdict = LiveHtml(gui)
        record, run = gui.add_folder("Record"), gui.add_folder("Run")
        more = gui.add_folder("More", expand_by_default=False)
        with record:
            self._record = ProgramRecord(session, self._editor, more)
        with run:
            self._run = ProgramRun(session, self._editor, verdict, more)
        with more:
            self._with_pins = gui.add_checkbox("Show tool path", initial_value=True, hint=_PINS_HINT)
        with gui.add_folder("Files", expand_by_default=False):
            self._files = ProgramFiles(session, self._run.check)
        self._session, self._ahead = session, session.console.shared(ProgramAhead)
        session.next.running = self._runs
        session.on(self._answer.on_click, self._on_answer)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw what has changed."""
        self._files.refresh()
        self._run.refresh()
        self._record.refresh()
        self._show_kept()
        self._list.refresh(snapshot)
        self._menu.refresh(snapshot)
        self._ring.refresh(snapshot)
        self._pins.refresh(snapshot, shown=self._with_pins.value)

    def _runs(self, snapshot: Snapshot) -> Told | None:
        """What the line under the scene says while a program runs."""
        at = snapshot.program
        if at is None:
            return None
        step, now = at.running.steps[at.step], self._ahead.underway(snapshot)
        how = [pass_words(at), *([at.inside] if at.inside else []), at.running.name]
        if snapshot.state is State.PAUSED:
            how.insert(0, "paused")
        elif now is not None and now.left:
            how.insert(0, f"{fixed(now.left, 1)} s left")
        return Told(f"Step {at.step + 1} of {at.steps}: {short_words(step)}", " · ".join(how))

    def _show_kept(self) -> None:
        """Offer what a console left unsaved; say where the present program is not kept."""
        left, kept = self._shared.left, self._shared.kept
        problem = "" if kept is None else kept.problem or ""
        self._answer.visible = left is not None
        self._offer.visible = bool(left or problem)
        if left is not None:
            self._offer.show(
                strong(f"Restore the unsaved program from {left.time}?")
                + muted("armctl ended before it was saved. Undo brings back what is on the list now.")
            )
        elif problem:
            self._offer.show(muted(f"A crash would lose what is not saved: {problem}"))

    async def _on_answer(self) -> None:
        self._session.require_operator()
        left = self._shared.left
        if left is not None:
            await self._shared.answer(left, restore=self._answer.value == RESTORE)


class ManualScreen:
    """Inner tabs, so that each fits a laptop's screen."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._readout = LiveReadout(session.console.robot)
        tabs = session.gui.add_tab_group()
        with tabs.add_tab("Joints"):
            self._joints = JointControl(session)
            self._by_hand = ByHand(session)
            self._readout.add_to(session.gui)
        with tabs.add_tab("Jog" if session.console.robot.gripper is None else "Jog & gripper"):
            self._jog = JogControl(session)
            self._readout.add_to(session.gui)
        self._signals: SignalPanel | None = None
        if session.console.robot.signals or kinds_of(session.console.robot):
            with tabs.add_tab("In & out"):
                self._signals = SignalPanel(session)
        with tabs.add_tab("Frames"):
            self._frames = FrameForm(session)
        with tabs.add_tab("Drawing"):
            DrawingForm(session)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
        if self._session.sees("Manual"):
            self._readout.refresh(snapshot)
        self._joints.refresh(snapshot)
        self._by_hand.refresh(snapshot)
        self._jog.refresh(snapshot)
        self._frames.refresh()
        if self._signals is not None:
            self._signals.refresh(snapshot)

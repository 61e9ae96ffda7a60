"""Recording steps, and changing the list of the program, by the page that operates."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, get_args

import numpy as np
import viser

from armctl.errors import ArmctlError, InputError, StateError
from armctl.motion import usual_pitch
from armctl.process.heavy_work import check_program_apart
from armctl.program import (
    CalledProgram,
    CallStep,
    CommentStep,
    MessageStep,
    MoveStep,
    Program,
    SpeedStep,
    Step,
    WaitStep,
)
from armctl.program import steps as registry
from armctl.program.base_steps import LONGEST_WAIT_S
from armctl.program.logic_steps import MOST_REPEATS
from armctl.program.message_step import LONGEST_MESSAGE, GoesOn
from armctl.program.motion_steps import tool_turn
from armctl.program.program import PLACES, Change, add, delete, duplicate, move, repeat
from armctl.program.rehearsal import pose_after
from armctl.program.standing_steps import EDGES, SLOWEST_PERCENT
from armctl.protocol import Party, Snapshot, UpdateProgram
from armctl.robot import Robot
from armctl.ui.events import OneAtATime
from armctl.ui.next_pose import PoseWriter
from armctl.ui.offers import refused_by
from armctl.ui.session import Session
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.angle_fields import slider_degrees
from armctl.ui.widgets.html import LiveHtml, muted, numbers
from armctl.ui.widgets.number_field import NumberField

EMPTY = "the list is empty; record a pose first"
EDIT_WAITS = "the edit takes effect at the next pass"


class ProgramEditor:
    """The selected row, and changes of the program: what the parts of the serial motion share on one page."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._shared = session.console.shared(SharedProgram)
        self._key, self._row = "", 0
        """of the selected row, and where it was last"""
        self.leads_nowhere = ""
        """why the step that was chosen leads to no next pose"""
        self._writer = PoseWriter(session, "", kept_words="step of a program, as it was")
        self._asked = self._shown = ""
        """keys of the step whose end is to be the next pose, and of the one whose end was made it last"""
        self._showing = OneAtATime(self._show_end)

    @property
    def selected(self) -> int:
        """Index of the selected row; where it has gone, of the one that has taken its place."""
        row = self._shared.row(self._key)
        return max(min(self._row, len(self._shared.keys) - 1), 0) if row is None else row

    @property
    def step(self) -> Step | None:
        """The selected step; None where the list is empty."""
        steps = self._shared.program.steps
        return steps[self.selected] if steps else None

    def select(self, row: int) -> None:
        """Select a row, from 0: it stays selected wherever it goes."""
        keys = self._shared.keys
        self._row, self._key = row, keys[row] if row < len(keys) else ""

    def choose(self, row: int) -> None:
        """Select a row, from 0, and make the pose to which it leads the next one; a page may watch."""
        self.select(row)
        self._ask(self._key)

    def follow(self) -> None:
        """The program was changed: what a step leads to may be another pose.

        Where the step is gone whose pose is the next one, it is that of the row that is selected now.
        """
        self.leads_nowhere = ""
        if self._writer.shown:
            gone = self._shared.row(self._shown) is None
            self.select(self.selected)
            self._ask(self._key if gone else self._shown)

    def _ask(self, key: str) -> None:
        self.leads_nowhere, self._asked = "", key
        self._session.spawn(self._showing.run())

    async def _show_end(self) -> None:
        """Planning the way there may take tenths of a second."""
        session, program, key = self._session, self._shared.program, self._asked
        row, start = self._shared.row(key), session.console.last_known.standing(session.snapshot)
        q, refused = None, ""
        if row is not None:
            try:
                linked = await self._shared.linked()
                q = await asyncio.to_thread(pose_after, session.held, linked, row, start)
            except ArmctlError as refusal:
                refused = f"step {row + 1}: {refusal}"
        if self._shared.program is not program or self._asked != key:
            return
        if q is not None and row is not None:
            self._shown, self._writer.words = key, f"step {row + 1}"
            self._writer.show(q)
        elif refused or self._shared.row(self._shown) is None:
            self.leads_nowhere = refused
            self._writer.hide()

    async def change(self, change: Callable[[Program], Change]) -> None:
        """Change list and selection, from the next pass on; refused if impossible, or on a watching page."""
        self._session.require_operator()
        changed, selected = change(self._shared.program)
        runs = await self._take_over(lambda: self._shared.edit(changed, self._me))
        self.select(selected)
        if runs:  # beside what else is done on the page
            self._session.spawn(self._session.attempt(partial(self._tell_next_pass, changed)))

    async def _tell_next_pass(self, changed: Program) -> None:
        """Say before the next pass that the arm would stop in it: only Run checks a program."""

        def progress(_: int, __: int) -> None:
            if self._shared.program is not changed or self._session.closed:
                raise StateError("the program was edited again")

        robot = self._session.console.robot
        try:
            linked = await self._shared.linked(self._running_called())
            found = await asyncio.to_thread(check_program_apart, linked, robot, progress=progress)
        except StateError:  # that edit is checked, too
            return
        error = next((finding for finding in found if finding.severity == "error"), None)
        if error is not None and self._shared.program is changed:
            text = f"{error}; edit it, or Undo"
            self._session.notify("The next pass would stop there", text, "yellow")

    def _running_called(self) -> tuple[CalledProgram, ...]:
        """What the program that runs calls was read when it began: that runs, whatever its files say now."""
        progress = self._session.snapshot.program
        return () if progress is None else progress.coming.called

    @property
    def _me(self) -> Party:
        return Party(self._session.me, self._session.name)

    async def undo(self, *, redo: bool = False) -> None:
        """Take the last change back, or make it again; refused as ``change``."""
        self._session.require_operator()
        await self._take_over(lambda: self._shared.undo(self._me, redo=redo))

    async def _take_over(self, edit: Callable[[], None]) -> bool:
        """Edit; if the arm runs what is edited, it is given the new version, too, and this is true."""
        shared, session = self._shared, self._session
        runs = shared.relation(session.snapshot.program) in ("running", "coming")
        edit()
        if runs:
            try:
                await session.submit(UpdateProgram(await shared.linked(self._running_called())))
            except StateError:
                if session.snapshot.program is not None:
                    raise
                return False  # it has ended meanwhile
        return runs


# Steps made of where the arm is.

SET_VIA, ADD_WAIT = "Set via", "Add wait"
_ARC = "Arc"
Point = tuple[float, float, float]
_END, _VIA = ("x_mm", "y_mm", "z_mm"), ("via_x_mm", "via_y_mm", "via_z_mm")
_RPY = ("rx_deg", "ry_deg", "rz_deg")
_DIGITS = 3
_SIGNAL_KEYS, _TIMEOUT_S = ("output", "watch", "timeout_s"), 10.0
_NOT_KNOWN = {
    "open_percent": "the gripper has not been told to move yet; press 'Set gripper' first",
    _VIA[0]: f"an arc needs a point on its way: bring the tool there and press {SET_VIA!r}, "
    f"then go on to its end and press {_ARC!r}",
}


def recorded_kinds(robot: Robot) -> dict[str, dict[str, type[Step]]]:
    """Rows of buttons: the label of each, and the kind of step that it records of an arm."""
    rows: dict[str, dict[str, type[Step]]] = {}
    there = {"open_percent"} if robot.gripper is not None else set[str]()
    there |= _signals_here(robot).keys()
    hand = robot.gripper is not None or "output" in there
    for kind in registry.KINDS:
        if kind.handles and not hand:
            continue
        if kind.button and not {"open_percent", *_SIGNAL_KEYS}.intersection(kind.button) - there:
            row, label, *_ = kind.button
            rows.setdefault(row, {})[label] = kind
    return rows


def step_here(kind: type[Step], robot: Robot, snapshot: Snapshot, via_mm: Point | None = None) -> Step:
    """A step made where the arm is; ``via_mm``: on an arc. ``StateError``: something is not known."""
    keys = kind.button[2:]
    here: dict[str, Any] = dict(zip(EDGES, snapshot.part_mm or (None, None, None), strict=True))
    here |= _signals_here(robot)
    if snapshot.gripper is not None:
        here["open_percent"] = here["close_percent"] = round(100 * snapshot.gripper, 1)
    elif kind.handles:  # closed, until it is edited in the row
        here["close_percent"] = 0.0
    if set(keys) - {"open_percent", "close_percent", *EDGES, *_SIGNAL_KEYS}:
        here |= _tool_here(robot, present_pose_deg(robot, snapshot))
    if via_mm is not None:
        here |= zip(_VIA, via_mm, strict=True)
    for key in keys:
        if key not in here:
            raise StateError(_NOT_KNOWN[key])
    if kind.handles and robot.gripper is None:
        keys = (*keys, "output")
    return kind(**{key: here[key] for key in keys})


def _signals_here(robot: Robot) -> dict[str, Any]:
    """Keys of steps about inputs and outputs: the first of each, to be edited in the row."""
    own = "" if robot.gripper is None else robot.gripper.output
    here: dict[str, Any] = {"timeout_s": _TIMEOUT_S}
    if outputs := [one.name for one in robot.signals.outputs if one.name != own]:
        here["output"] = outputs[0]
    if robot.signals.inputs:
        here["watch"] = robot.signals.inputs[0].name
    return here


def _tool_here(robot: Robot, pose_deg: tuple[float, ...]) -> Mapping[str, Any]:
    """Keys of steps and their values at a pose.

    Of an arm that can turn its tool about any axis, its orientation; else its pitch and roll, but no pitch
    where the place of the tool decides about it.
    """
    q = robot.read(pose_deg)
    angles: dict[str, float | None] = dict.fromkeys(("pitch_deg", "roll_deg", *_RPY))
    angles |= tool_turn(robot, q, _DIGITS)
    if robot.orients_tool:
        modes = {"pitch": None, "orientation": "interpolated"}
    else:
        modes = {"pitch": "free" if usual_pitch(robot) == "free" else None, "orientation": None}
        if modes["pitch"] is not None:
            angles["pitch_deg"] = None
    point = dict(zip(_END, tool_point_mm(robot, pose_deg), strict=True))
    return {"joints_deg": pose_deg, **point, **modes, **angles}


def tool_point_mm(robot: Robot, pose_deg: tuple[float, ...]) -> Point:
    """Where the tool is at a pose [mm], to a micrometre."""
    x, y, z = (np.round(1000 * robot.forward(robot.read(pose_deg))[:3, 3], _DIGITS) + 0.0).tolist()
    return x, y, z


def present_pose_deg(robot: Robot, snapshot: Snapshot) -> tuple[float, ...]:
    """The pose to record, in degrees: commanded, else as the board reports it; ``StateError``: not known."""
    q = snapshot.q_command if snapshot.commanded else snapshot.q
    if np.isfinite(q).all():
        return tuple(slider_degrees(robot, q))
    raise StateError(
        f"the arm is {snapshot.state.value}, so nobody knows where it stands; connect and enable it first"
    )


_EDITS: dict[str, Callable[[Program, int], Change]] = {
    "Up": lambda program, row: move(program, row, -1),
    "Down": lambda program, row: move(program, row, 1),
    "Duplicate": duplicate,
    "Delete": delete,
}
_MESSAGE_HINT = "What all pages, the terminal and the log show when the program comes there."
_NONE_SAVED = "no other program is saved yet; Save one in Files"
_TOOL_HINT = "Where the tool is: as a point, or as the end of a straight line or of an arc through 'via'."


class ProgramRecord:
    """Buttons that put steps on the list and move them about."""

    def __init__(self, session: Session, editor: ProgramEditor) -> None:
        self._session, self._editor = session, editor
        self._via_mm: Point | None = None
        self._kinds: dict[str, type[Step]] = {}
        gui = session.gui
        self._where = gui.add_dropdown("New steps go", PLACES, initial_value=PLACES[0])
        groups: list[viser.GuiButtonGroupHandle] = []
        for row, kinds in recorded_kinds(session.console.robot).items():
            self._kinds |= kinds
            labels = [*kinds]
            if _ARC in labels:
                labels.insert(labels.index(_ARC), SET_VIA)
            group = gui.add_button_group(row, labels, hint=_TOOL_HINT if _ARC in labels else None)
            session.on(group.on_click, partial(self._on_group, group))
            groups.append(group)
        session.needs(None, *groups, also=refused_by(self._require_known))
        self._seconds = NumberField(gui, "Wait s", 1.0)
        wait = gui.add_button_group("Add a pause", (ADD_WAIT,))
        session.needs(None, wait, told=False)
        session.on(wait.on_click, partial(self._on_group, wait))
        pose = partial(self._record, next(iter(self._kinds)))
        command = session.command("Record pose", pose, "Put the present pose on the list of Serial motion")
        session.needs(None, command, also=refused_by(self._require_known), told=False)
        session.on_press("record", "Record", self._on_record_next)
        self._via = LiveHtml(gui)
        self._via.visible = False
        edits = gui.add_button_group("Edit", tuple(_EDITS))
        self._shared = shared = session.console.shared(SharedProgram)
        session.needs(None, edits, also=lambda _: None if shared.program.steps else EMPTY, told=False)
        undo = gui.add_button_group("Take back", ("Undo",))
        redo = gui.add_button_group("Make again", ("Redo",))
        session.needs(None, undo, also=lambda _: shared.no_undo(), told=False)
        session.needs(None, redo, also=lambda _: shared.no_undo(redo=True), told=False)
        session.needs(None, also=lambda _: shared.no_undo() or shared.no_undo(redo=True))
        session.on(edits.on_click, lambda: self._edit(_EDITS[edits.value]))
        session.on(undo.on_click, editor.undo)
        session.on(redo.on_click, partial(editor.undo, redo=True))

    def add_extras(self) -> None:
        """Add speed, comment and repeat, which are not recorded from the arm, to the present container."""
        gui = self._session.gui
        percent = NumberField(gui, "Step speed %", 50)
        comment = gui.add_text("Comment", "")
        rows = gui.add_text("Rows to repeat", "", hint="E.g. 2-5. Empty: the selected row.")
        times = NumberField(gui, "How often", 2)
        group = gui.add_button_group("Add", ("Add speed", "Add comment", "Add repeat"))

        async def on_add() -> None:
            match group.value:
                case "Add speed":
                    await self._add(SpeedStep(percent=percent.within(SLOWEST_PERCENT, 100)))
                case "Add comment":
                    if not comment.value.strip():
                        raise InputError("Comment is empty; type it first")
                    await self._add(CommentStep(note=comment.value.strip()))
                case _:
                    often = times.whole(1, MOST_REPEATS)
                    await self._edit(lambda program, row: repeat(program, rows.value, row, often))

        self._session.on(group.on_click, on_add)

    def add_messages(self) -> None:
        """Add what tells the person something, and what runs a saved program, to the present container."""
        gui = self._session.gui
        text = gui.add_text("Message", "", hint=_MESSAGE_HINT)
        waits = gui.add_dropdown("Goes on", get_args(GoesOn))
        message = gui.add_button_group("Tell the person", ("Add message",))
        self._saved = gui.add_dropdown("Saved program", self._callable())
        call = gui.add_button_group("Run it there", ("Add call",))
        self._session.needs(None, message, told=False)
        self._session.needs(None, call, also=lambda _: None if self._shared.callable else _NONE_SAVED)

        async def on_message() -> None:
            if not text.value.strip():
                raise InputError("Message is empty; type it first")
            if len(text.value) > LONGEST_MESSAGE:
                raise InputError(f"Message: at most {LONGEST_MESSAGE} letters")
            await self._add(MessageStep(text=text.value.strip(), goes_on=waits.value))

        async def on_call() -> None:
            await self._add(CallStep(program=self._saved.value))

        self._session.on(message.on_click, on_message)
        self._session.on(call.on_click, on_call)

    def refresh(self) -> None:
        """Offer the programs that are saved now."""
        if self._saved.options != (names := self._callable()):
            self._saved.options = names

    def _callable(self) -> tuple[str, ...]:
        return tuple(self._shared.callable) or ("–",)

    def _require_known(self, snapshot: Snapshot) -> None:
        present_pose_deg(self._session.console.robot, snapshot)

    async def _add(self, step: Step) -> None:
        where = self._where.value
        await self._edit(lambda program, row: add(program, step, where, row))

    async def _edit(self, edit: Callable[[Program, int], Change]) -> None:
        row = self._editor.selected
        await self._editor.change(lambda program: edit(program, row))

    async def _on_record_next(self, key: str) -> None:
        """*Record* beside *Go*: the next pose is put on the list, or where the arm is."""
        self._session.next.require_seen(key)
        q = self._session.next.q
        if q is None:
            await self._record(next(iter(self._kinds)))
        else:
            await self._add(MoveStep(joints_deg=tuple(slider_degrees(self._session.console.robot, q))))

    async def _on_group(self, group: viser.GuiButtonGroupHandle) -> None:
        await self._record(group.value)

    async def _record(self, label: str) -> None:
        robot, snapshot = self._session.arm, self._session.snapshot
        if label == ADD_WAIT:
            await self._add(WaitStep(seconds=self._seconds.within(0, LONGEST_WAIT_S)))
        elif label == SET_VIA:
            self._session.require_operator()
            self._via_mm = tool_point_mm(robot, present_pose_deg(robot, snapshot))
            where = numbers(self._via_mm, 1)
            self._via.show(muted(f"Arc via ({where}) mm. Bring the tool to the arc's end, then press Arc."))
        else:
            await self._add(step_here(self._kinds[label], robot, snapshot, self._via_mm))
            if label == _ARC:
                self._via_mm = None
        self._via.visible = self._via_mm is not None

"""Recording steps, and what is done to the rows of the list."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from armctl.errors import InputError, StateError
from armctl.motion import usual_pitch
from armctl.program import (
    ArcStep,
    CommentStep,
    GripperStep,
    LineStep,
    MoveStep,
    PointStep,
    Program,
    SpeedStep,
    Step,
    WaitStep,
)
from armctl.program.steps import LONGEST_WAIT_S, MOST_REPEATS, SLOWEST_PERCENT
from armctl.robot import Robot
from armctl.runtime import Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs.program import editing as step_edit
from armctl.ui.tabs.program.editor import ProgramEditor
from armctl.ui.widgets.html import LiveHtml, muted, numbers
from armctl.ui.widgets.joint_angles import slider_degrees

# Steps made of where the arm stands.

POINT, LINE, SET_VIA, ARC = "Point", "Line", "Set via", "Arc"
"""labels of the buttons"""
Point = tuple[float, float, float]
_POINT_DIGITS = 3


def tool_point_mm(robot: Robot, pose_deg: tuple[float, ...]) -> Point:
    """Where the tool is at a pose [mm], to a micrometre."""
    x, y, z = np.round(1000 * robot.forward(np.radians(pose_deg))[:3, 3], _POINT_DIGITS).tolist()
    return x + 0.0, y + 0.0, z + 0.0


def step_here(kind: str, robot: Robot, pose_deg: tuple[float, ...], via_mm: Point | None) -> Step:
    """A step that leads to where the tool is.

    Args:
        kind: a button's label: point, line or arc.
        robot: the arm.
        pose_deg: (n,) where it stands.
        via_mm: the point on the arc, as set before.

    Raises:
        StateError: an arc without a via point.
    """
    x, y, z = tool_point_mm(robot, pose_deg)
    if kind == LINE:
        return LineStep(x_mm=x, y_mm=y, z_mm=z, pitch=usual_pitch(robot))
    if kind == POINT:
        pitch, roll = robot.inverse_kinematics.pitch_and_roll(np.radians(pose_deg))
        if usual_pitch(robot) == "free":  # the place decides about it
            pitch = None
        return PointStep(x_mm=x, y_mm=y, z_mm=z, pitch_deg=_degrees(pitch), roll_deg=_degrees(roll))
    if via_mm is None:
        raise StateError(
            f"an arc needs a point on its way: bring the tool there and press {SET_VIA!r}, "
            f"then go on to its end and press {ARC!r}"
        )
    via_x, via_y, via_z = via_mm
    return ArcStep(
        via_x_mm=via_x, via_y_mm=via_y, via_z_mm=via_z, x_mm=x, y_mm=y, z_mm=z, pitch=usual_pitch(robot)
    )


def _degrees(angle: float | None) -> float | None:
    return None if angle is None else round(float(np.degrees(angle)), _POINT_DIGITS) + 0.0


def present_pose_deg(robot: Robot, snapshot: Snapshot) -> tuple[float, ...]:
    """The pose to record, in degrees: what the arm was told last; before that, what its board says.

    Raises:
        StateError: the arm was told nothing, and its board does not know.
    """
    if snapshot.commanded:
        return tuple(slider_degrees(robot, snapshot.q_command))
    if np.isfinite(snapshot.q).all():
        return tuple(slider_degrees(robot, snapshot.q))
    raise StateError(
        f"the arm is {snapshot.state.value}, so nobody knows where it stands; connect and enable it first"
    )


def checked_seconds(value: float) -> float:
    """How long to wait [s].

    Raises:
        InputError: not finite, or outside 0 … 86400.
    """
    if not math.isfinite(value) or not 0 <= value <= LONGEST_WAIT_S:
        raise InputError(f"a wait of {value:g} s is outside 0 … {LONGEST_WAIT_S} s")
    return float(value)


_EDITS: dict[str, Callable[[Program, int], step_edit.Change]] = {
    "Up": lambda program, row: step_edit.shift(program, row, -1),
    "Down": lambda program, row: step_edit.shift(program, row, 1),
    "Duplicate": step_edit.double,
    "Delete": step_edit.remove,
}
_TOOL_HINT = "Where the tool is: as a point, or as the end of a straight line or of an arc through 'via'."


class ProgramRecord:
    """Buttons that put steps on the list and move them about."""

    def __init__(self, session: Session, editor: ProgramEditor) -> None:
        self._session = session
        self._editor = editor
        self._via_mm: Point | None = None
        gui = session.gui
        self._where = gui.add_dropdown("New steps go", step_edit.PLACES, initial_value=step_edit.PLACES[0])
        gripper = ("Record gripper",) if session.console.robot.gripper is not None else ()
        self._record = gui.add_button_group("Add step", ("Record pose", *gripper, "Add wait"))
        self._seconds = gui.add_number("Wait s", initial_value=1.0, min=0.0, max=LONGEST_WAIT_S, step=0.1)
        self._tool = gui.add_button_group("Record tool", (POINT, LINE, SET_VIA, ARC), hint=_TOOL_HINT)
        self._via = LiveHtml(gui)
        self._via.visible = False
        self._edit = gui.add_button_group("Edit", tuple(_EDITS))
        undo = gui.add_button_group("Take back", ("Undo", "Redo"))
        session.on(self._record.on_click, self._on_record)
        session.on(self._tool.on_click, self._on_tool)
        session.on(self._edit.on_click, self._on_edit)
        session.on(undo.on_click, lambda: editor.undo(redo=undo.value == "Redo"))

    async def add(self, step: Step) -> None:
        """Put a step where new ones go."""
        where, editor = self._where.value, self._editor
        await editor.change(lambda program: step_edit.add(program, step, where, editor.selected))

    def _pose_deg(self) -> tuple[float, ...]:
        return present_pose_deg(self._session.console.robot, self._session.snapshot)

    async def _on_record(self) -> None:
        match self._record.value:
            case "Record pose":
                await self.add(MoveStep(joints_deg=self._pose_deg()))
            case "Record gripper":
                opening = self._session.snapshot.gripper
                if opening is None:
                    raise StateError("the gripper has not been told to move yet; press 'Set gripper' first")
                await self.add(GripperStep(open_percent=round(100 * opening, 1)))
            case _:
                await self.add(WaitStep(seconds=checked_seconds(self._seconds.value)))

    async def _on_tool(self) -> None:
        robot, kind = self._session.console.robot, self._tool.value
        if kind == SET_VIA:
            self._session.require_operator()
            self._via_mm = tool_point_mm(robot, self._pose_deg())
            where = numbers(self._via_mm, 1)
            self._via.show(muted(f"Arc via ({where}) mm. Bring the tool to the arc's end, then press Arc."))
        else:
            await self.add(step_here(kind, robot, self._pose_deg(), self._via_mm))
            if kind == ARC:
                self._via_mm = None
        self._via.visible = self._via_mm is not None

    async def _on_edit(self) -> None:
        edit, row = _EDITS[self._edit.value], self._editor.selected
        await self._editor.change(lambda program: edit(program, row))


class ProgramExtras:
    """Speed, comment and repeat: what is not recorded from the arm."""

    def __init__(self, session: Session, editor: ProgramEditor, record: ProgramRecord) -> None:
        self._editor = editor
        self._record = record
        gui = session.gui
        self._percent = gui.add_number("Step speed %", initial_value=50, min=SLOWEST_PERCENT, max=100, step=1)
        self._comment = gui.add_text("Comment", "")
        self._rows = gui.add_text("Rows to repeat", "", hint="E.g. 2-5. Empty: the selected row.")
        self._times = gui.add_number("How often", initial_value=2, min=1, max=MOST_REPEATS, step=1)
        self._add = gui.add_button_group("Add", ("Add speed", "Add comment", "Add repeat"))
        session.on(self._add.on_click, self._on_add)

    async def _on_add(self) -> None:
        editor = self._editor
        match self._add.value:
            case "Add speed":
                percent = float(self._percent.value)
                if not SLOWEST_PERCENT <= percent <= 100:
                    raise InputError(f"speed: {percent:g} % is outside {SLOWEST_PERCENT} … 100 %")
                await self._record.add(SpeedStep(percent=percent))
            case "Add comment":
                note = self._comment.value.strip()
                if not note:
                    raise InputError("Comment is empty; type it first")
                await self._record.add(CommentStep(note=note))
            case _:
                rows, times = self._rows.value, int(self._times.value)
                await editor.change(lambda program: step_edit.wrap(program, rows, editor.selected, times))

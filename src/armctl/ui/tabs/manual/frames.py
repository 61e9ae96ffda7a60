"""User frames of the program: taught by three touches, listed, renamed, deleted, and drawn as axes."""

from __future__ import annotations

from collections.abc import Callable

import viser

from armctl.errors import InputError, StateError
from armctl.facts import State
from armctl.facts.angles import to_degrees
from armctl.kinematics import quaternion_wxyz
from armctl.program import FrameStep, Program, UserFrame
from armctl.program.edit import PLACES, add, delete_frame, put_frame, rename_frame
from armctl.program.frames import BASE, turn_errors
from armctl.protocol import Snapshot
from armctl.ui.session import Session
from armctl.ui.tabs.manual.new_step import Point, present_pose_deg, tool_point_mm
from armctl.ui.tabs.manual.program_editor import ProgramEditor
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.html import LiveHtml, fixed, muted, numbers, table

NEW = "a new frame"
TOUCHES = ("Origin", "On +x", "On the +y side")
RENAME, DELETE, ADD = "Rename", "Delete", "Add as step"
_TOUCH_HINT = (
    "Bring the tool's tip there, then press: the origin, a point on the x axis, a point on the side of y. "
    "The third press makes the frame; Undo takes it back."
)
_FRAME_HINT = "The one that is taught, renamed, deleted, or chosen by a step."
_USE = "A step with it on the list: what comes below is in this frame."
_NOTE = (
    "Points, lines, arcs and grids below a frame step of the program are given in that frame. Touch "
    "the three points anew where the fixture has been moved: the program goes with it."
)
_TOUCH_MM = 0.5
"""how true a touch by eye is taken to be"""
_AXES, _LABELLED = 0.18, 8
"""of the arm's reach: how long axes are drawn; so many frames have their names beside them"""


class FrameForm:
    """The controls of one page, and the axes in its scene."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        self._editor = ProgramEditor(session)
        self._shared = session.console.shared(SharedProgram)
        self._touched: dict[str, Point] = {}
        self._version = -1
        self._drawn: dict[str, UserFrame] = {}
        self._nodes: list[viser.FrameHandle | viser.LabelHandle] = []
        gui = session.gui
        self._chosen = gui.add_dropdown("Frame", self._choices(), hint=_FRAME_HINT)
        self._name = gui.add_text("Frame name", "frame 1")
        touch = gui.add_button_group("Touch here", TOUCHES, hint=_TOUCH_HINT)
        self._said = LiveHtml(gui)
        use = gui.add_button_group("Chosen frame", (ADD, RENAME, DELETE))
        session.needs(None, touch, told=False)
        session.needs(None, use, also=self._lacks, hint=_USE)
        self._list = LiveHtml(gui)
        LiveHtml(gui, muted(_NOTE))
        session.on(self._chosen.on_update, self._on_chosen)
        session.on(touch.on_click, lambda: self._on_touch(touch.value))
        session.on(use.on_click, lambda: self._on_use(use.value))
        self.refresh()

    def refresh(self) -> None:
        """Show the frames of the program, if it has changed."""
        if self._version == self._shared.version:
            return
        self._version = self._shared.version
        frames = self._shared.program.frames
        options = self._choices()
        if self._chosen.options != options:
            chosen = self._chosen.value
            self._chosen.options = options
            self._chosen.value = chosen if chosen in options else NEW
        if self._drawn != frames:
            self._drawn = dict(frames)
            self._draw()
        self._tell()

    def _lacks(self, _: Snapshot) -> str | None:
        return "choose a frame that was touched, or touch a new one" if self._chosen.value == NEW else None

    def _choices(self) -> tuple[str, ...]:
        return (NEW, BASE, *self._shared.program.frames)

    def _draw(self) -> None:
        while self._nodes:
            self._nodes.pop().remove()
        scene, size = self._session.client.scene, _AXES * self._robot.chain.length
        for k, (name, frame) in enumerate(self._drawn.items()):
            T = frame.matrix
            axes = scene.add_frame(
                f"/user_frames/{k}",
                axes_length=size,
                axes_radius=0.02 * size,
                origin_radius=0.04 * size,
                wxyz=quaternion_wxyz(T[:3, :3]),
                position=T[:3, 3] / 1000,
            )
            self._nodes.append(axes)
            if k < _LABELLED:
                self._nodes.append(scene.add_label(f"/user_frames/{k}/name", name))
        rows = [[name, *_numbers(frame)] for name, frame in self._drawn.items()]
        head = ("Frame", "X Y Z mm", "Rx Ry Rz °")
        self._list.show(table(head, rows) if rows else muted("The program has no frame yet."))

    def _tell(self) -> None:
        """Which touches there are, and how true the frame is that they make."""
        rows = [f"{name} ({numbers(point, 1)})" for name, point in self._touched.items()]
        missing = [name for name in TOUCHES if name not in self._touched]
        if not rows:
            self._said.show(muted(f"To teach it, touch three points: {', '.join(TOUCHES)}."))
        elif missing:
            self._said.show(muted(f"Touched: {', '.join(rows)} mm. Still to touch: {', '.join(missing)}."))
        else:
            origin, on_x, beside = (self._touched[name] for name in TOUCHES)
            errors = turn_errors(origin, on_x, beside, _TOUCH_MM)
            far = self._robot.chain.length / 2
            turned, off = numbers(to_degrees(errors).tolist(), 2), fixed(1000 * far * float(errors.max()), 1)
            self._said.show(
                muted(
                    f"Touched: {', '.join(rows)} mm. If each touch is true to {_TOUCH_MM:g} mm, the frame "
                    f"may be turned by {turned}° about its x, y and z: {off} mm at {1000 * far:.0f} mm from "
                    "its origin. Touches farther apart make it truer."
                )
            )

    async def _on_chosen(self) -> None:
        """Another frame: its touches are others."""
        self._touched.clear()
        self._name.value = self._free_name() if self._chosen.value in (NEW, BASE) else self._chosen.value
        self._tell()

    def _free_name(self) -> str:
        names = (f"frame {k}" for k in range(1, len(self._shared.program.frames) + 2))
        return next(name for name in names if name not in self._shared.program.frames)

    async def _on_touch(self, which: str) -> None:
        session = self._session
        session.require_operator()
        if session.snapshot.state is State.MOVING:
            raise StateError("the arm is moving; touch when it stands")
        self._touched[which] = tool_point_mm(session.arm, present_pose_deg(session.arm, session.snapshot))
        try:
            if len(self._touched) == len(TOUCHES):
                await self._teach(UserFrame.taught(*(self._touched[name] for name in TOUCHES)))
        except InputError:  # the press that gave no frame is forgotten, the others stay
            del self._touched[which]
            raise
        finally:
            self._tell()

    async def _teach(self, frame: UserFrame) -> None:
        if self._chosen.value == BASE:
            raise InputError("base is the frame of the arm; choose 'a new frame' above, or one to teach anew")
        new = self._chosen.value == NEW
        name = self._name.value.strip() if new else self._chosen.value
        if new and name in self._shared.program.frames:
            raise InputError(f"there is a frame {name!r} already; choose it above to teach it anew")
        await self._change(lambda program: put_frame(program, name, frame))
        self._chosen.value = self._name.value = name
        self._session.notify("Frame taught", f"{name}: {frame.describe()}. Undo takes it back.")

    async def _on_use(self, what: str) -> None:
        name = self._chosen.value
        if what == ADD:
            if name == NEW:
                raise InputError("choose the frame above that the next steps are to be in; base goes back")
            step = FrameStep(frame=name)
            await self._editor.change(lambda program: add(program, step, PLACES[0], 0))
            return
        if name in (NEW, BASE):
            raise InputError(f"choose the frame above that you want to {what.lower()}")
        if what == DELETE:
            await self._change(lambda program: delete_frame(program, name))
            return
        to = self._name.value.strip()
        await self._change(lambda program: rename_frame(program, name, to))
        self._chosen.value = to

    async def _change(self, change: Callable[[Program], Program]) -> None:
        """As any edit of the program: it can be undone, and counts from the next pass on."""
        row = self._editor.selected
        await self._editor.change(lambda program: (change(program), row))
        self.refresh()


def _numbers(frame: UserFrame) -> tuple[str, str]:
    place, turn = (frame.x_mm, frame.y_mm, frame.z_mm), (frame.rx_deg, frame.ry_deg, frame.rz_deg)
    return numbers(place, 1), numbers(turn, 2)

"""Drawing: a file, three touched points, a size; shown in the scene before the pen moves."""

from __future__ import annotations

import asyncio
from pathlib import Path, PurePath

import numpy as np
import viser

from armctl.documents import not_written, write_atomically
from armctl.drawing import DRAWING_SUFFIXES, DrawingPlane, PenDrawing
from armctl.drawing.files import parse_drawing, written_drawing
from armctl.drawing.plan import DrawingPlan
from armctl.errors import DrawingError, InputError, StateError
from armctl.facts import Need, State, say
from armctl.program import DrawStep, Program
from armctl.program.draw_step import FASTEST_MM_S, HIGHEST_LIFT_MM, WIDEST_MM
from armctl.program.edit import PLACES, add
from armctl.protocol import RunProgram, Snapshot
from armctl.ui.scene.ghost import Lines, segments
from armctl.ui.session import Session
from armctl.ui.tabs.manual.jog import SLOW_MM_S, ToolJog
from armctl.ui.tabs.manual.new_step import Point, present_pose_deg, tool_point_mm
from armctl.ui.tabs.manual.program_editor import ProgramEditor
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.tabs.manual.tool_steps import ToolSteps
from armctl.ui.widgets.html import LiveHtml, escape, fixed, folded, numbers, step_heading
from armctl.ui.widgets.number_field import NumberField, field_grid, in_row

_DRAWN, _LEFT_OUT, _PLANE = (66, 99, 235), (150, 150, 150), (46, 139, 87)
"""to be seen on a light ground and on a dark one"""
_TOUCHES = ("Origin", "To the right", "Upwards", "More")
_WHERE = {
    "Origin": "where the lower left corner of the drawing comes to lie",
    "To the right": "somewhere on its lower edge",
    "Upwards": "somewhere on its left edge",
}
_TOUCH_HINT = "Bring the pen's tip onto the surface, then press. More: further points, where it bends."
_FIT, _ADD, _DRAW, _SHOW = "Fit", "Add as step", "Draw", "Show"
_MOST_MORE = 20
_PREVIEW_POINTS = 2000


class DrawingForm:
    """The controls, and what is drawn of them in the scene of one page."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        self._editor = ProgramEditor(session)
        self._shared = session.console.shared(SharedProgram)
        self._touched: dict[str, Point] = {}
        self._more: list[Point] = []
        self._file: Path | None = None
        self._shift = (0.0, 0.0)
        gui, scene = session.gui, session.client.scene
        self._steps = [LiveHtml(gui, step_heading(1, "The drawing", done=False))]
        kinds = ",".join(DRAWING_SUFFIXES)
        with in_row(gui):
            self._upload = gui.add_upload_button(
                "Choose a drawing (SVG, G-code)", icon=viser.Icon.UPLOAD, mime_type=kinds
            )
        written = gui.add_form(None)
        with written:
            self._text = gui.add_text("Or write", "", hint="A name or a line of text, 20 mm high.")
        with in_row(gui, " "):
            write = gui.add_button("Write this", icon=viser.Icon.PENCIL, color="gray")
        self._said = LiveHtml(gui)
        self._steps.append(LiveHtml(gui))
        touch = gui.add_button_group("Touch here", _TOUCHES, hint=_TOUCH_HINT)
        self._plane_said = LiveHtml(gui)
        with gui.add_folder("Jog the tool", expand_by_default=False):
            ToolSteps(session)
            ToolJog(session, SLOW_MM_S)
        LiveHtml(gui, step_heading(3, "Size and pen", done=False))
        with field_grid(gui):
            self._width = NumberField(gui, "Width mm", 50.0, hint="Of the whole drawing.")
            self._speed = NumberField(gui, "Pen speed mm/s", 30.0)
            self._lift = NumberField(gui, "Lift mm", 10.0, hint="How high the pen is between strokes.")
        LiveHtml(gui, step_heading(4, "Look at it, then draw", done=False))
        look = gui.add_button_group(
            "Look", (_SHOW, _FIT), hint="Fit: smaller, and shifted, until all of it is in reach."
        )
        use = gui.add_button_group("Then", (_ADD, _DRAW))
        self._plan_said = LiveHtml(gui)
        self._drawn = Lines(scene, "/drawing/drawn", _DRAWN, 3.0)
        self._left_out = Lines(scene, "/drawing/left_out", _LEFT_OUT, 3.0)
        self._plane = Lines(scene, "/drawing/plane", _PLANE, 2.0)
        session.needs(None, self._upload, write, touch, told=False)
        session.needs(None, look, told=False, anyone=True, also=self._lacks)
        session.needs(Need.HOLDING, use, also=self._lacks)
        session.on(self._upload.on_upload, self._on_upload)
        session.on(written.on_submit, self._on_write)
        session.on(write.on_click, self._on_write)
        session.on(touch.on_click, lambda: self._on_touch(touch.value))
        session.on(look.on_click, lambda: self._on_fit() if look.value == _FIT else self._show())
        session.on(use.on_click, lambda: self._on_draw() if use.value == _DRAW else self._on_add())
        self._tell_plane()

    def _lacks(self, _: Snapshot) -> str | None:
        """What there must be before anything can be shown or drawn."""
        if self._file is None:
            return "choose a drawing first"
        return f"touch {', '.join(self._missing)} first" if self._missing else None

    @property
    def _missing(self) -> list[str]:
        """Of the plane, what is not touched yet."""
        return [name for name in _TOUCHES[:-1] if name not in self._touched]

    async def _on_upload(self) -> None:
        await self._take(PurePath(self._upload.value.name).name, self._upload.value.content)

    async def _on_write(self) -> None:
        await self._take(*written_drawing(self._text.value))

    async def _take(self, name: str, content: bytes) -> None:
        """Keep the file beside the programs, so that a saved program finds it."""
        self._session.require_operator()
        drawing = await self._session.work_out(parse_drawing, name, content)
        self._file = await asyncio.to_thread(_kept, self._shared.folder, name, content)
        low, high = drawing.box
        self._shared.file_came()
        self._shift = (0.0, 0.0)
        width, height = (high - low).tolist()
        self._width.fill(round(width, 1))
        count = len(drawing.strokes)
        size = f"{fixed(width, 1)} × {fixed(height, 1)} mm"
        said = (
            f"{preview_svg(drawing)}<b>{escape(name)}</b>: {count} stroke{'' if count == 1 else 's'}, {size}"
        )
        self._said.show(said + folded("Not drawn", drawing.left_out) if drawing.left_out else said)
        self._steps[0].show(step_heading(1, "The drawing", done=True))
        if len(self._touched) == len(_TOUCHES) - 1:
            await self._show()

    async def _on_touch(self, which: str) -> None:
        self._session.require_operator()
        if self._session.snapshot.state is State.MOVING:
            raise StateError("the arm is moving; touch when it stands")
        robot = self._session.arm
        point = tool_point_mm(robot, present_pose_deg(robot, self._session.snapshot))
        if which == "More":
            if len(self._more) == _MOST_MORE:
                raise InputError(
                    f"{_MOST_MORE} further points are touched already; touch the origin to begin anew"
                )
            self._more.append(point)
        else:
            if which == "Origin":
                self._more.clear()
            self._touched[which] = point
        self._tell_plane()
        if len(self._touched) == len(_TOUCHES) - 1:
            self._outline(DrawingPlane.touched(self._points()))

    def _tell_plane(self) -> None:
        rows = [
            f"<b>✓ {name}</b> ({numbers(self._touched[name], 1)}) mm"
            if name in self._touched
            else f"○ {name}: {where}"
            for name, where in _WHERE.items()
        ]
        more = "where the surface bends" if not self._more else f"{len(self._more)} touched"
        rows.append(f"{'✓' if self._more else '○'} More: {more}")
        self._plane_said.show("".join(f"<div>{row}</div>" for row in rows))
        self._steps[1].show(step_heading(2, "The surface", done=not self._missing))

    def _points(self) -> list[float]:
        if self._missing:
            raise InputError(f"the plane is not known yet; touch {', '.join(self._missing)}")
        points = [*(self._touched[name] for name in _TOUCHES[:-1]), *self._more]
        return [value for point in points for value in point]

    def _outline(self, plane: DrawingPlane) -> None:
        """The corner of the plane in the scene."""
        points = np.array(self._points()).reshape(-1, 3)[:3] / 1000
        corner = points[1] + points[2] - points[0]
        self._plane.show(segments(np.stack([*points[[0, 1]], corner, points[2], points[0]])))

    def _step(self) -> DrawStep:
        if self._file is None:
            raise InputError("no drawing is chosen yet")
        step = DrawStep(
            file=str(self._file),
            plane_mm=tuple(self._points()),
            width_mm=self._width.within(0.1, WIDEST_MM),
            right_mm=self._shift[0],
            up_mm=self._shift[1],
            pen_speed_mm_s=self._speed.within(0.1, FASTEST_MM_S),
            lift_mm=self._lift.within(0.1, HIGHEST_LIFT_MM),
        )
        step.check(self._robot)
        return step

    async def _show(self) -> DrawStep:
        """Plan it from where the arm stands, and draw it on the plane."""
        step = self._step()
        start = self._session.console.last_known.standing(self._session.snapshot)
        self._clear()
        plan = await self._session.work_out(step.drawn, self._session.held, start)
        self._draw_plan(plan)
        return step

    def _clear(self) -> None:
        self._drawn.hide()
        self._left_out.hide()
        self._plan_said.show("")

    def _draw_plan(self, plan: DrawingPlan) -> None:
        drawn = [segments(part.line) for part in plan.parts if len(part.line)]
        self._drawn.show(np.concatenate(drawn) if drawn else np.zeros((0, 2, 3)))
        grey = [segments(one.line) for one in plan.left_out]
        self._left_out.show(np.concatenate(grey) if grey else np.zeros((0, 2, 3)))
        tilt = abs(float(np.rad2deg(plan.hold.tilt)))
        tilted = f", the pen tilted by {tilt:.0f}°" if tilt else ""
        said = f"{1000 * plan.drawn_m:.0f} mm in {plan.trajectory.duration:.0f} s{tilted}."
        more = folded(
            f"{len(plan.left_out)} pieces are out of reach (grey)", [say(one.fact) for one in plan.left_out]
        )
        self._plan_said.show(f"<div>{said}</div>{more if plan.left_out else ''}")

    async def _on_fit(self) -> None:
        step, start = self._step(), self._session.console.last_known.standing(self._session.snapshot)
        self._clear()
        fitted = await self._session.work_out(step.fitted, self._session.held, start)
        self._shift = (fitted.right_mm, fitted.up_mm)
        if fitted.width_mm is not None:
            self._width.fill(fitted.width_mm)
        await self._show()

    async def _on_add(self) -> None:
        step = self._step()
        await self._editor.change(lambda program: add(program, step, PLACES[0], 0))

    async def _on_draw(self) -> None:
        """What is shown is what is drawn: planned here first, and checked again by the arm."""
        self._session.require_operator()
        step = await self._show()
        program = Program(robot=self._robot.name, name=Path(step.file).stem, steps=(step,))
        await self._session.submit(RunProgram(program, 1))


def preview_svg(drawing: PenDrawing) -> str:
    """The strokes as a picture, as high as five lines at most; of very many points some."""
    (left, low), (right, high) = (corner.tolist() for corner in drawing.box)
    every = 1 + sum(len(stroke.points) for stroke in drawing.strokes) // _PREVIEW_POINTS
    paths = ""
    for stroke in drawing.strokes:
        points = np.concatenate([stroke.points[:-1:every], stroke.points[-1:]]) * [1, -1] + [-left, high]
        paths += "M" + "L".join(f"{x:.2f} {y:.2f}" for x, y in points.tolist())
    width, height = max(right - left, 0.1), max(high - low, 0.1)
    return (
        f"<svg class='armctl-preview' viewBox='0 0 {width:.2f} {height:.2f}' role='img' "
        f"aria-label='The drawing'><path d='{paths}'/></svg>"
    )


def _kept(folder: Path, name: str, content: bytes) -> Path:
    """The file in a folder, under a name of its own where another one has that name."""
    plain = PurePath(name)
    for number in range(1, 1000):
        path = folder / (name if number == 1 else f"{plain.stem} {number}{plain.suffix}")
        try:
            if path.exists():
                if path.read_bytes() == content:
                    return path
                continue
            folder.mkdir(parents=True, exist_ok=True)
            write_atomically(path, content)
        except OSError as cause:
            raise DrawingError(not_written(path, cause)) from cause
        return path
    raise DrawingError(f"{name}: there are 999 other files of that name")

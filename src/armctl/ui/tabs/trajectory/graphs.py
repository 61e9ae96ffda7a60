"""The Graphs tab of a motion: plot, time cursor with the ghost, peaks, comparison, exports."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.errors import InputError
from armctl.motion.analysis import Derivative, Limit, analysis_csv, near_limits
from armctl.motion.figure import FigureForm, TitledMotion, color_of, figure_file
from armctl.protocol import Snapshot
from armctl.ui.events import Newest
from armctl.ui.scene.ghost import LOOKED_AT, Lines, Preview, played, segments
from armctl.ui.session import Session
from armctl.ui.tabs.trajectory.plan import PlannedMotion
from armctl.ui.widgets.graph import Bound, Curves, Graph, PlotLine, graph_html
from armctl.ui.widgets.html import LiveHtml, button, fixed, heading, muted, numbers, strong, table
from armctl.ui.widgets.number_field import choices_in_row

OF = ("Tool", "Joints")
QUANTITIES: dict[str, tuple[Derivative, str]] = {
    "Position": ("position", ""),
    "Velocity": ("velocity", "/s"),
    "Acceleration": ("acceleration", "/s²"),
    "Jerk": ("jerk", "/s³"),
}
"""what they are derivatives of, and the end of their unit"""
LIMITS = ("near", "all", "none")
_LIMITS_HINT = "Dashed lines, shaded beyond. near: those that the motion comes near to."
_JERK_NOTE = "Where the acceleration jumps (cubic at its ends, trapezoid), the jerk there has no bound."
_ZOOM_NOTE = "Click or drag in the graph to move the ghost; then the wheel zooms, with Shift it pans."
_COMPARE_NOTE = "Keep the shown motion as A, then show another: A is drawn thin and dashed beside it."
_CSV = "Motion (CSV)"
_FIGURE_FORMS: dict[str, FigureForm] = {"Figure (SVG)": "svg", "Figure (PNG)": "png"}
_FRAME_S = 1 / 25
_SLIDER_S = 0.15
"""a slider and a plot that are written more often make a page slow"""
_SPEEDS = 5, 400, 5
"""slowest, fastest, step"""
_SPEED_HINT = "Of the ghost; the arm does not move."
_PART = "graph"
_PATH_POINTS = 400


class GraphView:
    """The shown motion, and another one (A) kept before; a cursor or playing moves the ghost, not the arm."""

    def __init__(self, session: Session, preview: Preview) -> None:
        self._session, self._preview = session, preview
        self._shown: PlannedMotion | None = None
        self._a: PlannedMotion | None = None
        self._path = Lines(session.client.scene, "/shown_path", LOOKED_AT)
        self._newest = Newest()
        self._playing = False
        gui = session.gui
        self._curves: Curves | None = None
        self._graph = Graph(session, _PART, self._on_cursor, self._draw, scrolls=True)
        session.on_part("play", self._on_play)
        session.parts.add(gui, _PART)
        self._note = LiveHtml(gui, muted(_JERK_NOTE), visible=False)
        self._time = gui.add_slider("Time s", 0.0, 1.0, 0.001, initial_value=0.0, hint=_ZOOM_NOTE)
        with choices_in_row(gui):
            self._of = gui.add_dropdown("Graph of", OF)
            self._quantity = gui.add_dropdown("Quantity", tuple(QUANTITIES))
            self._limits = gui.add_dropdown("Limits", LIMITS, hint=_LIMITS_HINT)
        self._where = LiveHtml(gui)
        with gui.add_folder("Numbers and play speed", expand_by_default=False):
            self._speed = gui.add_slider("Play speed %", *_SPEEDS, initial_value=100, hint=_SPEED_HINT)
            self._joints = LiveHtml(gui)
            self._peaks = LiveHtml(gui)
        with gui.add_folder("Compare"):
            self._compared = LiveHtml(gui, muted(_COMPARE_NOTE))
            keep = gui.add_button("Keep as A", icon=viser.Icon.PIN, color="gray")
            self._drop = gui.add_button("Drop A", icon=viser.Icon.PINNED_OFF, color="gray", visible=False)
        self._export = gui.add_button_group("Export", (_CSV, *_FIGURE_FORMS))
        # the reason stands above already
        session.needs(None, keep, self._export, also=self._not_shown, told=False, anyone=True)
        for group in (self._of, self._quantity, self._limits):
            session.on(group.on_update, self._look)
        session.on(self._time.on_update, self._on_time)
        session.on(keep.on_click, lambda: self._keep(self._require_shown()))
        session.on(self._drop.on_click, lambda: self._keep(None))
        session.on(self._export.on_click, self._on_export)

    def refresh(self) -> None:
        """Draw the tool's path on its tab, for as long as no other screen shows something of its own."""
        self._path.set_visible(not self._preview.taken and self._session.sees("Trajectory"))

    def take(self, shown: PlannedMotion) -> None:
        """Show another motion: cursor and ghost stand at its end, the arm at its beginning."""
        self._halt()
        self._shown = shown
        self._graph.reset()
        self._peaks.show(peaks_html(shown))
        self._compare()
        time = np.linspace(0.0, shown.trajectory.duration, _PATH_POINTS)
        self._path.show(segments(shown.robot.forward(shown.trajectory.sample(time).q)[:, :3, 3]))
        self._time.value = 0.0
        end = max(math.ceil(1000 * shown.trajectory.duration - 1e-9), 1) / 1000  # never before the true end
        self._time.max = self._time.value = end
        self._look(draw=False)
        self._go(shown, self._time.value)

    @property
    def _beside(self) -> PlannedMotion | None:
        """A, where it is another motion than the one that is shown."""
        return None if self._a is self._shown else self._a

    @property
    def _longest_s(self) -> float:
        """How long the longer of the drawn motions lasts."""
        return max(one.trajectory.duration for one in (self._shown, self._beside) if one is not None)

    def _look(self, *, draw: bool = True) -> None:
        """Other curves."""
        if self._shown is not None:
            of, quantity, limits = self._of.value, self._quantity.value, self._limits.value
            self._note.visible = quantity == "Jerk"
            self._curves = curves(self._shown, of, quantity, limits, self._beside)
            if draw:
                self._place_cursor(self._time.value)
                self._draw()

    def _place_cursor(self, time: float) -> None:
        if (longest := self._longest_s) > 0.0:
            self._graph.share = min(time / longest, 1.0)

    def _draw(self) -> None:
        if self._curves is not None:
            heading = title(self._of.value, self._quantity.value)
            label, icon = ("Pause", "pause") if self._playing else ("Play", "play")
            play = button("play", label, icon=icon)
            self._session.parts.show(_PART, graph_html(self._graph, self._curves, heading, play))

    def _go(self, shown: PlannedMotion, time: float, *, draw: bool = True) -> None:
        time = min(time, shown.trajectory.duration)
        self._preview.show(shown.trajectory.sample(time).q, self._session.snapshot.q_command)
        if draw:
            self._where.show(tool_html(shown, time))
            self._joints.show(joints_html(shown, time))
            self._place_cursor(time)
            self._draw()

    def _on_time(self) -> None:
        self._halt()
        if self._shown is not None:
            self._go(self._shown, self._time.value)

    def _on_cursor(self, share: float) -> None:
        if self._shown is not None:
            self._halt()
            self._time.value = min(round(share * self._longest_s, 3), self._time.max)
            self._go(self._shown, self._time.value)

    def _on_play(self, _: str) -> None:
        if self._playing:
            self._halt()
        else:
            shown = self._require_shown()
            self._playing = True
            self._session.spawn(self._run(shown, self._newest.begin()))

    async def _run(self, shown: PlannedMotion, is_newest: Callable[[], bool]) -> None:
        clock, drawn, end = asyncio.get_running_loop().time, -1.0, shown.trajectory.duration
        begin = self._time.value if self._time.value < end - _FRAME_S else 0.0
        self._go(shown, begin, draw=False)
        async for time in played(begin, end, lambda: self._speed.value / 100, _FRAME_S):
            if not is_newest():
                return
            if self._preview.taken:
                break
            draw = clock() - drawn >= _SLIDER_S or time >= end
            with self._session.client.atomic():
                if draw:
                    drawn = clock()
                    self._time.value = self._time.max if time >= end else round(time, 3)
                self._go(shown, time, draw=draw)
        self._halt()

    def _halt(self) -> None:
        self._newest.drop()
        if self._playing:
            self._playing = False
            self._draw()

    def _keep(self, a: PlannedMotion | None) -> None:
        self._a = a
        self._compare()
        self._look()

    def _compare(self) -> None:
        self._drop.visible = self._a is not None
        if self._a is None or self._shown is None:
            self._compared.show(muted(_COMPARE_NOTE))
        elif self._a is self._shown:
            self._compared.show(muted(f"A is {self._a.title}. Choose another motion and press Show."))
        else:
            self._compared.show(compare_html(self._a, self._shown))

    async def _on_export(self) -> None:
        shown = self._require_shown()
        if self._export.value != _CSV:
            await self._export_figure(shown, _FIGURE_FORMS[self._export.value])
            return
        async with self._session.console.precedence.turn():
            text = await self._session.work_out(analysis_csv, shown.robot, shown.motion)
        self._session.download("motion.csv", text)

    async def _export_figure(self, shown: PlannedMotion, form: FigureForm) -> None:
        drawn = [TitledMotion(one.title, one.motion) for one in (shown, self._beside) if one is not None]
        async with self._session.console.precedence.turn():
            content = await self._session.work_out(figure_file, shown.robot, form, *drawn)
        if not self._session.closed:
            self._session.download(f"motion.{form}", content)

    def _not_shown(self, snapshot: Snapshot) -> str | None:
        del snapshot
        return "no motion is shown yet; press Show first" if self._shown is None else None

    def _require_shown(self) -> PlannedMotion:
        if self._shown is None:
            raise InputError("no motion is shown yet; press Show first")
        return self._shown


# What is drawn and written.

_MANY, _FLOOR = "#868e96", "#846358"
_OTHER_DASH = (3.0, 3.0)
_FLOOR_NEAR_M = 0.05
"""the floor is drawn where the tool comes this near"""


def title(of: str, quantity: str) -> str:
    """What is drawn, and its unit."""
    who, unit = ("Joint", "°") if of == "Joints" else ("Tool", "mm")
    return f"{who} {quantity.lower()} ({unit}{QUANTITIES[quantity][1]})"


def curves(shown: PlannedMotion, of: str, quantity: str, limits: str, beside: PlannedMotion | None) -> Curves:
    """One quantity of tool (mm) or joints (°); ``beside`` is drawn dashed."""
    time = shown.motion.time
    if beside is not None and beside.motion.time[-1] > time[-1]:  # the other one takes longer
        time = np.concatenate([time, beside.motion.time[beside.motion.time > time[-1]]])
    lines = _lines(shown, of, quantity, time, "" if beside is None else "B ")
    if beside is not None:
        others = _lines(beside, of, quantity, time, "A ")
        lines += [PlotLine(line.name, line.y, line.color, dash=_OTHER_DASH, width=1.2) for line in others]
    return Curves(time, tuple(lines), tuple(_limits(shown, of, quantity, limits)))


def _lines(shown: PlannedMotion, of: str, quantity: str, time: FloatArray, mark: str) -> list[PlotLine]:
    joints, tool = shown.motion.of(QUANTITIES[quantity][0])
    names, values, at = ["x", "y", "z"], 1000 * tool, shown.motion.time
    if of == "Joints":
        names, values = [joint.title for joint in shown.robot.joints], shown.robot.shown(joints)
    return [
        PlotLine(f"{mark}{name}", np.interp(time, at, values[:, i], right=np.nan), color_of(i, name))
        for i, name in enumerate(names)
    ]


def _limits(shown: PlannedMotion, of: str, quantity: str, limits: str) -> list[Bound]:
    robot, every = shown.robot, limits == "all"
    if limits == "none":
        return []
    if of == "Tool":
        near = float(shown.motion.position[:, 2].min()) < robot.floor_z + _FLOOR_NEAR_M
        if quantity != "Position" or not (near or every):
            return []
        return [Bound("floor", 1000 * robot.floor_z, _FLOOR, is_upper=False)]
    together: dict[tuple[float, bool], list[Limit]] = {}  # equal limits of several joints are one line
    for limit in near_limits(robot, shown.motion, QUANTITIES[quantity][0], every=every):
        together.setdefault((round(limit.value, 3), limit.is_upper), []).append(limit)
    bounds: list[Bound] = []
    for (value, is_upper), same in sorted(together.items(), reverse=True):
        first, alone = same[0], len(same) == 1
        who = robot.joints[first.joint].title if alone else f"{len(same)} joints"
        name = f"{who} {'≤' if is_upper else '≥'} {fixed(first.value, 1).removesuffix('.0')}"
        bounds.append(Bound(name, value, color_of(first.joint) if alone else _MANY, is_upper))
    return bounds


def named_html(planned: PlannedMotion) -> str:
    """What a motion is, and how long it takes."""
    return strong(f"{planned.title}: {fixed(planned.trajectory.duration, 2)} s")


def peaks_html(planned: PlannedMotion) -> str:
    """Largest joint speeds and accelerations against their limits, largest tool speed."""
    robot, motion, peaks = planned.robot, planned.motion, planned.peaks
    columns = (peaks.speed, robot.speed_limits, peaks.acceleration, robot.acceleration_limits)
    rows = [
        [joint.title, *(fixed(value, digits) for value, digits in zip(row, (1, 0, 1, 0), strict=True))]
        for joint, row in zip(
            robot.joints, np.column_stack([robot.shown(one) for one in columns]).tolist(), strict=True
        )
    ]
    tool_speed = 1000 * float(motion.tool_speed.max())
    tool_acceleration = 1000 * float(np.linalg.norm(motion.tool_acceleration, axis=1).max())
    asked = "" if planned.speed is None else f" (asked for: {fixed(1000 * planned.speed, 0)} mm/s)"
    return (
        heading("Peaks against the limits")
        + table(["largest", "speed °/s", "limit", "acc. °/s²", "limit"], rows)
        + muted(f"tool: at most {fixed(tool_speed, 1)} mm/s{asked} and {fixed(tool_acceleration, 0)} mm/s²")
    )


def tool_html(planned: PlannedMotion, time: float) -> str:
    """Where the tool is at one time [s], and how fast."""
    robot, state = planned.robot, planned.trajectory.sample(time)
    point = 1000 * robot.forward(state.q)[:3, 3]
    speed = 1000 * float(np.linalg.norm(robot.jacobian(state.q)[:3] @ state.velocity))
    step = planned.step_at(time)
    return (
        f"<div>at {fixed(time, 2)} s: tool (<b>{numbers(point.tolist(), 1)}</b>) mm, {fixed(speed, 1)} mm/s"
        f"{'' if step is None else f', step {step + 1}'}</div>"
    )


def joints_html(planned: PlannedMotion, time: float) -> str:
    """Where the joints are at one time [s], and how fast."""
    robot, state = planned.robot, planned.trajectory.sample(time)
    rows = [
        ["angle °", *(fixed(value, 2) for value in robot.shown(state.q).tolist())],
        ["°/s", *(fixed(value, 1) for value in robot.shown(state.velocity).tolist())],
        ["°/s²", *(fixed(value, 0) for value in robot.shown(state.acceleration).tolist())],
    ]
    titles = ["", *(joint.title for joint in robot.joints)]
    return f"<div style='font-size:11.5px'>{table(titles, rows)}</div>"


def compare_html(a: PlannedMotion, b: PlannedMotion) -> str:
    """Durations, peaks of the joints as a share of their limits, and the largest tool speeds of both."""
    robot = a.robot
    rows = [
        ["duration s", *(fixed(shown.trajectory.duration, 3) for shown in (a, b))],
        ["tool, largest mm/s", *(fixed(1000 * float(shown.motion.tool_speed.max()), 1) for shown in (a, b))],
    ]
    shares = np.column_stack(
        [one.peaks.speed / robot.speed_limits for one in (a, b)]
        + [one.peaks.acceleration / robot.acceleration_limits for one in (a, b)]
        + [np.abs(one.motion.jerk).max(axis=0) / robot.jerk_limits for one in (a, b)]
    )
    titled = zip(robot.joints, shares.tolist(), strict=True)
    percent = [[joint.title, *(fixed(100 * share, 0) for share in row)] for joint, row in titled]
    return (
        muted(f"A (dashed): {a.title}")
        + muted(f"B: {b.title}")
        + table(["", "A", "B"], rows)
        + table(["% of limit", "speed A", "B", "acc. A", "B", "jerk A", "B"], percent)
        + muted("Only quintic and s-curve keep the jerk limits; trapezoid and cubic jump in acceleration.")
    )

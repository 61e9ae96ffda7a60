"""The page of ``armctl replay``: a recorded minute played on the arm's figure. No arm is driven."""

from __future__ import annotations

import logging
from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.protocol import Recording
from armctl.protocol.recording import INPUT, OUTPUT
from armctl.robot import Robot
from armctl.ui.guard import GuardedServer
from armctl.ui.scene.arm_model import ARM, ArmFigure
from armctl.ui.scene.camera import look_at_arm
from armctl.ui.scene.ghost import THICKER, played
from armctl.ui.scene.stage import Stage, set_lights
from armctl.ui.widgets.graph import TALL_TICKS, Curves, PlotLine, legend, plot_html, thinned
from armctl.ui.widgets.html import ERROR, WARNING, LiveHtml, fixed, heading, muted, table

LOG = logging.getLogger("armctl.ui")
_WIDTH = 460
_FRAME_S = 1 / 30
_FRAMES_A_TEXT = 4
_SPEEDS = {"1/10": 0.1, "1/4": 0.25, "1/1": 1.0, "4/1": 4.0}
_TWIN = (240, 140, 0)
_LINES_SHOWN = 12
_MOST_POINTS = 600
_COLOR = {"warning": WARNING, "error": ERROR}


class ReplayApp:
    """Serves one recording; each page plays it for itself."""

    def __init__(self, recording: Recording, robot: Robot, server: GuardedServer) -> None:
        """``robot``: the arm of the recording, to be drawn."""
        self.server = server
        self._recording, self._robot = recording, robot
        server.gui.configure_theme(dark_mode=False, show_logo=False, show_share_button=False)
        set_lights(server.scene)
        self._stage = Stage(server.scene, robot)
        self._pages: dict[int, ReplayPage] = {}
        server.on_client_connect(self._connect)
        server.on_client_disconnect(self._disconnect)

    async def _connect(self, client: viser.ClientHandle) -> None:
        try:
            camera = client.camera
            look_at_arm(client, self._robot, picture=(camera.image_width - _WIDTH, camera.image_height))
            self._pages[client.client_id] = ReplayPage(client, self._recording, self._robot)
        except Exception:
            LOG.exception("a page could not be built")
            raise

    async def _disconnect(self, client: viser.ClientHandle) -> None:
        page = self._pages.pop(client.client_id, None)
        if page is not None:
            page.close()

    def close(self) -> None:
        """Stop serving."""
        self.server.stop()


class ReplayPage:
    """Play, pause and a slider over the time; the arm as it answered, orange where it was sent."""

    def __init__(self, client: viser.ClientHandle, recording: Recording, robot: Robot) -> None:
        self._client, self._recording, self._robot = client, recording, robot
        self._time = (recording.time_s - recording.clock_s).round(3)
        setpoint, readback = recording.setpoint, recording.readback
        # what is not known is drawn where it was known last
        self._sent, self._read = _filled(setpoint, robot), _filled(readback, robot, setpoint)
        self._arm = ArmFigure(client.scene, robot, ARM)
        self._twin = ArmFigure(client.scene, robot, "/setpoint", color=_TWIN, opacity=0.45, thicker=THICKER)
        gui = client.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_WIDTH)
        self._head = LiveHtml(gui, _head(recording))
        self._play = gui.add_button_group("Replay", ("Play", "Pause"))
        self._speed = gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1/1")
        first, last = float(self._time[0]), float(self._time[-1])
        step = 0.001
        self._at = gui.add_slider("Time s", first, max(last, first + step), step, initial_value=last)
        self._step = gui.add_button_group("One tick", ("Back", "Forward"))
        self._state = LiveHtml(gui)
        self._joint = gui.add_dropdown("Joint", recording.titles, initial_value=recording.titles[0])
        self._plot = LiveHtml(gui)
        self._story = LiveHtml(gui)
        self._now, self._run = last, 0
        self._on(self._play.on_click, self._on_play)
        self._on(self._at.on_update, lambda: self._go(self._at.value))
        self._on(self._step.on_click, self._on_step)
        self._on(self._joint.on_update, self._draw_plot)
        self._show(last)
        self._draw_text()

    def _on(self, attach: Callable[..., object], action: Callable[[], Any]) -> None:
        async def callback(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                result = action()
                if result is not None:
                    await result

        attach(callback)

    async def _on_play(self) -> None:
        self._run += 1
        mine, last = self._run, float(self._time[-1])
        if self._play.value == "Pause":
            self._draw_text()
            return
        begin = float(self._time[0]) if self._now >= last else self._now
        frame = 0
        async for at in played(begin, last, lambda: _SPEEDS[self._speed.value], _FRAME_S):
            if mine != self._run:
                return
            self._show(at)
            frame += 1
            if frame % _FRAMES_A_TEXT == 0:
                self._draw_text()
        self._draw_text()

    def close(self) -> None:
        """The page is gone."""
        self._run += 1

    def _on_step(self) -> None:
        way = 1 if self._step.value == "Forward" else -1
        self._go(float(self._time[np.clip(self._index + way, 0, len(self._time) - 1)]))

    def _go(self, at: float) -> None:
        self._run += 1
        self._show(at)
        self._draw_text()

    @property
    def _index(self) -> int:
        return max(int(np.searchsorted(self._time, self._now + 1e-9, side="right")) - 1, 0)

    def _show(self, at: float) -> None:
        self._now = at
        k = self._index
        with self._client.atomic():
            gripper = self._recording.column("gripper")[k]
            if self._recording.tools and self._robot.tools:
                robot = self._robot.with_tool(self._recording.tool_at(k))
                self._arm, self._twin = self._arm.wearing(robot), self._twin.wearing(robot)
            self._arm.pose(self._read[k], None if np.isnan(gripper) else float(gripper))
            self._twin.pose(self._sent[k])
            self._twin.root.visible = bool(np.isfinite(self._recording.setpoint[k]).all())

    def _draw_text(self) -> None:
        recording, k = self._recording, self._index
        state = recording.states[int(recording.column("state")[k])]
        sent, read = self._robot.shown(recording.setpoint[k]), self._robot.shown(recording.readback[k])
        rows = [
            [title, fixed(a, 2), fixed(b, 2), fixed(b - a, 2)]
            for title, a, b in zip(recording.titles, sent, read, strict=True)
        ]
        now = recording.time_s[k]
        when = recording.wall(now).strftime("%H:%M:%S.%f")[:-3]
        late, took = (1000 * recording.column(name)[k] for name in ("late_s", "took_s"))
        warned = [one.texts for one in recording.warnings if one.time_s <= now]
        warnings = "".join(
            f"<div style='color:{ERROR}'>⚠ {escape(text)}</div>" for text in (warned[-1] if warned else ())
        )
        with self._client.atomic():
            self._at.value = min(max(self._now, self._at.min), self._at.max)
            self._state.show(
                f"<b style='font-size:1.15em'>{escape(state.upper())}</b> at {when} ({fixed(self._now, 2)} s)"
                + table(("Joint", "Setpoint °", "Reading °", "Off °"), rows)
                + _signals(recording, k)
                + muted(f"this tick came {fixed(late, 1)} ms late and took {fixed(took, 1)} ms")
                + warnings
            )
            self._story.show(heading("Commands and log") + _story(recording, now))
            self._draw_plot()

    def _draw_plot(self) -> None:
        recording, joint = self._recording, self._recording.titles.index(self._joint.value)
        sent, read = (self._robot.shown(one)[:, joint] for one in (recording.setpoint, recording.readback))
        keep, here = thinned(len(self._time), _MOST_POINTS), self._index
        lines = (
            PlotLine("setpoint", sent[keep], "#e8590c"),
            PlotLine("reading", read[keep], "#1971c2", (3.0, 4.0), 2.2),
        )
        x = self._time[keep]
        if x[0] < x[-1]:
            values = [float(sent[here]), float(read[here])]
            share = (self._now - float(x[0])) / float(x[-1] - x[0])
            # no script of the console is here, so it is no part of the page, and has its looks alone
            self._plot.show(
                f"<armctl-part><header><b>{escape(self._joint.value)} (°)</b></header>"
                f"<div class='legend'>{legend(lines, values)}</div>"
                f"{plot_html(Curves(x, lines), TALL_TICKS, share)}</armctl-part>"
            )


def _filled(q: FloatArray, robot: Robot, other: FloatArray | None = None) -> FloatArray:
    """Angles (k, n) [rad] without NaN: those of ``other``, the last known ones, the rest pose."""
    found = q.copy() if other is None else np.where(np.isnan(q), other, q)
    last = robot.pose("rest")
    for k in range(len(found)):
        found[k] = last = np.where(np.isnan(found[k]), last, found[k])
    return found


def _head(recording: Recording) -> str:
    wall = recording.wall(recording.clock_s).isoformat(sep=" ", timespec="seconds")
    return (
        f"<b>{escape(recording.why)}</b><div>{escape(recording.robot)} on {escape(recording.board)}, "
        f"up to {wall}</div>"
        + muted("A recording: no arm is driven. The arm: as the board told. Orange: the setpoint.")
    )


def _signals(recording: Recording, k: int) -> str:
    """What inputs and outputs were at tick ``k``, and which tool was on; empty where there are none."""
    rows = [
        [name, f"{recording.ticks[k, i]:g}"]
        for i, name in enumerate(recording.columns)
        if name.startswith((INPUT, OUTPUT)) and np.isfinite(recording.ticks[k, i])
    ]
    rows += [["tool", recording.tool_at(k)]] if recording.tools else []
    return table(("", "was"), rows) if rows else ""


def _story(recording: Recording, now: float) -> str:
    happened = [
        (one.time_s, f"<b>{escape(one.who)}</b>: {escape(one.what)}"
         + (f" → {escape(one.answer)}" if one.answered_s is not None and one.answered_s <= now else ""))
        for one in recording.commands
    ]  # fmt: skip
    happened += [
        (one.time_s, f"<span style='color:{_COLOR.get(one.level, 'inherit')}'>{escape(one.text)}</span>")
        for one in recording.lines
    ]
    shown = [one for one in sorted(happened, key=lambda one: one[0]) if one[0] <= now][-_LINES_SHOWN:]
    return "".join(
        f"<div><span style='opacity:.6'>{fixed(at - recording.clock_s, 2)} s</span> {text}</div>"
        for at, text in reversed(shown)
    )

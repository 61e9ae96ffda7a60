"""The cursor of a motion: a slider over its time, or played, with the ghost and the numbers there."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import viser

from armctl.errors import InputError
from armctl.ui.screens.trajectory_graphs import cursor_html
from armctl.ui.screens.trajectory_motion import PlannedMotion
from armctl.ui.widgets.preview import Preview
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

_FRAME_S = 1 / 25
_SLIDER_S = 0.15
"""a slider and a plot that are written more often make a page slow"""
_SLOWEST, _FASTEST = 5, 400
_PATH_POINTS, _PATH_COLOR = 400, (0, 140, 170)
_PLAY, _PAUSE = "Play", "Pause"


class CursorView:
    """Moves the ghost along the shown motion; the arm does not move."""

    def __init__(self, session: Session, preview: Preview, moved: Callable[[float], None]) -> None:
        """Add the widgets to the present container; ``moved(time)`` is told where the cursor is [s]."""
        self._session, self._preview, self._moved = session, preview, moved
        self._robot = session.console.robot
        self._planned: PlannedMotion | None = None
        self._path: viser.LineSegmentsHandle | None = None
        self._turn = 0
        self._playing = False
        gui = session.gui
        self._box = gui.add_folder(None, visible=False)
        with self._box:
            self._slider = gui.add_slider("Time s", min=0.0, max=1.0, step=0.01, initial_value=0.0)
            self._play = gui.add_button(_PLAY, icon=viser.Icon.PLAYER_PLAY, color="gray")
            self._speed = gui.add_slider(
                "Play speed %", min=_SLOWEST, max=_FASTEST, step=5, initial_value=100,
                hint="Of the ghost; the arm does not move.",
            )  # fmt: skip
            self._where = LiveHtml(gui)
        session.on(self._slider.on_update, self._on_slider)
        session.on(self._play.on_click, self._on_play)

    def refresh(self) -> None:
        """Draw the tool's path for as long as no other screen shows something of its own."""
        if self._path is not None and self._path.visible == self._preview.taken:
            self._path.visible = not self._preview.taken

    def take(self, planned: PlannedMotion) -> None:
        """Another motion is shown: cursor and ghost stand at its end, the arm at its beginning."""
        self._halt()
        self._planned = planned
        self._draw_path(planned)
        self._slider.value = 0.0
        self._slider.max = self._slider.value = max(round(planned.trajectory.duration, 2), 0.01)
        self._box.visible = True
        self._go(self._slider.value)

    @property
    def time(self) -> float:
        """Where the cursor is [s]."""
        return self._slider.value

    async def _on_slider(self) -> None:
        self._halt()
        self._go(self._slider.value)

    def _go(self, time: float, *, draw: bool = True) -> None:
        planned = self._planned
        if planned is None:
            return
        time = min(time, planned.trajectory.duration)
        self._preview.show(planned.trajectory.sample(time).q, self._session.snapshot.q_command)
        if draw:
            self._where.show(cursor_html(self._robot, planned, time))
            self._moved(time)

    async def _on_play(self) -> None:
        if self._playing:
            self._halt()
            return
        if self._planned is None:
            raise InputError("there is no motion to play: press Show first")
        self._turn += 1
        self._playing = True
        self._play.label = _PAUSE
        self._play.icon = viser.Icon.PLAYER_PAUSE
        self._session.spawn(self._run(self._planned, self._turn))

    async def _run(self, planned: PlannedMotion, turn: int) -> None:
        clock = asyncio.get_running_loop().time
        end = planned.trajectory.duration
        time = self._slider.value if self._slider.value < end - _FRAME_S else 0.0
        before, drawn = clock(), -1.0
        while True:
            now = clock()
            time = min(time + (now - before) * self._speed.value / 100, end)
            before = now
            draw = now - drawn >= _SLIDER_S or time >= end
            with self._session.client.atomic():
                self._go(time, draw=draw)
                if draw:
                    drawn = now
                    self._slider.value = min(round(time, 2), self._slider.max)
            if time >= end:
                self._halt()
                return
            await asyncio.sleep(_FRAME_S)
            if turn != self._turn:
                return
            if self._preview.taken:
                self._halt()
                return

    def _draw_path(self, planned: PlannedMotion) -> None:
        if self._path is not None:
            self._path.remove()
        time = np.linspace(0.0, planned.trajectory.duration, _PATH_POINTS)
        points = self._robot.forward(planned.trajectory.sample(time).q)[:, :3, 3]
        self._path = self._session.client.scene.add_line_segments(
            "/shown_path", np.stack([points[:-1], points[1:]], axis=1), _PATH_COLOR, thickness=2.0,
            thickness_units="screen",
        )  # fmt: skip

    def _halt(self) -> None:
        self._turn += 1
        if self._playing:
            self._playing = False
            self._play.label = _PLAY
            self._play.icon = viser.Icon.PLAYER_PLAY

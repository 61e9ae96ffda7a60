"""Simulation: the motion drawn while it runs, and rehearsed without the arm."""

from __future__ import annotations

from collections import deque
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.runtime import Snapshot
from armctl.ui.console import Console, known
from armctl.ui.scene.ghost import Lines, segments
from armctl.ui.session import Session
from armctl.ui.tabs.simulation.joint_graph import ALL, JointGraph
from armctl.ui.tabs.simulation.live_target import LiveTarget
from armctl.ui.tabs.simulation.twin import TwinControl
from armctl.ui.tabs.simulation.workspace import WorkspaceView


class SimulationScreen:
    """Live target, twin, tool trail, joint graphs and workspace cloud; each page has its own."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._titles = [joint.title for joint in session.console.robot.joints]
        gui = session.gui
        with gui.add_folder("Live target"):
            self._live = LiveTarget(session)
        with gui.add_folder("Twin"):
            self._twin = TwinControl(session)
        with gui.add_folder("Joint graph"):
            self._joint = gui.add_dropdown("Show", (ALL, *self._titles), initial_value=ALL)
            self._graph_box = gui.add_folder(None)
            with self._graph_box:
                self._graph = JointGraph(gui, session.console.robot)
        with gui.add_folder("In the 3D view"):
            self._with_trail = gui.add_checkbox("Tool trail", initial_value=True)
            clear = gui.add_button_group("Trail so far", ("Clear trail",))
            self._trail = session.shared(Trail)
            self._cleared = self._drawn = 0
            self._line = Lines(session.client.scene, "/trail", _TRAIL_COLOR, 2.5)
            self._workspace = WorkspaceView(session)
        session.on(clear.on_click, self._on_clear)
        session.on(self._joint.on_update, self._on_joint)

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot."""
        self._live.refresh(snapshot)
        self._twin.refresh(snapshot)
        self._graph.add(snapshot, self._session.console.last_known.standing(snapshot))
        self._line.set_visible(self._with_trail.value)
        if self._with_trail.value and self._drawn != self._trail.count:
            self._draw_trail()
        self._workspace.refresh(snapshot)

    def _draw_trail(self) -> None:
        self._drawn = self._trail.count
        lines = segments(self._trail.since(self._cleared))
        self._line.show(lines[~np.isnan(lines).any(axis=(1, 2))])

    async def _on_joint(self) -> None:
        chosen = self._joint.value
        with self._graph_box:
            self._graph.choose(None if chosen == ALL else self._titles.index(chosen))

    async def _on_clear(self) -> None:
        self._cleared = self._trail.count
        self._draw_trail()


# The path of the tool point: kept once for all pages.

_TRAIL_POINTS = 600
_TRAIL_SPACING_M = 0.002
_TRAIL_COLOR = (214, 51, 108)


class Trail:
    """The newest tool points, at least 2 mm apart; no line goes over what nobody knows."""

    def __init__(self) -> None:
        self._points: deque[FloatArray] = deque(maxlen=_TRAIL_POINTS)
        self.count = 0
        """how many points were ever added"""

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Follow the arm from now on."""
        del before  # another arm, or one calibrated otherwise
        trail = cls()

        def follow(snapshot: Snapshot) -> None:
            if np.isnan(known(snapshot)).any():
                trail.lift()
            else:
                trail.add(console.robot.forward(console.last_known.drawn(snapshot))[:3, 3])

        console.frame_listeners.append(follow)
        return trail

    def add(self, point: FloatArray) -> None:
        """Add a tool point (3,) [m], if it lies far enough from the last one."""
        if not self._points or not np.linalg.norm(point - self._points[-1]) < _TRAIL_SPACING_M:
            self._append(point)

    def lift(self) -> None:
        """Where the tool goes from here on is not known: the line ends, the next point begins another."""
        if self._points and not np.isnan(self._points[-1]).any():
            self._append(np.full(3, np.nan))

    def since(self, first: int) -> FloatArray:
        """Points (k, 3) [m] that are still kept, from the ``first``-th ever added on, oldest first.

        A row of NaN stands between two lines.
        """
        dropped = self.count - len(self._points)
        kept = list(self._points)[max(first - dropped, 0) :]
        return np.array(kept).reshape(-1, 3)

    def _append(self, point: FloatArray) -> None:
        self._points.append(point.copy())
        self.count += 1

"""Joint angles of the last seconds as a live graph."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from html import escape

import numpy as np
import viser
from viser import uplot

from armctl.arrays import FloatArray
from armctl.robot import Robot
from armctl.runtime import Snapshot
from armctl.ui.widgets.html import LiveHtml, muted

SPAN_S = 20.0
_PERIOD_S = 0.2
_STILL_DEG = 0.02
_COLORS = ("#1971c2", "#e8590c", "#2f9e44", "#9c36b5", "#c92a2a", "#0c8599", "#5f3dc4", "#846358")
_HEIGHT = 200
ALL = "all joints"


class JointHistory:
    """Commanded and board angles of the last 20 s."""

    def __init__(self, n: int) -> None:
        self._rows: deque[tuple[float, FloatArray]] = deque()
        self._first, self._n = 0.0, n

    @property
    def full(self) -> bool:
        """It reaches back over the whole span."""
        return bool(self._rows) and self._rows[-1][0] - self._rows[0][0] > 0.98 * SPAN_S

    def add(self, stamp: float, q_command: FloatArray, q: FloatArray) -> None:
        """Add one state (n,) [rad]; one that is older than the span is dropped, as is a second of one stamp.

        Where the board does not know an angle, the commanded one takes its place, as in the drawn arm:
        the page's plot cannot fit a scale to what is no number.
        """
        if self._rows and stamp <= self._rows[-1][0]:
            return
        if not self._rows:
            self._first = stamp
        board = np.where(np.isnan(q), q_command, q)
        self._rows.append((stamp, np.degrees(np.concatenate([q_command, board]))))
        while stamp - self._rows[0][0] > SPAN_S:
            self._rows.popleft()

    def table(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times since the first state (k,) [s], commanded (k, n) and board angles (k, n) [degrees]."""
        if not self._rows:
            return np.zeros(1), np.zeros((1, self._n)), np.zeros((1, self._n))
        times = np.array([stamp for stamp, _ in self._rows]) - self._first
        angles = np.array([row for _, row in self._rows])
        return times, angles[:, : self._n], angles[:, self._n :]


class JointGraph:
    """The graph on one page; nothing is sent while all that it shows stands still."""

    def __init__(self, gui: viser.GuiApi, robot: Robot) -> None:
        """Add the graph of all joints to the present container."""
        self._gui, self._robot = gui, robot
        self._history = JointHistory(robot.n)
        self._sent_at = -np.inf
        self._still = False
        self._joints: Sequence[int] = range(robot.n)
        self._legend = LiveHtml(gui)
        self._plot = self._make()

    def choose(self, joint: int | None) -> None:
        """Show one joint, commanded and board; None: all joints."""
        self._joints = range(self._robot.n) if joint is None else [joint]
        plot = self._make()
        self._plot.remove()
        self._plot = plot

    def add(self, snapshot: Snapshot, standing: FloatArray) -> None:
        """Take a snapshot in and send the graph about five times a second.

        Args:
            snapshot: of the arm.
            standing: (n,) where the arm was commanded to be, or else where it was last known [rad].
        """
        self._history.add(snapshot.stamp, standing, snapshot.q)
        if snapshot.stamp - self._sent_at < _PERIOD_S:
            return
        data = self._data()
        still = self._history.full and all(np.ptp(column) < _STILL_DEG for column in data[1:])
        if not (still and self._still):
            self._sent_at, self._still = snapshot.stamp, still
            self._plot.data = data

    def _data(self) -> tuple[FloatArray, ...]:
        times, commanded, board = self._history.table()
        columns = [table[:, i] for table in (commanded, board) for i in self._joints]
        return (times, *(np.ascontiguousarray(column) for column in columns))

    def _make(self) -> viser.GuiUplotHandle:
        lines = [uplot.Series(label="time")]
        for dash, width, source in (((), 1.5, ""), ((3, 4), 2.5, " board")):
            lines += [
                uplot.Series(
                    label=f"{self._robot.joints[i].title}{source}",
                    stroke=_COLORS[i % len(_COLORS)],
                    width=width,
                    dash=dash,
                    points=uplot.Series_Points(show=False),
                )
                for i in self._joints
            ]
        self._still = False
        self._legend.show(legend_html(self._robot, self._joints))
        return self._gui.add_uplot(
            data=self._data(),
            series=tuple(lines),
            # No fixed range: the page fits the angles anew only when the times' ends move with the data.
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            axes=(
                uplot.Axis(label="time s", size=30, labelSize=18, labelGap=0),
                uplot.Axis(label="angle °", size=42, labelSize=18, labelGap=0),
            ),
            legend=uplot.Legend(show=False),  # it would name each joint twice
            height=_HEIGHT,
        )


def legend_html(robot: Robot, shown: Sequence[int]) -> str:
    """Each joint once, in its colour; and what solid and dotted lines are."""
    names = " ".join(
        "<span style='display:inline-block;margin-right:8px'>"
        f"<span style='color:{_COLORS[i % len(_COLORS)]}'>■</span> {escape(robot.joints[i].title)}</span>"
        for i in shown
    )
    return f"<div>{names}</div>{muted('Solid: commanded. Dotted: as the board tells it.')}"

"""Commanded against measured angles, and loads, of the last seconds or minutes: two graphs and a CSV file."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from html import escape
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.facts.angles import to_degrees
from armctl.hardware import Source
from armctl.lazy_dataclass import dataclass
from armctl.motion.figure import color_of
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.console import Console
from armctl.ui.session import Session
from armctl.ui.widgets.graph import TALL_TICKS, Bound, Curves, PlotLine, plot_html, thinned
from armctl.ui.widgets.html import LiveHtml, fixed, muted

SPANS = {"20 s": 20.0, "1 min": 60.0, "5 min": 300.0}
LONGEST_S = max(SPANS.values())
ALL = "all joints"
_APART_S = 0.04
"""from one row to the next at least: two ticks"""
_POINTS = 250
"""of a line, at most: so many a page hears of each, up to five times a second"""
_PERIOD_S, _STILL_DEG = 0.2, 0.02
_ANGLES, _LOADS = "joint-angles", "joint-loads"
_SPAN_HINT = "How far back the graphs go; armctl keeps five minutes."


@dataclass(frozen=True, slots=True, eq=False)
class JointRows:
    """What is known of a span of time, a row a moment."""

    time: FloatArray
    """(k,) since the first moment that was ever kept [s]"""
    commanded: FloatArray
    """(k, n) [degrees]"""
    board: FloatArray
    """(k, n) as the board tells them [degrees]; NaN where it does not"""
    load: FloatArray
    """(k, n) [%]; NaN where it is not measured"""

    def drawn(self) -> JointRows:
        """As many as a page can draw, with the time before the last moment, which is 0."""
        keep = thinned(len(self.time), _POINTS)
        time = self.time[keep] - self.time[-1]
        return JointRows(time, self.commanded[keep], self.board[keep], self.load[keep])


class JointHistory:
    """Angles and loads of the last minutes, kept once for all pages."""

    def __init__(self, titles: Sequence[str]) -> None:
        self._titles, self._n = tuple(titles), len(titles)
        self._rows: deque[tuple[float, FloatArray]] = deque()
        self._first = 0.0

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """Follow the arm from now on."""
        del before  # another arm, or one calibrated otherwise
        history = cls([joint.title for joint in console.robot.joints])

        def follow(snapshot: Snapshot) -> None:
            history.add(snapshot, console.last_known.standing(snapshot))

        console.frame_listeners.append(follow)
        return history

    def add(self, snapshot: Snapshot, standing: FloatArray) -> None:
        """Add a moment; ``standing`` (n,): where the arm was commanded to be, else last known [rad]."""
        stamp = snapshot.stamp
        if self._rows and stamp - self._rows[-1][0] < _APART_S:
            return
        if not self._rows:
            self._first = stamp
        found = [snapshot.quantities.get(title) for title in self._titles]
        load = [np.nan if one is None or one.load is None else 100 * one.load for one in found]
        self._rows.append((stamp, np.concatenate([to_degrees(standing), to_degrees(snapshot.q), load])))
        while stamp - self._rows[0][0] > LONGEST_S:
            self._rows.popleft()

    def since(self, span: float) -> JointRows:
        """The last ``span`` seconds."""
        n, last = self._n, self._rows[-1][0] if self._rows else 0.0
        kept = [row for row in self._rows if last - row[0] <= span] or [(0.0, np.full(3 * n, np.nan))]
        values = np.array([row for _, row in kept])
        times = np.array([stamp for stamp, _ in kept]) - self._first
        return JointRows(times, values[:, :n], values[:, n : 2 * n], values[:, 2 * n :])


class JointGraph:
    """The graphs on one page; nothing is sent while all that they show stands still, or nobody sees them."""

    def __init__(self, session: Session) -> None:
        self._session, self._robot = session, session.console.robot
        self._titles = [joint.title for joint in self._robot.joints]
        self._history = session.console.shared(JointHistory)
        self._drawn_at, self._still = -np.inf, False
        self._joints: Sequence[int] = range(self._robot.n)
        gui = session.gui
        self._joint = gui.add_dropdown("Show", (ALL, *self._titles), initial_value=ALL)
        self._span = gui.add_dropdown("Last", tuple(SPANS), hint=_SPAN_HINT)
        self._legend = LiveHtml(gui)
        session.parts.add(gui, _ANGLES)
        self._error = LiveHtml(gui)
        session.parts.add(gui, _LOADS)
        self._missing = LiveHtml(gui)
        csv = gui.add_button_group("Download", ("CSV",))
        session.on(self._joint.on_update, self._on_choice)
        session.on(self._span.on_update, self._on_choice)
        session.on(csv.on_click, self._on_csv)
        self._draw(session.snapshot)

    def refresh(self, snapshot: Snapshot, *, seen: bool) -> None:
        """Draw about five times a second while it is ``seen``; a long span less often."""
        period = max(_PERIOD_S, SPANS[self._span.value] / _POINTS)
        if not seen:
            self._still = False
        elif not 0 <= snapshot.stamp - self._drawn_at < period:
            self._draw(snapshot)

    def _on_choice(self) -> None:
        chosen = self._joint.value
        self._joints = [i for i, title in enumerate(self._titles) if chosen in (ALL, title)]
        self._still = False
        self._draw(self._session.snapshot)

    def _on_csv(self) -> None:
        rows = self._history.since(SPANS[self._span.value])
        name = "joints.csv" if self._joint.value == ALL else f"{self._robot.joint_names[self._joints[0]]}.csv"
        self._session.download(name, rows_csv(self._titles, rows, self._joints))

    def _draw(self, snapshot: Snapshot) -> None:
        rows = self._history.since(SPANS[self._span.value])
        self._drawn_at = snapshot.stamp
        whole = np.ptp(rows.time) > 0.98 * SPANS[self._span.value]
        shown = np.concatenate([rows.commanded, rows.board], axis=1)[:, :, None]
        still = whole and not (np.nanmax(np.ptp(shown, axis=0), initial=0.0) >= _STILL_DEG)
        self._legend.show(legend_html(self._robot, self._joints, snapshot.source))
        self._missing.show(missing_html(snapshot))
        if still and self._still:
            return
        self._still = bool(still)
        self._error.show(error_html(self._titles, rows, self._joints, snapshot.source))
        drawn = rows.drawn()
        limits = [snapshot.limits.get(title) for title in self._titles]
        most = [None if one is None else one.load for one in limits]
        angles = angle_curves(self._robot, drawn, self._joints, snapshot.source)
        loads = load_curves(self._robot, drawn, self._joints, most)
        measured = not np.isnan(rows.load[:, self._joints]).all()
        self._session.parts.show(_ANGLES, _plot("Angle (°)", angles))
        self._session.parts.show(_LOADS, _plot("Load (%)", loads) if measured else "")


# What is drawn and written.


def _plot(heading: str, curves: Curves) -> str:
    """A graph up to now; empty as long as there is a single moment."""
    if curves.x[0] == curves.x[-1]:
        return ""
    return f"<header><b>{heading}</b></header>{plot_html(curves, TALL_TICKS)}"


def angle_curves(robot: Robot, rows: JointRows, joints: Sequence[int], source: Source) -> Curves:
    """Commanded angles drawn through, those of the board dotted, where it tells any of its own."""
    kinds: list[tuple[FloatArray, str, tuple[float, float] | None, float]]
    kinds = [(rows.commanded, "commanded", None, 1.5)]
    if source is not Source.COMMANDED:
        kinds.append((rows.board, source.value, (3.0, 4.0), 2.5))
    lines = [
        PlotLine(f"{robot.joints[i].title} {what}", angles[:, i], color_of(i), dash, width)
        for angles, what, dash, width in kinds
        for i in joints
    ]
    return Curves(rows.time, tuple(lines))


def load_curves(
    robot: Robot, rows: JointRows, joints: Sequence[int], limits: Sequence[float | None]
) -> Curves:
    """Loads [%]; of a joint by itself both limits, a share."""
    lines = [PlotLine(robot.joints[i].title, rows.load[:, i], color_of(i)) for i in joints]
    bounds: list[Bound] = []
    if len(joints) == 1 and (limit := limits[joints[0]]) is not None:
        bounds = [Bound("limit", 100 * way * limit, "#868e96", way > 0) for way in (1.0, -1.0)]
    return Curves(rows.time, tuple(lines), tuple(bounds))


def error_html(titles: Sequence[str], rows: JointRows, joints: Sequence[int], source: Source) -> str:
    """The following error now, and its largest in that time; of several joints that of the worst."""
    away = rows.board[:, joints] - rows.commanded[:, joints]
    if source is not Source.MEASURED or np.isnan(away[-1]).all():
        why = "not known now" if source is Source.MEASURED else "nothing is measured"
        return f"<div>Following error: {why}</div><div>&nbsp;</div>"

    def told(errors: FloatArray) -> str:
        worst = int(np.nanargmax(np.abs(errors)))
        which = "" if len(joints) == 1 else f" ({escape(titles[joints[worst]])})"
        return f"<b>{fixed(float(errors[worst]), 2)}°</b>{which}"

    most = np.fmax.reduce(np.abs(away), axis=0)
    return (
        f"<div>Following error now: {told(away[-1])}</div>"
        f"<div>Largest of these {np.ptp(rows.time):.0f} s: {told(most)}</div>"
    )


def legend_html(robot: Robot, shown: Sequence[int], source: Source) -> str:
    """Each joint once, in its colour; and what solid and dotted lines are."""
    names = " ".join(
        "<span style='display:inline-block;margin-right:8px'>"
        f"<span style='display:inline-block;color:{color_of(i)};filter:var(--armctl-of)'>■</span> "
        f"{escape(robot.joints[i].title)}</span>"
        for i in shown
    )
    dotted = "" if source is Source.COMMANDED else f" Dotted: {source.value}."
    return f"<div>{names}</div>{muted(f'Solid: commanded.{dotted}')}"


_TELLS = {
    Source.COMMANDED: "This board tells no positions: only what was commanded is drawn.",
    Source.TRANSMITTED: "This board tells what it sends to the servos, not where they are.",
    Source.MEASURED: "",
}


def missing_html(snapshot: Snapshot) -> str:
    """What the board does not measure."""
    if snapshot.board is None:
        return muted("No board is connected.")
    loads = any(one.load is not None for one in snapshot.quantities.values())
    told = " ".join(filter(None, (_TELLS[snapshot.source], "" if loads else "It measures no loads.")))
    return muted(told) if told else ""


def rows_csv(titles: Sequence[str], rows: JointRows, joints: Sequence[int]) -> str:
    """All moments of these joints: time, commanded and board's angles, and loads where any is measured."""
    kinds = [(rows.commanded, "commanded °"), (rows.board, "board °"), (rows.load, "load %")]
    columns = [rows.time, *(values[:, i] for i in joints for values, _ in kinds)]
    heads = ["time s", *(f"{titles[i]} {what}" for i in joints for _, what in kinds)]
    lines = [",".join(f'"{head}"' if "," in head else head for head in heads)]
    for row in np.column_stack(columns).tolist():
        lines.append(",".join("" if np.isnan(value) else f"{value:.6g}" for value in row))
    return "\n".join(lines) + "\n"

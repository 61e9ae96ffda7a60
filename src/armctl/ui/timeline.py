"""A motion over time, under the scene: to the next pose, or the program's; a ghost stands at the cursor."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np

from armctl.arrays import FloatArray
from armctl.lazy_dataclass import dataclass
from armctl.motion import Trajectory
from armctl.motion.figure import color_of
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.scene.ghost import Preview
from armctl.ui.session import Session
from armctl.ui.tabs.manual.program_ahead import ProgramAhead
from armctl.ui.tabs.manual.shared_program import SharedProgram
from armctl.ui.widgets.graph import Bound, Curves, Graph, PlotLine, legend
from armctl.ui.widgets.html import button, fixed, sentence

_PART, _TICKS = "timeline", 4
QUANTITIES = {"Angle": "°", "Speed": "°/s", "Accel.": "°/s²", "Tool": "mm"}
"""what can be drawn, and its unit"""
_NOTHING = "The motion to the next pose is drawn here."
_MOTIONS = {"pose": "Next pose", "program": "Program"}
"""what motions can be drawn"""
_BOUND_FROM = 0.7
"""a joint that comes so near to its limit has it drawn"""
_OPEN, _FOLDED = "open", "folded"


@dataclass(frozen=True, eq=False)
class Track:
    """One quantity of a motion over time."""

    names: tuple[str, ...]
    values: FloatArray
    """(k, lines) in the unit of the quantity"""
    nearest: str = ""
    """the joint that comes nearest to its limit, and how near; empty where there is none"""
    line: int = 0
    """which of the lines that is"""
    bounds: tuple[float, float] | None = None
    """lower and upper limit of that joint; None: it stays far from them"""

    def curves(self, times: FloatArray) -> Curves:
        """It as it is drawn, at ``times`` (k,) [s]."""
        colors = [color_of(i) for i in range(len(self.names))]
        lines = tuple(map(PlotLine, self.names, self.values.T, colors))
        sides = zip(self.bounds or (), (False, True), strict=False)
        bounds = (Bound(self.nearest, value, colors[self.line], is_upper) for value, is_upper in sides)
        return Curves(times, lines, tuple(bounds))


def track(robot: Robot, motion: Trajectory, quantity: str, times: FloatArray) -> Track:
    """A quantity at ``times`` (k,) [s]: of every joint, or of the tool."""
    state = motion.sample(times)
    if quantity == "Tool":
        return Track(("X", "Y", "Z"), 1000 * robot.forward(state.q)[..., :3, 3])
    names = tuple(joint.title for joint in robot.joints)
    if quantity == "Angle":
        low, high = robot.limits.T
        shares = np.abs((state.q - 0.5 * (low + high)) / (0.5 * (high - low))).max(axis=0)
        values, what = state.q, "of the way to its limit"
    elif quantity == "Speed":
        low, high = -robot.speed_limits, robot.speed_limits
        shares, values, what = np.abs(state.velocity / high).max(axis=0), state.velocity, "of its speed limit"
    else:
        low, high = -robot.acceleration_limits, robot.acceleration_limits
        shares = np.abs(state.acceleration / high).max(axis=0)
        values, what = state.acceleration, "of its acceleration limit"
    most = int(shares.argmax())
    ends = robot.shown(low)[most], robot.shown(high)[most]
    bounds = (float(ends[0]), float(ends[1])) if shares[most] >= _BOUND_FROM else None
    near = f"{names[most]} at {100 * shares[most]:.0f} % {what}"
    return Track(names, robot.shown(values), near, most, bounds)


class Timeline:
    """One page's; folded until somebody opens it, and the browser remembers that."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._ahead = session.console.shared(ProgramAhead)
        self._shared = session.console.shared(SharedProgram)
        self._looked_at = Preview(session.ghost, None)
        self._open = False
        self._shows, self._quantity = "pose", next(iter(QUANTITIES))
        self._drawn: tuple[object, ...] = ()
        """what is drawn, apart from what is done here"""
        self._motion: Trajectory | None = None
        self._speed = 1.0
        """the override"""
        self.graph = Graph(session, _PART, self._on_cursor, self._draw)
        for do, action in {
            "timeline": self._on_fold,
            "timeline-of": self._on_motion,
            "timeline-shows": self._on_quantity,
            "timeline-csv": self._on_csv,
        }.items():
            session.on_part(do, action)
        session.parts.show(_PART, "")
        session.spawn(self._recall())

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw the motion, where it is another one."""
        whole = self._shows == "program"
        if whole and self._open:
            self._ahead.look(self._session, snapshot)
        motion = self._ahead.motion if whole else self._session.next.trajectory
        now = motion, snapshot.speed, self._running(snapshot), self._ahead.note if whole else ""
        if now != self._drawn:
            if motion is not self._motion:
                self._motion = motion
                self.graph.reset()
                self._looked_at.hide()
            self._drawn, self._speed = now, snapshot.speed
            self._draw()
        self._looked_at.refresh(snapshot.q_command)

    def _running(self, snapshot: Snapshot) -> int | None:
        """The step of the program on the list that runs."""
        at = snapshot.program
        return at.step if at is not None and self._shared.relation(at) == "running" else None

    async def _recall(self) -> None:
        self._open = await self._session.recall("timeline") == _OPEN
        self._draw()

    # What is done here.

    def _on_fold(self, _: str) -> None:
        self._open = not self._open
        self._session.remember("timeline", _OPEN if self._open else _FOLDED)
        self._looked_at.hide()
        self._draw()

    def _on_motion(self, key: str) -> None:
        if key in _MOTIONS:
            self._shows = key
            self._draw()

    def _on_quantity(self, key: str) -> None:
        if key in QUANTITIES:
            self._quantity = key
            self._draw()

    def _on_cursor(self, share: float) -> None:
        motion = self._motion
        if motion is None:
            return
        self.graph.share = share
        if share < 1.0:
            q = motion.sample(share * motion.duration).q
            self._looked_at.show(q, self._session.snapshot.q_command)
        else:
            self._looked_at.hide()
        self._draw()

    def _on_csv(self, _: str) -> None:
        """What is drawn, as it is drawn: at the present override, the part that is in view."""
        motion = self._motion
        if motion is None:
            return
        times = self.graph.times(motion.duration)
        drawn = track(self._robot, motion, self._quantity, times)
        unit = QUANTITIES[self._quantity]
        rows = [",".join(["time s", *(f"{name} {unit}" for name in drawn.names)])]
        for t, values in zip((times / self._speed).tolist(), drawn.values.tolist(), strict=True):
            rows.append(",".join(f"{value:.6g}" for value in (t, *values)))
        name = f"{self._shows}-{self._quantity.lower().strip('.')}.csv"
        self._session.download(name, "\n".join(rows) + "\n")

    # What is shown.

    def _draw(self) -> None:
        self._session.parts.show(_PART, self._html())

    def _html(self) -> str:
        label = "Hide" if self._open else "Graph"
        fold = button("timeline", label, title="A motion over time", kind="link")
        if not self._open:
            return f"<header>{fold}</header>"
        chips = _chips("timeline-of", _MOTIONS, self._shows) + "<i class='gap'></i>"
        chips += _chips("timeline-shows", dict.fromkeys(QUANTITIES), self._quantity)
        motion, whole = self._motion, self._shows == "program"
        if motion is None or motion.duration <= 0.0:
            why = sentence(self._ahead.note) if whole and self._ahead.note else _NOTHING
            return f"<header>{chips}{fold}</header><p class='plot'>{escape(why)}</p>"
        times, unit = self.graph.times(motion.duration), QUANTITIES[self._quantity]
        drawn = track(self._robot, motion, self._quantity, times)
        curves, share = drawn.curves(times), self.graph.share
        at = np.array([share * motion.duration])
        here = track(self._robot, motion, self._quantity, at).values[0]
        end = motion.duration / self._speed
        clock = f"<output>{fixed(share * end, 2)} / {fixed(end, 2)} s</output>"
        note = self._ahead.note if whole else ""
        words = "".join(f"<span>{escape(text)}</span>" for text in (unit, drawn.nearest, note) if text)
        csv = button("timeline-csv", "CSV", title="Download what is drawn", kind="chip")
        clips = self._clips(motion) if whole else ""
        plot = self.graph.plot(curves, _MOTIONS[self._shows], _TICKS, self._speed, clips)
        return (
            f"<header>{chips}{self.graph.tools()}{csv}{fold}</header>"
            f"<div class='legend'>{legend(curves.lines, here.tolist())}{words}{clock}</div>{plot}"
        )

    def _clips(self, motion: Trajectory) -> str:
        """The steps as they follow each other, in the part of the time that is in view."""
        found, (low, high) = self._ahead.rehearsal, self.graph.window
        running = self._running(self._session.snapshot)
        if found is None:
            return ""
        clips: list[str] = []
        for step in found.steps:
            begin, end = step.begins / motion.duration, (step.begins + step.duration) / motion.duration
            begin, end = max(begin, low), min(end, high)
            if end <= begin or step.index >= len(self._ahead.keys):
                continue
            left, width = 100 * (begin - low) / (high - low), 100 * (end - begin) / (high - low)
            does = self._ahead_words(step.index)
            on = " class=on" if step.index == running else ""
            clips.append(
                f"<button type=button tabindex=-1{on} style='left:{left:.2f}%;width:{width:.2f}%' "
                f"data-do=step data-key={self._ahead.keys[step.index]} title='{escape(does)}'>"
                f"{step.index + 1}</button>"
            )
        return f"<div class='clips' aria-label='Steps of the program'>{''.join(clips)}</div>"

    def _ahead_words(self, index: int) -> str:
        row = self._shared.row(self._ahead.keys[index])
        return "" if row is None else f"Step {row + 1}: {self._shared.program.steps[row].describe()}"


def _chips(do: str, labels: Mapping[str, str | None], chosen: str) -> str:
    return "".join(
        button(do, label or key, key=key, kind="chip on" if key == chosen else "chip")
        for key, label in labels.items()
    )

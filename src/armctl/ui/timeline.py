"""A motion over time, under the scene: to the next pose, or the program's; a ghost stands at the cursor."""

from __future__ import annotations

import time
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
from armctl.ui.widgets.html import button, fixed, sentence, with_minus

_PART, _TICKS = "timeline", 4
QUANTITIES = {"Angle": "°", "Speed": "°/s", "Accel.": "°/s²", "Tool": "mm"}
"""what can be drawn, and its unit"""
_NOTHING = "The motion to the next pose is drawn here."
_MOTIONS = {"pose": "Next pose", "program": "Program"}
"""what motions can be drawn"""
_BOUND_FROM = 0.7
"""a joint that comes so near to its limit has it drawn"""
_AT_LIMIT = 0.995
_OPEN, _FOLDED = "open", "folded"
_HELD_S = 4.0
"""so long after somebody has led the cursor it stays there, while a program runs"""


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
        colors = [color_of(i, name) for i, name in enumerate(self.names)]
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
    if bounds is not None and quantity == "Angle" and shares[most] >= _AT_LIMIT:
        share = (values[:, most] - low[most]) / (high[most] - low[most])
        end = bounds[int(share[np.abs(share - 0.5).argmax()] > 0.5)]
        near = f"{names[most]} reaches its limit ({fixed(end, 1)}°)"
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
        self._held_at = -np.inf
        """when somebody has led the cursor last [s]"""
        self._track: tuple[tuple[object, ...], Track] | None = None
        """what was drawn last, and for what"""
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
        at = self._at(snapshot) if whole and self._open else None
        now = motion, snapshot.speed, self._running(snapshot), self._ahead.note if whole else "", at
        if now != self._drawn:
            if motion is not self._motion or (self.graph.runs and at is None):
                self._motion = motion
                self.graph.reset()
                self._looked_at.hide()
            self.graph.runs = at is not None
            if at is not None:
                self.graph.share = at
                self._looked_at.hide()
            self._drawn, self._speed = now, snapshot.speed
            self._draw()
        self._looked_at.refresh(snapshot.q_command)

    def _running(self, snapshot: Snapshot) -> int | None:
        """The step of the program on the list that runs."""
        at = snapshot.program
        return at.step if at is not None and self._shared.relation(at) == "running" else None

    def _at(self, snapshot: Snapshot) -> float | None:
        """Where the program is that runs, as a share of a pass; None: the cursor does not follow it."""
        now, motion = self._ahead.underway(snapshot), self._ahead.motion
        if now is None or now.at is None or motion is None or motion.duration <= 0.0:
            return None
        return None if time.monotonic() - self._held_at < _HELD_S else now.at / motion.duration

    async def _recall(self) -> None:
        self._open = await self._session.recall("timeline") == _OPEN
        self._fold()

    # What is done here.

    def _on_fold(self, _: str) -> None:
        self._open = not self._open
        self._session.remember("timeline", _OPEN if self._open else _FOLDED)
        self._looked_at.hide()
        self._fold()

    def _fold(self) -> None:
        """The line above has the button that opens it."""
        self._session.next.graph = self._open
        self._session.next.draw()
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
        self.graph.share, self._held_at, self.graph.runs = share, time.monotonic(), False
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
        if not self._open:
            return ""
        chips = _chips("timeline-of", _MOTIONS, self._shows) + "<i class='gap'></i>"
        chips += _chips("timeline-shows", dict.fromkeys(QUANTITIES), self._quantity)
        motion, whole = self._motion, self._shows == "program"
        if motion is None or motion.duration <= 0.0:
            why = sentence(self._ahead.note) if whole and self._ahead.note else _NOTHING
            return f"<header>{chips}</header><p class='plot'>{escape(why)}</p>"
        csv = button("timeline-csv", "CSV", title="Download what is drawn", kind="tool", icon="download")
        clips = self._clips(motion) if whole else ""
        curves = self._tracked(motion).curves(self.graph.times(motion.duration))
        plot = self.graph.plot(curves, _MOTIONS[self._shows], _TICKS, self._speed, clips)
        return (
            f"<header>{chips}<i class='rest'></i>{self.graph.tools()}{csv}</header>"
            f"<div class='legend'>{self._legend(motion, curves)}</div>{plot}"
        )

    def _tracked(self, motion: Trajectory) -> Track:
        """What is drawn; a cursor that runs changes nothing of it."""
        of = motion, self._quantity, self.graph.window
        if self._track is None or self._track[0] != of:
            self._track = of, track(self._robot, motion, self._quantity, self.graph.times(motion.duration))
        return self._track[1]

    def _legend(self, motion: Trajectory, curves: Curves) -> str:
        """Each line with its value at the cursor, what comes near its limit, and the time at the cursor."""
        unit, share, drawn = QUANTITIES[self._quantity], self.graph.share, self._tracked(motion)
        if self.graph.runs:
            here = _now(self._robot, self._session.snapshot, self._quantity)
        else:
            here = track(self._robot, motion, self._quantity, np.array([share * motion.duration])).values[0]
        end = motion.duration / self._speed
        near = "warn" if drawn.bounds is not None else ""
        words = f"<span class='{near}'>{escape(drawn.nearest)}</span>" if drawn.nearest else ""
        note, found = self._ahead.note if self._shows == "program" else "", self._ahead.rehearsal
        if note and found is not None and found.broken is not None:
            told = escape(with_minus(note))
            words = f"<span class='bad' title='{told}'>Step {found.broken.index + 1} cannot run</span>"
        elif note:
            words += f"<span>{escape(with_minus(note))}</span>"
        clock = f"<output>{fixed(share * end, 2)} / {fixed(end, 2)} s</output>"
        return f"{legend(curves.lines, here.tolist(), unit=unit)}<p>{words}</p>{clock}"

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


def _now(robot: Robot, snapshot: Snapshot, quantity: str) -> FloatArray:
    """A quantity as it is commanded now, as ``track`` has it."""
    if quantity == "Tool":
        return 1000 * robot.forward(snapshot.q_command)[:3, 3]
    values = {"Angle": snapshot.q_command, "Speed": snapshot.velocity_command}
    return robot.shown(values.get(quantity, snapshot.acceleration_command))


def _chips(do: str, labels: Mapping[str, str | None], chosen: str) -> str:
    return "".join(
        button(do, label or key, key=key, kind="chip on" if key == chosen else "chip")
        for key, label in labels.items()
    )

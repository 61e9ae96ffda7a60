"""The motion to the next pose over time, under the scene: graph, cursor, and a ghost at the cursor."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np

from armctl.arrays import FloatArray
from armctl.errors import ArmctlError
from armctl.motion import Trajectory
from armctl.motion.figure import color_of
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.scene.ghost import Preview
from armctl.ui.session import Session
from armctl.ui.widgets.html import button, fixed
from armctl.ui.widgets.number_field import parse_number

_PART, _SAMPLES, _WIDE, _HIGH = "timeline", 121, 1000, 100
QUANTITIES = {"Angle": "°", "Speed": "°/s", "Accel.": "°/s²", "Tool": "mm"}
"""what can be drawn, and its unit"""
_NOTHING = "The motion to the next pose is drawn here."
_OPEN, _FOLDED = "open", "folded"


@dataclass(frozen=True, eq=False)
class Track:
    """One quantity of a motion over time."""

    names: tuple[str, ...]
    values: FloatArray
    """(k, lines) in the unit of the quantity"""
    nearest: str
    """the joint that comes nearest to its limit, and how near; empty where there is none"""


def track(robot: Robot, motion: Trajectory, quantity: str, times: FloatArray) -> Track:
    """A quantity at ``times`` (k,) [s]: of every joint, or of the tool."""
    state = motion.sample(times)
    if quantity == "Tool":
        return Track(("X", "Y", "Z"), 1000 * robot.forward(state.q)[..., :3, 3], "")
    names = tuple(joint.title for joint in robot.joints)
    if quantity == "Angle":
        return Track(names, robot.shown(state.q), "")
    rates, limits = (
        (state.velocity, robot.speed_limits)
        if quantity == "Speed"
        else (state.acceleration, robot.acceleration_limits)
    )
    shares = np.abs(rates).max(axis=0) / limits
    most = int(shares.argmax())
    what = "speed" if quantity == "Speed" else "acceleration"
    return Track(
        names, robot.shown(rates), f"{names[most]} at {100 * shares[most]:.0f} % of its {what} limit"
    )


class Timeline:
    """One page's; folded until somebody opens it, and the browser remembers that."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._robot = session.console.robot
        self._looked_at = Preview(session.ghost, None)
        self._open = False
        self._quantity = next(iter(QUANTITIES))
        self._motion: Trajectory | None = None
        self._speed = 1.0
        """the override"""
        self._share = 1.0
        """where the cursor stands, of the duration"""
        session.on_part("timeline", self._on_fold)
        session.on_part("timeline-shows", self._on_quantity)
        session.on_part_value("timeline-at", self._on_cursor)
        session.parts.show(_PART, "")
        session.spawn(self._recall())

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw the motion to the next pose, where it is another one."""
        motion, speed = self._session.next.trajectory, snapshot.speed
        if motion is not self._motion or speed != self._speed:
            if motion is not self._motion:
                self._motion, self._share = motion, 1.0
                self._looked_at.hide()
            self._speed = speed
            self._draw()
        self._looked_at.refresh(snapshot.q_command)

    async def _recall(self) -> None:
        self._open = await self._session.recall("timeline") == _OPEN
        self._draw()

    def _on_fold(self, _: str) -> None:
        self._open = not self._open
        self._session.remember("timeline", _OPEN if self._open else _FOLDED)
        self._looked_at.hide()
        self._draw()

    def _on_quantity(self, key: str) -> None:
        if key in QUANTITIES:
            self._quantity = key
            self._draw()

    def _on_cursor(self, _: str, value: str) -> None:
        try:
            share = parse_number(value, "the cursor") / _WIDE
        except ArmctlError:  # no page of armctl's
            return
        motion = self._motion
        if motion is None:
            return
        self._share = min(max(share, 0.0), 1.0)
        q = motion.sample(self._share * motion.duration).q
        if self._share < 1.0:
            self._looked_at.show(q, self._session.snapshot.q_command)
        else:
            self._looked_at.hide()
        self._draw()

    def _draw(self) -> None:
        self._session.parts.show(_PART, self._html())

    def _html(self) -> str:
        label = "Hide graph" if self._open else "Graph"
        fold = button("timeline", label, title="The motion to the next pose over time", kind="link")
        if not self._open:
            return f"<header>{fold}</header>"
        chips = "".join(
            button("timeline-shows", name, key=name, kind="chip on" if name == self._quantity else "chip")
            for name in QUANTITIES
        )
        motion = self._motion
        if motion is None or motion.duration <= 0.0:
            return f"<header>{chips}{fold}</header><p class='plot'>{_NOTHING}</p>"
        times = np.linspace(0.0, motion.duration, _SAMPLES)
        drawn = track(self._robot, motion, self._quantity, times)
        at = self._share * motion.duration
        here = track(self._robot, motion, self._quantity, np.array([at])).values[0]
        unit = QUANTITIES[self._quantity]
        legend = "".join(
            f"<span><i style='background:{color_of(i)}'></i>{escape(name)} <b>{fixed(value, 1)}</b></span>"
            for i, (name, value) in enumerate(zip(drawn.names, here.tolist(), strict=True))
        )
        end = motion.duration / self._speed
        clock = f"<output>{fixed(self._share * end, 2)} / {fixed(end, 2)} s</output>"
        near = f"<span>{escape(drawn.nearest)}</span>" if drawn.nearest else ""
        return (
            f"<header>{chips}{clock}{fold}</header>"
            f"<p class='legend'>{legend}<span>{unit}</span>{near}</p>{_plot(drawn.values, self._share)}"
        )


def _plot(values: FloatArray, share: float) -> str:
    low, high = float(values.min()), float(values.max())
    if high - low < 1e-6:
        low, high = low - 1.0, high + 1.0
    x = np.linspace(0.0, _WIDE, len(values))
    y = _HIGH * (high - values) / (high - low)
    points = [[f"{a:.0f},{b:.1f}" for a, b in zip(x, line, strict=True)] for line in y.T]
    paths = "".join(f"<path stroke='{color_of(i)}' d='M{' '.join(line)}'/>" for i, line in enumerate(points))
    at = round(_WIDE * share)
    return (
        f"<div class='plot'><small>{fixed(high, 0)}</small><small>{fixed(low, 0)}</small>"
        f"<svg viewBox='0 0 {_WIDE} {_HIGH}' preserveAspectRatio='none' aria-hidden='true'>{paths}</svg>"
        f"<i class='cursor' style='left:{100 * share:.1f}%'></i>"
        f"<input type='range' min='0' max='{_WIDE}' value='{at}' data-set='timeline-at' "
        f"aria-label='Time of the motion to the next pose'></div>"
    )

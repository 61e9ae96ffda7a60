"""The program in the scene: the path of the tool, and pins where steps lead; a click on one selects it."""

from __future__ import annotations

from functools import partial

import numpy as np
import viser

from armctl.arrays import FloatArray
from armctl.lazy_dataclass import dataclass
from armctl.program.rehearsal import Rehearsal
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.scene.ghost import Lines, segments
from armctl.ui.session import Session
from armctl.ui.tabs.manual.program_ahead import ProgramAhead
from armctl.ui.tabs.manual.program_editor import ProgramEditor
from armctl.ui.tabs.manual.shared_program import SharedProgram

_COLOR = (95, 61, 196)
_RADIUS = 0.014
"""of a pin, of the arm's reach"""
_MOST_PINS, _MOST_NUMBERED = 80, 24
_SAMPLES_A_STEP, _MOST_SAMPLES = 24, 2400
_ONE_PLACE_M = 1e-3
"""steps that lead so near to each other share a pin"""


@dataclass(frozen=True, slots=True)
class Pin:
    """One place to which steps lead."""

    point: tuple[float, float, float]
    """[m]"""
    rows: tuple[int, ...]
    """of the program, ascending"""

    @property
    def label(self) -> str:
        """The numbers of its steps."""
        return ", ".join(str(row + 1) for row in self.rows)


def pins_of(robot: Robot, found: Rehearsal) -> list[Pin]:
    """Where the moving steps lead, in the order in which they first come there."""
    moved = [step for step in found.steps if np.abs(step.trajectory.end - step.trajectory.start).max() > 0.0]
    if not moved:
        return []
    tips = robot.forward(np.stack([step.trajectory.end for step in moved]))[:, :3, 3]
    rows: dict[tuple[int, ...], list[int]] = {}
    points: dict[tuple[int, ...], tuple[float, float, float]] = {}
    for step, (x, y, z) in zip(moved, tips.tolist(), strict=True):
        place = tuple(round(value / _ONE_PLACE_M) for value in (x, y, z))
        points.setdefault(place, (x, y, z))
        rows.setdefault(place, []).append(step.index)
    return [Pin(points[place], tuple(sorted(set(rows[place])))) for place in points]


def pin_radius(robot: Robot) -> float:
    """Of a pin as it is drawn [m]."""
    return _RADIUS * robot.chain.length


def path_of(robot: Robot, found: Rehearsal) -> FloatArray:
    """Where the tool passes (k, 3) [m]; no more points than can be drawn."""
    return found.tool_path(robot, min(_SAMPLES_A_STEP * len(found.steps) + 1, _MOST_SAMPLES))


class ProgramPins:
    """One page's view of it."""

    def __init__(self, session: Session, editor: ProgramEditor) -> None:
        self._session, self._editor = session, editor
        self._robot = session.console.robot
        self._ahead = session.console.shared(ProgramAhead)
        self._shared = session.console.shared(SharedProgram)
        self._path = Lines(session.client.scene, "/program/path", _COLOR, 2.0)
        self._nodes: list[viser.IcosphereHandle | viser.LabelHandle] = []
        self._drawn: Rehearsal | None = None

    def refresh(self, snapshot: Snapshot, *, shown: bool) -> None:
        """Draw the program as it would run from where the arm stands, or nothing."""
        if shown and self._shared.program.steps:
            self._ahead.look(self._session, snapshot, from_here=False)
        found = self._ahead.rehearsal if shown and self._shared.program.steps else None
        if found is not self._drawn:
            self._drawn = found
            self._draw(found)

    def _draw(self, found: Rehearsal | None) -> None:
        self._path.hide()
        while self._nodes:
            self._nodes.pop().remove()
        if found is None:
            return
        self._path.show(segments(path_of(self._robot, found)))
        scene, radius = self._session.client.scene, pin_radius(self._robot)
        for i, pin in enumerate(pins_of(self._robot, found)[:_MOST_PINS]):
            ball = scene.add_icosphere(f"/program/pin{i}", radius, _COLOR, subdivisions=2, position=pin.point)
            self._session.on(ball.on_click, partial(self._on_pin, pin))
            self._nodes.append(ball)
            if i < _MOST_NUMBERED:
                above = (pin.point[0], pin.point[1], pin.point[2] + 2 * radius)
                self._nodes.append(scene.add_label(f"/program/number{i}", pin.label, position=above))

    def _on_pin(self, pin: Pin) -> None:
        """The step that leads there is selected; clicked again, the next one of those."""
        rows = [row for row in pin.rows if row < len(self._shared.program.steps)]
        if rows:
            at = rows.index(self._editor.selected) + 1 if self._editor.selected in rows else 0
            self._editor.choose(rows[at % len(rows)])

"""The program in the scene: the path of the tool, and pins where steps lead; a click on one selects it.

Pins are no clickable nodes of viser's: such a node takes the pointer from all that is behind it, also from
the arrows at the tool, which are drawn over it. Rays are looked along here instead.
"""

from __future__ import annotations

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
_NEAR = 1.2
"""of its radius: so near to a pin a click is for it"""
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


def first_met(origin: FloatArray, direction: FloatArray, pins: FloatArray, radius: float) -> int | None:
    """Which of ``pins`` (k, 3) [m] a ray passes within ``radius`` [m], the nearest first; None: none.

    ``origin`` (3,) [m], ``direction`` (3,) of length 1.
    """
    if not len(pins):
        return None
    along = (pins - origin) @ direction
    beside = np.linalg.norm(pins - origin - along[:, None] * direction, axis=1)
    met = np.flatnonzero((along > 0.0) & (beside <= radius))
    return int(met[along[met].argmin()]) if len(met) else None


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
        self._pins: list[Pin] = []

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
        self._pins = [] if found is None else pins_of(self._robot, found)[:_MOST_PINS]
        if found is None:
            return
        self._path.show(segments(path_of(self._robot, found)))
        scene, radius = self._session.client.scene, pin_radius(self._robot)
        for i, pin in enumerate(self._pins):
            ball = scene.add_icosphere(f"/program/pin{i}", radius, _COLOR, subdivisions=2, position=pin.point)
            self._nodes.append(ball)
            if i < _MOST_NUMBERED:
                above = (pin.point[0], pin.point[1], pin.point[2] + radius)
                number = scene.add_label(
                    f"/program/number{i}", pin.label, position=above, anchor="bottom-left"
                )  # it hides no pin
                self._nodes.append(number)

    @property
    def points(self) -> FloatArray:
        """Where pins are drawn (k, 3) [m]."""
        return np.array([pin.point for pin in self._pins]).reshape(-1, 3)

    def click(self, origin: FloatArray, direction: FloatArray) -> bool:
        """Take a click along a ray if it meets a pin that is drawn; ``origin`` (3,) [m], ``direction`` (3,).

        The step that leads there is selected; clicked again, the next one of those.
        """
        met = first_met(origin, direction, self.points, _NEAR * pin_radius(self._robot))
        if met is not None:
            self._choose(self._pins[met])
        return met is not None

    def _choose(self, pin: Pin) -> None:
        rows = [row for row in pin.rows if row < len(self._shared.program.steps)]
        if rows:
            at = rows.index(self._editor.selected) + 1 if self._editor.selected in rows else 0
            self._editor.choose(rows[at % len(rows)])

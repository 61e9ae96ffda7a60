"""The energy curve of a target over its free joint: a graph, and a slider elsewhere, to choose along it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from armctl.kinematics import Criterion
from armctl.ui.session import Session
from armctl.ui.tabs.inverse.answer import RankedSolutions, on_curve
from armctl.ui.widgets.graph import Graph, graph_html
from armctl.ui.widgets.html import LiveHtml, muted

_PART = "curve"
_ALONG = "On the curve °"
_ALONG_HINT = (
    "The free joint: move along the curve, and the nearest solution is selected. "
    "Clicks and drags in the graph do so, too; then the wheel zooms there."
)
_SELECTED_INK = "#0c8599"
_HEIGHT: dict[Criterion, str] = {
    "least-rotation": "Sum of joint angles",
    "published": "Sum of joint angles, as published",
    "least-travel": "Time that the joints turn",
    "shortest-time": "Time of the way",
    "least-torque": "Load",
}
"""what is drawn, in words"""


class EnergyCurveView:
    """The curve of the newest answer; ``select`` is called with a row of its list."""

    def __init__(self, session: Session, select: Callable[[int], None]) -> None:
        self._session, self._select = session, select
        self._robot = session.console.robot
        self._answer: RankedSolutions | None = None
        self._row: int | None = None
        session.parts.add(session.gui, _PART)
        self._graph = Graph(
            session, _PART, self._on_cursor, self._draw, scrolls=True, cursor="Place on the curve"
        )

    def add_slider(self) -> None:
        """Add to the present container what tells about the curve, and moves along it in steps."""
        session, gui = self._session, self._session.gui
        self._note = LiveHtml(gui)
        self._along = gui.add_slider(
            _ALONG, 0.0, 1.0, 0.01, initial_value=0.0, visible=False, hint=_ALONG_HINT
        )
        self._least = gui.add_button("Back to the least", color="gray", visible=False)
        session.on(self._along.on_update, self._on_along)
        session.on(self._least.on_click, lambda: self._select(1))

    def show(self, found: RankedSolutions, row: int | None) -> None:
        """Show the curve of an answer, or why there is none."""
        self._answer = found
        self._graph.reset()
        self._along.visible = self._least.visible = not isinstance(found.curve, str)
        if isinstance(found.curve, str):
            self._session.parts.show(_PART, "")
            self._note.show(muted(found.curve))
            return
        low, high = float(found.curve.x[0]), float(found.curve.x[-1])
        self._along.min, self._along.max = min(low, self._along.min), max(high, self._along.max)
        self._along.value = low
        self._along.min, self._along.max = low, high
        self._note.show("")
        self.mark(row)

    def mark(self, row: int | None) -> None:
        """Mark where the selected row is; None: none is selected."""
        self._row = row
        self._draw()

    def forget(self) -> None:
        """There is no answer any more."""
        self._answer = None
        self._along.visible = self._least.visible = False
        self._session.parts.show(_PART, "")

    def _on_along(self) -> None:
        if self._answer is not None and self._answer.solutions.success:
            joint = self._robot.joints[self._answer.solutions.free_joint or 0]
            self._select(self._answer.row_at(joint.read(self._along.value)))

    def _on_cursor(self, share: float) -> None:
        curve = "" if self._answer is None else self._answer.curve
        if not isinstance(curve, str):
            self._along.value = float(curve.x[0] + share * (curve.x[-1] - curve.x[0]))
            self._on_along()

    def _draw(self) -> None:
        found = self._answer
        if found is None or isinstance(found.curve, str):
            return
        curve = found.curve
        if self._row is not None:
            selected = on_curve(found, "selected", found.q(self._row), _SELECTED_INK)
            self._along.value = min(max(round(selected.x, 2), self._along.min), self._along.max)
            self._graph.share = (selected.x - curve.x[0]) / (curve.x[-1] - curve.x[0])
            curve = replace(curve, marks=(selected, *curve.marks))  # the least is seen where it is both
        free = self._robot.joints[found.solutions.free_joint or 0].title
        html = graph_html(self._graph, curve, f"{_HEIGHT[found.criterion]} ({found.unit}) as {free} turns")
        self._session.parts.show(_PART, html)

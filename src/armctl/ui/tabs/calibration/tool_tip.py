"""The tool point: one point is touched from several sides, and the page says where the tip is."""

from __future__ import annotations

from html import escape
from typing import Self

import numpy as np

from armctl.arrays import FloatArray
from armctl.calibration import LEAST_SIDES, ToolPoint, teach_tool
from armctl.errors import ArmctlError, InputError, StateError
from armctl.facts import State, say, say_with_advice
from armctl.facts.causes import TaughtTip
from armctl.protocol import Snapshot
from armctl.robot import Robot
from armctl.ui.console import Console
from armctl.ui.session import Session
from armctl.ui.widgets.html import LiveHtml, fixed, heading, muted, sentence, strong, table

TOUCH, DELETE, CLEAR = "Touch here", "Delete the last", "Start anew"
_MOST = 40
_ALIKE = 0.01
"""two touches with no joint farther apart [rad] are one"""
_NOTE = (
    "Fix a sharp tip to the table. Bring the tip of the tool onto it and press, then again with the tool "
    f"turned: {LEAST_SIDES} times at least, tilted and rolled as far apart as the arm can. Nobody needs to "
    "know where the point is."
)


class TipTouches:
    """The touches so far, which all pages share. Used on the web server's event loop only."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.touches: tuple[FloatArray, ...] = ()
        """(n,) each [rad]"""
        self.result: ToolPoint | str | None = None
        """where the tip is, or why that is not known; None: too few touches"""
        self.version = 0
        """rises with every change"""

    @classmethod
    def of(cls, console: Console, before: Self | None) -> Self:
        """The same while the arm is as it was."""
        return before if before is not None and before.robot == console.robot else cls(console.robot)

    def add(self, q: FloatArray) -> None:
        """Note a touch; refused where it is one of those before, or nobody knows where the arm stands."""
        if not np.isfinite(q).all():
            raise StateError("nobody knows where the arm stands; connect and enable it first")
        for number, other in enumerate(self.touches, 1):
            if np.abs(q - other).max() < _ALIKE:
                raise InputError(f"the arm stands as in touch {number}; turn the tool, then touch again")
        if len(self.touches) >= _MOST:
            raise InputError(f"{_MOST} touches are enough; press {CLEAR!r} to begin anew")
        self._set((*self.touches, q))

    def delete(self) -> None:
        """Take the last touch away."""
        self._set(self.touches[:-1])

    def clear(self) -> None:
        """Begin anew."""
        self._set(())

    def _set(self, touches: tuple[FloatArray, ...]) -> None:
        self.touches, self.result = touches, None
        self.version += 1
        if len(touches) >= LEAST_SIDES:
            try:
                self.result = teach_tool(self.robot, np.stack(touches))
            except ArmctlError as refusal:
                self.result = str(refusal)

    @property
    def suggestion(self) -> str:
        """What to write where; empty where there is nothing."""
        return self.result.suggestion if isinstance(self.result, ToolPoint) else ""


class CalibrationTip:
    """The controls of one page."""

    def __init__(self, session: Session) -> None:
        self._session, self._touches = session, session.console.shared(TipTouches)
        self._drawn = -1
        gui = session.gui
        LiveHtml(gui, muted(_NOTE))
        touch = gui.add_button(TOUCH)
        edit = gui.add_button_group("Touches", (DELETE, CLEAR))
        self._said = LiveHtml(gui)
        self._download = gui.add_button("Download the rows", color="gray", visible=False)
        session.needs(None, touch)
        session.needs(None, edit, also=lambda _: None if self._touches.touches else "nothing is touched yet")
        session.on(touch.on_click, self._on_touch)
        session.on(edit.on_click, lambda: self._on_edit(edit.value))
        session.on(self._download.on_click, self._on_download)

    def refresh(self, snapshot: Snapshot) -> None:
        """Show the touches and what they say, if they have changed."""
        if self._drawn != self._touches.version:
            self._drawn = self._touches.version
            self._said.show(tip_html(self._touches))
            self._download.visible = bool(self._touches.suggestion)

    async def _on_touch(self) -> None:
        self._session.require_operator()
        now = self._session.snapshot
        if now.state is State.MOVING:
            raise StateError("the arm is moving; touch when it stands")
        self._touches.add(np.where(np.isnan(now.q), now.q_command, now.q))

    async def _on_edit(self, what: str) -> None:
        self._session.require_operator()
        if what == DELETE:
            self._touches.delete()
        else:
            self._touches.clear()

    async def _on_download(self) -> None:
        self._session.download("tool-point.toml", self._touches.suggestion)


def tip_html(touches: TipTouches) -> str:
    """How many touches there are, what they say, and what to write where."""
    count, result = len(touches.touches), touches.result
    if result is None:
        left = LEAST_SIDES - count
        return strong(f"{count} of {LEAST_SIDES} touches") + muted(f"Touch the point {left} more times.")
    if isinstance(result, str):
        return strong(f"{count} touches") + muted(sentence(result))
    x, y, z = (fixed(1000 * value, 2) for value in result.offset_m.tolist())
    text = strong(f"Residual of {count} touches: {fixed(1000 * result.residual_m, 2)} mm")
    text += table(("Tip from the tool point", "x", "y", "z"), [["mm, along the tool's axes", x, y, z]])
    for one in result.facts:
        if not isinstance(one, TaughtTip):
            text += f"<div>{escape(sentence(say_with_advice(one)))}</div>"
        else:
            text += muted(sentence(say(one)))
    rows = [[str(i), fixed(1000 * away, 2)] for i, away in enumerate(result.away_m.tolist(), 1)]
    text += table(("Touch", "off by mm"), rows, marked=int(result.away_m.argmax()))
    if touches.suggestion:
        text += heading("Suggested values")
        pre = "margin:0;font-size:11.5px;user-select:text;white-space:pre-wrap"
        text += f"<pre style='{pre}'>{escape(touches.suggestion)}</pre>"
    return text

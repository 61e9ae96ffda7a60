"""Hold-to-jog of the tool: along an axis, or turning in its place."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from armctl.errors import ArmctlError
from armctl.robot import Robot
from armctl.runtime import JogTool
from armctl.runtime.tool_line import tool_turns
from armctl.ui.widgets.hold import Hold, attach_hold
from armctl.ui.widgets.html_bits import muted
from armctl.ui.widgets.text import LiveHtml

if TYPE_CHECKING:
    from armctl.ui.session import Session

ToolAxis = Literal["X", "Y", "Z", "Pitch", "Roll"]
FRAMES: dict[str, Literal["base", "tool"]] = {"base axes": "base", "tool axes": "tool"}
_TURN_DEG_PER_MM = 0.5
_SPEED_HINT = "How fast the tool goes while a button is held. The joints' limits and Speed % slow it down."
_NOTE = (
    "The tool moves on a straight line while the button is held, its pitch and roll kept where the arm can. "
    f"Pitch and Roll turn it in its place, {_TURN_DEG_PER_MM:g}°/s for each mm/s."
)


def tool_axes(robot: Robot) -> tuple[ToolAxis, ...]:
    """What the tool of an arm can be jogged along and about."""
    names: tuple[ToolAxis, ToolAxis] = ("Pitch", "Roll")
    turns: list[ToolAxis] = [name for name, can in zip(names, tool_turns(robot), strict=True) if can]
    return ("X", "Y", "Z", *turns)


def tool_jog(axis: ToolAxis, sign: float, speed_mm_s: float, frame: Literal["base", "tool"]) -> JogTool:
    """One short command; ``sign`` is 1 or -1."""
    linear, rate = np.zeros(3), sign * math.radians(_TURN_DEG_PER_MM * speed_mm_s)
    match axis:
        case "Pitch":
            return JogTool(linear, pitch_rate=rate, frame=frame)
        case "Roll":
            return JogTool(linear, roll_rate=rate, frame=frame)
        case _:
            linear["XYZ".index(axis)] = sign * speed_mm_s / 1000
            return JogTool(linear, frame=frame)


class ToolJog:
    """Two buttons an axis; letting go, or losing the page, stops the arm."""

    def __init__(self, session: Session, speed_mm_s: float = 30) -> None:
        """Add the controls to the present container; ``speed_mm_s`` is how fast it is to begin with."""
        self._session = session
        self._hold = Hold()
        gui = session.gui
        self._frame = gui.add_dropdown("Along the", tuple(FRAMES), initial_value="base axes")
        self._speed = gui.add_slider("Tool mm/s", 1, 150, 1, initial_value=speed_mm_s, hint=_SPEED_HINT)
        for axis in tool_axes(session.console.robot):
            for sign, text in ((-1.0, "−"), (1.0, "+")):
                button = gui.add_button(f"{axis} {text}")
                session.on(partial(attach_hold, button), partial(self._on_hold, axis, sign))
        LiveHtml(gui, muted(_NOTE))

    @property
    def speed_mm_s(self) -> float:
        """How fast the tool is jogged."""
        return self._speed.value

    async def _on_hold(self, axis: ToolAxis, sign: float) -> None:
        """One tick of a held button: a short command that expires by itself."""
        if not self._hold.wants(self._session.snapshot.stamp):
            return
        try:
            await self._session.submit(tool_jog(axis, sign, self.speed_mm_s, FRAMES[self._frame.value]))
        except ArmctlError:
            self._hold.refuse()
            raise

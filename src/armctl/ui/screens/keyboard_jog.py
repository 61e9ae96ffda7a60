"""Jogging with the keyboard: each key press is one short command, and a held key repeats.

A page tells of key presses only, never of a key let go. A held key comes again by itself, after the delay
and at the rate that the computer is set to (half a second, then thirty times a second, or so); each press
counts for 100 ms like every jog. So a tap is a small step, and a held key a step, a rest, and then a motion
that ends 100 ms after the key is let go.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np
import viser

from armctl.errors import ArmctlError
from armctl.runtime import Jog, JogTool
from armctl.ui.screens.tool_jog import tool_axes, tool_jog
from armctl.ui.widgets.hold import Hold
from armctl.ui.widgets.html_bits import muted
from armctl.ui.widgets.joint_step import held_at
from armctl.ui.widgets.text import LiveHtml, table

if TYPE_CHECKING:
    from collections.abc import Callable

    from armctl.ui.session import Session

Key = Literal["R", "F", "T", "G", "Y", "H", "U", "J", "I", "K", "O", "L", "P", "M"]
KEYS: tuple[tuple[Key, Key], ...] = (
    ("R", "F"),
    ("T", "G"),
    ("Y", "H"),
    ("U", "J"),
    ("I", "K"),
    ("O", "L"),
    ("P", "M"),
)
"""Key for + above key for −; the page's own camera keys (W A S D Q E, arrows) are left out."""
JOINTS, BASE, TOOL = "Joints", "Tool, base axes", "Tool, tool axes"
_SILENCE_S = 1.2
"""A key that was silent for this long was let go: longer than the delay before it repeats."""
_ON, _OFF = "Keyboard jog is ON: press to switch off", "Keyboard jog is off: press to switch on"
_NOTE = (
    "A tap is a small step; hold a key to go on. The motion ends 100 ms after the key is let go. Keys do "
    "nothing while a field has the focus: click into the 3D view first."
)


class KeyboardJog:
    """A switch, what the keys move, and the legend of the keys. Off until the operator switches it on."""

    def __init__(
        self, session: Session, joint_percent: Callable[[], float], tool_mm_s: Callable[[], float]
    ) -> None:
        """Add the controls to the present container; the speeds are those of the buttons."""
        self._session = session
        self._robot = session.console.robot
        self._joint_percent, self._tool_mm_s = joint_percent, tool_mm_s
        self._hold = Hold(_SILENCE_S)
        self._commands: list[viser.CommandHandle] = []
        self._on = False
        self._what = JOINTS
        gui = session.gui
        self._switch = gui.add_button(_OFF, color="gray", icon=viser.Icon.KEYBOARD)
        self._choice = gui.add_button_group("Keys move", (JOINTS, BASE, TOOL))
        self._legend = LiveHtml(gui)
        LiveHtml(gui, muted(_NOTE))
        session.on(self._switch.on_click, self._on_switch)
        session.on(self._choice.on_click, self._on_choice)

    def refresh(self) -> None:
        """Show the keys and their speed; a page that no longer operates has none."""
        if self._on and not self._session.operates:
            self._set(on=False)
        if self._what == JOINTS:
            speed = f"{self._joint_percent():.0f} % of each joint's speed"
        else:
            speed = f"{self._tool_mm_s():.0f} mm/s"
        rows = [[name, plus, minus] for name, (plus, minus) in zip(self._names(), KEYS, strict=False)]
        state = "" if self._on else muted("Off: the keys do nothing.")
        head = f"<b>{self._what}</b> at {speed}"
        self._legend.show(f"<div>{head}</div>{table(('Moves', 'key +', 'key −'), rows)}{state}")

    def _names(self) -> list[str]:
        if self._what == JOINTS:
            return [self._robot.joints[i].title for i in self._turning()]
        return list(tool_axes(self._robot))

    def _turning(self) -> list[int]:
        """Indices of the joints that can turn."""
        return [i for i, joint in enumerate(self._robot.joints) if held_at(joint) is None]

    async def _on_switch(self) -> None:
        if not self._on:
            self._session.require_operator()
        self._set(on=not self._on)

    async def _on_choice(self) -> None:
        self._what = self._choice.value
        self._set(on=self._on)

    def _set(self, *, on: bool) -> None:
        """Give the keys to the page, or take them away: what is not registered never comes."""
        for command in self._commands:
            self._session.take_key(command)
        self._commands.clear()
        self._on = on
        self._switch.label = _ON if on else _OFF
        self._switch.color = "orange" if on else "gray"
        if not on:
            return
        for index, (name, keys) in enumerate(zip(self._names(), KEYS, strict=False)):
            for key, sign, text in zip(keys, (1.0, -1.0), "+−", strict=True):
                command = self._session.gui.add_command(f"Jog {name} {text}", hotkey=key)
                self._session.on_key(command, partial(self._on_key, index, sign))
                self._commands.append(command)

    async def _on_key(self, index: int, sign: float) -> None:
        """One press, or one repeat, of a key."""
        if not (self._on and self._hold.wants(self._session.snapshot.stamp)):
            return
        try:
            await self._session.submit(self._jog(index, sign))
        except ArmctlError:
            self._hold.refuse()
            raise

    def _jog(self, index: int, sign: float) -> Jog | JogTool:
        if self._what == JOINTS:
            rate = np.zeros(self._robot.n)
            rate[self._turning()[index]] = sign * self._joint_percent() / 100
            return Jog(rate)
        frame = "base" if self._what == BASE else "tool"
        return tool_jog(tool_axes(self._robot)[index], sign, self._tool_mm_s(), frame)

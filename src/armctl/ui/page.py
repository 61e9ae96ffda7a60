"""One browser page: the bar and the tabs, built from a session."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

import viser

from armctl.protocol import Snapshot
from armctl.ui.bar import ControlBar
from armctl.ui.dragged_tool import DraggedTool
from armctl.ui.robot_switch import RobotSwitch
from armctl.ui.scene.camera import look_at_arm
from armctl.ui.session import Session
from armctl.ui.tabs import PROGRAM, TABS, Screen
from armctl.ui.telemetry import TelemetryTable
from armctl.ui.timeline import Timeline

_WIDE_PX, _USUAL_PX, _PHONE_PX = 1600, 1200, 576
_BAR_PX, _UNDER_PX = 56, 53
"""the bar on top, and the line of the next pose (``guard/frame.css``)"""
_ROOMY_PX = 700
"""a scene as wide as this shows the arm beside the table of its motors"""
_TURNS = 10
"""of the event loop: what a page says passes through several tasks until it is answered"""
_MOST_DIGITS = 20
_FIRST = -1.0
"""ahead of the tabs"""


def panel_widths(window: int) -> tuple[int, int]:
    """How wide program and tabs are in a window [px]; 0: they are not beside the scene."""
    if window >= _USUAL_PX:
        return (360, 580) if window >= _WIDE_PX else (280, 440)
    return 0, 0 if window < _PHONE_PX else 380


def picture_size(width: int, height: int) -> tuple[int, int]:
    """Width and height of the scene in a window [px]; on a phone the tabs lie over its lower part."""
    return max(width - sum(panel_widths(width)), 1), max(height - _BAR_PX - _UNDER_PX, 1)


def window_of(text: str) -> tuple[int, int] | None:
    """Width and height as a page says them; None: it says something else."""
    width, _, height = text.partition(" ")
    if len(text) > _MOST_DIGITS or not (width.isdecimal() and height.isdecimal()):
        return None
    return int(width), max(int(height), 1)


class Page:
    """What one client sees. Its panels and tabs outlive the arm: they stay where they are when it changes."""

    def __init__(
        self,
        client: viser.ClientHandle,
        robots: RobotSwitch,
        link: Callable[[str, str, Session], None],
        lost: Callable[[int], None],
    ) -> None:
        """Build the bar and empty tabs; ``link`` and ``lost`` as in ``Session.find_line``."""
        self.client, self._robots, self._link, self._lost = client, robots, link, lost
        self._window = client.camera.image_width, client.camera.image_height
        """[px]; those of the screen, until the page has said how many of them it takes for one of its own"""
        self._look()
        client.gui.main_panel.dock_right()
        self._panel = client.gui.add_panel()
        program = self._panel.add_tab(PROGRAM.label, PROGRAM.icon)
        group = client.gui.add_tab_group()
        self._containers = [program, *(group.add_tab(tab.label, tab.icon) for tab in TABS)]
        self._lay_out()
        self._begin()

    def show_bar(self) -> None:
        """Show in the bar what the arm does now."""
        self._always.refresh(self.session.snapshot)

    async def build(self) -> None:
        """Fill the tabs one by one: what others ask for, STOP above all, waits for one tab at most.

        The bar comes first: who presses Enable waits for no tab. Who presses Go on another page waits for the
        one that is begun.
        """
        while not (self.built or self.session.closed):
            await self._robots.console.precedence.give_way()
            self.show_bar()
            for _ in range(_TURNS):
                await asyncio.sleep(0)
            self._build_next()

    @property
    def built(self) -> bool:
        """Whether every tab is there."""
        return not self._unbuilt

    def _begin(self) -> None:
        self._drawn: Snapshot | None = None
        self._contents: list[viser.GuiFolderHandle] = []
        self._screens: list[Screen] = []
        self._unbuilt = list(zip((PROGRAM, *TABS), self._containers, strict=True))
        with self.client.atomic():
            self.session = Session(self.client, self._robots)
            self.session.spawn(self.session.find_line(self._link, self._lost))
            self.session.spawn(self._fit())
            self.session.on_part_value("window", self._on_window)
            self.session.on_phone = self._window[0] < _PHONE_PX
            self.client.gui.set_panel_label(self._robots.console.robot.title)  # of the sheet on a phone
            with self._content(_FIRST):
                self._always = ControlBar(self.session)
            self._tool, self._timeline = DraggedTool(self.session), Timeline(self.session)
            self._telemetry = TelemetryTable(
                self.session, lambda: picture_size(*self._window)[0] >= _ROOMY_PX
            )

    def _build_next(self) -> None:
        if self._unbuilt:
            tab, container = self._unbuilt.pop(0)
            with self.client.atomic(), container, self._content():
                self._screens.append(tab.build(self.session))

    def _content(self, order: float | None = None) -> viser.GuiFolderHandle:
        self._contents.append(self.client.gui.add_folder(None, order=order))
        return self._contents[-1]

    def _look(self) -> None:
        picture, sheet = picture_size(*self._window), self._window[0] < _PHONE_PX
        look_at_arm(self.client, self._robots.console.robot, picture=picture, sheet=sheet)

    async def _fit(self) -> None:
        """Lay the page out anew where its pixels are larger than those of the screen: phones, and zoom."""
        window = window_of(await self.session.recall("window") or "")
        if window is None or window == self._window:
            return
        self._resize(window)
        self.session.on_phone = self._window[0] < _PHONE_PX
        self.session.view.look(picture=picture_size(*window))

    def _on_window(self, _: str, text: str) -> None:
        """It is larger or smaller now: panels beside the scene become as wide as it has room for."""
        window = window_of(text)
        if window is None:
            return
        if all(panel_widths(self._window[0])) and all(panel_widths(window[0])):
            self._resize(window)

    def _resize(self, window: tuple[int, int]) -> None:
        before, self._window = self._window, window
        if panel_widths(before[0]) != panel_widths(window[0]):  # else it would fold what has just been opened
            self._lay_out()

    def _lay_out(self) -> None:
        """The program at the left, the tabs at the right; where there is no room, the program is folded."""
        program, tabs = panel_widths(self._window[0])
        if self._window[0] < _PHONE_PX:
            self._panel.dock_below(self.client.gui.main_panel)
        else:
            self._panel.dock_left()
            self.client.gui.main_panel.set_width(tabs)
        if program:
            self._panel.set_width(program)
            self._panel.expand()
        else:
            self._panel.minimize()

    def rebuild(self) -> None:
        """The arm was changed: build everything anew for the present one."""
        look_at_arm(self.client, self._robots.console.robot, sheet=self.session.on_phone)
        self.session.close()
        with self.client.atomic():
            self.session.take_keys()
            for content in self._contents:
                content.remove()
            self.client.scene.reset()
            self._begin()
            while not self.built:
                self._build_next()

    def see(self, tabs: Sequence[str]) -> None:
        """These tabs are open: the ghosts of the others are hidden, and the one that is new is drawn."""
        if self.session.ghost.see(next((tab.label for tab in TABS if tab.label in tabs), None)):
            self._drawn = None

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot; it is drawn once, and not before all tabs are there."""
        if snapshot is self._drawn or not self.built:
            return
        self._drawn = snapshot
        with self.client.atomic():
            self.session.refresh(snapshot)
            self.session.next.refresh(snapshot)
            self._always.refresh(snapshot)
            self._tool.refresh(snapshot)
            self._timeline.refresh(snapshot)
            self._telemetry.refresh(snapshot)
            for screen in self._screens:
                screen.refresh(snapshot)

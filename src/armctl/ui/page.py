"""One browser page: the control panel and the tabs, built from a session."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence

import viser

from armctl.protocol import Snapshot
from armctl.ui.panel import PANEL_WIDTH, ControlPanel
from armctl.ui.robot_switch import RobotSwitch
from armctl.ui.scene.stage import look_at_arm
from armctl.ui.session import Session
from armctl.ui.tabs import TABS, Screen

_WIDE_PX, _USUAL_PX, _NARROW_PX, _PHONE_PX = 1600, 1200, 900, 576


def tabs_width(window: int) -> int:
    """How wide the tabs are in a window [px]."""
    return 580 if window >= _WIDE_PX else 480 if window >= _USUAL_PX else 380


def above_tabs(width: int, height: int) -> bool:
    """Whether the panel stands above the tabs, in a narrow upright window: the arm is seen beside them."""
    return width < _NARROW_PX and width < height


def covered(width: int, height: int) -> int:
    """How much of the width of a window is panels [px]."""
    if width < _PHONE_PX:
        return 0  # they lie over the lower part of the scene
    return tabs_width(width) + (0 if above_tabs(width, height) else PANEL_WIDTH)


class Page:
    """What one client sees. Its panels and tabs outlive the arm: they stay where they are when it changes."""

    def __init__(
        self,
        client: viser.ClientHandle,
        robots: RobotSwitch,
        link: Callable[[str, Session], None],
        lost: Callable[[int], None],
    ) -> None:
        """Build *Control* and empty tabs; ``link`` and ``lost`` as in ``Session.find_line``."""
        self.client, self._robots, self._link, self._lost = client, robots, link, lost
        self._window = client.camera.image_width, client.camera.image_height
        """[px]; those of the screen, until the page has said how many of them it takes for one of its own"""
        self._look()
        client.gui.main_panel.dock_right()
        self._panel = client.gui.add_panel()
        self._control = self._panel.add_tab("Control", viser.Icon.HAND_STOP)
        self._lay_out()
        group = client.gui.add_tab_group()
        self._containers = [group.add_tab(tab.label, tab.icon) for tab in TABS]
        self._begin()

    async def build(self) -> None:
        """Fill the tabs one by one: what others ask for, STOP above all, waits for one tab at most."""
        while not (self.built or self.session.closed):
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
        self._unbuilt = list(zip(TABS, self._containers, strict=True))
        with self.client.atomic():
            self.session = Session(self.client, self._robots)
            self.session.spawn(self.session.find_line(self._link, self._lost))
            self.session.spawn(self._fit())
            self.session.on_phone = self._window[0] < _PHONE_PX
            with self._control, self._content():
                self._always = ControlPanel(self.session, self._panel)

    def _build_next(self) -> None:
        if self._unbuilt:
            tab, container = self._unbuilt.pop(0)
            with self.client.atomic(), container, self._content():
                self._screens.append(tab.build(self.session))

    def _content(self) -> viser.GuiFolderHandle:
        self._contents.append(self.client.gui.add_folder(None))
        return self._contents[-1]

    def _look(self) -> None:
        width, height = self._window
        picture = width - covered(width, height), height
        look_at_arm(self.client, self._robots.console.robot, picture=picture, sheet=width < _PHONE_PX)

    async def _fit(self) -> None:
        """Lay the page out anew where its pixels are larger than those of the screen: phones, and zoom."""
        width, _, height = (await self.session.recall("window") or "").partition(" ")
        if not (width.isdecimal() and height.isdecimal()) or (int(width), int(height)) == self._window:
            return
        self._window = int(width), max(int(height), 1)
        self.session.on_phone = self._window[0] < _PHONE_PX
        self._lay_out()
        self._look()

    def _lay_out(self) -> None:
        """As wide as the window allows; *Control* to the left of the arm, or above the tabs."""
        tabs, panel = self.client.gui.main_panel, self._panel
        tabs.set_width(tabs_width(self._window[0]))
        if above_tabs(*self._window):
            panel.dock_above(tabs)
            panel.expand()  # on a phone it begins folded, and Enable is in it
        else:  # docked: notifications cover what floats at the left, but give way to what is docked there
            panel.dock_left()
            panel.set_width(PANEL_WIDTH)

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
            self._always.refresh(snapshot)
            for screen in self._screens:
                screen.refresh(snapshot)

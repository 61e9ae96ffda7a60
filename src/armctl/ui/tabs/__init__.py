"""The tabs, in the order in which they are shown."""

from __future__ import annotations

from collections.abc import Callable

import viser

from armctl.ui.tabs.calibration.screen import CalibrationScreen
from armctl.ui.tabs.forward.screen import ForwardScreen
from armctl.ui.tabs.inverse.screen import InverseScreen
from armctl.ui.tabs.main.screen import MainScreen
from armctl.ui.tabs.manual.screen import ManualScreen
from armctl.ui.tabs.screen import Screen
from armctl.ui.tabs.simulation.screen import SimulationScreen
from armctl.ui.tabs.trajectory.screen import TrajectoryScreen

SCREENS: tuple[type[Screen], ...] = (
    MainScreen,
    ManualScreen,
    TrajectoryScreen,
    ForwardScreen,
    InverseScreen,
    SimulationScreen,
    CalibrationScreen,
)

__all__ = ["SCREENS", "Screen"]


# The tabs of one page.

_STYLE = (
    "<style>[data-dock-tab]{padding:0 .5em!important}"
    "label[for],.mantine-Notification-description{color:#495057!important}</style>"
)
"""With the page's own, wider padding the tabs need a second row; its grey for labels is hard to read."""


class PageTabs:
    """They outlive the arm: whoever has a tab open keeps it when its screen is built anew."""

    def __init__(self, gui: viser.GuiApi) -> None:
        """Add the tabs, empty, in the order of the screens."""
        self._gui = gui
        gui.add_html(_STYLE)
        group = gui.add_tab_group()
        self._tabs = [group.add_tab(screen.label, screen.icon) for screen in SCREENS]
        self._contents: list[viser.GuiFolderHandle] = []

    def fill(self, build: Callable[[type[Screen]], Screen]) -> list[Screen]:
        """Build every screen inside its tab."""
        screens: list[Screen] = []
        for screen, tab in zip(SCREENS, self._tabs, strict=True):
            with tab:
                content = self._gui.add_folder(None)
            self._contents.append(content)
            with content:
                screens.append(build(screen))
        return screens

    def clear(self) -> None:
        """Take the screens out of their tabs."""
        for content in self._contents:
            content.remove()
        self._contents.clear()

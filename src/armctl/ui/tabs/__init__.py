"""The tabs of a page, in the order in which they are shown."""

from __future__ import annotations

import pkgutil
from typing import Protocol, cast

import viser

from armctl.lazy_dataclass import dataclass
from armctl.protocol import Snapshot
from armctl.ui.session import Session

__all__ = ["PROGRAM", "TABS", "Screen", "Tab"]


class Screen(Protocol):
    """What a tab shows: built once inside its tab, then drawn again and again."""

    def __init__(self, session: Session) -> None: ...

    def refresh(self, snapshot: Snapshot) -> None:
        """Draw a snapshot; called about ten times a second, so it writes only what has changed."""
        ...


@dataclass(frozen=True, slots=True)
class Tab:
    """One tab; its screen is imported when the first page is built."""

    label: str
    screen: str
    """``module:class`` of a ``Screen``"""
    icon: viser.IconName | None = None

    def build(self, session: Session) -> Screen:
        """Build the screen in the present GUI container."""
        return cast("type[Screen]", pkgutil.resolve_name(self.screen))(session)


TABS: tuple[Tab, ...] = (
    Tab("Main", "armctl.ui.tabs.main.screen:MainScreen"),
    Tab("Manual", "armctl.ui.tabs.manual.screen:ManualScreen"),
    Tab("Trajectory", "armctl.ui.tabs.trajectory.screen:TrajectoryScreen"),
    Tab("Forward", "armctl.ui.tabs.forward.screen:ForwardScreen"),
    Tab("Inverse", "armctl.ui.tabs.inverse.screen:InverseScreen"),
    Tab("Simulation", "armctl.ui.tabs.simulation.screen:SimulationScreen"),
    Tab("Calibration", "armctl.ui.tabs.calibration.screen:CalibrationScreen"),
    Tab("Log", "armctl.ui.tabs.log:LogScreen"),
)
PROGRAM = Tab("Serial motion", "armctl.ui.tabs.manual.screen:SerialMotion", viser.Icon.LIST_NUMBERS)
"""beside the scene, whatever tab is open"""

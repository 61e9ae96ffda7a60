"""The tabs, in the order in which they are shown."""

from armctl.ui.screens.calibration import CalibrationScreen
from armctl.ui.screens.forward import ForwardScreen
from armctl.ui.screens.inverse import InverseScreen
from armctl.ui.screens.main import MainScreen
from armctl.ui.screens.manual import ManualScreen
from armctl.ui.screens.screen import Screen
from armctl.ui.screens.simulation import SimulationScreen
from armctl.ui.screens.trajectory import TrajectoryScreen

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

"""The browser pages over viser."""

from armctl.ui.app import App
from armctl.ui.calibration_desk import CalibrationDesk
from armctl.ui.console import Console, PortChoice
from armctl.ui.program_desk import ProgramDesk
from armctl.ui.robot_desk import RobotChoice, RobotDesk

__all__ = ["App", "CalibrationDesk", "Console", "PortChoice", "ProgramDesk", "RobotChoice", "RobotDesk"]

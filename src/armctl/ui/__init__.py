"""The browser pages over viser."""

from armctl.ui.app import App, settle_interpreter
from armctl.ui.console import CalibrationInForce, Console, PortChoice
from armctl.ui.robot_switch import RobotChoice, RobotSwitch

__all__ = [
    "App",
    "CalibrationInForce",
    "Console",
    "PortChoice",
    "RobotChoice",
    "RobotSwitch",
    "settle_interpreter",
]

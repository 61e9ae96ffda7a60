"""What all browser pages share: the arm, its controller, who operates, the program being edited."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from armctl.robot import Robot
from armctl.runtime import Controller, Event
from armctl.ui.calibration_desk import CalibrationDesk
from armctl.ui.last_known import LastKnown
from armctl.ui.operator import OperatorDesk
from armctl.ui.program_desk import ProgramDesk
from armctl.ui.scene.cloud import CloudStore
from armctl.ui.scene.trail import Trail


@dataclass(frozen=True, slots=True)
class PortChoice:
    """One entry of the port list."""

    port: str
    """what ``Connect`` takes: sim, auto or a device"""
    label: str
    why_not: str | None = None
    """why it cannot be used, and what to do"""
    serial_number: str | None = None
    notes: tuple[str, ...] = ()
    """what the user should know before connecting"""
    listed: bool = False
    """there is a device; not just a way to ask for one"""


@dataclass(frozen=True)
class Console:
    """One arm and everything that the pages share. Used on the web server's event loop only."""

    robot: Robot
    controller: Controller
    list_ports: Callable[[], Sequence[PortChoice]]
    programs: ProgramDesk
    calibrating: CalibrationDesk
    close: Callable[[], None]
    """ends the arm: controller and boards; may block for as long as a moving arm needs to come to rest"""
    default_port: str = "sim"
    """the port that the arm was opened for, as it is calibrated with the board on it"""
    operators: OperatorDesk = field(default_factory=OperatorDesk)
    last_known: LastKnown = field(default_factory=LastKnown)
    """where the arm was last known to stand"""
    trail: Trail = field(default_factory=Trail)
    """where the tool point has been"""
    clouds: CloudStore = field(default_factory=CloudStore)
    """the workspace cloud, computed once for all pages"""
    earlier: tuple[Event, ...] = ()
    """the log from before this arm was chosen, oldest first"""

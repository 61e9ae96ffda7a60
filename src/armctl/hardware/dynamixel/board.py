"""ROBOTIS Dynamixel X servos (OpenMANIPULATOR-X, PincherX, WidowX, ViperX, Koch) on a USB adapter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armctl.hardware.bus import SCALE
from armctl.hardware.bus.board import BusBoard

if TYPE_CHECKING:
    from armctl.hardware.bus.make import ServoMake
    from armctl.hardware.bus.plant import PlantJoint
    from armctl.hardware.bus.simulated import BusServo, Gear, Supply


class DynamixelBoard(BusBoard):
    """X servos with Protocol 2.0, on a bus of their own."""

    kind = "dynamixel"
    title = "Dynamixel servo bus"
    plugged_in = "servo bus adapter"
    scale = SCALE
    baud = 1_000_000
    sag_deg = 6.0  # an OpenMANIPULATOR-X under its payload comes to 5.4°
    notes = (
        "Dynamixel servos stop and hold where they are when this program ends or its cable is pulled: their "
        "bus watchdog sees to that. Release switches their torque off",
    )
    simulator_robot = "open_manipulator_x"
    simulator_help = "Serve a simulated bus of Dynamixel X servos, with an arm on it, until interrupted."

    def make(self) -> ServoMake:
        """Packets and control table."""
        from armctl.hardware.dynamixel.make import DYNAMIXEL

        return DYNAMIXEL

    def servo(self, number: int, joint: PlantJoint, gear: Gear, supply: Supply) -> BusServo:
        """A simulated servo, as it is set up for its arm."""
        from armctl.hardware.dynamixel.simulated import SimulatedX, factory_memory

        return SimulatedX(joint, gear, supply, factory_memory(id=number))

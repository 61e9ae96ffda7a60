"""Feetech's bus servos (SO-100, SO-101, LeKiwi) on a USB adapter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armctl.hardware.bus import SCALE
from armctl.hardware.bus.board import BusBoard

if TYPE_CHECKING:
    from armctl.hardware.bus.make import ServoMake
    from armctl.hardware.bus.plant import PlantJoint
    from armctl.hardware.bus.simulated import BusServo, Gear, Supply


class FeetechBoard(BusBoard):
    """STS and SMS servos, on a bus of their own."""

    kind = "feetech"
    title = "Feetech servo bus"
    plugged_in = "servo bus adapter"
    scale = SCALE
    baud = 1_000_000
    notes = (
        "Feetech servos hold their last goal when this program ends or its cable is pulled: they have no "
        "watchdog. Release switches their torque off",
    )
    simulator_robot = "so101"
    simulator_help = "Serve a simulated bus of Feetech STS3215 servos, with an arm on it, until interrupted."

    def make(self) -> ServoMake:
        """Packets and control table."""
        from armctl.hardware.feetech.make import FEETECH

        return FEETECH

    def servo(self, number: int, joint: PlantJoint, gear: Gear, supply: Supply) -> BusServo:
        """A simulated servo, as it is set up for its arm."""
        from armctl.hardware.feetech.make import FEETECH
        from armctl.hardware.feetech.simulated import SimulatedFeetech, factory_memory

        return SimulatedFeetech(FEETECH, joint, gear, supply, factory_memory(id=number))

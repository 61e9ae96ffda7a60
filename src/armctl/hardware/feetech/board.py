"""Feetech's bus servos (SO-100, SO-101, LeKiwi) on a USB adapter."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from armctl.hardware.board_type import ByteModel, Setup, SimulatorOptions
from armctl.hardware.bus import SCALE, BusEntries
from armctl.hardware.bus.board import BusBoard
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.feetech import SCS_STEPS

if TYPE_CHECKING:
    from armctl.hardware.bus.driver import BusDriver
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


class ScsBoard(BusBoard):
    """SCS servos, on a bus of their own."""

    kind = "feetech_scs"
    title = "Feetech SCS servo bus"
    plugged_in = "servo bus adapter"
    scale = SCALE
    entries = BusEntries("steps", "steps", "range_steps", 0.0, SCS_STEPS - 1.0, limited=False)
    baud = 1_000_000
    notes = (
        "Feetech servos hold their last goal when this program ends or its cable is pulled: they have no "
        "watchdog. Release switches their torque off at once: support the arm",
    )
    simulator_help = "Serve a simulated bus of four Feetech SCS0009 servos, until interrupted."

    def make(self) -> ServoMake:
        """Packets and control table."""
        from armctl.hardware.feetech.scs import SCS

        return SCS

    def driver_type(self) -> type[BusDriver]:
        """Without limits of the torque."""
        from armctl.hardware.feetech.scs import ScsDriver

        return ScsDriver

    def servo(self, number: int, joint: PlantJoint, gear: Gear, supply: Supply) -> BusServo:
        """A simulated servo, as it comes, with all of its range."""
        from armctl.hardware.feetech.scs import FACTORY, SCS, TABLE
        from armctl.hardware.feetech.simulated import SimulatedFeetech, factory_memory

        memory = factory_memory(TABLE, FACTORY, id=number)
        return SimulatedFeetech(SCS, joint, gear, supply, memory)

    def simulated(self, setup: Setup, options: SimulatorOptions) -> ByteModel:
        """Four servos on free shafts where no robot is named; they are fed with 7.4 V."""
        if not setup.channels:
            setup = replace(
                setup, channels=[ChannelSettings(one, 0.0, SCS_STEPS - 1.0) for one in range(1, 5)]
            )
        return super().simulated(setup, {"volts": 7.4, **{k: v for k, v in options.items() if v is not None}})

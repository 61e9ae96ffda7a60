"""What every bus servo shares: the half-duplex line, the torque-on rite, the driver, and the simulated bus.

A make (``ServoMake``) has its folder beside this one: its packets, its control table, what its servos mean.
"""

from armctl.hardware.driver import ChannelScale
from armctl.robot.board_entries import ServoEntries

SCALE = ChannelScale("servo", "steps")
SERVO_ENTRIES = ServoEntries("steps", "steps", "range_steps", 0.0, 4095.0)
"""what a robot file says of a servo; its channel is its id"""
EEPROM_ADVICE = "armctl writes nothing into a servo's EEPROM unasked: see Main → Servos, or `armctl servos`"

"""What every bus servo shares: the half-duplex line, the torque-on rite, the driver, and the simulated bus.

A make (``ServoMake``) has its folder beside this one: its packets, its control table, what its servos mean.
"""

from armctl.hardware.driver import ChannelScale

SCALE = ChannelScale("servo", "steps")
EEPROM_ADVICE = "armctl writes nothing into a servo's EEPROM unasked: see `armctl servos`"

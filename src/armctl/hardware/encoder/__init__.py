"""Arduinos with armctl's own firmware for motors with encoders."""

from armctl.hardware.driver import ChannelScale

# What the descriptor says as well as the driver: every program imports the former, few the latter.
SCALE = ChannelScale("axis", "counts")
FLASHING = "`armctl firmware FOLDER` writes it there; its README.md says how under Flashing"
FLASH_IT = f"flash armctl's encoder firmware ({FLASHING})"

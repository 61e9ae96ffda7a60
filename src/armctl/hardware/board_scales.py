"""How finely each kind of board takes its setpoints."""

from __future__ import annotations

from armctl.hardware.channel_scale import ChannelScale
from armctl.hardware.encoder.axis_table import SCALE as ENCODER
from armctl.hardware.firmata.pin_table import SCALE as FIRMATA
from armctl.hardware.maestro.channel_table import SCALE as MAESTRO
from armctl.robot.robot import BoardKind

BOARD_SCALES: dict[BoardKind, ChannelScale] = {"maestro": MAESTRO, "firmata": FIRMATA, "encoder": ENCODER}

"""What people call each kind of board."""

from __future__ import annotations

from armctl.hardware.driver import ChannelScale
from armctl.hardware.encoder.axes import SCALE as ENCODER
from armctl.hardware.firmata.pins import SCALE as FIRMATA
from armctl.hardware.maestro.driver import SCALE as MAESTRO
from armctl.robot.robot import BoardKind

BOARD_TITLES: dict[BoardKind, str] = {
    "maestro": "Pololu Maestro",
    "firmata": "Arduino with StandardFirmata",
    "encoder": "Arduino with armctl's encoder firmware",
}


# How finely each kind of board takes its setpoints.

BOARD_SCALES: dict[BoardKind, ChannelScale] = {"maestro": MAESTRO, "firmata": FIRMATA, "encoder": ENCODER}

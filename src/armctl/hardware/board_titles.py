"""What people call each kind of board."""

from __future__ import annotations

from armctl.robot.robot import BoardKind

BOARD_TITLES: dict[BoardKind, str] = {
    "maestro": "Pololu Maestro",
    "firmata": "Arduino with StandardFirmata",
    "encoder": "Arduino with armctl's encoder firmware",
}

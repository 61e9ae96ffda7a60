"""Whether a board takes the channels that a robot has for it, told without one."""

from __future__ import annotations

from collections.abc import Sequence

from armctl.errors import BoardError
from armctl.hardware.driver import ChannelSettings
from armctl.hardware.encoder.axes import AxisTable
from armctl.hardware.encoder.simulated_axis import FIRMWARE_DEFAULTS
from armctl.hardware.firmata.pins import PinTable
from armctl.hardware.firmata.simulated import SERVO_PINS
from armctl.hardware.maestro.driver import ChannelTable
from armctl.robot import BoardKind, EncoderAxis


def channel_refusal(
    kind: BoardKind,
    settings: Sequence[ChannelSettings],
    axes: Sequence[EncoderAxis] = (),
    differential: tuple[int, int] | None = None,
) -> str | None:
    """What the largest board of a kind would refuse when it is configured.

    Args:
        kind: of the board.
        settings: what each channel may do, in the board's unit.
        axes: how each axis of an encoder board is controlled and homed.
        differential: the two axes of a differential wrist, None without one.

    Returns:
        The refusal in words; None: it takes them all.
    """
    try:
        match kind:
            case "maestro":
                ChannelTable(settings, None)
            case "firmata":
                PinTable(settings, SERVO_PINS)
            case "encoder":
                AxisTable(settings, axes, differential, len(FIRMWARE_DEFAULTS)).configuration()
    except BoardError as refusal:
        return str(refusal)
    return None

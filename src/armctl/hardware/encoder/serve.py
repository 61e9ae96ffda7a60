"""A simulated encoder board on a pty, ready to be opened: what ``sim`` and ``armctl simulate`` use."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from armctl.hardware.driver import ChannelSettings
from armctl.hardware.encoder.axis_plant import plant_of
from armctl.hardware.encoder.simulated import SimulatedEncoderBoard
from armctl.hardware.pty_server import PtyServer
from armctl.robot import EncoderAxis


def simulated_encoder_board(
    channels: Sequence[ChannelSettings], axes: Sequence[EncoderAxis]
) -> SimulatedEncoderBoard:
    """A board with an arm on it that fits these settings; axes without any are plain ones."""
    limits = {one.channel: one for one in channels}
    return SimulatedEncoderBoard(
        {one.axis: plant_of(limits[one.axis], one) for one in axes if one.axis in limits}
    )


def serve_simulated_encoder(
    now: Callable[[], float],
    *,
    channels: Sequence[ChannelSettings],
    axes: Sequence[EncoderAxis],
    link: Path | None = None,
) -> PtyServer[SimulatedEncoderBoard]:
    """A server to be entered as a context; its ``port`` is what a driver or any other client opens.

    Args:
        now: the clock [s].
        channels: the limits of each axis in counts: the hard stops are a little outside.
        axes: how each axis is homed: its switch is where it is looked for.
        link: where the pty is to be found; under its own name when None.
    """
    return PtyServer(simulated_encoder_board(channels, axes), now, link=link)

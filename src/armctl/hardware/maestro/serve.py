"""A simulated Maestro on a pty, ready to be opened: what ``--port sim`` and ``armctl simulate`` use."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from armctl.hardware.driver import ChannelSettings
from armctl.hardware.maestro.simulated import MaestroSettings, SimulatedMaestro
from armctl.hardware.maestro.simulated_channel import ChannelConfig
from armctl.hardware.maestro_models import MaestroModel
from armctl.hardware.pty_server import PtyServer


def serve_simulated_maestro(
    now: Callable[[], float],
    *,
    channels: Sequence[ChannelSettings] = (),
    model: MaestroModel | None = None,
    settings: MaestroSettings | None = None,
    link: Path | None = None,
) -> PtyServer[SimulatedMaestro]:
    """A server to be entered as a context; its ``port`` is what a driver or any other client opens.

    Args:
        now: the clock [s].
        channels: the robot's channels, whose ranges the simulated board gets as if its owner had set
            them in the Maestro Control Center; the factory's 992 … 2000 µs for all others.
        model: which board; None: the smallest with enough channels.
        settings: what else is stored on the board; its ``channels`` win over ranges from ``channels``.
        link: where the pty is to be found; under its own name when None.
    """
    settings = settings or MaestroSettings()
    if model is None:
        used = [one.channel for one in channels] + list(settings.channels or {})
        model = MaestroModel.with_channels(max(used, default=0) + 1)
    configs = {one.channel: ChannelConfig(one.minimum, one.maximum) for one in channels}
    board = SimulatedMaestro(model, replace(settings, channels=configs | dict(settings.channels or {})))
    return PtyServer(board, now, link=link)

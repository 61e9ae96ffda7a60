"""``armctl simulate``: a simulated board on a pty, for any client."""

from __future__ import annotations

from pathlib import Path

import click

from armctl.cli.ending import end_event
from armctl.errors import InputError
from armctl.hardware.encoder import serve_simulated_encoder
from armctl.hardware.firmata import serve_simulated_firmata
from armctl.hardware.maestro import serve_simulated_maestro
from armctl.hardware.ports import MaestroModel
from armctl.hardware.simulation.pty_server import Model, PtyServer
from armctl.robot import load_robot
from armctl.runtime import MonotonicClock, channel_settings


@click.group()
def simulate() -> None:
    """Serve a simulated board on a pseudo-terminal, for any program that opens serial ports."""


@simulate.command()
@click.option("--link", type=click.Path(path_type=Path), help="Where to find the port, e.g. /tmp/maestro.")
@click.option(
    "--robot", default="uzuner", show_default=True, help="Whose channel ranges the board is set up with."
)
@click.option("--factory", is_flag=True, help="Leave all channels at the factory's 992 … 2000 µs.")
@click.option(
    "--channels",
    type=click.Choice(["6", "12", "18", "24"]),
    help="Board size (default: what the robot needs).",
)
def maestro(link: Path | None, robot: str, factory: bool, channels: str | None) -> int:
    """Serve a simulated Pololu Maestro until interrupted.

    It speaks the compact and the Pololu protocol in USB dual-port mode.
    """
    loaded = load_robot(robot)
    if loaded.board == "encoder":
        raise InputError(f"{robot} has motors with encoders, not servos; use `armctl simulate encoder`")
    settings = () if factory else channel_settings(loaded)
    model = None if channels is None else MaestroModel.with_channels(int(channels))
    clock = MonotonicClock()
    return _serve(serve_simulated_maestro(clock.now, channels=settings, model=model, link=link))


@simulate.command()
@click.option("--link", type=click.Path(path_type=Path), help="Where to find the port, e.g. /tmp/firmata.")
def firmata(link: Path | None) -> int:
    """Serve a simulated Arduino Mega with StandardFirmata until interrupted.

    Servos on pins 2 … 49. It does not restart when its port is opened, as a real Mega does.
    """
    return _serve(serve_simulated_firmata(MonotonicClock().now, link=link))


@simulate.command()
@click.option("--link", type=click.Path(path_type=Path), help="Where to find the port, e.g. /tmp/encoder.")
@click.option("--robot", default="scorbot", show_default=True, help="Whose motors and encoders are on it.")
def encoder(link: Path | None, robot: str) -> int:
    """Serve a simulated Arduino Mega with armctl's encoder firmware and an arm on it until interrupted.

    Its axes must be homed, each of which takes about a second. It does not restart when its port is
    opened, as a real Mega does.
    """
    loaded = load_robot(robot)
    if not loaded.axes:
        raise InputError(f"{robot} has no motors with encoders; choose a robot whose board is encoder")
    clock = MonotonicClock()
    channels = channel_settings(loaded)
    return _serve(serve_simulated_encoder(clock.now, channels=channels, axes=loaded.axes, link=link))


def _serve(server: PtyServer[Model]) -> int:
    """Until it is told to end, which is a good end."""
    ended = end_event()
    with server:
        click.echo(f"simulated board on {server.port} (ctrl-c ends it)")
        ended.wait()
    return 0

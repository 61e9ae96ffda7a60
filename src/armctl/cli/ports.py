"""``armctl ports``: serial ports and the boards behind them."""

from __future__ import annotations

import dataclasses

import click

from armctl.cli.options import json_option, print_json
from armctl.hardware.ports import list_ports


@click.command()
@json_option
def ports(as_json: bool) -> None:
    """List serial ports: which board, and why one cannot be used."""
    found = list_ports()
    if as_json:
        print_json([dataclasses.asdict(port) for port in found])
        return
    if not found:
        click.echo("no serial port found; the simulated board needs none (--port sim)")
    for port in found:
        serial = f", serial number {port.serial_number}" if port.serial_number else ""
        click.echo(f"{port.device:<20}{port.kind}{serial}")
        click.echo(f"{'':<20}{'ready to use' if port.usable else port.why_not}")

"""``armctl ports`` and ``armctl firmware``: serial ports, the boards behind them, what runs on a board."""

from __future__ import annotations

import shutil
from dataclasses import asdict
from pathlib import Path

import click

from armctl.cli.options import json_option, print_json
from armctl.documents import shipped_folder
from armctl.errors import ArmctlError, InputError
from armctl.hardware.access import udev_rules
from armctl.hardware.ports import list_ports
from armctl.hardware.probe import approach, probe
from armctl.hardware.transport import PortInfo, SerialTransport
from armctl.protocol import MonotonicClock

_WIDTH = 20


@click.command()
@click.option(
    "--probe",
    "probing",
    is_flag=True,
    help="Open each port and find out who answers. Restarts Arduinos: what their motors hold sinks.",
)
@click.option("--udev", is_flag=True, help="Print the udev rules for the boards, and nothing else.")
@json_option
def ports(probing: bool, udev: bool, as_json: bool) -> None:
    """List serial ports: which board, and why one cannot be used."""
    if udev:
        click.echo(udev_rules(), nl=False)
        return
    found = list_ports()
    answers = {port.device: _answer(port) for port in found} if probing else {}
    if as_json:
        extra = {device: {"answer": answer} for device, answer in answers.items()}
        print_json([asdict(port) | extra.get(port.device, {}) for port in found])
        return
    if not found:
        click.echo("no serial port found; the simulated board needs none (--port sim)")
    for port in found:
        serial = f", serial number {port.serial_number}" if port.serial_number else ""
        click.echo(f"{port.device:<{_WIDTH}}{port.kind}{serial}")
        lines = ["ready to use" if port.usable else port.why_not, port.stable_name, *port.notes]
        for line in (*lines, answers.get(port.device)):
            if line:
                click.echo(f"{'':<{_WIDTH}}{line}")


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
def firmware(folder: Path) -> None:
    """Write armctl's Arduino sketch to FOLDER.

    It drives motors with encoders. FOLDER must be empty or new.
    """
    try:
        if folder.exists() and any(folder.iterdir()):
            raise InputError(f"{folder} is not empty; name a new folder")
        shutil.copytree(shipped_folder("firmware"), folder, dirs_exist_ok=True)
    except OSError as cause:
        raise InputError(f"{folder}: the sketch cannot be written: {cause.strerror or cause}") from cause
    click.echo(f"open {folder / 'encoder' / 'encoder.ino'} in the Arduino IDE; README.md has the wiring")


def _answer(port: PortInfo) -> str | None:
    """Who answers there; None for a port that cannot be used anyway."""
    if not port.usable:
        return None
    try:
        answer = probe(
            lambda baud: SerialTransport(port.device, baud=baud), approach(port.kind), MonotonicClock().now
        )
        return f"probed: {answer}"
    except ArmctlError as error:
        return f"probed: {error}"

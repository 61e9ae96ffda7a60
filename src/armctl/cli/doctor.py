"""``armctl doctor``: a check-up of a port and its board, as a report to paste into a bug report."""

from __future__ import annotations

import dataclasses
import getpass
import platform
import socket
from collections.abc import Sequence
from contextlib import closing
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import click

from armctl.boards import AUTOMATIC, SIMULATED, Boards, require_kind, split_kind
from armctl.cli.options import json_option, print_json
from armctl.errors import ArmctlError
from armctl.hardware.doctor import Patient, examine, without_personal_data
from armctl.hardware.findings import Finding, Verdict, failed
from armctl.hardware.ports import find_board, list_ports
from armctl.hardware.transport import SerialTransport, describe_port
from armctl.robot import Robot, load_robot
from armctl.runtime import MonotonicClock, channel_settings

ALL_FINE, SOMETHING_FAILED = 0, 1
_PACKAGES = ("armctl", "numpy", "scipy", "viser", "pyserial", "msgspec")
_WIDTH = 16


@click.command()
@click.option("--port", required=True, help="sim, auto, a device or socket://host:port.")
@click.option("--robot", help="Check the board for what this robot needs of it too.")
@json_option
def doctor(port: str, robot: str | None, as_json: bool) -> int:
    """Check a port and the board behind it, and print a report.

    Nothing moves and nothing is changed; but opening the port of an Arduino restarts it, which switches
    its servos or motors off, and what is held by them sinks.

    The report names no person and no computer: it can go into a public bug report. The exit status is 1
    when something failed.
    """
    loaded = None if robot is None else load_robot(robot)
    try:
        findings = _examined(port, loaded)
    except ArmctlError as error:
        findings = (failed("port", str(error)),)
    asked = {"port": port, "robot": None if loaded is None else loaded.name}
    if as_json:
        print_json(
            {
                **{name: _scrubbed(value) if value else None for name, value in asked.items()},
                "environment": _environment(),
                "findings": [_record(finding) for finding in findings],
            }
        )
    else:
        click.echo(_scrubbed(_report(asked, findings)))
    return SOMETHING_FAILED if any(one.verdict is Verdict.FAILED for one in findings) else ALL_FINE


def _examined(port: str, robot: Robot | None) -> Sequence[Finding]:
    clock = MonotonicClock()
    expected = None if robot is None else robot.board
    channels = () if robot is None else tuple(channel_settings(robot))
    if port == SIMULATED:
        # Of the simulated boards the Maestro is the one that needs no robot to be set up.
        with closing(Boards(robot or load_robot("uzuner"), clock.now)) as boards:
            patient = Patient(boards.simulated().port, expected=expected, channels=channels, simulated=True)
            return examine(patient, _opener(patient.port), clock.now)
    listing = list_ports()
    named, device = split_kind(port)
    if robot is not None and named is not None:
        require_kind(robot, named, device)
    if port == AUTOMATIC:
        device = find_board(listing, expected).device
    patient = Patient(device, describe_port(device, listing), named.kind if named else expected, channels)
    return examine(patient, _opener(device), clock.now)


def _opener(device: str):
    def open_line(baud: int) -> SerialTransport:
        return SerialTransport(device, baud=baud)

    return open_line


def _environment() -> dict[str, str]:
    """Versions of everything that has a part in it."""
    return {
        "Python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        **{package: _version(package) for package in _PACKAGES},
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from a source tree that was not installed
        return "not installed"


def _report(asked: dict[str, str | None], findings: Sequence[Finding]) -> str:
    environment = _environment()
    lines = [
        "armctl doctor: " + ", ".join(f"{name} {text}" for name, text in environment.items()),
        f"port {asked['port']}, robot {asked['robot'] or 'not named'}",
        "",
    ]
    for finding in findings:
        lines.append(f"{finding.verdict.value:<{_WIDTH - 4}}{finding.check:<{_WIDTH}}{finding.seen}")
        if finding.advice:
            lines.append(f"{'':<{2 * _WIDTH - 4}}-> {finding.advice}")
    counts = [
        f"{sum(one.verdict is verdict for one in findings)} {verdict.value}"
        for verdict in Verdict
        if any(one.verdict is verdict for one in findings)
    ]
    return "\n".join([*lines, "", ", ".join(counts)])


def _record(finding: Finding) -> dict[str, str]:
    texts = dataclasses.asdict(finding) | {"verdict": finding.verdict.value}
    return {name: _scrubbed(text) for name, text in texts.items()}


def _scrubbed(text: str) -> str:
    return without_personal_data(text, str(Path.home()), socket.gethostname(), _user())


def _user() -> str:
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # a user without an entry, as in some containers
        return ""

"""``armctl doctor``: a check-up of a port and its board, as a report to paste into a bug report."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

import click

from armctl.boards import AUTOMATIC, SIMULATED, Boards, require_kind, split_kind
from armctl.cli.main import DONE, REFUSED
from armctl.cli.options import ROBOT, json_option, named_port_option, print_json
from armctl.documents import write_atomically
from armctl.errors import ArmctlError, InputError
from armctl.hardware.channels import channel_settings
from armctl.hardware.doctor import Patient, examine
from armctl.hardware.findings import Finding, Verdict, failed
from armctl.hardware.ports import find_board, list_ports
from armctl.hardware.transport import SerialTransport, describe_port
from armctl.protocol import MonotonicClock
from armctl.report import environment, report, scrubbed
from armctl.robot import Robot, load_robot

_WIDTH = 16


@click.command()
@named_port_option("examines")
@click.option("--robot", type=ROBOT, help="Check the board for what this robot needs of it too.")
@click.option("--report", "file", type=click.Path(path_type=Path), metavar="FILE",
              help="Also write a zip file to send: versions, logs, the last faults, this check-up.",
              )  # fmt: skip
@json_option
def doctor(port: str, robot: str | None, file: Path | None, as_json: bool) -> int:
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
    name = None if loaded is None else loaded.name
    text = _report(f"port {port}, robot {name or 'not named'}", findings)
    if file is not None:
        try:
            write_atomically(file, report(robot, checkup=text), private=True)
        except OSError as cause:
            raise InputError(f"{file}: the report cannot be written: {cause.strerror}") from cause
    if as_json:
        texts = [asdict(finding) | {"verdict": finding.verdict.value} for finding in findings]
        print_json({
            "port": scrubbed(port) or None,
            "robot": name and scrubbed(name),
            "environment": environment(),
            "findings": [{key: scrubbed(text) for key, text in one.items()} for one in texts],
        })  # fmt: skip
    else:
        click.echo(scrubbed(text))
    return REFUSED if any(one.verdict is Verdict.FAILED for one in findings) else DONE


def _examined(port: str, robot: Robot | None) -> Sequence[Finding]:
    now = MonotonicClock().now
    expected = None if robot is None else robot.board
    channels = () if robot is None else tuple(channel_settings(robot))
    # Of the simulated boards the Maestro is the one that needs no robot to be set up.
    with closing(Boards(robot or load_robot("uzuner"), now)) as boards:
        if port == SIMULATED:
            device = boards.simulated().port
            patient = Patient(device, expected=expected, channels=channels, simulated=True)
        else:
            listing = list_ports()
            named, device = split_kind(port)
            if robot is not None and named is not None:
                require_kind(robot, named, device)
            if port == AUTOMATIC:
                device = find_board(listing, expected).device
            kind = named.kind if named else expected
            missing = [one for one in listing if one.missing]
            patient = Patient(device, describe_port(device, listing), kind, channels, missing=missing)
        return examine(patient, lambda baud: SerialTransport(device, baud=baud), now)


def _report(asked: str, findings: Sequence[Finding]) -> str:
    versions = ", ".join(f"{name} {text}" for name, text in environment().items())
    lines = [f"armctl doctor: {versions}", asked, ""]
    for finding in findings:
        lines.append(f"{finding.verdict.value:<{_WIDTH - 4}}{finding.check:<{_WIDTH}}{finding.seen}")
        if finding.advice:
            lines.append(f"{'':<{2 * _WIDTH - 4}}-> {finding.advice}")
    counts = {verdict: sum(one.verdict is verdict for one in findings) for verdict in Verdict}
    said = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)
    return "\n".join([*lines, "", said])

"""``armctl ports`` and ``armctl firmware``: serial ports, the boards behind them, what runs on a board."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from armctl.boards import AUTOMATIC, SIMULATED, Boards, require_kind, setup_of, split_kind
from armctl.cli.main import DONE, REFUSED
from armctl.cli.options import (
    INPUTS,
    ROBOT,
    Number,
    end_event,
    json_option,
    named_port_option,
    print_json,
)
from armctl.documents import shipped_folder, write_atomically
from armctl.errors import ArmctlError, InputError
from armctl.hardware import BoardType, Setup, SimulatorOption
from armctl.hardware.access import udev_rules
from armctl.hardware.board_type import ByteModel, Finding, SimulatedPins, Verdict, failed
from armctl.hardware.boards import board_type, board_types, channel_settings, find_board_type
from armctl.hardware.doctor import Patient, examine
from armctl.hardware.faults import FAULT_HELP, FaultyModel, Trouble, trouble
from armctl.hardware.input_script import InputPlayer, load_script, read_script
from armctl.hardware.ports import approach, find_board, list_ports, open_line, probe
from armctl.hardware.simulation import BoardServer
from armctl.hardware.transport import PortInfo, describe_port
from armctl.protocol import MonotonicClock
from armctl.report import environment, report, scrubbed
from armctl.robot import Robot, load_robot

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
            lambda baud: open_line(port.device, baud),
            approach(port.kind, port=port.device),
            MonotonicClock().now,
        )
        return f"probed: {answer}"
    except ArmctlError as error:
        return f"probed: {error}"


# ``armctl doctor``: a check-up of a port and its board, as a report to paste into a bug report.


_CHECK_WIDTH = 16


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
    settings = None if robot is None else robot.board_settings
    # Of the simulated boards the Maestro is the one that needs no robot to be set up.
    with closing(Boards(robot or load_robot("uzuner"), now)) as boards:
        if port == SIMULATED:
            device = boards.simulated().port
            patient = Patient(device, None, expected, channels, simulated=True, settings=settings)
        else:
            listing = list_ports()
            named, device = split_kind(port)
            if robot is not None and named is not None:
                require_kind(robot, named, device)
            if port == AUTOMATIC:
                device = find_board(listing, expected).device
            kind = named.kind if named else expected
            missing = [one for one in listing if one.missing]
            info = describe_port(device, listing)
            patient = Patient(device, info, kind, channels, missing=missing, settings=settings)
        return examine(patient, lambda baud: open_line(device, baud), now)


def _report(asked: str, findings: Sequence[Finding]) -> str:
    versions = ", ".join(f"{name} {text}" for name, text in environment().items())
    lines = [f"armctl doctor: {versions}", asked, ""]
    for finding in findings:
        lines.append(
            f"{finding.verdict.value:<{_CHECK_WIDTH - 4}}{finding.check:<{_CHECK_WIDTH}}{finding.seen}"
        )
        if finding.advice:
            lines.append(f"{'':<{2 * _CHECK_WIDTH - 4}}-> {finding.advice}")
    counts = {verdict: sum(one.verdict is verdict for one in findings) for verdict in Verdict}
    said = ", ".join(f"{count} {verdict.value}" for verdict, count in counts.items() if count)
    return "\n".join([*lines, "", said])


# ``armctl simulate``: a simulated board on a pty, for any client.


_LOOK_S = 0.1


class _Fault(click.ParamType[Trouble]):
    """A fault, and when it strikes."""

    name = "fault"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Trouble:
        """Read ``value``; a refusal is wrong usage."""
        try:
            return trouble(value)
        except InputError as error:
            self.fail(str(error), param, ctx)


class BoardGroup(click.Group):
    """A command for each kind of board."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The kinds of boards."""
        return [board.kind for board in board_types()]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of one kind of board, with the options that its simulation takes."""
        board = find_board_type(cmd_name)
        return None if board is None else _command(board)


@click.group(cls=BoardGroup)
def simulate() -> None:
    """Serve a simulated board on a pseudo-terminal, for any program that opens serial ports."""


def _command(board: BoardType) -> click.Command:
    where = f"Where to find the port, e.g. /tmp/{board.kind}."
    params: list[click.Parameter] = [click.Option(["--link"], type=click.Path(path_type=Path), help=where)]
    if board.simulator_robot is not None:
        whose = "Whose channels the board is set up with."
        params.append(click.Option(["--robot"], default=board.simulator_robot, show_default=True, help=whose))
    params += [_option(one) for one in board.simulator_options]
    if board.inputs:
        params.append(click.Option(["--inputs"], **INPUTS))
    params.append(click.Option(["--fault", "faults"], type=_Fault(), multiple=True, help=FAULT_HELP))
    whose = "Another number, another sequence of faults."
    params.append(click.Option(["--seed"], type=int, default=0, show_default=True, help=whose))

    def serve(
        link: Path | None,
        faults: Sequence[Trouble],
        seed: int,
        robot: str | None = None,
        inputs: Path | None = None,
        **options: str | float | bool | None,
    ) -> None:
        setup = Setup() if robot is None else _setup(board, robot)
        ended = end_event()
        plain = board.simulated(setup, options)
        player = None if inputs is None else _player(plain, setup, inputs)
        model = FaultyModel(plain, seed, faults)
        with BoardServer(model, MonotonicClock().now, link=link) as server:
            server.play(player)
            told = ""
            while not (told and ended.wait(_LOOK_S)):
                port = server.address
                text = "unplugged" if port is None else f"on {port} (ctrl-c ends it)"
                if text != told:
                    click.echo(f"simulated board {text}")
                    told = text

    about = board.simulator_help or f"Serve a simulated {board.title} until interrupted."
    return click.Command(board.kind, params=params, callback=serve, help=about)


def _player(model: ByteModel, setup: Setup, inputs: Path) -> InputPlayer:
    signals = setup.signals
    script = read_script(load_script(inputs, signals), signals)
    if not isinstance(model, SimulatedPins):
        raise InputError(f"--inputs {inputs}: this simulated board has no inputs")
    model.levels |= signals.at_rest
    return InputPlayer(script, signals, model.levels)


def _option(one: SimulatorOption) -> click.Option:
    kind: click.ParamType[Any] | None = None
    if one.choices:
        kind = click.Choice(one.choices)
    elif one.between is not None:
        low, high = one.between
        kind = click.IntRange(int(low), int(high)) if one.whole else Number(between=one.between)
    return click.Option([f"--{one.name}"], is_flag=kind is None, type=kind, help=one.help)


def _setup(board: BoardType, name: str) -> Setup:
    """What a robot needs of the board, if it needs this kind of board."""
    robot = load_robot(name)
    unit = robot.outputs.unit
    if unit != board.scale.unit:
        raise InputError(
            f"{name} is set up for {board_type(robot.board).title}, whose outputs are in {unit}; "
            f"use `armctl simulate {robot.board}`, or name a robot whose outputs are in {board.scale.unit}"
        )
    return setup_of(robot)

"""``armctl simulate``: a simulated board on a pty, for any client."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from armctl.boards import setup_of
from armctl.cli.ending import end_event
from armctl.cli.options import Number
from armctl.errors import InputError
from armctl.hardware import BoardType, Setup, SimulatorOption
from armctl.hardware.boards import board_type, board_types, find_board_type
from armctl.hardware.faults import FAULT_HELP, FaultyModel, Trouble, trouble
from armctl.hardware.simulation import BoardServer
from armctl.protocol import MonotonicClock
from armctl.robot import load_robot

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
    params.append(click.Option(["--fault", "faults"], type=_Fault(), multiple=True, help=FAULT_HELP))
    whose = "Another number, another sequence of faults."
    params.append(click.Option(["--seed"], type=int, default=0, show_default=True, help=whose))

    def serve(
        link: Path | None,
        faults: Sequence[Trouble],
        seed: int,
        robot: str | None = None,
        **options: str | float | bool | None,
    ) -> None:
        setup = Setup() if robot is None else _setup(board, robot)
        ended = end_event()
        model = FaultyModel(board.simulated(setup, options), seed, faults)
        with BoardServer(model, MonotonicClock().now, link=link) as server:
            told = ""
            while not (told and ended.wait(_LOOK_S)):
                port = server.address
                text = "unplugged" if port is None else f"on {port} (ctrl-c ends it)"
                if text != told:
                    click.echo(f"simulated board {text}")
                    told = text

    about = board.simulator_help or f"Serve a simulated {board.title} until interrupted."
    return click.Command(board.kind, params=params, callback=serve, help=about)


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

"""``armctl simulate``: a simulated board on a pty, for any client."""

from __future__ import annotations

from pathlib import Path

import click

from armctl.boards import setup_of
from armctl.cli.ending import end_event
from armctl.errors import InputError
from armctl.hardware import BoardType, Setup
from armctl.hardware.boards import board_type, board_types, find_board_type
from armctl.hardware.simulation import PtyServer
from armctl.robot import load_robot
from armctl.runtime import MonotonicClock
from armctl.runtime.board import output_map


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
    for one in board.simulator_options:
        choices = click.Choice(one.choices) if one.choices else None
        params.append(click.Option([f"--{one.name}"], is_flag=not one.choices, type=choices, help=one.help))

    def serve(link: Path | None, robot: str | None = None, **options: str | bool | None) -> None:
        setup = Setup() if robot is None else _setup(board, robot)
        ended = end_event()
        with PtyServer(board.simulated(setup, options), MonotonicClock().now, link=link) as server:
            click.echo(f"simulated board on {server.port} (ctrl-c ends it)")
            ended.wait()

    about = board.simulator_help or f"Serve a simulated {board.title} until interrupted."
    return click.Command(board.kind, params=params, callback=serve, help=about)


def _setup(board: BoardType, name: str) -> Setup:
    """What a robot needs of the board, if it needs this kind of board."""
    robot = load_robot(name)
    unit = output_map(robot).unit
    if unit != board.scale.unit:
        raise InputError(
            f"{name} is set up for {board_type(robot.board).title}, whose outputs are in {unit}; "
            f"use `armctl simulate {robot.board}`, or name a robot whose outputs are in {board.scale.unit}"
        )
    return setup_of(robot)

"""The command line: each command is imported only when it is called, so that ``armctl ik`` starts quickly."""

from __future__ import annotations

import errno
import importlib
import os
import re
import sys
from collections.abc import Sequence
from io import TextIOWrapper

import click

from armctl.errors import ArmctlError, with_help
from armctl.version import __version__

COMMANDS = {
    "serve": "armctl.cli.serve:serve",
    "robots": "armctl.cli.kinematics:robots",
    "ports": "armctl.cli.boards:ports",
    "firmware": "armctl.cli.boards:firmware",
    "fk": "armctl.cli.kinematics:fk",
    "ik": "armctl.cli.kinematics:ik",
    "run": "armctl.cli.programs:run",
    "draw": "armctl.cli.draw:draw",
    "new": "armctl.cli.new:new",
    "check": "armctl.cli.programs:check",
    "twin": "armctl.cli.programs:twin",
    "calibrate": "armctl.cli.calibrate:calibrate",
    "sheet": "armctl.cli.sheet:sheet",
    "doctor": "armctl.cli.boards:doctor",
    "servos": "armctl.cli.servos:servos",
    "replay": "armctl.cli.replay:replay",
    "published": "armctl.cli.kinematics:published",
    "simulate": "armctl.cli.boards:simulate",
}
UNNAMED = "serve"
"""the command that is meant where none is named"""
DONE, REFUSED, WRONG_USAGE = 0, 1, 2
_ARGUMENT = re.compile(r"[A-Za-z_][\w.-]*:=.*", re.DOTALL)
"""``model:=mk3``, as ROS users give arguments of launch and xacro files"""
_FULL = frozenset({errno.ENOSPC, errno.EDQUOT})


class LazyGroup(click.Group):
    """A group that knows its commands by name and imports one when it is called."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Options without a command are those of the command that needs no name."""
        own = {name for parameter in self.get_params(ctx) for name in parameter.opts}
        if args and args[0].startswith("-") and args[0] not in own:
            args = [UNNAMED, *args]
        return super().parse_args(ctx, _with_arguments(args))

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of all commands, in the order of the table above."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import one command."""
        if cmd_name not in COMMANDS:
            return None
        module, _, attribute = COMMANDS[cmd_name].partition(":")
        command = getattr(importlib.import_module(module), attribute)
        return command if isinstance(command, click.Command) else None


def _with_arguments(args: Sequence[str]) -> list[str]:
    """``arm.xacro model:=mk3`` as ``arm.xacro#model:=mk3``, for each robot on the command line.

    Arguments belong to the robot before them, else to the one behind.
    """
    given = [k for k, word in enumerate(args) if _ARGUMENT.fullmatch(word)]
    words = list(args)
    for k in given:
        from armctl.robot import with_argument  # half a second that other commands may not need

        for near in (*range(k - 1, 0, -1), *range(k + 1, len(args))):
            option, _, name = words[near].rpartition("=" if words[near].startswith("--") else "\0")
            found = None if near in given else with_argument(name, args[k])
            if found is not None:
                words[near] = f"{option}={found}" if option else found
                break
        else:
            raise click.UsageError(f"{args[k]} is an argument of a xacro file: name that file before it")
    return [word for k, word in enumerate(words) if k not in given]


_COMPLETION = """\b
Completion, for bash (or zsh_source, fish_source):
  eval "$(_ARMCTL_COMPLETE=bash_source armctl)"
"""


@click.group(
    cls=LazyGroup, invoke_without_command=True, epilog=_COMPLETION,
    context_settings={"help_option_names": ["-h", "--help"]},
)  # fmt: skip
@click.version_option(__version__, message="armctl %(version)s")
@click.pass_context
def cli(ctx: click.Context) -> None:
    """An operator's console for small serial robot arms, served in the browser.

    Without a command: the same as `armctl serve`, with its options. Lengths are in mm, angles in degrees.
    """
    if ctx.invoked_subcommand is None:
        command = cli.get_command(ctx, UNNAMED)
        if command is not None:
            ctx.invoke(command)


def run(arguments: Sequence[str]) -> int:
    """Run one command line; errors go to stderr as one line each. Returns the exit status."""
    try:
        status = cli.main(list(arguments), prog_name="armctl", standalone_mode=False)
    except click.UsageError as error:
        hint = "" if error.ctx is None else f" (see `{error.ctx.command_path} --help`)"
        return _complain(error.format_message() + hint, WRONG_USAGE)
    except click.ClickException as error:
        return _complain(error.format_message(), REFUSED)
    except (click.Abort, KeyboardInterrupt):
        return _complain("interrupted", REFUSED)
    except ArmctlError as error:
        return _complain(with_help(error), REFUSED)
    except OSError as error:  # not a pipe that nobody reads on: click ends that in silence, with status 1
        if error.errno not in _FULL:
            raise
        # what is left in the buffer would fail once more when Python ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _complain(f"the output cannot be written: {error.strerror}", REFUSED)
    return status if isinstance(status, int) else DONE


def _complain(text: str, status: int) -> int:
    click.echo("armctl: " + " ".join(text.split()), err=True)
    return status


def main() -> None:
    """Console script."""
    for stream in (sys.stdout, sys.stderr):  # a terminal or file without Greek letters and degree signs
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="replace")
    sys.exit(run(sys.argv[1:]))

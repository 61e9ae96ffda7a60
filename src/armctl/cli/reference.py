"""The reference of the command line, made from the commands themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator
from inspect import cleandoc
from typing import cast

import click

from armctl.ui.docs.tables import row


def commands(cli: click.Command) -> str:
    """Every command below ``cli`` with its options, as Markdown."""
    with click.Context(cli, info_name="armctl") as context:
        return "\n\n".join(_command(cli, context))


def _command(command: click.Command, context: click.Context) -> Iterator[str]:
    if isinstance(command, click.Group):
        yield f"## {context.command_path}\n\n{_help(command.help or '')}\n\n{_help(command.epilog or '')}"
        for name in command.list_commands(context):
            inner = cast("click.Command", command.get_command(context, name))
            with click.Context(inner, info_name=name, parent=context) as below:
                yield from _command(inner, below)
        return
    usage = " ".join((context.command_path, *command.collect_usage_pieces(context)))
    yield f"## {context.command_path}\n\n    {usage}\n\n{_help(command.help or '')}"
    records = [one.get_help_record(context) for one in command.get_params(context)]
    if options := [record for record in records if record and record[1] and "--help" not in record[0]]:
        yield "| option | meaning |\n|---|---|\n" + "\n".join(row((f"`{a}`", _line(b))) for a, b in options)


def _help(text: str) -> str:
    """Help as Markdown: what keeps its lines (after a backspace) is a block of code."""
    parts: list[str] = []
    for part in cleandoc(text).split("\n\n"):
        kept = part.startswith("\b")
        parts.append(re.sub("^", "    ", part.removeprefix("\b\n"), flags=re.MULTILINE) if kept else part)
    return "\n\n".join(parts)


def _line(text: str) -> str:
    return " ".join(text.split()).replace("<", "&lt;").replace("[", "\\[")

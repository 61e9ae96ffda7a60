"""What several commands share: number arguments, the ``--json`` switch, JSON output."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Sequence
from typing import Any, cast

import click
import numpy as np
from click.decorators import FC
from click.shell_completion import CompletionItem
from numpy.typing import NDArray

QUERY_SETTINGS = {"ignore_unknown_options": True, "help_option_names": ["-h", "--help"]}
"""For commands with number arguments: ``-196`` is a number, not an option."""

_PORT_HELP = "sim, auto, a device or socket://host:port."
port_option = click.option("--port", default="sim", show_default=True, help=_PORT_HELP)
park_option = click.option(
    "--park",
    is_flag=True,
    help="At the end (Ctrl-C, too) go to the rest pose first, where the arm has power.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON for programs.")


class _NamedPort(click.ParamType[str]):
    """A port that has no default: opening one may restart its board."""

    name = "text"

    def __init__(self, does: str) -> None:
        self._does = does

    def get_missing_message(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """What one may give."""
        return f"auto looks for a board, sim {self._does} the simulated one, armctl ports lists all."


def named_port_option(does: str) -> Callable[[FC], FC]:
    """``--port`` of a command that ``does`` something with it, for example "examines"."""
    return click.option("--port", type=_NamedPort(does), required=True, help=_PORT_HELP)


class Number(click.ParamType[float]):
    """A finite number: NaN and infinity are as wrong on a command line as text."""

    name = "float"

    def __init__(
        self, above: float = -math.inf, between: tuple[float, float] = (-math.inf, math.inf)
    ) -> None:
        self._above, self._between = above, between

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Read ``value``; a refusal is wrong usage."""
        if "," in str(value):
            self.fail(f"{value!r} is not a number (write 1.5, with a point)", param, ctx)
        number = float(click.FLOAT.convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        if not number > self._above:
            self.fail(f"{number:g} must be more than {self._above:g}", param, ctx)
        low, high = self._between
        if not low <= number <= high:
            self.fail(f"{number:g} must be within {low:g} … {high:g}", param, ctx)
        return number


class RobotName(click.ParamType[str]):
    """A robot's name or file; a shell that asks how it may go on is told the names."""

    name = "robot"

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """The names that begin so; the shell completes files where there are none."""
        from armctl.robot import shipped_robots, user_robots

        names = [name for name in (*shipped_robots(), *user_robots()) if name.startswith(incomplete)]
        return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


class Pose(click.ParamType["str | list[float]"]):
    """A pose's name, or joint angles [degrees] with commas between them."""

    name = "pose"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | list[float]:
        """Read ``value``; half a list is wrong usage."""
        parts = str(value).split(",")
        try:
            return [float(part) for part in parts]
        except ValueError:
            if len(parts) == 1:
                return parts[0]
            self.fail(
                f"{value}: joint angles are numbers with commas between them, e.g. 0,90,-80,-40,0", param, ctx
            )


pose_option = click.option(
    "--pose",
    type=Pose(),
    help="Where the arm stands now: last (as armctl saw it; last-moving if it was moving then), a named "
    "pose, or joint angles in degrees (10,20,30). Needed where servos are off: they cannot tell.",
)
NUMBER = Number()
ROBOT = RobotName()
SPEED_PERCENT = Number(between=(5, 100))


def print_json(record: object) -> None:
    """One JSON document; arrays as lists, NaN refused (it is no JSON)."""
    click.echo(json.dumps(record, default=_plain, allow_nan=False, ensure_ascii=False))


def rounded(values: NDArray[np.float64] | Sequence[float], digits: int = 9) -> list[float]:
    """A list for JSON, without the noise of the last bits (and without ``-0.0``)."""
    return [round(float(value), digits) + 0.0 for value in values]


def has_display() -> bool:
    """Whether a browser can be opened here."""
    return sys.platform in ("darwin", "win32") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return cast(NDArray[np.float64], value).tolist()
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")

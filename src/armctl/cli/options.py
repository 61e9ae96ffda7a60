"""What several commands share: number arguments, the ``--json`` switch, JSON output."""

from __future__ import annotations

import json
import math
import os
import signal
import sys
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from queue import Empty, SimpleQueue
from types import FrameType
from typing import Any, cast

import click
import numpy as np
from click.decorators import FC
from click.shell_completion import CompletionItem
from numpy.typing import NDArray

from armctl.errors import StoppedError
from armctl.protocol import MonotonicClock
from armctl.robot import Robot, load_robot
from armctl.robot.tools import tool_of
from armctl.system import ending_signals

# Signals that end a command: Ctrl-C, a service manager, a terminal that is closed.


_LOOK_S = 0.5
"""Windows runs no handler while its program waits without end."""


class EndEvent:
    """Set by signals. A ``threading.Event`` would lock up where one signal interrupts another's handler."""

    def __init__(self) -> None:
        self._signals: SimpleQueue[int] = SimpleQueue()
        self.came = False
        self.patient = True
        """False: a second signal interrupts what is under way, which may never end"""

    def set(self, signum: int) -> None:
        """From a signal's handler, also in the middle of ``wait`` or of itself."""
        if self.came and not self.patient:
            raise KeyboardInterrupt
        self.came = True
        self._signals.put(signum)

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for a signal; whether one came within ``timeout`` [s]."""
        while True:
            try:
                self._signals.put(self._signals.get(timeout=_LOOK_S if timeout is None else timeout))
            except Empty:
                if timeout is not None:
                    return False
            else:  # put back: it stays set
                return True


def end_event() -> EndEvent:
    """An event that these signals set; from now on they do nothing else."""
    ended = EndEvent()

    def end(signum: int, frame: FrameType | None) -> None:
        ended.set(signum)

    for number in (signal.SIGINT, *_quiet_ends()):  # Ctrl-C also where a shell's & has it ignored
        signal.signal(number, end)
    return ended


@contextmanager
def ends_like_ctrl_c() -> Generator[None]:
    """These signals raise ``KeyboardInterrupt`` inside, so that a moving arm is stopped first.

    Ctrl-C does so already. Where it is ignored, as in a script's background job, it stays ignored: there it
    is meant for the job in front. SIGTERM ends the command all the same.
    """

    def interrupt(signum: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = {number: signal.signal(number, interrupt) for number in _quiet_ends()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, signal.SIG_DFL if handler is None else handler)  # None: not Python's own


def _quiet_ends() -> tuple[signal.Signals, ...]:
    """SIGTERM and SIGHUP, without one that is ignored, as ``nohup`` does with SIGHUP."""
    return tuple(number for number in ending_signals() if signal.getsignal(number) is not signal.SIG_IGN)


# Arms with meshes take seconds to open, the first time: the command line says so meanwhile.


_QUIET_S = 0.3


tool_option = click.option("--tool", metavar="NAME", help="The tool that is on, of those in the robot file.  "
                           "[default: the first]")  # fmt: skip


def load_with(name: str | Path, tool: str | None) -> Robot:
    """As ``load_robot``, with one of its tools on; ``None``: as the file has it."""
    robot = load_robot(name)
    return robot if tool is None else robot.with_tool(tool_of(robot.tools, tool).name)


def load_whole(name: str | Path, tool: str | None = None) -> Robot:
    """The same, with the body worked out of its meshes."""
    return with_body(load_with(name, tool))


def with_body(robot: Robot) -> Robot:
    """The arm with its body; standard error tells of the work."""
    progress = MeshProgress(robot.title)
    try:
        from armctl.process.heavy_work import worked_out  # pyserial: 10 ms that ``armctl ik`` does not need

        return worked_out(robot, progress=progress)[0]
    finally:
        progress.end()


class MeshProgress:
    """Tells on standard error how far the work on an arm's meshes is, once it takes a while."""

    def __init__(
        self, title: str, is_over: Callable[[], bool] = lambda: False, now: Callable[[], float] | None = None
    ) -> None:
        """``is_over``: whether nobody waits for it any more, so that it ends."""
        self._title, self._is_over, self._now = title, is_over, now or MonotonicClock().now
        self._began = self._now()
        self._told = -1
        self.given_up = False
        """set from another thread: the work ends"""

    def __call__(self, done: int, parts: int) -> None:
        """Called ten times a second."""
        if self.given_up or self._is_over():
            raise StoppedError(f"{self._title} is not opened: it was given up")
        if self._now() - self._began < _QUIET_S or done == self._told:
            return
        if self._told < 0:
            what = f"armctl: reading the meshes of {self._title}; this takes seconds, the first time"
            click.echo(f"{what} (Ctrl-C ends it)", err=True)
        self._told = done
        if sys.stderr.isatty():
            click.echo(f"\r{done} of {parts} parts done", err=True, nl=False)

    def end(self) -> None:
        """Leave the line clean."""
        if self._told >= 0 and sys.stderr.isatty():
            click.echo("\r" + " " * 30 + "\r", err=True, nl=False)


QUERY_SETTINGS = {"ignore_unknown_options": True, "help_option_names": ["-h", "--help"]}
"""For commands with number arguments: ``-196`` is a number, not an option."""

_PORT_HELP = "sim, auto, a device, socket://host:port or i2c://bus/address."
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


INPUTS: dict[str, Any] = {
    "type": click.Path(path_type=Path),
    "metavar": "FILE",
    "help": "What the inputs of the simulated board see over time: a script, e.g. 'every 5 s part on for "
    "200 ms', or a table (CSV) with time_s and the inputs as its columns.",
}
inputs_option = click.option("--inputs", **INPUTS)


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

"""Arms with meshes take seconds to open, the first time: the command line says so meanwhile."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import click

from armctl.errors import StoppedError
from armctl.process.heavy_work import worked_out
from armctl.protocol import MonotonicClock
from armctl.robot import Robot, load_robot

_QUIET_S = 0.3


def load_whole(name: str | Path) -> Robot:
    """As ``load_robot``, with the body worked out of its meshes."""
    return with_body(load_robot(name))


def with_body(robot: Robot) -> Robot:
    """The arm with its body; standard error tells of the work."""
    progress = MeshProgress(robot.title)
    try:
        return worked_out(robot, progress=progress)[0]
    finally:
        progress.end()


class MeshProgress:
    """Tells on standard error how far the work on an arm's meshes is, once it takes a while."""

    def __init__(
        self,
        title: str,
        is_over: Callable[[], bool] = lambda: False,
        now: Callable[[], float] | None = None,
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

"""What a caller gets for a command: when it has begun, and when it is over."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial

from armctl.errors import ArmctlError


class Ticket:
    """Two futures of one command; both may be waited for from any thread.

    ``accepted`` is done as soon as the command is accepted and begun, or carries the ``ArmctlError``
    that refused it. ``finished`` is done when what it began is over: at once for most commands, at the
    end of the motion for motions; it carries the error that refused, stopped or broke it. Neither can
    be cancelled from outside: only STOP stops a motion.
    """

    def __init__(self, answers: list[Callable[[], None]] | None = None) -> None:
        """Nothing is known of it yet.

        Args:
            answers: where its answers wait to be called, in order, so that whoever waits for one finds
                the snapshot that shows it; None: they are given at once.
        """
        self._answers = answers
        self.accepted: Future[None] = Future()
        self.finished: Future[None] = Future()
        # asyncio.wrap_future cancels what it wraps when its task ends; a running future refuses that.
        self.accepted.set_running_or_notify_cancel()
        self.finished.set_running_or_notify_cancel()

    def accept(self) -> None:
        """It has begun."""
        self._answer(partial(_succeed, self.accepted))

    def finish(self) -> None:
        """It is over, as it should be."""
        self.accept()
        self._answer(partial(_succeed, self.finished))

    def refuse(self, error: ArmctlError) -> None:
        """It was refused, or did not come to its end."""
        for future in (self.accepted, self.finished):
            self._answer(partial(_fail, future, error))

    def result(self, timeout: float | None = None) -> None:
        """Wait until it is over.

        Raises:
            ArmctlError: what refused, stopped or broke it.
            TimeoutError: it is not over after ``timeout`` seconds; it goes on.
        """
        self.finished.result(timeout)

    def _answer(self, answer: Callable[[], None]) -> None:
        if self._answers is None:
            answer()
        else:
            self._answers.append(answer)


def _succeed(future: Future[None]) -> None:
    if not future.done():
        future.set_result(None)


def _fail(future: Future[None], error: ArmctlError) -> None:
    if not future.done():
        future.set_exception(error)

"""Signals that end a command: Ctrl-C, a service manager, a terminal that is closed."""

from __future__ import annotations

import signal
from collections.abc import Generator
from contextlib import contextmanager
from queue import Empty, SimpleQueue
from types import FrameType

from armctl.system import ending_signals

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
